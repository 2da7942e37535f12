"""Locates a misfit of joints: the share of the excess χ² by joint, sensor or contact, and its intervals of time."""

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.excess import Excess, Interval, Place, count_blocks, significant_blocks
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.contact_consistency import wrong_contact
from drake_cafim.diagnosis.joints.mismatch_conditions import condition, seen_at
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.diagnosis.thresholds import LOCATION_P_VALUE, WINDOWS_PER_BLOCK
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def locate(problem: WeakFormRows, model: Model) -> tuple[Location, ...]:
    """The places with their shares of the excess χ² under `model`, strongest first, and the intervals of each.

    Rows of the equation of motion belong to their joint, kinematic rows and wrench rows to their sensor; all but the
    kinematic ones to the contact where its law is wrong (`wrong_contact`).
    """
    physics = model.physics(problem.scene)
    places = places_of(problem)
    contact = wrong_contact(problem, physics)
    if contact is not None:
        kinematic = problem.runs[0].weak.kinematic_rows
        places = [*places[:kinematic], *[("contact", contact)] * (len(places) - kinematic)]
    excess = Excess.at(places)
    standard: dict[Place, list[list[Array]]] = {place: [] for place in places}
    blocks = sum(count_blocks(len(run.weak.samples.windows)) for run in problem.runs) * len(places)
    for run in problem.runs:
        z = standardised(run, run.noisy_rows(physics))
        for place in standard:
            standard[place].append([z[:, row] for row, other in enumerate(places) if other == place])
        for row, place in enumerate(places):
            excess.add(place, z[:, row] ** 2)
            excess.show(place, run.name, _intervals(z[:, row] ** 2, run.weak.samples.windows, blocks))
    return excess.locations(
        [run.name for run in problem.runs], lambda place: _condition(problem, physics, place, standard[place])
    )


def _intervals(squares: Array, windows: Windows, blocks: int) -> list[Interval]:
    """Intervals, s, of successive blocks whose `squares` (M,) are significant among `blocks` tests.

    Where single windows are significant, from the first to the last of these, each counted by its middle, where its
    test function has most of its weight.
    """
    standing = np.zeros(len(squares), dtype=bool)
    for part in significant_blocks(squares, blocks):
        standing[part] = True
    ends = np.flatnonzero(np.diff(np.concatenate([[False], standing, [False]]))).reshape(-1, 2)
    hop, middles = float(np.median(np.diff(windows.starts))), windows.centers
    found = []
    for first, last in ends:
        alone = first + np.flatnonzero(chi2.sf(squares[first:last], 1) * blocks * WINDOWS_PER_BLOCK < LOCATION_P_VALUE)
        if len(alone):
            found.append((float(middles[alone[0]] - 0.5 * hop), float(middles[alone[-1]] + 0.5 * hop)))
        else:
            found.append((float(windows.starts[first]), float(windows.starts[last - 1] + windows.width)))
    return found


def _condition(problem: WeakFormRows, physics: Physics, place: Place, rows: list[list[Array]]) -> str:
    """The condition in words under which a place's misfit shows, by the largest of its rows in each recording."""
    names = problem.scene.tree.joint_names
    label = place[1].removeprefix("v.").removeprefix("q.")
    together = [np.stack(own)[np.argmax([np.sum(row**2) for row in own])] for own in rows]
    joint = names.index(label) if label in names else None
    return condition(seen_at(problem.runs, physics, together, joint))


def standardised(run: Run, rows: Array) -> Array:
    """Rows (M, r) over their standard deviation; dynamic and sensor rows given the kinematic rows of their window.

    Unlike whitening by a Cholesky factor, this does not mix rows of different joints.
    """
    k = run.weak.kinematic_rows
    covariance = run.covariance
    result = rows / np.sqrt(covariance[:, np.arange(rows.shape[1]), np.arange(rows.shape[1])])
    if k == 0:
        return np.asarray(result, dtype=float)
    cross = covariance[:, k:, :k]
    gain = np.swapaxes(np.linalg.solve(covariance[:, :k, :k], np.swapaxes(cross, 1, 2)), 1, 2)
    left = rows[:, k:] - np.einsum("mij,mj->mi", gain, rows[:, :k])
    variance = np.einsum("mii->mi", covariance[:, k:, k:] - gain @ np.swapaxes(cross, 1, 2))
    return np.concatenate([result[:, :k], left / np.sqrt(variance)], axis=1)


def places_of(problem: WeakFormRows) -> list[Place]:
    """Kind and name of the place of each row of a window, in the rows' order."""
    weak = problem.runs[0].weak
    names = problem.scene.tree.joint_names
    places = [("sensor", f"v.{name}") for name in names] if weak.kinematic_rows else []
    places += [("joint", name) for name in names]
    for sensor in weak.sensors:
        places += [("sensor", f"wrench.{sensor.name}.{axis}") for axis in ("fx", "fy", "fz", "tx", "ty", "tz")]
    return places
