"""Effects of position servos: on the command that a servo follows, and on its law."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from drake_cafim.effects.actuator import ActuatorDelay, ActuatorLag, Effort
from drake_cafim.effects.effect import Direction, Effect, P, Place, Strength
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ServoEffect(Effect):
    """A change of one joint's position servo: of the command that it follows, of its law, or of both."""

    place: ClassVar[Place] = Place.ACTUATOR
    family: ClassVar[str] = "servo"
    kind: ClassVar[str] = "servo"
    bounds_profile: ClassVar[bool] = False
    """Whether its one strength bounds how what is followed, a ramped signal, moves."""

    def add_to(self, physics: P) -> P:
        return physics.with_part("servo_effects", self)

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        driven = {servo.joint for servo in where.servos if cls.suits(servo)}
        yield from (at for at in super().attachments(where) if at in driven)

    @classmethod
    def suits(cls, servo: Servo) -> bool:
        """Whether it is a hypothesis for this servo."""
        return True

    @property
    def past(self) -> float:
        """How far back, s, past commands determine the one that is followed."""
        return 0.0

    def follow(self, command: Effort) -> Effort:
        """The commanded position over time, rad (m), that the servo follows when `command` is sent."""
        return command

    def rest(self, sent: float) -> Array:
        """(m,) the state of what is followed, its position first, where nothing but `sent` has been commanded."""
        return np.array([sent])

    def after(self, now: Array, sent: float, period: float) -> Array:
        """(m,) the state of what is followed `period` s after `now` (m,), while `sent` is commanded, rad (m)."""
        return np.array([sent])

    def follow_from(self, now: Array, sent: float, period: float) -> Effort:
        """What is followed over `period` s from the state `now` (m,) at 0 s, while `sent` is commanded."""
        # a lag and a bounded rate start where they are: one held piece there, before the command
        return self.follow(Effort(np.array([-period, 0.0, period]), np.array([now[0], sent, sent])))

    @property
    def remembers(self) -> bool:
        """Whether what is followed depends on earlier commands."""
        return type(self).follow is not ServoEffect.follow

    def of(self, servo: Servo) -> Servo:
        """The servo with the effect."""
        return servo

    def looks(self, rate: Array, error: Array) -> Iterator[Sequence[Direction]]:
        """Alternative sets of steps for screening, each tested alone.

        `rate` (N,), of the command, rad/s (m/s), and `error` (N,), command less position, rad (m), are the joint's over
        all recordings.
        """
        yield self.directions()

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> Self | None:
        """The effect that the coefficients of one of `looks` determine; None where they are implausible for it."""
        return self.from_directions(coefficients)


@dataclass(frozen=True)
class ServoGainError(ServoEffect):
    """gain·kp acts."""

    name: ClassVar[str] = "servo_gain_error"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("gain", "1", 0.1, lower=0.1, upper=10.0, nominal=1.0),)
    reference: ClassVar[str] = "Duclusaud, Passault, Padois, Ly, IEEE ICRA, 2025 (a servo's gain, fitted)"
    formula: ClassVar[str] = "<i>g</i> <i>k<sub>p</sub></i> (cmd − <i>q</i>)"
    words: ClassVar[str] = "answers a position error with another stiffness than stated"
    alike: ClassVar[dict[str, str]] = {
        "servo_dead_band": "a band much smaller than the errors takes a nearly constant share of them",
        "supply_sag": "a share of the effort is lost either way; sag takes more of the large ones",
        "payload": "more load and a softer servo look alike at one joint",
    }

    def of(self, servo: Servo) -> Servo:
        return replace(servo, stiffness=self.values["gain"] * servo.stiffness)


