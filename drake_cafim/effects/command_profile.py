"""The profile that a servo makes of its command: what is followed gets to the command with a bounded acceleration."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.effect import Direction, Strength
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

CHORD = 1e-5
"""rad (m), by which a chord of a parabola may leave it: below what encoders tell."""
RAMP_STEPS = 8
"""Steps that a ramp of the command is taken as, between two samples."""


@dataclass(frozen=True)
class CommandAccelerationLimit(ServoEffect):
    """What is followed gets to cmd, and to rest there, as fast as ±acceleration allows; it starts at the first command.

    With y followed and g commanded, ÿ = a sign(g − y − ẏ|ẏ|/(2a)), and y rests where it meets g.
    """

    name: ClassVar[str] = "command_acceleration_limit"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("acceleration", "rad/s²", 50.0, lower=1e-3, upper=1e6, inverse=True, linear_unit="m/s²"),
    )
    reference: ClassVar[str] = "Zanasi, Lo Bianco, Tonielli, Automatica 36(3), 2000 (profiles of bounded acceleration)"
    formula: ClassVar[str] = (
        "<i>ÿ</i> = <i>a</i> sign(cmd − <i>y</i> − <i>ẏ</i>|<i>ẏ</i>|/2<i>a</i>), <i>y</i> is followed"
    )
    words: ClassVar[str] = "follows the command with a bounded acceleration"
    alike: ClassVar[dict[str, str]] = {
        "command_rate_limit": "both hold back a fast command; a bounded acceleration overshoots the turns",
        "command_lag": "both are late in turns; a bounded acceleration only in sharp ones",
        "command_delay": "both are late; a bounded acceleration only in sharp turns",
    }

    bounds_profile: ClassVar[bool] = True
    difference_step: ClassVar[float] = 2e-2
    """Between two times at which it gets to a command a sample earlier or later, the motion hardly changes: a wider
    difference alone has the slope of what is followed."""

    def follow(self, command: Effort) -> Effort:
        start = self.rest(float(command.values[0]))
        times, values, _ = _profile(command.times, command.values, command.ramped, self.values["acceleration"], start)
        return Effort(times, values, True)

    def rest(self, sent: float) -> Array:
        return np.array([sent, 0.0])

    def after(self, now: Array, sent: float, period: float) -> Array:
        return self._moving(now, sent, period)[2]

    def follow_from(self, now: Array, sent: float, period: float) -> Effort:
        times, values, _ = self._moving(now, sent, period)
        return Effort(times, values, True)

    def _moving(self, now: Array, sent: float, period: float) -> tuple[Array, Array, Array]:
        held = np.array([sent, sent])
        times, values, end = _profile(np.array([0.0, period]), held, False, self.values["acceleration"], now)
        return times, values, end

    def looks(self, rate: Array, error: Array) -> Iterator[Sequence[Direction]]:
        fastest = float(np.quantile(np.abs(rate), 0.97))
        for rise in (0.01, 0.03, 0.06, 0.1, 0.16, 0.25, 0.4, 0.6, 1.0):
            if fastest > 0.0:
                yield (Direction({"acceleration": fastest / rise}, None, 1.0),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "CommandAccelerationLimit | None":
        # the coefficient is about 1 if the acceleration is bounded by this value, else about 0
        return self.with_values(look[0].ahead) if 0.3 < coefficients[0] < 3.0 else None


@compiled
def _profile(times: Array, values: Array, ramped: bool, a: float, start: Array) -> tuple[Array, Array, Array]:
    """Knots and values of chords of a signal that gets to a held or ramped one with the acceleration ±`a`.

    `start` (2,) and the last of what is returned are its position and velocity, at the first time and at the last.
    Towards a goal g it accelerates in the direction s of g − y − w|w|/(2a) to the speed √(a s (g − y) + w²/2), from
    which it comes to rest at g.
    """
    at, found = [times[0]], [start[0]]
    y, w = start[0], start[1]
    parts = RAMP_STEPS if ramped else 1
    for k in range(len(times) - 1):
        for part in range(parts):
            goal = values[k]
            if ramped:
                goal += (values[k + 1] - values[k]) * (part + 0.5) / parts
            begin, left = times[k] + part * (times[k + 1] - times[k]) / parts, (times[k + 1] - times[k]) / parts
            if y == goal and w == 0.0:
                at.append(begin + left)
                found.append(y)
                continue
            s = 1.0 if goal - y - 0.5 * w * abs(w) / a >= 0.0 else -1.0
            fastest = np.sqrt(max(a * s * (goal - y) + 0.5 * w**2, 0.0))
            for phase in range(3):
                if left <= 0.0:
                    break
                direction = s if phase == 0 else -s if phase == 1 else 0.0
                needed = max(fastest - s * w, 0.0) / a if phase == 0 else fastest / a if phase == 1 else left
                lasting = min(needed, left)
                chords = 1 if phase == 2 else int(np.ceil(np.sqrt(a * lasting**2 / (8.0 * CHORD))))
                for c in range(1, chords + 1):
                    t = lasting * c / chords
                    at.append(begin + t)
                    found.append(y + w * t + 0.5 * direction * a * t**2)
                y += w * lasting + 0.5 * direction * a * lasting**2
                w += direction * a * lasting
                if phase == 1 and needed <= left:
                    y, w = goal, 0.0
                begin += lasting
                left -= lasting
    return np.array(at), np.array(found), np.array([y, w])
