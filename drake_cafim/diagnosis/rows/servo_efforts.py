"""The efforts of position servos along a recorded motion, with their derivatives by the measured channels.

Between samples a servo's effort is smooth but for the steps of its command, and for what the joint's own motion takes
back of these. Both are split off, so that integrals of the effort take them exactly and the rest as a smooth channel.
The effort also bends where it enters or leaves its limit or the dead band: what is linear between such instants is
split off as well.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.servo import Servo, ServoEffort
from drake_cafim.effects.step_response import Answers, StepResponse
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.driving import Command
from drake_cafim.typing import Array, Indices


@dataclass(frozen=True)
class ServoDrive:
    """The effort of one servo: `mean` (N,) around each sample with its derivatives; `steps` S and `ramps`; `rest` (N,).

    S is held, the ramps are linear between their times; the rest is what they leave at the samples. Once the joints'
    `response` to their steps is known, what that leaves of S is in its place.
    """

    mean: ServoEffort
    steps: Effort
    rest: Array
    ramps: tuple[Effort, ...] = ()
    response: StepResponse | None = None

    @property
    def jumps(self) -> Array:
        """(K,) the steps of S at its times, N m or N."""
        return np.diff(self.steps.values, prepend=0.0)

    @cached_property
    def _slopes(self) -> tuple[float, float]:
        """Medians of −∂effort/∂q and −∂effort/∂v where these act."""
        return _median_above_zero(-self.mean.d_q), _median_above_zero(-self.mean.d_v)

    def settling(self, own: Array) -> tuple[float, float]:
        """k and d by which the joint settles, of its `own` mobility (N,).

        They are medians of −∂effort/∂q and −∂effort/∂v where these act, neither at the limit nor within the dead band:
        one number for all samples, since what is left of the steps would jump where the slope does. A joint that would
        swing is taken as softer, so that it just does not, k = d² m/4: what is split off is the shape of the effort
        within an interval, and must not ring for seconds without the friction that ends that.
        """
        (stiffness, damping), m = self._slopes, float(np.median(own))
        return min(stiffness, 0.25 * damping**2 * m), damping

    def settling_by(self, parameter: str, servo: Servo, own: Array) -> tuple[float, float]:
        """The derivatives of `settling` by the "stiffness" or the "damping" of the joint's `servo`, one without sag."""
        k, d = self.settling(own)
        swings = k < self._slopes[0]
        if parameter == "stiffness":
            return (0.0 if swings else k / servo.stiffness if k else 0.0), 0.0
        return (0.5 * d * float(np.median(own)) if swings else 0.0), (1.0 if d else 0.0)

    def bent_by(self, time: Array, own: Array, mobility: Array, other: "ServoDrive") -> "ServoDrive":
        """The drive with the bends split off at steps of `other` by which its damping is not that of `settling`.

        `own` (N,) is this joint's own mobility, `mobility` (N,) its acceleration for a unit effort of the other one, at
        `time` (N,) s.
        """
        if not np.any(self.mean.d_v != self.mean.d_v[0]):
            return self
        at = np.clip(np.searchsorted(time, other.steps.times, side="right") - 1, 0, None)
        settling = self.settling(own)[1]
        beyond = (self.mean.d_v + settling) * mobility
        if len(at) < 2 or not np.any(beyond[at] * other.jumps):
            return self
        slope = np.cumsum((beyond * mean_left(self.mean.d_v * own, time))[at] * other.jumps)
        ramp = np.concatenate([[0.0], np.cumsum(slope[:-1] * np.diff(other.steps.times))])
        bend = Effort(other.steps.times, ramp, True)
        rest = self.rest - np.interp(time, bend.times, bend.values)
        return replace(self, rest=rest, ramps=(*self.ramps, bend))

    def after(self, time: Array) -> Array:
        """(N,) the effort at `time` (N,) s of the samples, just after a step that is there."""
        split = self.steps.at(time) if self.response is None else self.response.after
        return self.beside_steps(time) + split

    def beside_steps(self, time: Array) -> Array:
        """(N,) the part of the effort at `time` (N,) s of the samples that has no steps."""
        return self.rest + sum(np.interp(time, ramp.times, ramp.values) for ramp in self.ramps)


def _median_above_zero(values: Array) -> float:
    above = values[values > 0.0]
    return float(np.median(above)) if len(above) else 0.0


