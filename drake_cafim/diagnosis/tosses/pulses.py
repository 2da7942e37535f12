"""Matched filters for short pulses of force at the body's origin: where in the tosses a push would explain most."""

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.pushes import Push, candidate_intervals, search_once
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows
from drake_cafim.diagnosis.tosses.jacobian import force_rows
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.body import pulse
from drake_cafim.typing import Array

TOGETHER = 8
"""Number of pulses whose rows are computed at once."""


def strongest_pushes(problem: ArcRows, at: Fit) -> tuple[list[Push], int]:
    """The strongest push of each recording beyond the model `at`, best first, and the number of pulses tried."""
    return search_once(problem.found_pushes, at.residual, lambda: _search(problem, at))


def _search(problem: ArcRows, at: Fit) -> tuple[list[Push], int]:
    """`strongest_pushes` without its cache; recordings are independent, so one propagation serves all of them."""
    shot = problem.shot(at.model)
    starts = [run.time[0] for run in problem.runs]
    length = max(float(run.time[-1] - run.time[0]) for run in problem.runs)
    trials = list(candidate_intervals(0.0, length))
    basis = np.linalg.qr(at.jacobian)[0][: problem.rows] if at.jacobian.shape[1] else np.zeros((problem.rows, 0))
    residual = at.residual[: problem.rows]
    ends = np.cumsum([0, *(run.rows for run in problem.runs)])
    best: dict[int, Push] = {}
    for first in range(0, len(trials), TOGETHER):
        own = trials[first : first + TOGETHER]
        columns = problem.innovations(force_rows(shot, *_pulse_accelerations(shot, own, starts)))
        for k, (start, duration) in enumerate(own):
            for run in range(len(problem.runs)):
                part = slice(ends[run], ends[run + 1])
                gain = _gain(columns[part, 3 * k : 3 * k + 3], residual[part], basis[part])
                begin = starts[run] + start
                if run not in best or gain > best[run].gain:
                    best[run] = Push(run, begin, begin + duration, gain)
    return sorted(best.values(), key=lambda push: -push.gain), len(trials) * len(problem.runs)


def _pulse_accelerations(
    shot: Shot, trials: list[tuple[float, float]], starts: list[float]
) -> tuple[list[Array], list[Array]]:
    """Accelerations (F, 6) by a unit pulse along each axis, three a trial, and depths at landing, unchanged (0)."""
    f, body = shot.flights.fine, shot.body
    R = rotation_matrices(f.state.quaternion)
    # a force at the origin, in body axes: its columns of the inverse inertia
    inverse = body.inertial[3][:, :3]
    linear, angular = R @ inverse[:3] @ np.swapaxes(R, 1, 2), R @ inverse[3:] @ np.swapaxes(R, 1, 2)
    unit = np.concatenate([linear, angular], axis=1)
    since = f.time - np.array(starts)[shot.arcs.recording[f.flight]]
    changes = []
    for start, duration in trials:
        weight = pulse(since, start, start + duration)
        changes += [unit[:, :, axis] * weight[:, None] for axis in range(3)]
    return changes, [np.zeros(len(shot.tangent.landings.row))] * len(changes)


def _gain(columns: Array, residual: Array, basis: Array) -> float:
    """The decrease of χ² by the columns, after projection on the complement of the model's columns `basis`."""
    left = columns - basis @ (basis.T @ columns)
    normal = left.T @ left
    # keeps the system regular where columns are nearly dependent, as in a recording of a short overlap
    normal[np.diag_indices(len(normal))] *= 1.0 + 1e-9
    if not np.all(np.diag(normal) > 0.0):
        return 0.0
    along = left.T @ residual
    return float(along @ np.linalg.solve(normal, along))
