"""Generalized momenta and forces of a tree by its links' inertial parameters, compiled, without a motion being kept.

A long recording's poses and velocities take more time to be written to memory and read again than to be computed.
Notation and arguments are those of `recursions`; inertial parameters are those of `Tree.inertial_parameters`.
"""

import numpy as np

from drake_cafim.dynamics.recursions import into_frame, place
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices


@compiled
def momenta(
    parents: Indices, R_PF: Array, p_PF: Array, joint_axes: Array, prismatic: Indices, parameters: Array,
    q: Array, v: Array,
) -> Array:  # fmt: skip
    """M(q) v (N, n), without rotor inertias, for `parameters` (n, 10): S_k · h of the subtree beyond joint k."""
    N, n = q.shape
    momentum = np.empty((N, n))
    R, p, S, V, F, h = _work_arrays(n)
    local = np.empty(6)
    for i in range(N):
        place(parents, R_PF, p_PF, joint_axes, prismatic, q[i], v[i], R, p, S, V, F)
        for j in range(n):
            _momentum(R[j], p[j], V[j], parameters[j], local, h[j])
        for j in range(n - 1, -1, -1):
            momentum[i, j] = 0.0
            for r in range(6):
                momentum[i, j] += S[j, r] * h[j, r]
                if parents[j] >= 0:
                    h[parents[j], r] += h[j, r]
    return momentum


@compiled
def inertial_forces(
    parents: Indices, R_PF: Array, p_PF: Array, joint_axes: Array, prismatic: Indices, parameters: Array,
    q: Array, v: Array, gravity: Array,
) -> Array:  # fmt: skip
    """∂T/∂q + gravity (N, n) under `gravity` (3,) m/s²: Ṡ_k · h + S_k · w, w the weight of the subtree beyond k."""
    N, n = q.shape
    force = np.empty((N, n))
    R, p, S, V, F, h = _work_arrays(n)
    local, lump = np.empty(6), np.empty((n, 4))
    for i in range(N):
        place(parents, R_PF, p_PF, joint_axes, prismatic, q[i], v[i], R, p, S, V, F)
        for j in range(n):
            own = parameters[j]
            _momentum(R[j], p[j], V[j], own, local, h[j])
            lump[j, 3] = own[0]
            for r in range(3):
                lump[j, r] = own[0] * p[j, r] + R[j, r, 0] * own[1] + R[j, r, 1] * own[2] + R[j, r, 2] * own[3]
        for j in range(n - 1, -1, -1):
            W, A, g, c = V[j], S[j], h[j], lump[j]
            if parents[j] >= 0:
                for r in range(6):
                    h[parents[j], r] += g[r]
                for r in range(4):
                    lump[parents[j], r] += c[r]
            total = 0.0
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                total += A[x] * (c[y] * gravity[z] - c[z] * gravity[y]) + A[3 + x] * c[3] * gravity[x]
                total += g[x] * (W[y] * A[z] - W[z] * A[y])
                total += g[3 + x] * (W[y] * A[3 + z] - W[z] * A[3 + y] + W[3 + y] * A[z] - W[3 + z] * A[y])
            force[i, j] = total
    return force


@compiled
def _work_arrays(n: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """R, p, S, V and the work array F of `place`, and h (n, 6)."""
    return (
        np.empty((n, 3, 3)),
        np.empty((n, 3)),
        np.zeros((n, 6)),
        np.empty((n, 6)),
        np.empty((3, 3)),
        np.empty((n, 6)),
    )


@compiled
def _momentum(R: Array, p: Array, V: Array, parameters: Array, local: Array, h: Array) -> None:
    """Writes the momentum h (6,) about the world's origin of a link with these `parameters` (10,) in its frame (R, p).

    `local` (6,) is a work array.
    """
    into_frame(R, p, V, local)
    wx, wy, wz, ux, uy, uz = local[0], local[1], local[2], local[3], local[4], local[5]
    m, cx, cy, cz = parameters[0], parameters[1], parameters[2], parameters[3]
    fx, fy, fz = m * ux + wy * cz - wz * cy, m * uy + wz * cx - wx * cz, m * uz + wx * cy - wy * cx
    tx = parameters[4] * wx + parameters[7] * wy + parameters[8] * wz + cy * uz - cz * uy
    ty = parameters[7] * wx + parameters[5] * wy + parameters[9] * wz + cz * ux - cx * uz
    tz = parameters[8] * wx + parameters[9] * wy + parameters[6] * wz + cx * uy - cy * ux
    for r in range(3):
        h[r] = R[r, 0] * tx + R[r, 1] * ty + R[r, 2] * tz
        h[3 + r] = R[r, 0] * fx + R[r, 1] * fy + R[r, 2] * fz
    h[0] += p[1] * h[5] - p[2] * h[4]
    h[1] += p[2] * h[3] - p[0] * h[5]
    h[2] += p[0] * h[4] - p[1] * h[3]
