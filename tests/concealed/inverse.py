"""Inverse dynamics of an arm at many samples at once: Newton and Euler's recursion in the links' own axes.

Vectors have their components first and samples last, (3, N), and matrices are (3, 3, N): each operation runs over all
samples. What moves is reckoned once; efforts are then linear in the masses that are carried along.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .robots import Array, Joint, Link, Robot


def cross(a: Array, b: Array) -> Array:
    """Products of vectors (3, N) or (3, 1)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]
    return out


def into(turn: Array, vector: Array) -> Array:
    """A parent's vectors (3, N) in its child's axes: the transpose of `turn` times them."""
    out: Array = turn[0] * vector[0]
    out += turn[1] * vector[1]
    out += turn[2] * vector[2]
    return out


def outof(turn: Array, vector: Array) -> Array:
    """A child's vectors (3, N) in its parent's axes."""
    out: Array = turn[:, 0] * vector[0]
    out += turn[:, 1] * vector[1]
    out += turn[:, 2] * vector[2]
    return out


def turned(joint: Joint, q: Array) -> Array:
    """Child's axes in the parent's (3, 3, N) at the joint's positions (N,)."""
    mounted = Rotation.from_euler("xyz", joint.rpy).as_matrix()
    if joint.kind == "prismatic":
        return np.repeat(mounted[:, :, None], len(q), axis=2)
    x, y, z = joint.axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    along = mounted @ np.outer(joint.axis, joint.axis)
    out: Array = (mounted - along)[:, :, None] * np.cos(q)
    out += (mounted @ skew)[:, :, None] * np.sin(q)
    out += along[:, :, None]
    return out


class Moving:
    """An arm along q, v, a (N, n): turns of the links, their spins and accelerations, gravity taken for one upwards."""

    def __init__(self, robot: Robot, q: Array, v: Array, a: Array) -> None:
        self.robot, (self.q, self.v, self.a) = robot, (np.ascontiguousarray(x.T) for x in (q, v, a))
        self.turns: list[Array] = []
        self.levers: list[Array] = []  # of a link's origin about its parent's, in the parent's axes
        self.spins: list[tuple[Array, Array, Array]] = []  # turning, its rate, the origin's acceleration
        for index, joint in enumerate(robot.joints):
            self._hang(index, joint)

    def _hang(self, index: int, joint: Joint) -> None:
        turn, axis = turned(joint, self.q[index]), joint.axis[:, None]
        slides = joint.kind == "prismatic"
        lever = joint.origin[:, None] + (turn[:, :, 0] @ joint.axis)[:, None] * (self.q[index] if slides else 0.0)
        if joint.parent < 0:
            nothing = np.zeros((3, self.q.shape[1]))
            turning, rate, pull = nothing, nothing, nothing - self.robot.gravity[:, None]
        else:
            turning, rate, pull = self.spins[joint.parent]
            pull = pull + cross(rate, lever) + cross(turning, cross(turning, lever))
        turning, rate, pull = (into(turn, x) for x in (turning, rate, pull))
        along, faster = axis * self.v[index], axis * self.a[index]
        if slides:
            pull += faster + 2.0 * cross(turning, along)
        else:
            rate += faster + cross(turning, along)
            turning = turning + along
        self.turns.append(turn)
        self.levers.append(lever)
        self.spins.append((turning, rate, pull))

    def needed(self, index: int, link: Link) -> tuple[Array, Array]:
        """Force and moment about its origin (3, N) that `link` in the place of link `index` needs to move so."""
        turning, rate, pull = self.spins[index]
        com = link.com[:, None]
        force = link.mass * (pull + cross(rate, com) + cross(turning, cross(turning, com)))
        moment = link.inertia @ rate + cross(turning, link.inertia @ turning) + cross(com, force)
        return force, moment

    def carried(self, index: int, link: Link) -> Array:
        """Efforts (N, n) of all joints for `link` alone in the place of link `index`."""
        out = np.zeros_like(self.q)
        force, moment = self.needed(index, link)
        while index >= 0:
            joint = self.robot.joints[index]
            out[index] = joint.axis @ (force if joint.kind == "prismatic" else moment)
            force, moment = self._passed(index, force, moment)
            index = joint.parent
        return np.ascontiguousarray(out.T)

    def _passed(self, index: int, force: Array, moment: Array) -> tuple[Array, Array]:
        """A link's force and moment about its origin as its parent's."""
        force, moment = (outof(self.turns[index], x) for x in (force, moment))
        return force, moment + cross(self.levers[index], force)

    def efforts(self) -> Array:
        """Efforts (N, n) of all joints for the arm as it is: M a + bias + damping v."""
        needed = [self.needed(index, link) for index, link in enumerate(self.robot.links)]
        out = np.empty_like(self.q)
        for index in reversed(range(self.robot.size)):
            joint, (force, moment) = self.robot.joints[index], needed[index]
            out[index] = joint.axis @ (force if joint.kind == "prismatic" else moment)
            out[index] += joint.rotor_inertia * self.a[index] + joint.damping * self.v[index]
            if joint.parent >= 0:
                for own, passed in zip(needed[joint.parent], self._passed(index, force, moment), strict=True):
                    own += passed
        return np.ascontiguousarray(out.T)
