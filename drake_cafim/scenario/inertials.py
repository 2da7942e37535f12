"""Unknown inertials: all ten inertial parameters of a link, uncertain together and physically consistent.

`{parameter: inertials, body: link3, std: 0.2}` stands for ten unknowns, the log-Cholesky parameters of the link's
pseudo-inertia relative to the model's (`dynamics.pseudo_inertia`); `std` is that of the relative changes of its mass,
of its second moments a unit of mass, and of its centre of mass in radii of gyration. Each of the ten has the name of
one of the physical parameters that they give together, under which a report states it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri_exp
from scipy.stats import chi2

from drake_cafim.dynamics.pseudo_inertia import (
    PARAMETERS,
    SENSITIVITY,
    changed,
    inertial_parameters,
    is_consistent,
    log_cholesky,
    pseudo_inertia,
    pseudo_inertia_of,
    slopes,
    with_pseudo_inertia,
)
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameter
from drake_cafim.scenario.schema import Unknown
from drake_cafim.typing import Array

INERTIALS, ALL = "inertials", "all"
"""The name under `unknown:`, and the `body` that stands for every link."""
DEFAULT_STD = 0.2
"""Relative std of the inertials of all links where only a model file is given."""
PHYSICAL = {
    "mass": "kg",
    "com_x": "m",
    "com_y": "m",
    "com_z": "m",
    **dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "kg m^2"),
}
"""A link's physical parameters with their units; the inertia is about the body's origin, in its axes."""


def each_link(entries: Sequence[Unknown], tree: Tree) -> list[Unknown]:
    """The entries of `unknown:` with one for each link in place of one for `all`.

    A link is the heaviest of the bodies that are fixed to one joint's moving frame: of bodies that move as one, only
    the sum of their inertias acts.
    """
    found: list[Unknown] = []
    for entry in entries:
        if entry.parameter != INERTIALS or entry.body != ALL or ALL in (body.name for body in tree.bodies):
            found.append(entry)
            continue
        found.extend(replace(entry, body=link) for link in _links(tree))
    return found


def _links(tree: Tree) -> Iterator[str]:
    for joint in range(1 if tree.floating else len(tree.joints)):
        riding = [body for body in tree.bodies if body.joint == joint and body.mass > 0.0]
        if riding:
            yield max(riding, key=lambda body: body.mass).name


def priors_of(entry: Unknown) -> list[Parameter]:
    """The ten priors of an entry, about the change that it states, or the model's values."""
    mean = np.array(entry.log_cholesky or np.zeros(PARAMETERS), dtype=float)
    return [
        Parameter(f"{name}@{entry.body}", float(value), float(entry.std / by))
        for name, value, by in zip(PHYSICAL, mean, SENSITIVITY, strict=True)
    ]


def check_body(body: Body, key: str) -> None:
    """Raises `InputError` for a body whose inertials cannot be scaled: one without mass."""
    if not body.mass > 0.0:
        raise InputError(f"{key}.body is {body.name}, which has no mass in the model that could be scaled")


def with_change(body: Body, theta: Array) -> Body:
    """The body with its inertials changed by the log-Cholesky parameters `theta` (10,).

    For zeros it is the same body, unless no mass has such an inertia: then the nearest one that is possible.
    """
    J = pseudo_inertia(body)
    return with_pseudo_inertia(body, changed(J, theta)) if np.any(theta) or not is_consistent(J) else body


def stepped(body: Body, theta: Array, step: Array) -> Array:
    """(10,) θ after a `step` from `theta` (10,), along which the inertial parameters change linearly, and not θ.

    The pseudo-inertia becomes J(θ) + Σ δθₖ ∂J/∂θₖ: forces and momenta are linear in it, so that they change as their
    slopes tell, however far. Where no body has such a pseudo-inertia it is θ + δθ.
    """
    J = pseudo_inertia(body)
    try:
        return log_cholesky(changed(J, theta) + np.tensordot(step, slopes(J, theta), 1), J)
    except np.linalg.LinAlgError:
        return np.asarray(theta + step)


def distance_together(shift: Array) -> float:
    """The standard deviations from zero that are as unlikely as ten priors `shift` (10,) of their stds away.

    |shift|² is χ²-distributed with ten degrees of freedom if the priors are right.
    """
    square = float(shift @ shift)
    chance = chi2.logsf(square, PARAMETERS)
    # the tail's logarithm ends at the smallest number that a float can hold
    return float(-ndtri_exp(min(chance - np.log(2.0), np.log(0.5)))) if np.isfinite(chance) else float(np.sqrt(square))


@dataclass(frozen=True)
class LinkInertials:
    """The ten physical parameters of a link, `PHYSICAL`, as functions of its log-Cholesky parameters θ (10,)."""

    body: Body
    """The link of the model."""

    def physical(self, theta: Array) -> Array:
        """(10,) mass, centre of mass, and inertia about the body's origin."""
        return _physical(inertial_parameters(changed(pseudo_inertia(self.body), theta)))

    def slopes(self, theta: Array) -> Array:
        """(10, 10) derivatives of `physical` (rows) by θ (columns)."""
        J = pseudo_inertia(self.body)
        value, by = inertial_parameters(changed(J, theta)), inertial_parameters(slopes(J, theta)).T
        result = by.copy()
        result[1:4] = by[1:4] / value[0] - np.outer(value[1:4], by[0]) / value[0] ** 2
        return result

    def theta(self, physical: Array) -> Array:
        """(10,) θ of `physical` (10,); raises `numpy.linalg.LinAlgError` where no body has such parameters."""
        numbers = np.array(physical, dtype=float)
        numbers[1:4] *= numbers[0]
        return log_cholesky(pseudo_inertia_of(numbers), pseudo_inertia(self.body))


def _physical(parameters: Array) -> Array:
    """The ten parameters with the centre of mass in place of the first moment."""
    result = parameters.copy()
    result[1:4] /= parameters[0]
    return result
