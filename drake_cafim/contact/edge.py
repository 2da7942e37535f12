"""The force of Drake's pressure field between a rigid sphere and the edge of a compliant box, in closed form.

In the box the pressure grows with the distance to the nearest face; its gradient G points inwards from that face. By
the divergence theorem the force on an immersed body is G times the volume of what is nearest to each face, along that
face's outward normal. Near an edge the plane at 45° between the two faces divides the immersed part of the sphere.
"""

from typing import Any

import numpy as np

from drake_cafim.typing import Array

HALF = np.sqrt(0.5)
NEARLY = 1.0 - 1e-9
"""A plane that misses the ball is moved to touch it: there all volumes and areas are as without it."""


MOST_COSINE = 1.0 - 1e-15
"""At 1 the derivative of arccos is infinite."""


def wedge_volume(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """V (...,) of the unit ball's part that is nearest to the first face, and ∂V/∂first, ∂V/∂second.

    `first` a and `second` b (...,) are how far the ball's centre is beyond the two faces, in radii. With the faces at
    x = −a and y = −b, the box where both are less, the part is x < −a and x − y > b − a. Its volume is a third of the
    integral of p·n over its surface, V = (Ω + Σ dᵢ Aᵢ)/3: dᵢ the distances of the two planes along their outward
    normals, Aᵢ their areas within the ball, and Ω = φ₁ d₁ + φ₂ d₂ + 2 θ the solid angle, by the theorem of Gauss and
    Bonnet, of arcs φᵢ that meet at the angle θ.
    """
    d1, d2 = _within(-first), _within(HALF * (first - second))
    r1, r2 = np.sqrt(1.0 - d1 * d1), np.sqrt(1.0 - d2 * d2)
    phi1, A1 = _segment(r1, d1 + 2.0 * HALF * d2)
    phi2, A2 = _segment(r2, d2 + 2.0 * HALF * d1)
    theta = np.pi - np.arccos(_within((-HALF - d1 * d2) / (r1 * r2), MOST_COSINE))
    solid = phi1 * d1 + phi2 * d2 + 2.0 * theta
    inside = (d1 > -NEARLY) & (d2 > -NEARLY)  # else nothing is immersed
    values = ((solid + d1 * A1 + d2 * A2) / 3.0, -A1 + HALF * A2, -HALF * A2)
    volume, by_first, by_second = (np.where(inside, value, 0.0 * first) for value in values)
    return volume, by_first, by_second


def _within(value: Any, most: float = NEARLY) -> Any:
    """`value` between −most and most; of AutoDiffXd where it is cut with zero derivatives, not without any."""
    return np.minimum(np.maximum(value, -most), most) + 0.0 * value


def _segment(radius: Any, reach: Any) -> tuple[Any, Any]:
    """Arc φ and area A (...,) of the part of a disc of `radius` below the line at `reach` from its centre."""
    cosine = _within(reach / radius, MOST_COSINE)
    half = np.pi - np.arccos(cosine)
    return 2.0 * half, radius * radius * (half + cosine * np.sqrt(1.0 - cosine * cosine))
