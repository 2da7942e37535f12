"""Contact kinematics of spheres on planes, their wrenches, and wrench sensor readings (compiled)."""

import numpy as np

from drake_cafim.contact.normal import normal_force_at
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices


@compiled
def touch_kinematics(
    R: Array, p: Array, V: Array, joint: int, p_JC: Array, radius: float, point: Array, normal: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Penetration m, rate m/s (N,), slip m/s and position m (N, 3) of a sphere's deepest point; and ω rad/s (N, 3).

    `R` (N, n, 3, 3), `p` (N, n, 3) and `V` (N, n, 6) are those of `Motion`; the sphere's centre `p_JC` (3,) m is fixed
    in the joint's frame J; the plane passes through `point` (3,) m with outward unit `normal` (3,), world frame.
    """
    N = len(p)
    penetration, rate = np.empty(N), np.empty(N)
    slip, place, w = np.empty((N, 3)), np.empty((N, 3)), np.empty((N, 3))
    for i in range(N):
        depth, faster = 0.0, 0.0
        for x in range(3):
            turned = R[i, joint, x, 0] * p_JC[0] + R[i, joint, x, 1] * p_JC[1] + R[i, joint, x, 2] * p_JC[2]
            place[i, x] = p[i, joint, x] + turned - radius * normal[x]
            w[i, x] = V[i, joint, x]
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            slip[i, x] = V[i, joint, 3 + x] + w[i, y] * place[i, z] - w[i, z] * place[i, y]
            depth -= normal[x] * (place[i, x] - point[x])
            faster -= normal[x] * slip[i, x]
        for x in range(3):
            slip[i, x] += faster * normal[x]
        penetration[i], rate[i] = depth, faster
    return penetration, rate, slip, place, w


@compiled
def _friction_ratio(normal: float, speed: float, law: Array) -> float:
    """Friction force divided by `speed`, N s/m, as of `slip_force` or `resistance_force`, for a `normal` force N."""
    friction, kind, width = law[4], law[5], law[6]
    if kind == 0.0:
        return 0.0
    rubbed: float = width
    if kind == 1.0:
        rubbed = friction * normal * (np.tanh(speed / width) / speed if speed > 0.0 else 1.0 / width)
    elif speed > 0.0 and friction * normal < width * speed:
        rubbed = friction * normal / speed
    return rubbed


@compiled
def sphere_wrenches(R: Array, p: Array, V: Array, joints: Indices, placed: Array, laws: Array) -> Array:
    """Wrenches (N, n, 6) on the links about the world's origin, moment first, by the contacts of C spheres with planes.

    `R`, `p` and `V` as for `touch_kinematics`. `joints` (C,) are the spheres' joints, `placed` (C, 10) centre, radius,
    point and normal of each, `laws` (C, 10) the numbers of its law, as in `SphereContact.numbers`.
    """
    wrench, f = np.zeros((*p.shape[:2], 6)), np.empty(3)
    for k in range(len(joints)):
        j, at, law = joints[k], placed[k], laws[k]
        depth, rate, slip, place, _ = touch_kinematics(R, p, V, j, at[:3], at[3], at[4:7], at[7:])
        for i in range(len(p)):
            # a law has damping or dissipation, never both: `law` holds the one that it has
            normal = normal_force_at(int(law[0]), depth[i], rate[i], law[1], law[2], law[2], law[7], law[8], law[3])[0]
            if normal == 0.0:
                continue
            speed = np.sqrt(slip[i, 0] * slip[i, 0] + slip[i, 1] * slip[i, 1] + slip[i, 2] * slip[i, 2])
            rubbed = _friction_ratio(normal, speed, law)
            lift = law[9] * depth[i]
            for x in range(3):
                f[x] = normal * at[7 + x] - rubbed * slip[i, x]
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                arm_y, arm_z = place[i, y] + lift * at[7 + y], place[i, z] + lift * at[7 + z]
                wrench[i, j, x] += arm_y * f[z] - arm_z * f[y]
                wrench[i, j, 3 + x] += f[x]
    return wrench


@compiled
def sensor_reading(R: Array, p: Array, joint: int, R_JS: Array, p_JS: Array, wrench: Array) -> Array:
    """The reading (N, 6), force then torque in a sensor's frame S about So, for a wrench about the world's origin.

    The wrench (N, 6) has its moment first; `R` and `p` as for `touch_kinematics`; `R_JS` (3, 3) and `p_JS` (3,) m are
    the sensor's pose in its joint's frame.
    """
    N = len(p)
    result, moment, at, onto = np.empty((N, 6)), np.empty(3), np.empty(3), np.empty(3)
    for i in range(N):
        for x in range(3):
            turned = R[i, joint, x, 0] * p_JS[0] + R[i, joint, x, 1] * p_JS[1] + R[i, joint, x, 2] * p_JS[2]
            at[x] = p[i, joint, x] + turned
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            moment[x] = wrench[i, x] - (at[y] * wrench[i, 3 + z] - at[z] * wrench[i, 3 + y])
        for part in range(2):
            for x in range(3):
                onto[x] = 0.0
                for y in range(3):
                    onto[x] += R[i, joint, y, x] * (wrench[i, 3 + y] if part == 0 else moment[y])
            for x in range(3):
                result[i, 3 * part + x] = R_JS[0, x] * onto[0] + R_JS[1, x] * onto[1] + R_JS[2, x] * onto[2]
    return result
