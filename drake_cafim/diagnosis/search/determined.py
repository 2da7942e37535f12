"""Whether the recordings determine the strengths of an effect."""

import numpy as np

from drake_cafim.diagnosis.fit.fitting import NOTHING_KNOWN
from drake_cafim.diagnosis.thresholds import UNDETERMINED_STD_SHARE
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

UNSEEN_STD = 0.5 * float(np.sqrt(NOTHING_KNOWN))
"""Standard deviation, by linearisation, of a strength that changes nothing in the recordings."""


def undetermined(effect: Effect, std: Array, linear_std: Array) -> tuple[str, float, float] | None:
    """A strength whose standard deviation is too large a share of what it may be: its name, the std and that size.

    That size is the width of its bounds or, where they are not finite, the larger of its value and its typical size.
    `std` and `linear_std` (k,) are those of the effect's strengths, the second by linearisation alone.

    A component that changes nothing in the recordings, as that of a force along the axis of the only joint, says
    nothing against the others.
    """
    seen = bool(np.any(linear_std < UNSEEN_STD))
    for strength, deviation, linear in zip(effect.strengths, std, linear_std, strict=True):
        if seen and linear >= UNSEEN_STD:
            continue
        value, width = effect.values[strength.name], strength.upper - strength.lower
        size = width if np.isfinite(width) else max(abs(value), strength.typical)
        if not deviation <= UNDETERMINED_STD_SHARE * size:
            return strength.name, float(deviation), float(size)
    return None
