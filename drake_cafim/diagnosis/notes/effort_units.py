"""Efforts in another unit than N m (N): a motor's current, or its torque before the gear, by a factor at each joint.

With k_j u_j the effort at joint j and τ_j what its motion needs, the rows τ_j/k_j − u_j are linear in 1/k_j. That is
fitted with the unknowns, friction, a bias and a rotor at each joint, so that neither friction, which efforts of a small
joint are mostly, nor a rotor is taken for a unit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.notes.first_order import COMMON, fit_to_first_order
from drake_cafim.diagnosis.thresholds import (
    MISTAKE_CHI_SQUARE_SHARE_LEFT,
    UNDETERMINED_STD_SHARE,
    UNIT_FACTOR,
    UNIT_FACTOR_PRIOR_STD,
)
from drake_cafim.effects.catalogue import effect_named

GAIN, ROTOR = "actuator_gain_error", "rotor_inertia"


@dataclass(frozen=True)
class EffortFactors:
    """By joint, the factor k by which its recorded effort has to be multiplied, and which joints tell it `surely`."""

    by_joint: dict[str, float]
    surely: tuple[str, ...]

    @property
    def are_units(self) -> bool:
        """Whether they are of another unit: where surely told, too far from 1 for an error of a gain.

        One joint alone of several may as well carry a link that is far heavier than it is stated to be.
        """
        [gain] = effect_named(GAIN)("").strengths
        told = [self.by_joint[joint] for joint in self.surely]
        return len(told) >= min(2, len(self.by_joint)) and not any(gain.lower <= it <= gain.upper for it in told)


def effort_factors(
    problem: WeakProblem, scaled: Callable[[Mapping[str, float]], WeakProblem], plain: float, corrected: float
) -> EffortFactors | None:
    """The factors, or None where efforts are in N m (N); `scaled` gives the rows with efforts times factors by joint.

    They are so unless, at each joint that tells k, it is above `UNIT_FACTOR`, or at each below the inverse of that, and
    the factors take most of what physics leaves, `plain`, and leave less than where the recording is `corrected` for
    its other mistakes (see `cost_beside_physics`). Joints that do not tell k get the geometric mean of the others.
    """
    columns = {name for form in problem.forms for name in form.samples.recording.columns}
    first = _inverse_factors(problem)[0]
    told = {joint: 1.0 / value for joint, (value, std) in first.items() if f"u.{joint}" in columns and value > std}
    if not _differ(told):
        return None
    mean = float(np.exp(np.mean(np.log([*told.values()]))))
    factors = {joint: told.get(joint, mean) for joint in first if f"u.{joint}" in columns}
    # the first fit is linear about efforts as recorded: how well links and factors are told apart, the second one says
    second, left = _inverse_factors(scaled(factors))
    surely = {joint: second[joint] for joint in factors if second[joint][1] < UNDETERMINED_STD_SHARE * second[joint][0]}
    factors |= {joint: factors[joint] / value for joint, (value, _) in surely.items()}
    explains = left < min(MISTAKE_CHI_SQUARE_SHARE_LEFT * plain, corrected)
    return EffortFactors(factors, tuple(surely)) if explains and _differ({it: factors[it] for it in surely}) else None


def cost_beside_physics(problem: WeakProblem) -> float:
    """The cost per row of a fit of friction, a bias and a rotor at each joint, and of unknowns near their priors."""
    return fit_to_first_order([problem], (*COMMON, ROTOR), bounded=True).cost


def _inverse_factors(problem: WeakProblem) -> tuple[dict[str, tuple[float, float]], float]:
    """By joint 1/k and its standard deviation, and the cost per row of the fit."""
    found = fit_to_first_order([problem], (*COMMON, ROTOR, GAIN), {GAIN: UNIT_FACTOR_PRIOR_STD}, bounded=True)
    # to first order the change of a gain from 1 is that of −1/k
    return {joint: (1.0 - change, std) for joint, (change, std) in found.of(GAIN).items()}, found.cost


def _differ(factors: Mapping[str, float]) -> bool:
    """Whether all are larger than may be of one unit, or all smaller."""
    values = np.array([*factors.values()])
    return bool(len(values) and (np.all(values > UNIT_FACTOR) or np.all(values < 1.0 / UNIT_FACTOR)))