def mean_left(slope: Array, time: Array) -> Array:
    """(N,) mean over a sample interval of e^(−λ s), with the rate λ = −`slope` (N,) 1/s."""
    x = np.maximum(-slope * np.gradient(time), 1e-6)
    return np.asarray(-np.expm1(-x) / x)


def answers_to_steps(servos: Mapping[int, ServoDrive], time: Array, mobility: Array) -> dict[int, StepResponse]:
    """What the joints make of the steps of all `servos`, under the `mobility` (N, n, n) at `time` (N,) s."""
    return step_answers(servos, time, mobility).responses


def step_answers(servos: Mapping[int, ServoDrive], time: Array, mobility: Array) -> Answers:
    """As `answers_to_steps`, with what their derivatives need."""
    by_q, by_v = np.zeros((2, *mobility.shape[:2]))
    for j, drive in servos.items():
        by_q[:, j], by_v[:, j] = drive.settling(mobility[:, j, j])
    return Answers.of(time, mobility, (by_q, by_v), {j: drive.steps for j, drive in servos.items()})


def split_steps(servos: Mapping[int, ServoDrive], time: Array, mobility: Array) -> dict[int, ServoDrive]:
    """The drives with their steps as the joints leave them, under the `mobility` (N, n, n) at `time` (N,) s."""
    answers = answers_to_steps(servos, time, mobility)
    found = {}
    for j, drive in servos.items():
        rest = drive.rest + drive.steps.at(time) - answers[j].after
        split = replace(drive, response=answers[j], rest=rest)
        for k, other in servos.items():
            split = split.bent_by(time, mobility[:, j, j], mobility[:, j, k], other)
        found[j] = split
    return found


def split_by_parameter(
    answers: Answers, joint: int, own: ServoDrive, settling: tuple[float, float]
) -> dict[int, ServoDrive]:
    """The derivatives of `split_steps` by a number of the servo at `joint`, which has no sag.

    `answers` are those of all servos to their steps, `own` is the derivative of that servo's drive, and `settling` that
    of its k and d.
    """
    time, by = answers.time, answers.by_slopes(joint, *settling, own.steps)
    nothing = np.zeros(len(time))
    still = ServoDrive(_constant(nothing), Effort(time[:1], np.zeros(1)), nothing)
    found = {}
    for j in by:
        drive = own if j == joint else still
        found[j] = replace(drive, response=by[j], rest=drive.rest + drive.steps.at(time) - by[j].after)
    return found


@dataclass(frozen=True)
class ServoMotion:
    """What the servos of one recording act on: the `commands` by joint index, and q, v (N, n) at `time` (N,) s.

    q is what the encoders read, without the delay or lag of the recording; v is the true velocity, since back-EMF acts
    at once.
    """

    time: Array
    q: Array
    v: Array
    commands: Mapping[int, Command]

    def drives(self, physics: Physics) -> dict[int, ServoDrive]:
        """The drive of each servo, by joint index."""
        found = {}
        for j, command in self.commands.items():
            servo, sent = self._servo(physics, j)
            mean = servo.effort(mean_around(sent, self.time), *self._read(j), command.gain, command.supply)
            bends = _bends_at_edges(servo, command, sent, self.time, *self._read(j))
            ramps = () if bends is None else (bends.ramp,)
            steps, rest = self._split(j, sent, lambda *at, servo=servo: servo.effort(*at).value)
            found[j] = ServoDrive(
                mean, steps, rest - sum(np.interp(self.time, r.times, r.values) for r in ramps), ramps
            )
        return found

    def by_parameter(self, physics: Physics, joint: int, parameter: str) -> ServoDrive:
        """The derivative of a servo's drive by its "stiffness" or its "damping", of one without sag.

        Its response is not that of `drives`, which other joints' steps belong to.
        """
        command, (servo, sent) = self.commands[joint], self._servo(physics, joint)
        law = partial(servo.effort_by, parameter)
        mean = law(mean_around(sent, self.time), *self._read(joint), command.gain, command.supply)
        steps, rest = self._split(joint, sent, law)
        bends = _bends_at_edges(servo, command, sent, self.time, *self._read(joint))
        if bends is None or parameter != "stiffness":
            return ServoDrive(_constant(mean), steps, rest)
        ramp, moved = Effort(bends.ramp.times, bends.ramp.values / servo.stiffness, True), bends.moved_by_stiffness
        rest = rest - np.interp(self.time, ramp.times, ramp.values) - moved.at(self.time)
        return ServoDrive(_constant(mean), steps, rest, (ramp, moved))

    def _servo(self, physics: Physics, joint: int) -> tuple[Servo, Effort]:
        """The servo at a joint, and the commanded position that it follows."""
        name = physics.tree.joints[joint].name
        return physics.bounded_servo_at(name), followed(physics, name, self.commands[joint].over(self.time))

    def _read(self, joint: int) -> tuple[Array, Array]:
        return self.q[:, joint], self.v[:, joint]

    def _split(self, joint: int, sent: Effort, law: Callable[..., Array]) -> tuple[Effort, Array]:
        """The steps that a command `sent` makes in a `law` of it, q, v, gain and supply; and the rest at samples."""
        time, command = self.time, self.commands[joint]
        channels = (*self._read(joint), command.gain, command.supply)
        if sent.ramped:
            return Effort(time[:1], np.zeros(1)), law(mean_around(sent, time), *channels)
        at = np.clip(sent.times[1:], time[0], time[-1])
        there = [np.interp(at, time, channel) for channel in channels]
        after, before = (law(goal, *there) for goal in (sent.values[1:], sent.values[:-1]))
        steps = Effort(sent.times, np.concatenate([[0.0], np.cumsum(after - before)]))
        # values at the samples, just after a step that is there
        index = np.clip(np.searchsorted(sent.times, time, side="right") - 1, 0, None)
        return steps, law(sent.values[index], *channels) - steps.values[index]


