"""Time integration of many simulations at once (compiled)."""

import numpy as np

from drake_cafim.dynamics.recursions import bias_forces, equations, kinematics, project_wrenches, velocities
from drake_cafim.dynamics.touching import sphere_wrenches
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices


@compiled
def _solve(A: Array, b: Array) -> None:
    """Overwrites `b` (n,) with A⁻¹ b by Gaussian elimination with partial pivoting; `A` (n, n) is overwritten too.

    Where `A` is singular or not finite, as once a simulation runs away, with NaN: compiled code raises an error at a
    division by zero, and with it all simulations that are made at once would be lost.
    """
    n = len(b)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if not abs(A[pivot, k]) > 0.0:
            for i in range(n):
                b[i] = np.nan
            return
        if pivot != k:
            for j in range(n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            b[k], b[pivot] = b[pivot], b[k]
        for i in range(k + 1, n):
            share = A[i, k] / A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= share * A[k, j]
            b[i] -= share * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= A[k, j] * b[j]
        b[k] /= A[k, k]


@compiled
def integrate(
    parents: Indices, R_PF: Array, p_PF: Array, joint_axes: Array, prismatic: Indices, mass: Array, center: Array,
    inertia: Array, rotors: Array, dampings: Array, gravity: Array, joints: Indices, placed: Array, laws: Array,
    q: Array, v: Array, force: Array, slope: Array, duration: Array, count: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Positions and velocities (B, n) after `count` steps of `duration` (B,) s each, by the rule of `stepper.step`.

    The tree's arrays as for `kinematics` and `equations`, `rotors` and `dampings` (n,) of its joints, contacts as for
    `sphere_wrenches`. `force` (B, n) acts at the joints in addition to damping; its `slope` ∂force/∂v (B, n) enters
    implicitly.
    """
    B, n = q.shape
    q, v, change, implicit = q.copy(), v.copy(), np.empty((B, n)), np.empty((n, n))
    middle, rate = np.empty((B, n)), np.empty((B, n))
    for _ in range(count):
        for i in range(B):
            for j in range(n):
                middle[i, j] = q[i, j] + 0.5 * duration[i] * v[i, j]
        R, p, S, V = kinematics(parents, R_PF, p_PF, joint_axes, prismatic, middle, v)
        M, bias = equations(parents, R, p, S, V, v, mass, center, inertia, gravity)
        push = project_wrenches(parents, S, sphere_wrenches(R, p, V, joints, placed, laws))
        for stage in range(2):
            for i in range(B):
                h = duration[i]
                for j in range(n):
                    for k in range(n):
                        implicit[j, k] = M[i, j, k]
                    implicit[j, j] += rotors[j] + 0.5 * h * (dampings[j] - slope[i, j])
                    change[i, j] = h * (force[i, j] - dampings[j] * v[i, j] - bias[i, j] + push[i, j])
                _solve(implicit, change[i])
            if stage == 0:
                for i in range(B):
                    for j in range(n):
                        rate[i, j] = v[i, j] + 0.5 * change[i, j]
                V = velocities(parents, S, rate)
                bias = bias_forces(parents, R, p, S, V, rate, mass, center, inertia, gravity)
                push = project_wrenches(parents, S, sphere_wrenches(R, p, V, joints, placed, laws))
        for i in range(B):
            for j in range(n):
                q[i, j] += duration[i] * (v[i, j] + 0.5 * change[i, j])
                v[i, j] += change[i, j]
    return q, v
