"""Where the excess over noise lies: which rows, which joints and sensors, and when."""

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
    """The places by their share of the excess χ² under `model`, strongest first, with the intervals where it shows.

    Rows of the equation of motion stand for their joint, kinematic rows and wrench rows for their sensor; where sensor
    and joints miss the same force, for the contact.
    """
    physics = model.physics(problem.scene)
    places = places_of(problem)
    contact = wrong_contact(problem, physics)
    if contact is not None:
        felt = problem.runs[0].weak.kinematic_rows
        places = [*places[:felt], *[("contact", contact)] * (len(places) - felt)]
    excess = Excess.at(places)
    standard: dict[Place, list[list[Array]]] = {place: [] for place in places}
    blocks = sum(count_blocks(len(run.weak.samples.windows)) for run in problem.runs) * len(places)
    for run in problem.runs:
        z = standardised(run, run.weak.residual(physics))
        for place in standard:
            standard[place].append([z[:, row] for row, other in enumerate(places) if other == place])
        for row, place in enumerate(places):
            excess.add(place, z[:, row] ** 2)
            excess.show(place, run.name, _intervals(z[:, row] ** 2, run.weak.samples.windows, blocks))
    return excess.locations(
        [run.name for run in problem.runs], lambda place: _condition(problem, physics, place, standard[place])
    )


def _intervals(squares: Array, windows: Windows, blocks: int) -> list[Interval]:
    """Stretches of time, s, of blocks whose `squares` (M,) stand out among so many blocks.

    Where single windows stand out, from the first to the last of these: a window weighs its middle most.
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
    """The condition of one place, by the strongest of its rows in each recording."""
    names = problem.scene.tree.joint_names
    label = place[1].removeprefix("v.").removeprefix("q.")
    together = [np.stack(one)[np.argmax([np.sum(row**2) for row in one])] for one in rows]
    joint = names.index(label) if label in names else None
    return condition(seen_at(problem.runs, physics, together, joint))


def standardised(run: Run, rows: Array) -> Array:
    """Rows (M, r) in units of their own standard deviation, given the kinematic rows of the same window.

    A row of the equation of motion keeps to its own joint this way, which the Cholesky factor does not see to.
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
    """Kind and name of what each row of a window stands for, in the rows' order."""
    weak = problem.runs[0].weak
    names = problem.scene.tree.joint_names
    places = [("sensor", f"v.{name}") for name in names] if weak.kinematic_rows else []
    places += [("joint", name) for name in names]
    for sensor in weak.sensors:
        places += [("sensor", f"wrench.{sensor.name}.{axis}") for axis in ("fx", "fy", "fz", "tx", "ty", "tz")]
    return places
