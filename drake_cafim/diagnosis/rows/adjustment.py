"""The samples of a recording replaced by the motion that is estimated from all of them under a model.

Laws, inertias and contacts are evaluated on the estimated motion ŷ, and the noise y − ŷ of the samples enters the rows
to first order only (Gauss–Helmert model; Förstner, Wrobel, Photogrammetric Computer Vision, 2016, §4.8):

    rows(y; θ) ≈ rows(ŷ; θ) + J (y − ŷ),    J the rows' derivative by the samples at ŷ.

Products of noise, which would bias what is fitted, do not occur, and regressors do not contain the rows' own noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.noise.coloured import covariance
from drake_cafim.diagnosis.rows.coupled_motion import CoupledMotion, damping_of, relax_together
from drake_cafim.diagnosis.rows.filtered_windows import FilteredWindows
from drake_cafim.diagnosis.rows.law_points import lay_points
from drake_cafim.diagnosis.rows.measurement import corrected_measurement
from drake_cafim.diagnosis.rows.samples import EstimatedMotion, Samples
from drake_cafim.diagnosis.rows.servo_efforts import answers_to_steps, mean_left
from drake_cafim.diagnosis.rows.trajectory import PASSES, SETTLED, ChannelNoise, Trajectory, Transition, smooth
from drake_cafim.diagnosis.rows.weak_form import WeakForm, acting_effort
from drake_cafim.diagnosis.thresholds import LAW_ACCURACY
from drake_cafim.dynamics.motion import motion
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.step_response import StepResponse, oscillator
from drake_cafim.scenario.physics import FreeResponse, Physics
from drake_cafim.typing import Array

POSITION_STEP, VELOCITY_STEP = 1e-6, 1e-5
"""Steps of central differences, rad and rad/s (m and m/s)."""
CONTRADICTED = 10.0
"""Density of the accelerations that the model does not explain, over that of all accelerations, from which on the
model's say nothing of a joint's motion. Less may come from a few moments that it does not explain."""
LEAST_STD = 1e-12
"""rad or rad/s (m or m/s): exact samples would leave the filter without a scale."""


def adjust(weak: WeakForm, physics: Physics) -> WeakForm:
    """The recording of `weak` with its positions and velocities as estimated under `physics`; efforts as recorded.

    Where viscous friction couples light joints within sample intervals, all joints are estimated together.

    A joint whose samples are likelier with nothing known of its acceleration, of which the model leaves far more than
    all (`CONTRADICTED`), is estimated by these alone: stiff laws of light joints that are coupled with each other
    cannot be integrated joint by joint.
    """
    samples, names = weak.samples, physics.tree.joint_names
    as_read = weak.measurement(physics)
    of_q, of_v = ([_noise(samples, physics, f"{kind}.{name}") for name in names] for kind in "qv")
    read = (samples.time, as_read.q, as_read.v, of_q, of_v)
    free = found = smooth(*read, Transition.unknown(samples.time, len(names)))
    contradicted = np.zeros(len(names), dtype=bool)
    nothing = np.zeros((len(samples.time) - 1, len(names)))
    current = _with_trajectory(weak, physics, found, nothing, np.zeros(len(names)))
    # efforts that their maker filtered are not those that made the motion
    filtered = isinstance(samples.windows, FilteredWindows)
    if not filtered and relax_together(current, physics):
        return _adjust_together(weak, physics, current, free, (of_q, of_v))
    for _ in range(0 if filtered else PASSES):
        transition, bend, mobility = _transition(current, physics, found)
        if not (np.all(np.isfinite(transition.rise_v)) and np.all(np.isfinite(transition.rise_q))):
            break
        before, found = found, smooth(*read, transition.without_model(contradicted))
        contradicted |= (found.surprise > free.surprise) & (found.density > CONTRADICTED * free.density)
        found = found.with_joints(contradicted, free)
        bend = np.where(contradicted, 0.0, bend)
        current = _with_trajectory(weak, physics, found, bend, _unmodelled_force(current, physics, found, mobility))
        if np.sqrt(np.mean(((found.v - before.v) / np.maximum(found.v_std, LEAST_STD)) ** 2)) < SETTLED:
            break
    return current


def _adjust_together(
    weak: WeakForm, physics: Physics, current: WeakForm, found: Trajectory, noises: tuple[list[ChannelNoise], ...]
) -> WeakForm:
    """As `adjust`, from the motion `found` of `current` on, where joints relax together; `noises` of all q and v.

    A joint of whose acceleration the model leaves far more than all (`CONTRADICTED`) stays as in `found`: it may lack
    what is far heavier than the link, as a rotor is, and such a link would follow each step of its effort at once.
    """
    as_read = weak.measurement(physics)
    most = _largest_unmodelled(current, physics, LAW_ACCURACY)
    density, free = most, found
    contradicted = np.zeros(weak.joints, dtype=bool)
    for _ in range(PASSES):
        moving = CoupledMotion(current, physics, found, _contact_slopes(current, physics, found))
        space = moving.state_space(as_read.q, as_read.v, noises)
        if not np.all(np.isfinite(space.rise)):
            break
        before = found
        found, density = moving.likeliest(space, density)
        contradicted |= density * moving.own_mobility**2 > CONTRADICTED * free.density
        bend = np.where(contradicted, 0.0, moving.bend(found))
        found = found.with_joints(contradicted, free)
        current = _with_trajectory(weak, physics, found, bend, np.minimum(density, most))
        if np.sqrt(np.mean(((found.v - before.v) / np.maximum(found.v_std, LEAST_STD)) ** 2)) < SETTLED:
            break
    return current


def _noise(samples: Samples, physics: Physics, column: str) -> ChannelNoise:
    """The noise of `column` as corrected for the sensor effects of `physics`, by which it may grow.

    What interpolation, or a correction, adds to correlated noise counts as white.
    """
    time, memory, bridge = samples.time, samples.memories.get(column), samples.bridges.get(column)
    if column.startswith("v.") and not samples.velocity_measured:
        return ChannelNoise(np.full(len(time), np.inf))
    if bridge is not None:
        # white noise that averages as slowly
        alike = bridge @ (bridge.T if memory is None else covariance(time, memory) @ bridge.T)
        total, memory = alike @ np.ones(len(time)), None
    else:
        total = np.full(len(time), 1.0 if memory is None else memory.share + memory.white)
    for effect in physics.sensors:
        correction = effect.correction(time) if effect.channels((column,)) else None
        if correction is not None:
            spread = correction if memory is None else correction @ covariance(time, memory)
            total = total * np.asarray(spread.multiply(correction).sum(axis=1)).ravel()
    recorded = np.isfinite(samples.recording[column])
    std = max(samples.std[column], LEAST_STD)
    if memory is None:
        return ChannelNoise(np.where(recorded, std**2 * np.maximum(total, 1e-6), np.inf))
    white = np.where(recorded, std**2 * np.maximum(total - memory.share, 1e-6), np.inf)
    return ChannelNoise(white, std * np.sqrt(memory.share), memory.process(time))


def _transition(weak: WeakForm, physics: Physics, found: Trajectory) -> tuple[Transition, Array, Array]:
    """How `physics` changes each joint's state from sample to sample, about the motion `found` of `weak`.

    And what its acceleration changes over each interval, but by the slopes of ramped efforts, (N − 1, n); and the
    joints' own mobilities (n,), means over time.
    """
    samples, terms = weak.samples, weak.terms(physics)
    time, moving = samples.time, replace(terms.moving, tree=physics.tree)
    h = np.diff(time)[:, None]
    response = physics.free_response(moving)
    law, by_q, by_v = physics.applied_along_motion(terms.joints)
    for j, drive in terms.servos.items():
        by_q[:, j] += drive.mean.d_q
        by_v[:, j] += drive.mean.d_v
    if physics.contacts:
        law = law + moving.project(physics.contact_wrenches(moving, weak.contact_memory(physics)))
    if physics.body_forces:
        law = law + moving.project(physics.body_wrenches(moving, time, samples.recording.name))
    by_rotors, turned = _rotor_efforts(weak, physics)
    effort = weak.mean_effort(physics) + by_rotors
    following = np.concatenate([effort[:1], effort[:-1]])
    # a held effort has two values at a sample, a ramped one has one
    at_samples = weak.effort_at_samples(physics)
    sides = (np.where(samples.ramped, at_samples, side) for side in (effort, following))
    after, before = (_accelerate(response, acting - response.bias) for acting in sides)
    by_law = _accelerate(response, law)
    # Simpson's rule for what is smooth within an interval; laws may jump there, and their values are means
    change = before[1:] - after[:-1]
    q_middle = 0.5 * (found.q[:-1] + found.q[1:]) - 0.125 * h * np.diff(found.v, axis=0)
    v_middle = 0.5 * (found.v[:-1] + found.v[1:]) - 0.125 * h * change
    halfway = physics.free_response(motion(physics.tree, q_middle, v_middle))
    middle = _accelerate(halfway, effort[:-1] - halfway.bias)
    own = np.diagonal(response.mobility, axis1=1, axis2=2)
    mean, first, second = _relaxing(h * own[:-1] * damping_of(physics))
    gain = h / 6.0 * (after[:-1] + 4.0 * middle + before[1:]) + 0.5 * h * (by_law[:-1] + by_law[1:])
    # laws that relax within an interval are not linear in time there
    turn = np.diff(law, axis=0)
    relaxed, by_way, bent = (_accelerate_between(response, part * turn) for part in (mean, first, second))
    gain = gain + h * relaxed
    # a force with the mean f and the change Δ over an interval moves the joint by h² (f/2 − Δ/12)
    ringing = _accelerate(response, turned)[:-1]
    way = h**2 / 6.0 * (after[:-1] + 2.0 * middle + 2.0 * by_law[:-1] + by_law[1:]) + h**2 * (by_way - ringing / 12.0)
    by_contact = _contact_slopes(weak, physics, found)
    slopes = (own * (by_q + by_contact[0]), own * (by_v + by_contact[1]))
    transition = Transition.of(time, found.q, found.v, gain, way, *slopes, (0.5 + mean, 1.0 / 6.0 + first))
    # of ramped efforts the rows know the slopes; of those of servos whose joints settle at once, not what is smooth
    ramps = np.where(samples.ramped, at_samples, 0.0)
    settled = {j: d for j, d in terms.servos.items() if d.settling(own[:, j])[1] > 0.0}
    acting, arriving = at_samples.copy(), at_samples.copy()
    for j, drive in terms.servos.items():
        acting[:, j] = drive.after(time)
        arriving[:, j] = acting[:, j] - drive.steps.at(time) + drive.steps.before(time)
        if j in settled:
            ramps[:, j] = -drive.beside_steps(time) * mean_left(slopes[1][:, j], time)
    if settled:
        ends = (_accelerate(response, force + law - response.bias) for force in (acting, arriving))
        # Simpson's rule again, under the mean efforts, for what posture and speed change within an interval
        curved = (4.0 * middle - 2.0 * (after[:-1] + before[1:])) / 6.0
        answers = answers_to_steps(terms.servos, time, response.mobility)
        transition = _answering(transition, time, answers, list(settled), response.mobility, (*ends, curved), slopes)
    change = change + ringing + 12.0 * bent + np.diff(by_law, axis=0) - np.diff(_accelerate(response, ramps), axis=0)
    return transition, change, np.mean(own, axis=0)


def _answering(
    transition: Transition,
    time: Array,
    answers: Mapping[int, StepResponse],
    settled: Sequence[int],
    mobility: Array,
    accelerations: Sequence[Array],
    slopes: tuple[Array, Array],
) -> Transition:
    """The transition with the `settled` joints as they answer to their servos between samples.

    With x from the `answers` to the steps of servos, what is left of a joint's motion, y = q − x, obeys
    ÿ = r − ω² y − λ ẏ under a smooth r. `accelerations` are those (N, n) just after each sample at `time` (N,) s and
    just before it, and what is to be added to their mean over each interval (N − 1, n); `mobility` is M⁻¹ (N, n, n),
    and `slopes` are −ω² and −λ (N, n).
    """
    w, d = (np.maximum(-0.5 * (slope[:-1] + slope[1:]), 0.0) for slope in slopes)
    begin, end, curved = (values.copy() for values in accelerations)
    for j, answer in answers.items():
        begin -= mobility[:, :, j] * answer.after[:, None]
        end -= mobility[:, :, j] * answer.before[:, None]
    columns = {name: getattr(transition, name).copy() for name in ROWS}
    for j in settled:
        answer = answers[j]
        y, rate = transition.about[0, :, j] - answer.q, transition.about[1, :, j] - answer.v
        own_w, own_d = w[:, j], d[:, j]
        by_q, by_v, v_by_q, v_by_v, way, rise, way_by_slope, rise_by_slope = oscillator(own_w, own_d, np.diff(time))
        first = begin[:-1, j] + own_w * y[:-1] + own_d * rate[:-1]
        last = end[1:, j] + own_w * y[1:] + own_d * rate[1:]
        mean, slope = 0.5 * (first + last) + curved[:, j], (last - first) / np.diff(time)
        moved_q = by_q * y[:-1] + by_v * rate[:-1] + way * mean + way_by_slope * slope - y[1:]
        moved_v = v_by_q * y[:-1] + v_by_v * rate[:-1] + rise * mean + rise_by_slope * slope - rate[1:]
        for name, column in zip(ROWS, (by_q, by_v, v_by_q, v_by_v, moved_q, moved_v), strict=True):
            columns[name][:, j] = column
    return replace(transition, **columns)


ROWS = ("q_by_q", "q_by_v", "v_by_q", "v_by_v", "rise_q", "rise_v")
"""The parts of a transition that depend on the model."""


def _relaxing(rate: Array) -> tuple[Array, Array, Array]:
    """How a force that relaxes by exp(−λ s) over an interval, s from 0 to 1, differs from a linear one of equal ends.

    With the share p = (1 − e^{−λ s})/(1 − e^{−λ}) of its whole change that has come at s, these are, `rate` λ,
    ∫ p ds − 1/2, ∫ (1 − s) p ds − 1/6 and ∫ (s − 1/2) p ds − 1/12.
    """
    # a linear force shows an inertia λ²/12 too large; within the accuracy of laws that is nothing
    linear = rate**2 < 12.0 * LAW_ACCURACY
    # a joint that relaxes at once does so at 50
    rate = np.clip(rate, 1e-3, 50.0)
    lost = -np.expm1(-rate)
    mean = 1.0 / lost - 1.0 / rate
    falling = (0.5 - 1.0 / rate + lost / rate**2) / lost
    return (
        np.where(linear, 0.0, mean - 0.5),
        np.where(linear, 0.0, falling - 1.0 / 6.0),
        np.where(linear, 0.0, 0.5 * mean - falling - 1.0 / 12.0),
    )


def _unmodelled_force(weak: WeakForm, physics: Physics, found: Trajectory, mobility: Array) -> Array:
    """(n,) density of the white forces that make the accelerations of `found` that the model does not explain.

    At most as large as a model that is right to `LAW_ACCURACY` may miss: that share of a joint's effort, anew in each
    test function. Of a servo's effort also what bends between samples.
    """
    most = _largest_unmodelled(weak, physics, LAW_ACCURACY + _bent_between_samples(weak, physics, mobility))
    return np.asarray(np.minimum(found.density / np.maximum(mobility, 1e-300) ** 2, most), dtype=float)


def _largest_unmodelled(weak: WeakForm, physics: Physics, accuracy: Array | float) -> Array:
    """(n,) density of white forces of the share `accuracy` of each joint's effort, anew in each test function."""
    effort = acting_effort(weak, physics)
    return np.asarray(accuracy**2 * np.mean(effort**2, axis=0) * weak.samples.windows.spacing, dtype=float)


