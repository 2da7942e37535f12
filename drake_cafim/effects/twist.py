"""Time integration of the twist between a rotor and its link (compiled)."""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


@compiled
def transition(pull: Array, drag: Array, step: Array) -> Array:
    """The entries (4, N) ψψ, ψψ̇, ψ̇ψ, ψ̇ψ̇ of exp(A h) over steps h (N,) for ψ̈ = −pull ψ − drag ψ̇, each (N,)."""
    phi = np.empty((4, len(step)))
    for k in range(len(step)):
        half, h = 0.5 * drag[k], step[k]
        square = half * half - pull[k]
        root = max(np.sqrt(abs(square)), 1e-6)
        if square < 0.0:
            decay = np.exp(-half * h)
            cosine, sine = decay * np.cos(root * h), decay * np.sin(root * h) / root
        else:
            # overdamped: both exponents are negative, so that neither exponential overflows
            slow, fast = np.exp((root - half) * h), np.exp(-(root + half) * h)
            cosine, sine = 0.5 * (slow + fast), 0.5 * (slow - fast) / root
        phi[0, k], phi[1, k] = cosine + half * sine, sine
        phi[2, k], phi[3, k] = -pull[k] * sine, cosine - half * sine
    return phi


@compiled
def linear_twist_rate(phi: Array, rest: Array, twist: float, rate: float) -> Array:
    """ψ̇ (N,) from initial `twist` ψ and `rate` ψ̇, by transition matrices (4, N − 1) about equilibria `rest` (N,)."""
    rates = np.empty(len(rest))
    rates[0] = rate
    for k in range(len(rest) - 1):
        x = twist - rest[k]
        twist, rate = rest[k] + phi[0, k] * x + phi[1, k] * rate, phi[2, k] * x + phi[3, k] * rate
        rates[k + 1] = rate
    return rates


@compiled
def backlash_twist_rate(
    half: float, stiffness: float, damping: float, parts: int, step: Array, transition: Array, rest: Array,
    push: Array, mobility: Array, twist: float, rates: Array,
) -> Array:  # fmt: skip
    """Fills `rates` (N,) with ψ̇ at the samples, from rest at `twist`, for a gap from −`half` to `half`.

    An interval has `parts` steps of `step` (N − 1,) s. On a flank each step is `transition` (4, N − 1) about the
    equilibrium `rest` (N,) beyond the gap's end; between the flanks only the constant `push` accelerates the twist.
    """
    rate = 0.0
    rates[0] = rate
    for k in range(len(step)):
        a, b, c, d = transition[0, k], transition[1, k], transition[2, k], transition[3, k]
        h, g = step[k], push[k]
        for _ in range(parts):
            if twist > half and stiffness * (twist - half) + damping * rate > 0.0:
                x = twist - half - rest[k]
                twist, rate = half + rest[k] + a * x + b * rate, c * x + d * rate
            elif twist < -half and stiffness * (twist + half) + damping * rate < 0.0:
                x = twist + half - rest[k]
                twist, rate = rest[k] - half + a * x + b * rate, c * x + d * rate
            else:
                before = twist
                twist, rate = twist + h * (rate + 0.5 * h * g), rate + h * g
                wall = half if twist > half else -half
                if (before - wall) * (twist - wall) < 0.0 and abs(twist) > half:
                    # impact within the step: the flank's force acts for the remaining time
                    left = h * (twist - wall) / (twist - before)
                    force = 0.5 * stiffness * (twist - wall) + damping * rate
                    if force * wall > 0.0:
                        rate -= force * left * mobility[k]
        rates[k + 1] = rate
    return rates
