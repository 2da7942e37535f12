"""Spatial kinematics and momentum of a tree over many samples at once.

Spatial vectors are about the world origin, in world axes, angular part first (Featherstone, *Rigid Body
Dynamics Algorithms*, 2008, ch. 2): a joint's axis S, a link's velocity V = Σ S v, its momentum h = I V.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from drake_cafim.dynamics.momentum_rows import inertial_forces, momenta
from drake_cafim.dynamics.recursions import equations, kinematics, momentum_terms, project_wrenches
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.dynamics.tree import FIXED, Tree
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array


def skew(a: Array) -> Array:
    """(..., 3) to the (..., 3, 3) matrices of a ×."""
    result = np.zeros((*a.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -a[..., 2], a[..., 1]
    result[..., 1, 0], result[..., 1, 2] = a[..., 2], -a[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -a[..., 1], a[..., 0]
    return result


def cross_motion(V: Array, S: Array) -> Array:
    """V × S for motion vectors (..., 6)."""
    angular = cross(V[..., :3], S[..., :3])
    linear = cross(V[..., :3], S[..., 3:]) + cross(V[..., 3:], S[..., :3])
    return np.concatenate([angular, linear], axis=-1)


@dataclass(frozen=True)
class Motion:
    """Poses and spatial velocities of all links over N samples.

    `q`, `v` (N, n) joint positions and velocities; `R_WJ` (N, m, 3, 3), `p_WJ` (N, m, 3) m poses of the joints' moving
    frames; joint `axes` S (N, m, 6) and link `velocities` V (N, m, 6) about the world origin, world axes. There are as
    many frames as joints, m = n, unless joints follow others.
    """

    tree: Tree
    q: Array
    v: Array
    R_WJ: Array
    p_WJ: Array
    axes: Array
    velocities: Array
    lasting: Array | float = 0.0
    """Sample interval s, (N,), over which force onsets are averaged; zero for an instant."""
    _points: dict[tuple[int, bytes], tuple[Array, Array]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _forces: dict[tuple[int, bytes], Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def axes_rate(self) -> Array:
        """Ṡ = V × S, (N, m, 6)."""
        return cross_motion(self.velocities, self.axes)

    @property
    def no_wrenches(self) -> Array:
        """(N, m, 6) zeros."""
        return np.zeros((*self.p_WJ.shape[:2], 6))

    def project(self, wrench: Array) -> Array:
        """Generalized forces (N, n) of wrenches (N, m, 6) that act on the links."""
        forces = project_wrenches(self.tree.frames[0], self.axes, np.ascontiguousarray(wrench))
        return _on_leaders(self.tree, np.asarray(forces, dtype=float))

    def twists(self, joint: int) -> Array:
        """(N, n, 6): spatial velocity of frame J by each joint at unit speed, about the world origin, world axes."""
        result = np.zeros((*self.q.shape, 6))
        G, _ = self.tree.following
        for k in np.flatnonzero(self.tree.carriers()[joint]):
            j = self.tree.leader(int(k))
            result[:, j] += G[k, j] * self.axes[:, k]
        return result

    def point(self, joint: int, p_JP: Array) -> tuple[Array, Array]:
        """World position and velocity, each (N, 3), of the point `p_JP` (3,) m fixed in frame J; cached by point."""
        key = joint, p_JP.tobytes()
        if key not in self._points:
            while len(self._points) >= 8:
                self._points.pop(next(iter(self._points)))
            self._points[key] = self._point(joint, p_JP)
        return self._points[key]

    def _point(self, joint: int, p_JP: Array) -> tuple[Array, Array]:
        if joint == FIXED:
            position = np.broadcast_to(p_JP, (len(self.q), 3)).copy()
            return position, np.zeros_like(position)
        position = self.p_WJ[:, joint] + self.R_WJ[:, joint] @ p_JP
        V = self.velocities[:, joint]
        return position, V[:, 3:] + cross(V[:, :3], position)

    def force_at(self, joint: int, p_JP: Array) -> Array:
        """Transposed Jacobian (N, n, 3): generalized forces of unit forces along the world's axes at a point of J.

        That of the last point is cached.
        """
        key = joint, p_JP.tobytes()
        if key not in self._forces:
            p_WP, _ = self.point(joint, p_JP)
            S = self.twists(joint)
            self._forces.clear()
            self._forces[key] = S[..., 3:] + cross(S[..., :3], np.broadcast_to(p_WP[:, None], S[..., :3].shape))
        return self._forces[key]


def motion(tree: Tree, q: Array, v: Array) -> Motion:
    """The motion of `tree` at positions `q` and velocities `v`, each (N, n)."""
    # the compiled function expects C-contiguous arrays
    q, v = np.ascontiguousarray(q, dtype=float), np.ascontiguousarray(v, dtype=float)
    return Motion(tree, q, v, *kinematics(*tree.frames, positions(tree, q), rates(tree, v)))


def positions(tree: Tree, q: Array) -> Array:
    """(N, m) positions of all moving joints, with those that follow, from q (N, n)."""
    G, offset = tree.following
    return np.ascontiguousarray(q @ G.T + offset) if tree.followers else q


def rates(tree: Tree, v: Array) -> Array:
    """(N, m) velocities of all moving joints, with those that follow, from v (N, n)."""
    return np.ascontiguousarray(v @ tree.following[0].T) if tree.followers else v


def _on_leaders(tree: Tree, forces: Array) -> Array:
    """(N, n) generalized forces from those (N, m) at all moving joints: what acts on a follower moves its leader."""
    return np.asarray(forces @ tree.following[0]) if tree.followers else forces


def free_motion(tree: Tree, state: Array) -> Motion:
    """The motion of a floating tree's one frame J from states (N, 13).

    A state is Drake's of a floating body: quaternion w x y z of any length and p_WJ m, then ω rad/s and v m/s of Jo.
    """
    quaternion, p, w, v = state[:, :4], state[:, 4:7], state[:, 7:10], state[:, 10:]
    R = rotation_matrices(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
    velocity = np.concatenate([w, v - cross(w, p)], axis=1)
    none = np.zeros((len(state), 0))
    return Motion(tree, none, none, R[:, None], p[:, None].copy(), np.zeros((len(state), 0, 6)), velocity[:, None])


@dataclass(frozen=True)
class MomentumBalance:
    """Terms of the momentum balance d/dt(∂T/∂v) = ∂T/∂q + gravity + applied, each (N, n)."""

    momentum: Array
    """p = M(q) v."""
    force: Array
    """∂T/∂q + generalized gravity force."""


def momentum_balance(moving: Motion, gravity: Array) -> MomentumBalance:
    """Generalized momentum and its inertial and gravity forces; `gravity` (3,) m/s² in the world."""
    places = (moving.R_WJ, moving.p_WJ, moving.axes, moving.velocities)
    numbers = (np.ascontiguousarray(values, dtype=float) for values in (*places, *moving.tree.lumps, gravity))
    terms = momentum_terms(moving.tree.frames[0], *numbers)
    return MomentumBalance(*(_on_leaders(moving.tree, term) for term in terms))


def momentum(tree: Tree, q: Array, v: Array) -> Array:
    """M(q) v (N, n), without rotor inertias."""
    q, v = np.ascontiguousarray(q, dtype=float), np.ascontiguousarray(v, dtype=float)
    found = momenta(*tree.frames, tree.inertial_parameters, positions(tree, q), rates(tree, v))
    return _on_leaders(tree, np.asarray(found, dtype=float))


def inertial_force(tree: Tree, q: Array, v: Array, gravity: Array) -> Array:
    """∂T/∂q + generalized gravity force (N, n); `gravity` (3,) m/s² in the world."""
    q, v, gravity = (np.ascontiguousarray(values, dtype=float) for values in (q, v, gravity))
    found = inertial_forces(*tree.frames, tree.inertial_parameters, positions(tree, q), rates(tree, v), gravity)
    return _on_leaders(tree, np.asarray(found, dtype=float))


def equations_of_motion(moving: Motion, gravity: Array) -> tuple[Array, Array]:
    """M(q) (N, n, n), without rotor inertias, and the bias C(q, v) v − gravity (N, n), the force for which v̇ = 0."""
    places = (moving.R_WJ, moving.p_WJ, moving.axes, moving.velocities, rates(moving.tree, moving.v))
    numbers = (np.ascontiguousarray(values, dtype=float) for values in (*places, *moving.tree.lumps, gravity))
    M, bias = equations(moving.tree.frames[0], *numbers)
    if moving.tree.followers:
        G, _ = moving.tree.following
        M = G.T @ M @ G
    return np.asarray(M, dtype=float), _on_leaders(moving.tree, np.asarray(bias, dtype=float))


def mass_matrix(moving: Motion) -> Array:
    """M(q), (N, n, n), without rotor inertias."""
    return equations_of_motion(moving, np.zeros(3))[0]


def bias_force(moving: Motion, gravity: Array) -> Array:
    """C(q, v) v − gravity, (N, n): the generalized force for which v̇ = 0."""
    return equations_of_motion(moving, gravity)[1]