def _bent_between_samples(weak: WeakForm, physics: Physics, mobility: Array) -> Array:
    """(n,) the share of a servo's effort by which it bends beyond a parabola between samples; 0 without a servo.

    A joint under kp and kv obeys q̈ = −λ q̇ − ω² q, and its effort bends by (λ² + ω²) of itself: over an interval h the
    midpoint rule misses h²/24 of that, and at most all of it.
    """
    share = np.zeros(len(mobility))
    h = float(np.median(np.diff(weak.samples.time)))
    for j, drive in weak.terms(physics).servos.items():
        damped, stiff = (np.sqrt(np.mean(slope**2)) * mobility[j] for slope in (drive.mean.d_v, drive.mean.d_q))
        share[j] = min(1.0, h**2 / 24.0 * (damped**2 + stiff))
    return share


def _accelerate(response: FreeResponse, force: Array) -> Array:
    """M⁻¹ `force` (N, n)."""
    return np.asarray(np.einsum("nij,nj->ni", response.mobility, force), dtype=float)


def _accelerate_between(response: FreeResponse, force: Array) -> Array:
    """M⁻¹ `force` (N − 1, n) of sample intervals, with the mean of M⁻¹ over each."""
    mobility = 0.5 * (response.mobility[:-1] + response.mobility[1:])
    return np.asarray(np.einsum("nij,nj->ni", mobility, force), dtype=float)


