"""The normal force of the contact laws, and its derivatives.

With penetration d = −φ (m, positive in contact) and its rate ḋ (m/s, positive on approach):

    paper          λ = max(0, K d − C |ḋ|)                 as printed (paper, "Contact Model"); damps in both directions
    kelvin_voigt   λ = max(0, K d + C ḋ)   for d > 0        no adhesion, and no force before touch-down
    hunt_crossley  λ = K d max(0, 1 + c ḋ) for d > 0        Drake's compliant point contact
    hydroelastic   λ = P h² (1 − k h) max(0, 1 + c ḋ)       Drake's pressure field, see `pressure`; h = d − s for d > s,
                                                           at most 2/(3 k), where the force has its maximum
"""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

NormalLaw: TypeAlias = Literal["paper", "kelvin_voigt", "hunt_crossley", "hydroelastic"]
NORMAL_LAWS: tuple[str, ...] = get_args(NormalLaw)

Scalars: TypeAlias = float | Array
"""A float or an array that broadcasts over samples (..., ); AutoDiffXd arrays pass as well."""


@dataclass(frozen=True)
class NormalForce:
    """λ (...,) in N and its derivatives, each (...,); on a kink, the derivatives on the side out of contact."""

    force: Array
    wrt_penetration: Array
    wrt_rate: Array
    wrt_stiffness: Array
    wrt_damping: Array
    wrt_dissipation: Array


def normal_force(
    law: NormalLaw,
    penetration: Array,
    rate: Array,
    *,
    stiffness: Scalars,
    damping: Scalars = 0.0,
    dissipation: Scalars = 0.0,
    narrowing: Scalars = 1.0,
    deficit: Scalars = 0.0,
    smoothing: float = 0.0,
    added: Scalars = 0.0,
) -> Array:
    """λ (...,) in N of `law` for penetration (...,) m and penetration rate (...,) m/s.

    `stiffness` in N/m, `damping` in N s/m (paper, kelvin_voigt), `dissipation` in s/m (the others). Of `hydroelastic`
    `stiffness` is P in N/m², `narrowing` k in 1/m and `deficit` s in m; the other laws have neither.
    With `smoothing` s > 0 (N), max(0, f) becomes (f + √(f² + s²))/2, also for d < 0: a law without kinks, for
    programs that need derivatives everywhere. `added` (...,) N is added to the force before it is clipped at zero.

    Works on floats and on object arrays of AutoDiffXd. Raises `InputError` on an unknown law.
    """
    unclipped = _force_before_clipping(
        _index(law), penetration, rate, stiffness, damping, dissipation, narrowing, deficit
    )
    force = unclipped + added
    if smoothing > 0:
        return np.asarray(0.5 * (force + np.sqrt(force * force + smoothing**2)))
    return np.asarray(np.where((penetration > 0) & (force > 0), force, 0.0))


def _force_before_clipping(
    law: int,
    penetration: Any,
    rate: Any,
    stiffness: Any,
    damping: Any,
    dissipation: Any,
    narrowing: Any,
    deficit: Any,
) -> Any:
    """The force (...,) N of floats or arrays before it is clipped at zero; `law` is its index in `NORMAL_LAWS`."""
    if law == 0:
        return stiffness * penetration - damping * abs(rate)
    if law == 1:
        return stiffness * penetration + damping * rate
    if law == 2:
        return stiffness * penetration * (1.0 + dissipation * rate)
    # odd in h: out of contact it is negative, and clipped
    most = 2.0 / (3.0 * narrowing)
    h = np.minimum(np.maximum(penetration - deficit, -most), most)
    return stiffness * h * abs(h) * (1.0 - narrowing * abs(h)) * (1.0 + dissipation * rate)


force_before_clipping_at = compiled(_force_before_clipping)
"""The same from floats, for compiled loops."""


def _index(law: str) -> int:
    if law not in NORMAL_LAWS:
        raise InputError(f"contact law {law!r}: expected one of {', '.join(NORMAL_LAWS)}")
    return NORMAL_LAWS.index(law)


def normal_force_derivatives(
    law: NormalLaw,
    penetration: Array,
    rate: Array,
    *,
    stiffness: Scalars,
    damping: Scalars = 0.0,
    dissipation: Scalars = 0.0,
    narrowing: Scalars = 1.0,
    deficit: Scalars = 0.0,
    smoothing: float = 0.0,
) -> NormalForce:
    """`normal_force` with its analytic derivatives; arguments, shapes and errors are the same."""
    index = _index(law)
    arguments = (penetration, rate, stiffness, damping, dissipation, narrowing, deficit)
    shape = np.broadcast_shapes(*map(np.shape, arguments))
    full = np.empty((len(arguments), *shape))
    for number, argument in enumerate(arguments):
        full[number] = argument
    values = _each(index, *full.reshape(len(arguments), -1), smoothing)
    return NormalForce(*values.reshape(6, *shape))


@compiled
def normal_force_at(
    law: int,
    penetration: float,
    rate: float,
    stiffness: float,
    damping: float,
    dissipation: float,
    narrowing: float,
    deficit: float,
    smoothing: float,
) -> tuple[float, float, float, float, float, float]:
    """The six numbers of `NormalForce` from floats; `law` is the law's index in `NORMAL_LAWS`.

    For compiled loops; bit-identical with `normal_force_derivatives`.
    """
    speed, slope = rate, 1.0
    if law == 0:
        speed, slope = -abs(rate), -np.sign(rate)
    through = 1.0 + dissipation * rate
    unclipped = force_before_clipping_at(law, penetration, rate, stiffness, damping, dissipation, narrowing, deficit)
    if smoothing > 0:
        root = np.sqrt(unclipped * unclipped + smoothing**2)
        force, active = 0.5 * (unclipped + root), 0.5 * (1.0 + unclipped / root)
    else:
        active = 1.0 if penetration > 0 and unclipped > 0 else 0.0
        force = unclipped if active > 0 else 0.0
    if law == 2:
        factor, product = active * through, active * penetration
        rates = stiffness * dissipation * product
        return force, stiffness * factor, rates, penetration * factor, 0.0, stiffness * product * rate
    if law == 3:
        most = 2.0 / (3.0 * narrowing)
        h = min(max(penetration - deficit, -most), most)
        size = h * abs(h) * (1.0 - narrowing * abs(h)) * active
        slope = abs(h) * (2.0 - 3.0 * narrowing * abs(h)) * active
        return (
            force,
            stiffness * slope * through,
            stiffness * size * dissipation,
            size * through,
            0.0,
            stiffness * size * rate,
        )
    return force, stiffness * active, damping * slope * active, penetration * active, speed * active, 0.0


@compiled
def _each(
    law: int,
    penetration: Array,
    rate: Array,
    stiffness: Array,
    damping: Array,
    dissipation: Array,
    narrowing: Array,
    deficit: Array,
    smoothing: float,
) -> Array:
    """`normal_force_at` for each of the samples (N,), as (6, N)."""
    values = np.empty((6, len(rate)))
    for i in range(len(rate)):
        at = normal_force_at(
            law,
            penetration[i],
            rate[i],
            stiffness[i],
            damping[i],
            dissipation[i],
            narrowing[i],
            deficit[i],
            smoothing,
        )
        for j in range(6):
            values[j, i] = at[j]
    return values