def _constant(value: Array) -> ServoEffort:
    """An effort that nothing measured changes."""
    return ServoEffort(value, *(np.zeros_like(value) for _ in range(3)))


@dataclass(frozen=True)
class Bends:
    """The piecewise linear part of an effort that bends at edges of its law: `ramp`.

    `moved_by_stiffness` is the part of its derivative by kp by which the instants of the bends move.
    """

    ramp: Effort
    moved_by_stiffness: Effort


def _bends_at_edges(servo: Servo, command: Command, sent: Effort, time: Array, q: Array, v: Array) -> Bends | None:
    """The bends of the effort where the position error crosses an edge of the law.

    Edges are the dead band's and the limit's; between knots, the samples and the command's steps, the error is taken as
    linear. None where nothing bends.
    """
    levels = [servo.dead_band] if servo.dead_band > 0.0 else []
    if np.isfinite(servo.limit):
        levels.append(np.nan)  # depends on the gain, below
    if not levels and not servo.has_envelope:
        return None
    knots = np.unique(np.concatenate([time, sent.times[(sent.times > time[0]) & (sent.times < time[-1])]]))
    held = np.clip(np.searchsorted(sent.times, knots[:-1], side="right") - 1, 0, None)
    goal = np.interp(knots, sent.times, sent.values) if sent.ramped else np.zeros(0)
    begin, end = (goal[:-1], goal[1:]) if sent.ramped else (sent.values[held], sent.values[held])
    at = np.interp(knots, time, q)
    before, after, lasting = begin - at[:-1], end - at[1:], np.diff(knots)
    moving = np.interp(knots, time, v)
    speed, faster = moving[:-1], moving[1:]
    gain, supply = (np.interp(knots[:-1], time, channel) for channel in (command.gain, command.supply))
    instants, bends, later = [], [], []
    for level in levels:
        edge, by_stiffness = np.full_like(before, level), np.zeros_like(before)
        if np.isnan(level):
            reach = servo.limit / np.maximum(servo.stiffness * gain, 1e-300)
            edge, by_stiffness = servo.dead_band + reach, -reach / max(servo.stiffness, 1e-300)
        for sign_of_side in (1.0, -1.0):
            side = sign_of_side * edge
            k = np.flatnonzero((before - side) * (after - side) < 0.0)
            rate = (after[k] - before[k]) / lasting[k]
            aside = EDGE * np.sign(rate)
            slopes = [
                servo.effort(side[k] + sign * aside, 0.0 * rate, speed[k], gain[k], supply[k]).d_command
                for sign in (1.0, -1.0)
            ]
            instants.append(knots[k] + (side[k] - before[k]) / rate)
            bends.append((slopes[0] - slopes[1]) * rate)
            later.append(sign_of_side * by_stiffness[k] / rate)
    if servo.has_envelope:
        speeds, supplied = (speed, faster), (gain, supply)
        for k, since, bend in _bends_at_envelope(servo, (before, after), speeds, supplied, lasting):
            instants.append(knots[k] + since)
            bends.append(bend)
            later.append(np.zeros(len(k)))
    # a step of the command may cross an edge as well
    rates, accelerations = (after - before) / lasting, (faster - speed) / lasting
    begins, ends = (
        servo.effort(error, 0.0 * error, at, gain, supply) for error, at in ((before, speed), (after, faster))
    )
    change = (begins.d_command[1:] - ends.d_command[:-1]) * 0.5 * (rates[1:] + rates[:-1])
    change = change + (begins.d_v[1:] - ends.d_v[:-1]) * 0.5 * (accelerations[1:] + accelerations[:-1])
    crossed = np.flatnonzero(begins.d_command[1:] != ends.d_command[:-1])
    instants.append(knots[1:-1][crossed])
    bends.append(change[crossed])
    later.append(np.zeros(len(crossed)))
    times, bent = np.concatenate(instants), np.concatenate(bends)
    if not len(times):
        return None
    order = np.argsort(times, kind="stable")
    moved = np.cumsum((-bent * np.concatenate(later))[order])
    stairs = Effort(np.concatenate([[time[0]], times[order]]), np.concatenate([[0.0], moved]))
    times = np.concatenate([[time[0]], times[order], [time[-1]]])
    slope = np.concatenate([[0.0], np.cumsum(bent[order])])
    ramp = Effort(times, np.concatenate([[0.0], np.cumsum(slope * np.diff(times))]), True)
    return Bends(ramp, stairs)