def _contact_slopes(weak: WeakForm, physics: Physics, found: Trajectory) -> Array:
    """(2, N, n) derivatives of contacts' and body forces at each joint by its own position and by its own velocity."""
    slopes = np.zeros((2, *found.q.shape))
    if not physics.contacts and not physics.body_forces:
        return slopes
    memory = weak.contact_memory(physics)
    for j in range(weak.joints):
        for kind, size in enumerate((POSITION_STEP, VELOCITY_STEP)):
            step = np.zeros_like(found.q)
            step[:, j] = size
            ahead, behind = (
                motion(physics.tree, found.q + sign * step * (kind == 0), found.v + sign * step * (kind == 1))
                for sign in (1.0, -1.0)
            )
            change = weak.contacts.forces_and_readings(physics, ahead, memory)
            change = change - weak.contacts.forces_and_readings(physics, behind, memory)
            slopes[kind, :, j] = change[:, j] / (2.0 * size)
    return slopes


def _rotor_efforts(weak: WeakForm, physics: Physics) -> tuple[Array, Array]:
    """−J ψ̈ of rotors that twist against their links from rest: its mean from each sample to the next, and its change.

    Both are (N, n), the last row zero. With ψ̈ = g − m f, and g constant within an interval, −J ψ̈ changes there by
    J m times the change of the coupling's torque f, which is continuous.
    """
    taken, turned = np.zeros((2, len(weak.samples.time), weak.joints))
    for coupling in physics.couplings:
        joint = physics.tree.joint_index(coupling.at)
        drive = weak.couplings.rotor_drives(physics)[joint]
        acceleration = np.diff(coupling.twist_rate(drive)) / np.diff(weak.samples.time)
        torque = (drive.push[:-1] - acceleration) / drive.mobility[:-1]
        taken[:-1, joint] -= drive.inertia * acceleration
        turned[:-1, joint] += drive.inertia * drive.mobility[:-1] * np.gradient(torque)
    return taken, turned


