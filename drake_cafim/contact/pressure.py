"""The force of Drake's pressure field between a sphere and a flat body, in closed form (the law `hydroelastic`).

Elandt, Drumwright, Sherman and Ruina, "A pressure field model for fast, robust approximation of net contact force and
moment between nominally rigid objects", 2019. One of two bodies is compliant: its pressure is 0 on its surface and
grows linearly with depth.

A compliant sphere of radius R on a rigid plane has the pressure E (1 − r/R), r the distance from its centre. Over the
circle in which the plane cuts it at depth d,

    λ = π E (d² − 2 d³/(3 R))                                       up to d = R, where λ has its maximum

A rigid sphere in a compliant box, whose pressure is E times the depth over H, half the box's smallest extent: by the
divergence theorem the force is the field's gradient times the volume V = π d² (R − d/3) of the immersed cap,

    λ = (E / H) V = π E (R / H) (d² − d³/(3 R))                      up to d = 2 R

Both are P d² (1 − k d). Drake replaces a sphere by a polyhedron with its vertices on the sphere, which is smaller: R
and d are both less by a mean distance, `surface_deficit`. How it dissipates: pressures are multiplied by
max(0, 1 + c ḋ), Hunt and Crossley's factor.
"""

import numpy as np

from drake_cafim.contact.normal import Scalars

DEFICIT = 0.51
"""Of a sphere's octahedral mesh, refined L times: mean distance between the polyhedron and the sphere is this times
R/4^L. The number with the least largest deviation from Drake at L = 2 and 3; `tests/test_pressure.py` compares them."""


def surface_deficit(radius: Scalars, resolution: float) -> Scalars:
    """By how much, m, Drake's mesh of a sphere of `radius` m lies below it on average, for a resolution hint m.

    Drake refines an octahedron until its edges are shorter than the hint; 0 stands for the exact sphere.
    """
    if resolution <= 0.0:
        return 0.0 * radius
    refinements = np.clip(np.ceil(np.log2(np.sqrt(2.0) * radius / resolution)), 0, 8)
    return np.asarray(DEFICIT * radius / 4.0**refinements)


def field_numbers(
    modulus: Scalars, radius: Scalars, half_extent: Scalars = 0.0, resolution: float = 0.0
) -> tuple[Scalars, Scalars, Scalars]:
    """P (N/m²), k (1/m) and deficit (m) of the law, for a `modulus` E Pa and a sphere of `radius` R m.

    With `half_extent` H m the flat body is the compliant one, with 0 the sphere. `resolution` m is the hint for the
    sphere's mesh.
    """
    deficit = surface_deficit(radius, resolution)
    R = radius - deficit
    if np.ndim(half_extent) == 0 and half_extent == 0.0:
        return np.pi * modulus, 2.0 / (3.0 * R), deficit
    return np.pi * modulus * R / half_extent, 1.0 / (3.0 * R), deficit


def modulus_for(force: float, stiffness: float, radius: float, half_extent: float = 0.0) -> float:
    """The modulus, Pa, at which the force at rest is `force` N at the depth `force` / `stiffness` (N/m).

    Where that is deeper than the law reaches, at its greatest depth.
    """
    P, k, _ = field_numbers(1.0, radius, half_extent)
    depth = min(force / stiffness, 2.0 / (3.0 * float(k)))
    return float(force / (P * depth**2 * (1.0 - k * depth)))