@dataclass(frozen=True)
class ServoDeadBand(ServoEffect):
    """No effort while |cmd − q| < width; beyond, kp acts on what exceeds the width."""

    name: ClassVar[str] = "servo_dead_band"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("width", "rad", 0.01, lower=0.0, linear_unit="m"),)
    reference: ClassVar[str] = "Tao, Kokotović, Adaptive Control with Actuator Nonlinearities, 1996, §2"
    formula: ClassVar[str] = "<i>k<sub>p</sub></i> acts on cmd − <i>q</i> less ±<i>w</i>, 0 within"
    words: ClassVar[str] = "makes no effort while the position error is small"
    # where neither inertia nor gravity shows, it acts as dry friction does, which every geared joint has
    surprise: ClassVar[float] = 2.0 * float(np.log(10.0))
    alike: ClassVar[dict[str, str]] = {
        "servo_gain_error": "a band much smaller than the errors takes a nearly constant share of them",
        "joint_coulomb_friction": "a loss of constant size, but opposed to the motion instead of the position error",
    }

    def of(self, servo: Servo) -> Servo:
        return replace(servo, dead_band=self.values["width"])

    def looks(self, rate: Array, error: Array) -> Iterator[Sequence[Direction]]:
        scale = float(np.sqrt(np.mean(error**2)))
        for share in (0.03, 0.1, 0.3, 0.6, 1.0):
            if scale > 0.0:
                yield (Direction({"width": share * scale}, None, share * scale),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ServoDeadBand":
        return self.with_values({"width": min(float(coefficients[0]), 2.0 * look[0].size)})


@dataclass(frozen=True)
class SupplySag(ServoEffect):
    """The voltage term T acts times 1 − sag·|T|/limit·|effort|."""

    name: ClassVar[str] = "supply_sag"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("sag", "1/(N m)", 0.2, lower=0.0, upper=1e4, linear_unit="1/N"),
    )
    reference: ClassVar[str] = "Ragone, Proc. Intersociety Energy Conversion Conf., 1968 (a battery's inner resistance)"
    formula: ClassVar[str] = "<i>T</i> (1 − <i>s</i> |<i>T</i>|/limit |effort|) − <i>k<sub>v</sub></i> <i>v</i>"
    words: ClassVar[str] = "loses voltage under load"
    alike: ClassVar[dict[str, str]] = {
        "servo_gain_error": "a share of the effort is lost either way; sag takes more of the large ones",
        "actuator_saturation": "both take from the largest efforts",
    }

    @classmethod
    def suits(cls, servo: Servo) -> bool:
        # without a limit there is no full duty
        return bool(np.isfinite(servo.limit))

    def of(self, servo: Servo) -> Servo:
        return replace(servo, sag=self.values["sag"])