def _with_trajectory(weak: WeakForm, physics: Physics, found: Trajectory, bend: Array, force: Array) -> WeakForm:
    """`weak` with the estimated motion `found` in place of its positions and velocities, as its sensors record it."""
    samples, names = weak.samples, physics.tree.joint_names
    columns = {f"q.{name}": found.q[:, j] for j, name in enumerate(names)}
    columns |= {f"v.{name}": found.v[:, j] for j, name in enumerate(names)}
    for effect in reversed(physics.sensors):
        columns |= _as_recorded(effect, samples.time, columns)
    q = np.stack([columns[f"q.{name}"] for name in names], axis=1)
    v = np.stack([columns[f"v.{name}"] for name in names], axis=1)
    beyond = None if samples.differentiate is None else found.v - samples.differentiate @ found.q
    recorded = {name: value for name, value in columns.items() if name in samples.recording.columns}
    recording = replace(samples.recording, columns={**samples.recording.columns, **recorded})
    nothing = np.zeros_like(found.q)
    points = lay_points(samples.windows, found.v)
    estimated = EstimatedMotion(
        found.q, found.v, found.q_std, found.v_std, beyond, points, nothing, nothing, force, bend
    )
    weak = WeakForm(replace(samples, recording=recording, q=q, v=v, estimated=estimated), weak.sensors)
    if not any(name in columns for effect in physics.sensors for name in effect.channels(tuple(columns))):
        return weak
    # a filter and its inverse, both from sample to sample, do not quite cancel where the velocity bends
    undone = corrected_measurement(weak.samples, weak.sensors, physics)
    estimated = replace(estimated, missed_q=found.q - undone.q, missed_v=found.v - undone.v)
    return WeakForm(replace(weak.samples, estimated=estimated), weak.sensors)


def _as_recorded(effect: SensorEffect, time: Array, columns: dict[str, Array]) -> dict[str, Array]:
    on = effect.channels(tuple(columns))
    if not on:
        return {}
    recorded = effect.measured(time, np.stack([columns[name] for name in on], axis=1))
    return {name: recorded[:, k] for k, name in enumerate(on)}
