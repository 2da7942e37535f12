"""Recursive rigid-body algorithms (kinematics, mass matrix, bias, momentum), compiled, over many samples.

Spatial vectors are about the world origin, in world axes, angular part first; a link's inertia is ten numbers: mass,
first moment, and the inertia about the origin (xx, yy, zz, xy, xz, yz) (Featherstone, Rigid Body Dynamics Algorithms,
2008, ch. 5, 6).
"""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices


@compiled
def kinematics(
    parents: Indices, R_PF: Array, p_PF: Array, joint_axes: Array, prismatic: Indices, q: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    """Poses R (N, n, 3, 3), p (N, n, 3) of the joints' moving frames, axes S and velocities V (N, n, 6).

    For `q` and `v` (N, n). `parents` (n,) are the parent joints' indices, −1 for the world; R_PF (n, 3, 3) and p_PF
    (n, 3) m the joints' poses on their parents; `joint_axes` (n, 3) in F; `prismatic` (n,) 1 or 0 for revolute.
    """
    N, n = q.shape
    R, p = np.empty((N, n, 3, 3)), np.empty((N, n, 3))
    S, V = np.zeros((N, n, 6)), np.zeros((N, n, 6))
    F = np.empty((3, 3))
    for i in range(N):
        place(parents, R_PF, p_PF, joint_axes, prismatic, q[i], v[i], R[i], p[i], S[i], V[i], F)
    return R, p, S, V


@compiled
def place(
    parents: Indices, R_PF: Array, p_PF: Array, joint_axes: Array, prismatic: Indices, q: Array, v: Array,
    R: Array, p: Array, S: Array, V: Array, F: Array,
) -> None:  # fmt: skip
    """Writes R (n, 3, 3), p (n, 3), S and V (n, 6) of one sample `q`, `v` (n,), as `kinematics`.

    `F` (3, 3) is a work array; S must be zero where it is not written.
    """
    for j in range(len(parents)):
        parent, axis = parents[j], joint_axes[j]
        for r in range(3):
            p[j, r] = p_PF[j, r]
            for s in range(3):
                F[r, s] = R_PF[j, r, s]
        if parent >= 0:
            for r in range(3):
                p[j, r] = p[parent, r]
                for s in range(3):
                    p[j, r] += R[parent, r, s] * p_PF[j, s]
                    F[r, s] = 0.0
                    for t in range(3):
                        F[r, s] += R[parent, r, t] * R_PF[j, t, s]
        ax = F[0, 0] * axis[0] + F[0, 1] * axis[1] + F[0, 2] * axis[2]
        ay = F[1, 0] * axis[0] + F[1, 1] * axis[1] + F[1, 2] * axis[2]
        az = F[2, 0] * axis[0] + F[2, 1] * axis[1] + F[2, 2] * axis[2]
        if prismatic[j]:
            for r in range(3):
                for s in range(3):
                    R[j, r, s] = F[r, s]
            p[j, 0] += ax * q[j]
            p[j, 1] += ay * q[j]
            p[j, 2] += az * q[j]
            S[j, 3], S[j, 4], S[j, 5] = ax, ay, az
        else:
            # Rodrigues' formula: F rotated about the joint's axis
            sine, versine = np.sin(q[j]), 1.0 - np.cos(q[j])
            x, y, z = axis[0], axis[1], axis[2]
            for r in range(3):
                along = (F[r, 0] * x + F[r, 1] * y + F[r, 2] * z) * versine
                keep = 1.0 - versine
                R[j, r, 0] = keep * F[r, 0] + along * x + sine * (F[r, 1] * z - F[r, 2] * y)
                R[j, r, 1] = keep * F[r, 1] + along * y + sine * (F[r, 2] * x - F[r, 0] * z)
                R[j, r, 2] = keep * F[r, 2] + along * z + sine * (F[r, 0] * y - F[r, 1] * x)
            px, py, pz = p[j, 0], p[j, 1], p[j, 2]
            S[j, 0], S[j, 1], S[j, 2] = ax, ay, az
            S[j, 3], S[j, 4], S[j, 5] = py * az - pz * ay, pz * ax - px * az, px * ay - py * ax
        for r in range(6):
            V[j, r] = S[j, r] * v[j]
            if parent >= 0:
                V[j, r] += V[parent, r]


@compiled
def into_frame(R: Array, p: Array, V_W: Array, V: Array) -> None:
    """Transforms a spatial vector V_W (6,) about the world's origin into `V` about the origin of the frame (R, p)."""
    x = V_W[3] + V_W[1] * p[2] - V_W[2] * p[1]
    y = V_W[4] + V_W[2] * p[0] - V_W[0] * p[2]
    z = V_W[5] + V_W[0] * p[1] - V_W[1] * p[0]
    for r in range(3):
        V[r] = R[0, r] * V_W[0] + R[1, r] * V_W[1] + R[2, r] * V_W[2]
        V[3 + r] = R[0, r] * x + R[1, r] * y + R[2, r] * z


@compiled
def _momentum(inertia: Array, V: Array, h: Array) -> None:
    """Writes h (6,) = I V for an inertia I of ten numbers."""
    m, x, y, z = inertia[0], inertia[1], inertia[2], inertia[3]
    h[0] = inertia[4] * V[0] + inertia[7] * V[1] + inertia[8] * V[2] + y * V[5] - z * V[4]
    h[1] = inertia[7] * V[0] + inertia[5] * V[1] + inertia[9] * V[2] + z * V[3] - x * V[5]
    h[2] = inertia[8] * V[0] + inertia[9] * V[1] + inertia[6] * V[2] + x * V[4] - y * V[3]
    h[3] = m * V[3] - y * V[2] + z * V[1]
    h[4] = m * V[4] - z * V[0] + x * V[2]
    h[5] = m * V[5] - x * V[1] + y * V[0]


@compiled
def _inertia(
    R: Array, p: Array, mass: float, center: Array, inertia: Array, turned: Array, c: Array, found: Array
) -> None:
    """Writes into `found` (10,) the inertia, about the world origin, of the bodies fixed to a joint's moving frame.

    Its pose is `R` (3, 3), `p` (3,); `turned` (3, 3) and `c` (3,) are work arrays.
    """
    for r in range(3):
        c[r] = p[r]
        for s in range(3):
            c[r] += R[r, s] * center[s]
            turned[r, s] = 0.0
            for t in range(3):
                turned[r, s] += R[r, t] * inertia[t, s]
    square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    found[0] = mass
    for r in range(3):
        found[1 + r] = mass * c[r]
        # parallel axis from the centre of mass to the world's origin
        found[4 + r] = mass * (square - c[r] * c[r])
        for t in range(3):
            found[4 + r] += turned[r, t] * R[r, t]
    for k, r, s in ((7, 0, 1), (8, 0, 2), (9, 1, 2)):
        found[k] = -mass * c[r] * c[s]
        for t in range(3):
            found[k] += turned[r, t] * R[s, t]


@compiled
def _loads(
    parents: Indices, R: Array, p: Array, S: Array, V: Array, v: Array, mass: Array, center: Array, inertia: Array,
    gravity: Array, total: Array, force: Array, acceleration: Array,
) -> None:  # fmt: skip
    """The spatial inertia `total` (n, 10) of each link and the `force` (n, 6) that it needs, joints not accelerating.

    Of one configuration; `acceleration` (n, 6) is overwritten with that of the links. Newton-Euler, from base to tip.
    """
    turned, c, h = np.empty((3, 3)), np.empty(3), np.empty(6)
    for j in range(len(v)):
        _inertia(R[j], p[j], mass[j], center[j], inertia[j], turned, c, total[j])
        W, A, parent, rate = V[j], S[j], parents[j], v[j]
        a = acceleration[j]
        for r in range(3):
            a[r] = 0.0 if parent < 0 else acceleration[parent, r]
            # a base that accelerates against gravity stands for the links' weight
            a[3 + r] = -gravity[r] if parent < 0 else acceleration[parent, 3 + r]
        a[0] += rate * (W[1] * A[2] - W[2] * A[1])
        a[1] += rate * (W[2] * A[0] - W[0] * A[2])
        a[2] += rate * (W[0] * A[1] - W[1] * A[0])
        a[3] += rate * (W[1] * A[5] - W[2] * A[4] + W[4] * A[2] - W[5] * A[1])
        a[4] += rate * (W[2] * A[3] - W[0] * A[5] + W[5] * A[0] - W[3] * A[2])
        a[5] += rate * (W[0] * A[4] - W[1] * A[3] + W[3] * A[1] - W[4] * A[0])
        _momentum(total[j], a, force[j])
        _momentum(total[j], W, h)
        force[j, 0] += W[1] * h[2] - W[2] * h[1] + W[4] * h[5] - W[5] * h[4]
        force[j, 1] += W[2] * h[0] - W[0] * h[2] + W[5] * h[3] - W[3] * h[5]
        force[j, 2] += W[0] * h[1] - W[1] * h[0] + W[3] * h[4] - W[4] * h[3]
        force[j, 3] += W[1] * h[5] - W[2] * h[4]
        force[j, 4] += W[2] * h[3] - W[0] * h[5]
        force[j, 5] += W[0] * h[4] - W[1] * h[3]


@compiled
def equations(
    parents: Indices, R: Array, p: Array, S: Array, V: Array, v: Array, mass: Array, center: Array, inertia: Array,
    gravity: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """M (N, n, n) by composite inertias, and C v − gravity (N, n) by Newton-Euler recursion, without rotor inertias.

    R, p, S, V are the outputs of `kinematics`; `mass` (n,) kg, `center` (n, 3) m and central `inertia` (n, 3, 3) kg m²
    those of the bodies fixed to each joint's moving frame, as `Tree.lumps`; `gravity` (3,) m/s², world axes.
    """
    N, n = v.shape
    M, bias = np.zeros((N, n, n)), np.empty((N, n))
    total, force, acceleration, f = np.empty((n, 10)), np.empty((n, 6)), np.empty((n, 6)), np.empty(6)
    for i in range(N):
        _loads(
            parents, R[i], p[i], S[i], V[i], v[i], mass, center, inertia, gravity, total, force, acceleration
        )  # fmt: skip
        for j in range(n - 1, -1, -1):
            _momentum(total[j], S[i, j], f)
            bias[i, j] = 0.0
            for r in range(6):
                bias[i, j] += S[i, j, r] * force[j, r]
            k = j
            while k >= 0:
                along = 0.0
                for r in range(6):
                    along += f[r] * S[i, k, r]
                M[i, j, k] = M[i, k, j] = along
                k = parents[k]
            if parents[j] >= 0:
                for r in range(10):
                    total[parents[j], r] += total[j, r]
                for r in range(6):
                    force[parents[j], r] += force[j, r]
    return M, bias


@compiled
def bias_forces(
    parents: Indices, R: Array, p: Array, S: Array, V: Array, v: Array, mass: Array, center: Array, inertia: Array,
    gravity: Array,
) -> Array:  # fmt: skip
    """C v − gravity (N, n) alone, as `equations` has it."""
    N, n = v.shape
    total, force, acceleration = np.empty((n, 10)), np.empty((N, n, 6)), np.empty((n, 6))
    for i in range(N):
        _loads(
            parents, R[i], p[i], S[i], V[i], v[i], mass, center, inertia, gravity, total, force[i], acceleration
        )  # fmt: skip
    bias: Array = project_wrenches(parents, S, force)
    return bias


@compiled
def velocities(parents: Indices, S: Array, v: Array) -> Array:
    """Spatial velocities V (N, n, 6) of the joints' moving frames at joint velocities `v` (N, n); S as `kinematics`."""
    N, n = v.shape
    V = np.empty((N, n, 6))
    for i in range(N):
        for j in range(n):
            for r in range(6):
                V[i, j, r] = S[i, j, r] * v[i, j] + (V[i, parents[j], r] if parents[j] >= 0 else 0.0)
    return V


@compiled
def momentum_terms(
    parents: Indices, R: Array, p: Array, S: Array, V: Array, mass: Array, center: Array, inertia: Array, gravity: Array
) -> tuple[Array, Array]:
    """Generalized momentum M v and ∂T/∂q + gravity, each (N, n), without rotor inertias; arguments as of `equations`.

    With h the momentum and w the weight of the subtree beyond joint k, they are S_k·h and Ṡ_k·h + S_k·w, Ṡ = V × S.
    """
    N, n = S.shape[:2]
    momentum, force = np.empty((N, n)), np.empty((N, n))
    h, w, link, pull = np.empty((n, 6)), np.empty((n, 6)), np.empty(10), np.zeros(6)
    turned, c = np.empty((3, 3)), np.empty(3)
    for r in range(3):
        pull[3 + r] = gravity[r]
    for i in range(N):
        for j in range(n):
            _inertia(R[i, j], p[i, j], mass[j], center[j], inertia[j], turned, c, link)
            _momentum(link, V[i, j], h[j])
            _momentum(link, pull, w[j])
        for j in range(n - 1, -1, -1):
            W, A, g = V[i, j], S[i, j], h[j]
            momentum[i, j], force[i, j] = 0.0, 0.0
            for r in range(6):
                momentum[i, j] += A[r] * g[r]
                force[i, j] += A[r] * w[j, r]
                if parents[j] >= 0:
                    h[parents[j], r] += g[r]
                    w[parents[j], r] += w[j, r]
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                force[i, j] += g[x] * (W[y] * A[z] - W[z] * A[y])
                force[i, j] += g[3 + x] * (W[y] * A[3 + z] - W[z] * A[3 + y] + W[3 + y] * A[z] - W[3 + z] * A[y])
    return momentum, force


@compiled
def project_wrenches(parents: Indices, S: Array, wrench: Array) -> Array:
    """Generalized forces (N, n) of wrenches (N, n, 6) on the links: S_k · the sum of the wrenches on k's subtree."""
    N, n = wrench.shape[:2]
    result, total = np.empty((N, n)), np.empty((n, 6))
    for i in range(N):
        for j in range(n):
            for r in range(6):
                total[j, r] = wrench[i, j, r]
        for j in range(n - 1, -1, -1):
            result[i, j] = 0.0
            for r in range(6):
                result[i, j] += S[i, j, r] * total[j, r]
                if parents[j] >= 0:
                    total[parents[j], r] += total[j, r]
    return result
