"""Compiled kinematics and dynamics of a batch of free bodies that may touch a plane.

Bodies are rows of 13 numbers, as in `State`, with rotation matrices `R` (B, 3, 3). The touch points are R p + `below`
for the K columns p of `points` (3, K) m in the body frame, `below` (3,) m in world axes; the plane is at `height` m
along its unit `normal` (3,).
"""

from typing import Any

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices


@compiled
def depths(numbers: Array, R: Array, points: Array, below: Array, normal: Array, height: float) -> tuple[Array, Array]:
    """The depth d (B, K) m of each point below the plane, and its rate ḋ (B, K) m/s."""
    B, K = len(numbers), points.shape[1]
    depth, sinking, r = np.empty((B, K)), np.empty((B, K)), np.empty(3)
    for i in range(B):
        w = numbers[i, 10:]
        for k in range(K):
            for x in range(3):
                r[x] = R[i, x, 0] * points[0, k] + R[i, x, 1] * points[1, k] + R[i, x, 2] * points[2, k] + below[x]
            deep, rate = height, 0.0
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                deep -= normal[x] * (numbers[i, x] + r[x])
                rate -= normal[x] * (numbers[i, 7 + x] + w[y] * r[z] - w[z] * r[y])
            depth[i, k], sinking[i, k] = deep, rate
    return depth, sinking


@compiled
def near_points(
    R: Array, points: Array, below: Array, depth: Array, mode: Any, reach: float
) -> tuple[Indices, Indices, Array]:
    """The points that touch, by `mode` (B, K), or are less than `reach` m above the plane, if that is positive.

    Indices of body (E,) and point (E,), and the levers (E, 3) m from the origins.
    """
    B, K = mode.shape
    rows, columns = np.empty(B * K, dtype=np.int64), np.empty(B * K, dtype=np.int64)
    lever, found = np.empty((B * K, 3)), 0
    for i in range(B):
        for k in range(K):
            if mode[i, k] or (reach > 0.0 and depth[i, k] > -reach):
                rows[found], columns[found] = i, k
                for x in range(3):
                    turned_x = R[i, x, 0] * points[0, k] + R[i, x, 1] * points[1, k] + R[i, x, 2] * points[2, k]
                    lever[found, x] = turned_x + below[x]
                found += 1
    return rows[:found], columns[:found], lever[:found]


@compiled
def contact_kinematics(
    numbers: Array, lever: Array, touching: Any, normal: Array, height: float
) -> tuple[Array, Array, Array, Array]:
    """Penetration m and its rate m/s (E,), slip m/s and position m (E, 3) of one point of each of E bodies.

    The penetration of those of `touching` (E,) is made positive, that of the others not positive: the mode, not
    rounding, decides which point presses.
    """
    E = len(numbers)
    held, rate, slip, position = np.empty(E), np.empty(E), np.empty((E, 3)), np.empty((E, 3))
    for i in range(E):
        w, r = numbers[i, 10:], lever[i]
        depth, faster = height, 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            position[i, x] = numbers[i, x] + r[x]
            slip[i, x] = numbers[i, 7 + x] + w[y] * r[z] - w[z] * r[y]
            depth -= normal[x] * position[i, x]
            faster -= normal[x] * slip[i, x]
        for x in range(3):
            slip[i, x] += faster * normal[x]
        rate[i] = faster
        held[i] = max(depth, 1e-15) if touching[i] else min(depth, 0.0)
    return held, rate, slip, position


@compiled
def add_forces(wrench: Array, rows: Indices, lever: Array, force: Array, moment: Array) -> None:
    """Adds forces and moments (E, 3) at levers to the bodies' wrenches (B, 2, 3), force first, about the origins."""
    for e in range(len(rows)):
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            wrench[rows[e], 0, x] += force[e, x]
            wrench[rows[e], 1, x] += moment[e, x] + lever[e, y] * force[e, z] - lever[e, z] * force[e, y]


@compiled
def acceleration(
    numbers: Array, R: Array, wrench: Array, mass: float, center: Array, inertia: Array, inverse: Array, gravity: Array
) -> Array:
    """(v̇, ω̇) (B, 6), world axes, by the weight and by wrenches (B, 2, 3); Newton–Euler about the body's origin.

    `center` (3,) m is the centre of mass and `inertia` (3, 3) kg m² that about the origin, body axes; `inverse` (6, 6)
    of the spatial inertia they make.
    """
    B = len(numbers)
    result, w, F, T, g, turning = np.empty((B, 6)), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    both, moved = np.empty(6), np.empty(6)
    for i in range(B):
        for x in range(3):
            w[x], F[x], T[x], g[x] = 0.0, 0.0, 0.0, 0.0
            for y in range(3):
                w[x] += R[i, y, x] * numbers[i, 10 + y]
                F[x] += R[i, y, x] * wrench[i, 0, y]
                T[x] += R[i, y, x] * wrench[i, 1, y]
                g[x] += R[i, y, x] * gravity[y] * mass
        turn = w[0] * center[0] + w[1] * center[1] + w[2] * center[2]
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        for x in range(3):
            turning[x] = inertia[x, 0] * w[0] + inertia[x, 1] * w[1] + inertia[x, 2] * w[2]
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            # ω × (ω × c) = (ω·c) ω − ω² c
            both[x] = F[x] + g[x] - mass * (turn * w[x] - square * center[x])
            both[3 + x] = T[x] + center[y] * g[z] - center[z] * g[y] - (w[y] * turning[z] - w[z] * turning[y])
        for r in range(6):
            moved[r] = 0.0
            for s in range(6):
                moved[r] += inverse[r, s] * both[s]
        for x in range(3):
            result[i, x] = R[i, x, 0] * moved[0] + R[i, x, 1] * moved[1] + R[i, x, 2] * moved[2]
            result[i, 3 + x] = R[i, x, 0] * moved[3] + R[i, x, 1] * moved[4] + R[i, x, 2] * moved[5]
    return result


