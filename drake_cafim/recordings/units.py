"""Detection of degrees and other units than radians, by the joints' limits and by q against the integral of v."""

from collections.abc import Mapping

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

DEGREES = 180.0 / np.pi
FAR = 1.0  # of the joint's range: a longer overrun is not explained by an inaccurate limit
MARGIN = 0.1  # of the joint's range: how far q·π/180 may lie beyond limits that are inaccurate
CORRELATED = 0.95  # least correlation of q with the integral of v at which the ratio of the two is used
LARGEST_GAIN = 5.0  # of a sensor: a larger ratio of q to the integral of v is one of units


def unit_mistakes(recording: Recording, limits: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """One sentence for each revolute joint of which q or v, but not both, is in degrees or in another unit.

    `limits` maps each revolute joint to its (lower, upper) in rad; infinite ones are allowed. The test: q and the
    integral of v differ by the factor 180/π or π/180, or by another one that no sensor's gain is, as of an encoder's
    counts or of turns. A small motion in degrees without v, or with v in degrees too, is not detected. Raises
    `InputError` where q exceeds the limits by more than their range while q·π/180 lies within them: such a recording
    cannot be used.
    """
    found = []
    for joint in recording.joints("q"):
        if joint in limits:
            unusable = _by_limits(recording, joint, limits[joint])
            if unusable:
                raise InputError(unusable)
            sentence = _by_velocity(recording, joint)
            found += [sentence] if sentence else []
    return tuple(found)


def _by_limits(recording: Recording, joint: str, limits: tuple[float, float]) -> str | None:
    lower, upper = limits
    q = recording.columns[f"q.{joint}"]
    q = q[np.isfinite(q)]
    span = upper - lower
    if q.size == 0 or not np.isfinite(span) or span <= 0.0:
        return None
    least, most = float(q.min()), float(q.max())
    overrun = max(most - upper, lower - least)
    within = least / DEGREES >= lower - MARGIN * span and most / DEGREES <= upper + MARGIN * span
    if overrun <= FAR * span or not within:
        return None
    return (
        f"{recording.name}: column q.{joint} runs from {least:.4g} to {most:.4g}, far beyond the joint's "
        f"limits {lower:.4g} to {upper:.4g} rad, as degrees would; expected rad, or wider limits in the model"
    )


def _by_velocity(recording: Recording, joint: str) -> str | None:
    if f"v.{joint}" not in recording.columns:
        return None
    ratio = _motion_ratio(recording.time, recording.columns[f"q.{joint}"], recording.columns[f"v.{joint}"])
    if ratio is None:
        return None
    # the factor may miss 180/π by a quarter: noise and filters of v change it, and no other unit is near
    if 0.8 * DEGREES < ratio < 1.25 * DEGREES:
        return (
            f"{recording.name}: column q.{joint} moves {ratio:.3g} times as far as the integral of "
            f"v.{joint}, as degrees would; expected rad"
        )
    if 0.8 / DEGREES < ratio < 1.25 / DEGREES:
        return (
            f"{recording.name}: the integral of column v.{joint} is {1 / ratio:.3g} times the motion of "
            f"q.{joint}, as degrees per second would be; expected rad/s"
        )
    if not 1.0 / LARGEST_GAIN < abs(ratio) < LARGEST_GAIN:
        return (
            f"{recording.name}: column q.{joint} moves {ratio:.3g} times as far as the integral of v.{joint}; "
            "expected rad and rad/s"
        )
    return None


def _motion_ratio(time: Array, q: Array, v: Array) -> float | None:
    """The motion of q divided by the integral of v, both without their linear trends; None where they differ in shape.

    Negative where they have opposite signs.
    """
    there = np.isfinite(q) & np.isfinite(v)
    if there.sum() < 10:  # with so few samples noise alone can correlate
        return None
    t, q, v = time[there], q[there], v[there]
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    # A constant offset of v is a ramp in its integral: without the linear trends only the motion is left.
    basis = np.column_stack([np.ones_like(t), t - t[0]])
    a, b = (y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0] for y in (travelled, q))
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    if scale == 0.0 or abs(float(a @ b)) < CORRELATED * scale:
        return None
    return float(np.linalg.norm(b) / np.linalg.norm(a)) * float(np.sign(a @ b))