@dataclass(frozen=True)
class CommandDelay(ServoEffect):
    """cmd(t − delay) is followed; before t₀ + delay, the first command."""

    name: ClassVar[str] = "command_delay"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("delay", "s", 0.005, lower=0.0, upper=0.2),)
    reference: ClassVar[str] = "Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991 (delayed commands)"
    formula: ClassVar[str] = "follows cmd(<i>t</i> − τ)"
    words: ClassVar[str] = "follows the command of a moment ago"
    alike: ClassVar[dict[str, str]] = {
        "command_lag": "slow commands are late by the time constant, whichever of the two it is",
        "actuator_delay": "it delays the measured position within the servo, too",
        "joint_viscous_friction": "in a steady motion, a late command is a command that is behind",
    }

    @property
    def past(self) -> float:
        return self.values["delay"]

    def follow(self, command: Effort) -> Effort:
        return ActuatorDelay(self.at, self.values).drive(command)

    def looks(self, rate: Array, error: Array) -> Iterator[Sequence[Direction]]:
        for delay in (0.001, 0.004, 0.012, 0.03, 0.08):
            yield (Direction({"delay": delay}, None, delay),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "CommandDelay":
        # a negative delay is kept: it is implausible, so that the hypothesis is dropped later
        return self.with_values({"delay": min(float(coefficients[0]), 2.0 * look[0].size)})


@dataclass(frozen=True)
class CommandLag(ServoEffect):
    """τ ẏ = cmd − y, and y is followed; it starts in steady state, y = cmd."""

    name: ClassVar[str] = "command_lag"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("time_constant", "s", 0.005, lower=1e-5, upper=0.5),)
    reference: ClassVar[str] = "Åström, Hägglund, PID Controllers, 1995, §3.4 (filtered set-points)"
    formula: ClassVar[str] = "τ <i>ẏ</i> = cmd − <i>y</i>, <i>y</i> is followed"
    words: ClassVar[str] = "follows the command slowly"
    alike: ClassVar[dict[str, str]] = {
        "command_delay": "slow commands are late by the time constant, whichever of the two it is",
        "actuator_lag": "it filters the measured position within the servo, too",
        "command_rate_limit": "both hold back a fast command",
        "command_acceleration_limit": "both are late in turns; a bounded acceleration only in sharp ones",
    }

    @property
    def settling(self) -> float:
        return self.values["time_constant"]

    def follow(self, command: Effort) -> Effort:
        return ActuatorLag(self.at, self.values).drive(command)

    def after(self, now: Array, sent: float, period: float) -> Array:
        return sent + (now - sent) * float(np.exp(-period / self.values["time_constant"]))

    def looks(self, rate: Array, error: Array) -> Iterator[Sequence[Direction]]:
        for constant in (0.001, 0.004, 0.012, 0.03, 0.08):
            yield (Direction({"time_constant": constant}, None, constant),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "CommandLag":
        return self.with_values({"time_constant": min(float(coefficients[0]), 2.0 * look[0].size)})


@dataclass(frozen=True)
class CommandRateLimit(ServoEffect):
    """What is followed moves towards cmd at most at `rate`; it starts at the first command."""

    name: ClassVar[str] = "command_rate_limit"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("rate", "rad/s", 5.0, lower=1e-4, upper=1e4, inverse=True, linear_unit="m/s"),
    )
    reference: ClassVar[str] = "Hess, Snell, J. Guidance, Control, and Dynamics 20(4), 1997 (rate limiting)"
    bounds_profile: ClassVar[bool] = True
    formula: ClassVar[str] = "what is followed moves at most at the rate <i>r</i>"
    words: ClassVar[str] = "follows the command at a bounded rate"
    alike: ClassVar[dict[str, str]] = {
        "command_lag": "both hold back a fast command",
        "command_acceleration_limit": "both hold back a fast command; a bounded acceleration overshoots the turns",
        "actuator_speed_limit": "both bound the joint's speed",
    }

    def follow(self, command: Effort) -> Effort:
        times, values = _rate_limited(command.times, command.values, command.ramped, self.values["rate"])
        return Effort(times, values, True)

    def after(self, now: Array, sent: float, period: float) -> Array:
        farthest = self.values["rate"] * period
        return now + np.clip(sent - now, -farthest, farthest)

    def looks(self, rate: Array, error: Array) -> Iterator[Sequence[Direction]]:
        for share in (0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.97):
            level = float(np.quantile(np.abs(rate), share))
            if level > 0.0:
                yield (Direction({"rate": level}, None, 1.0),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "CommandRateLimit | None":
        # the coefficient is about 1 if the rate is bounded by this value, else about 0
        return self.with_values(look[0].ahead) if 0.3 < coefficients[0] < 3.0 else None


@compiled
def _rate_limited(times: Array, values: Array, ramped: bool, rate: float) -> tuple[Array, Array]:
    """Knots and values of a ramped signal that follows a held or ramped one at most at `rate`.

    In an interval with the goal g₀ → g₁ it moves from y at the slope ±rate, until it meets the goal, and with the goal
    from there on where that is slow enough.
    """
    count = len(times)
    at, y_at = np.empty(2 * count), np.empty(2 * count)
    y, used = values[0], 0
    for k in range(count):
        at[used], y_at[used] = times[k], y
        used += 1
        if k + 1 == count:
            break
        h = times[k + 1] - times[k]
        begin = values[k]
        end = values[k + 1] if ramped else values[k]
        slope = (end - begin) / h if h > 0.0 else 0.0
        gap = begin - y
        if gap == 0.0 and abs(slope) <= rate:
            y = end
            continue
        direction = 1.0 if gap > 0.0 or (gap == 0.0 and slope > 0.0) else -1.0
        closing = direction * rate - slope
        meets = gap / closing if closing * direction > 0.0 else h
        if meets < h and meets >= 0.0:
            at[used], y_at[used] = times[k] + meets, begin + slope * meets
            used += 1
            y = end if abs(slope) <= rate else y_at[used - 1] + np.sign(slope) * rate * (h - meets)
        else:
            y = y + direction * rate * h
    return at[:used], y_at[:used]