@compiled
def velocity_slopes(
    R: Array, inverse: Array, rows: Indices, lever: Array, along: Array, across: Array, onward: Array, into: Array,
    normal: Array,
) -> Array:  # fmt: skip
    """∂(v̇, ω̇)/∂(v, ω) (B, 6, 6) by forces at points (E,) that oppose their velocity, with slopes (E,) N s/m.

    `onward` along the slip's direction `along` (E, 3), `across` it in the plane, and `into` along the normal.
    """
    B = len(R)
    wrench, result = np.zeros((B, 6, 6)), np.zeros((B, 6, 6))
    slope, arm, moved = np.empty((3, 3)), np.zeros((3, 6)), np.empty((6, 6))
    arm[0, 0] = arm[1, 1] = arm[2, 2] = 1.0
    for e in range(len(rows)):
        r = lever[e]
        arm[0, 4], arm[0, 5] = r[2], -r[1]
        arm[1, 3], arm[1, 5] = -r[2], r[0]
        arm[2, 3], arm[2, 4] = r[1], -r[0]
        for x in range(3):
            for y in range(3):
                slope[x, y] = (into[e] - across[e]) * normal[x] * normal[y]
                slope[x, y] += (onward[e] - across[e]) * along[e, x] * along[e, y]
            slope[x, x] += across[e]
        wrench[rows[e]] -= arm.T @ (slope @ arm)
    for i in range(B):
        for p in range(2):
            for q in range(2):
                block = R[i] @ (np.ascontiguousarray(inverse[3 * p : 3 * p + 3, 3 * q : 3 * q + 3]) @ R[i].T)
                moved[3 * p : 3 * p + 3, 3 * q : 3 * q + 3] = block
        result[i] = moved @ wrench[i]
    return result


@compiled
def time_to_land(
    numbers: Array, R: Array, points: Array, depth: Array, sinking: Array, mode: Any, acceleration: Array, normal: Array
) -> Array:
    """The time (B,) s until the first point lands that does not touch yet, at constant acceleration; ∞ for never."""
    B, K = mode.shape
    result, r, turning = np.empty(B), np.empty(3), np.empty(3)
    for i in range(B):
        result[i] = np.inf
        w, a = numbers[i, 10:], acceleration[i, 3:]
        for k in range(K):
            if mode[i, k] or depth[i, k] >= -1e-8:
                continue
            for x in range(3):
                r[x] = R[i, x, 0] * points[0, k] + R[i, x, 1] * points[1, k] + R[i, x, 2] * points[2, k]
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                turning[x] = w[y] * r[z] - w[z] * r[y]
            speeding = 0.0
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                # of a point that turns with the body n·(ω̇ × r + ω × (ω × r)) counts as well
                around = a[y] * r[z] - a[z] * r[y] + w[y] * turning[z] - w[z] * turning[y]
                speeding -= normal[x] * (acceleration[i, x] + around)
            square = sinking[i, k] ** 2 - 2.0 * speeding * depth[i, k]
            if square > 0.0 and sinking[i, k] + np.sqrt(square) > 1e-9:
                result[i] = min(result[i], -2.0 * depth[i, k] / (sinking[i, k] + np.sqrt(square)))
    return result


@compiled
def combine_stages(numbers: Array, step: Array, shares: Array, slopes: Array) -> Array:
    """The bodies (B, 13) plus step · Σ shares[i] slopes[i] over the first k of `slopes` (4, B, 13), normalised."""
    result = numbers.copy()
    for i in range(len(numbers)):
        for x in range(13):
            total = 0.0
            for k in range(len(shares)):
                total += shares[k] * slopes[k, i, x]
            result[i, x] += step[i] * total
        size = np.sqrt(result[i, 3] ** 2 + result[i, 4] ** 2 + result[i, 5] ** 2 + result[i, 6] ** 2)
        for x in range(3, 7):
            result[i, x] /= size
    return result


@compiled
def rates(numbers: Array, change: Array, into: Array) -> None:
    """Fills `into` (B, 13) with the time derivative of the bodies' numbers, given (v̇, ω̇) = `change` (B, 6)."""
    for i in range(len(numbers)):
        a, b, c, d = numbers[i, 3], numbers[i, 4], numbers[i, 5], numbers[i, 6]
        x, y, z = 0.5 * numbers[i, 10], 0.5 * numbers[i, 11], 0.5 * numbers[i, 12]
        into[i, :3] = numbers[i, 7:10]
        into[i, 3] = -x * b - y * c - z * d
        into[i, 4] = x * a + y * d - z * c
        into[i, 5] = y * a + z * b - x * d
        into[i, 6] = z * a + x * c - y * b
        into[i, 7:] = change[i]
