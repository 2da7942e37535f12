"""Forward simulation over windows of a second: what the model predicts, against what was recorded."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.initial_state import LOOK_BACK, state_at
from drake_cafim.diagnosis.stepper import State, advance, driven
from drake_cafim.diagnosis.weak_form import Measurement, WeakForm
from drake_cafim.dynamics.motion import motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

HORIZON = 1.0
"""s"""
DIVERGED = 1e3
"""rad (m) or more times the motion's range: a simulation is stopped there and its error counted at that."""


@dataclass(frozen=True)
class Forecast:
    """One recording simulated window after window: `time` (K,), `window` (K,), and by column predicted and measured."""

    recording: str
    time: Array
    window: np.ndarray[tuple[int], np.dtype[np.int64]]
    predicted: dict[str, Array]
    measured: dict[str, Array]


def forecast(weak: WeakForm, physics: Physics, horizon: float = HORIZON) -> Forecast:
    """The recording's windows of `horizon` s under `physics`, open loop in u; each starts from its 50 ms before."""
    samples = weak.samples
    time = samples.time
    measured = weak.measurement(physics)
    starts = _starts(time, horizon)
    states = [state_at(samples, measured, index) for index in starts]
    state = State(np.stack([s[0] for s in states]), np.stack([s[1] for s in states]))
    stops = [int(np.searchsorted(time, time[i] + horizon + 1e-9, side="right")) - 1 for i in starts]
    knots, efforts = driven(physics, time, measured.u)
    where = np.array(starts)
    first_knot = np.searchsorted(knots, time[where] - 1e-12)
    steps = max(stop - start for start, stop in zip(starts, stops, strict=True))
    trail_q, trail_v = [state.q], [state.v]
    cursor = first_knot.copy()
    limit = DIVERGED * (1.0 + np.ptp(measured.q, axis=0))
    for k in range(steps):
        target = time[np.minimum(where + k + 1, np.array(stops))]
        while True:
            now = knots[np.minimum(cursor, len(knots) - 1)]
            begin = np.maximum(now, time[np.minimum(where + k, np.array(stops))])
            following = knots[np.minimum(cursor + 1, len(knots) - 1)]
            end = np.where(cursor + 1 < len(knots), np.minimum(following, target), target)
            duration = np.maximum(end - begin, 0.0)
            if np.any(duration > 0.0):
                state = advance(physics, state, efforts[np.minimum(cursor, len(knots) - 1)], duration)
            state = _bounded(state, limit)
            move = (following <= target + 1e-12) & (cursor + 1 < len(knots))
            cursor = cursor + move
            if not np.any(move & (following < target - 1e-12)):
                break
        trail_q.append(state.q)
        trail_v.append(state.v)
    return _gather(weak, physics, measured, starts, stops, np.stack(trail_q), np.stack(trail_v))


def root_mean_square(forecasts: Sequence[Forecast]) -> dict[str, float]:
    """By column, over all windows of all recordings."""
    result = {}
    for column in forecasts[0].predicted:
        errors = np.concatenate([f.predicted[column] - f.measured[column] for f in forecasts])
        result[column] = float(np.sqrt(np.nanmean(errors**2)))
    return result


def _starts(time: Array, horizon: float) -> list[int]:
    """Indices at which windows begin, one horizon apart, after the first look back; one window if it is short."""
    first = time[0] + LOOK_BACK
    count = max(1, int((time[-1] - first + 1e-9) / horizon))
    return [int(np.searchsorted(time, first + k * horizon - 1e-9)) for k in range(count)]


def _bounded(state: State, limit: Array) -> State:
    lost = ~np.isfinite(state.q) | (np.abs(state.q) > limit) | ~np.isfinite(state.v)
    if not np.any(lost):
        return state
    rows = np.any(lost, axis=1, keepdims=True)
    return State(np.where(rows, limit, state.q), np.where(rows, 0.0, state.v))


def _gather(
    weak: WeakForm, physics: Physics, measured: Measurement, starts: list[int], stops: list[int], q: Array, v: Array
) -> Forecast:
    """Predicted and measured columns of all windows, end to end; sensor effects are put back into the prediction."""
    samples, names = weak.samples, physics.tree.joint_names
    pieces = [(window, start, stop) for window, (start, stop) in enumerate(zip(starts, stops, strict=True))]
    index = np.concatenate([np.arange(start, stop + 1) for _, start, stop in pieces])
    window = np.concatenate([np.full(stop - start + 1, w) for w, start, stop in pieces])
    q_flat = np.concatenate([q[: stop - start + 1, w] for w, start, stop in pieces])
    v_flat = np.concatenate([v[: stop - start + 1, w] for w, start, stop in pieces])
    predicted = {f"q.{name}": q_flat[:, j].copy() for j, name in enumerate(names)}
    if samples.velocity_measured:
        predicted |= {f"v.{name}": v_flat[:, j].copy() for j, name in enumerate(names)}
    if weak.sensors:
        moving = motion(physics.tree, q_flat, v_flat)
        wrenches = physics.contact_wrenches(moving)
        for sensor in weak.sensors:
            reading = sensor.reading(moving, wrenches[:, sensor.joint])
            predicted |= {
                f"wrench.{sensor.name}.{axis}": reading[:, k].copy()
                for k, axis in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))
            }
    time = samples.time[index]
    for effect in physics.sensors:
        on = [name for name in effect.channels(list(predicted)) if name in predicted]
        for w in range(len(pieces) if on else 0):
            rows = window == w
            written = effect.measured(time[rows], np.stack([predicted[name][rows] for name in on], axis=1))
            for k, name in enumerate(on):
                predicted[name][rows] = written[:, k]
    columns = samples.recording.columns
    return Forecast(samples.recording.name, time, window, predicted, {name: columns[name][index] for name in predicted})