def _bends_at_envelope(
    servo: Servo,
    errors: tuple[Array, Array],
    speeds: tuple[Array, Array],
    supplied: tuple[Array, Array],
    lasting: Array,
) -> Iterator[tuple[Indices, Array, Array]]:
    """Where the effort enters or leaves the motor's envelope, on either side of zero.

    The intervals (k,), the instants (k,) s after their beginnings, and the bends (k,) there, of intervals that last
    `lasting` (K,) s: the effort beyond the envelope is taken as linear in each, from the `errors` and `speeds` at its
    beginning to those at its end.
    """
    free = replace(servo, stall_torque=np.inf)
    begin, end = (free.effort(error, 0.0 * error, v, *supplied).value for error, v in zip(errors, speeds, strict=True))
    for side in (1.0, -1.0):
        bounds = (servo.stall_torque * np.maximum(1.0 - side * v / servo.no_load_speed, 0.0) for v in speeds)
        before, after = (side * effort - bound for effort, bound in zip((begin, end), bounds, strict=True))
        k = np.flatnonzero(before * after < 0.0)
        rate = (after[k] - before[k]) / lasting[k]
        yield k, -before[k] / rate, -side * np.abs(rate)


EDGE = 1e-9
"""rad (m), beside an edge of the law, where its slope on either side is taken."""


def followed(physics: Physics, joint: str, command: Effort) -> Effort:
    """The commanded position over time that the servo at `joint` follows when `command` is sent to it."""
    for effect in physics.servo_effects:
        if effect.at == joint:
            command = effect.follow(command)
    return command


def mean_around(signal: Effort, time: Array) -> Array:
    """(N,) mean of `signal` from halfway after the sample before to halfway before the next, for each of `time` (N,) s.

    With it, the trapezoid rule integrates a staircase between the samples.
    """
    middles = 0.5 * (time[1:] + time[:-1])
    edges = np.concatenate([[2.0 * time[0] - middles[0]], middles, [2.0 * time[-1] - middles[-1]]])
    return signal.means(edges)[:-1]


def servo_key(physics: Physics) -> tuple[object, ...]:
    """All numbers that the efforts of servos and the loads from outside depend on, as a key of a cache."""
    servos = tuple(physics.bounded_servo_at(servo.joint) for servo in physics.servos)
    effects = ((effect.key, *effect.values.items()) for effect in physics.servo_effects)
    contacts = (str(contact) for contact in physics.contacts)
    return (servos, *effects, physics.tree.inertial_parameters.tobytes(), physics.gravity.tobytes(), *contacts)
