"""The rows' terms of joint effects and of forces on bodies, cached for the last few parameter values."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.dynamics.motion import Motion
from drake_cafim.effects.body import BodyForce
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

CACHED_TERMS = 64
"""Most cached terms."""
CACHED_FORCES = 8
"""Most cached forces, which are as long as the recording."""


@dataclass(frozen=True)
class ForceRows:
    """Integrals over the `windows` of forces evaluated along one motion `moving` of the recording named `recording`.

    `joints` are each joint's motion at the P points at which its laws are evaluated; `value` (M, P) integrates them.
    """

    windows: Windows
    recording: str
    joints: tuple[JointSamples, ...]
    value: sp.csr_matrix
    moving: Motion
    _known: dict[tuple[object, ...], Array] = field(default_factory=dict, repr=False, compare=False)
    _forces: dict[tuple[object, ...], Force] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def velocity(self) -> Array:
        """∫ w v dt (M, n) of the joints' velocities, along the motion between samples, which held efforts bend."""
        return np.asarray(self.value @ np.stack([joint.v for joint in self.joints], axis=1))

    def at_joint(self, effect: JointForce, joint: int) -> Array:
        """∫ w force dt (M,) of the force law `effect` at `joint`."""
        return self._cached(
            (*_numbers(effect), joint), lambda: np.asarray(self.value @ self.force(effect, joint).value)
        )

    def force(self, effect: JointForce, joint: int) -> Force:
        """The law `effect` at the P points of `joint`; the last few are cached, since their slopes are wanted next."""
        key = _numbers(effect)
        if key not in self._forces:
            make_room(self._forces, CACHED_FORCES)
            self._forces[key] = effect.force(self.joints[joint])
        return self._forces[key]

    def on_bodies(self, physics: Physics) -> Array:
        """∫ w Jᵀ F dt (M, n): generalised forces of all forces F on bodies."""
        total = np.zeros((len(self.windows), len(self.joints)))
        for effect in physics.body_forces:
            body = physics.tree.body(effect.at)
            p_JP = np.asarray(body.p_JB + body.R_JB @ effect.point(body), dtype=float)
            for share, part in effect.parts():
                if share != 0.0:
                    total += share * self._on_body(part, body.joint, p_JP)
        return total

    def _on_body(self, effect: BodyForce, joint: int, p_JP: Array) -> Array:
        """∫ w Jᵀ F dt (M, n) of one force at the point `p_JP` (3,) m, fixed in the link's frame J; cached."""
        key = (*_numbers(effect), joint, p_JP.tobytes())
        return self._cached(key, lambda: self._integrate(effect, joint, p_JP))

    def _integrate(self, effect: BodyForce, joint: int, p_JP: Array) -> Array:
        """`_on_body` without the cache."""
        p_WP, v_WP = self.moving.point(joint, p_JP)
        force = effect.force(p_WP, v_WP, self.windows.time, self.recording, self.moving.lasting)
        if not np.any(force):
            return np.zeros((len(self.windows), len(self.joints)))
        generalised = np.einsum("nja,na->nj", self.moving.force_at(joint, p_JP), force)
        return np.asarray(self.windows.value @ generalised)

    def _cached(self, key: tuple[object, ...], compute: Callable[[], Array]) -> Array:
        if key not in self._known:
            make_room(self._known, CACHED_TERMS)
            self._known[key] = compute()
        return self._known[key]


def _numbers(effect: Effect) -> tuple[object, ...]:
    """The cache key of a law: all its attributes but its place."""
    others = tuple(value for name, value in vars(effect).items() if name not in ("at", "values"))
    return (*effect.key, *effect.values.items(), *others)
