"""What joint effects and pushes on bodies add to a recording's rows; the last few numbers that were tried are kept."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.windows import Windows
from drake_cafim.dynamics.motion import Motion
from drake_cafim.effects.body import BodyForce
from drake_cafim.effects.effect import Effect, JointSamples
from drake_cafim.effects.joint import JointForce
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

KEPT = 64
"""Of what a law adds under numbers that are tried."""


@dataclass(frozen=True)
class ActingRows:
    """Integrals over the `windows` of what acts along one motion of the `recording`."""

    windows: Windows
    recording: str
    joints: tuple[JointSamples, ...]
    moving: Motion
    _known: dict[tuple[object, ...], Array] = field(default_factory=dict, repr=False, compare=False)

    def at_joint(self, effect: JointForce, joint: int) -> Array:
        """∫ w force dt (M,) of a joint's law."""
        return self._kept(
            (*_numbers(effect), joint),
            lambda: np.asarray(self.windows.value @ effect.force(self.joints[joint]).value),
        )

    def on_bodies(self, physics: Physics) -> Array:
        """∫ w force dt (M, n) at the joints of what pushes the bodies."""
        total = np.zeros((len(self.windows), len(self.joints)))
        for effect in physics.body_forces:
            body = physics.tree.body(effect.at)
            p_JP = np.asarray(body.p_JB + body.R_JB @ effect.point(body), dtype=float)
            for share, part in effect.parts():
                if share != 0.0:
                    total += share * self._on_body(part, body.joint, p_JP)
        return total

    def _on_body(self, effect: BodyForce, joint: int, p_JP: Array) -> Array:
        """(M, n) of one push at a point fixed in frame J."""
        key = (*_numbers(effect), joint, p_JP.tobytes())
        return self._kept(key, lambda: self._pushed(effect, joint, p_JP))

    def _pushed(self, effect: BodyForce, joint: int, p_JP: Array) -> Array:
        p_WP, v_WP = self.moving.point(joint, p_JP)
        force = effect.force(p_WP, v_WP, self.windows.time, self.recording, self.moving.lasting)
        if not np.any(force):
            return np.zeros((len(self.windows), len(self.joints)))
        felt = np.einsum("nja,na->nj", self.moving.force_at(joint, p_JP), force)
        return np.asarray(self.windows.value @ felt)

    def _kept(self, key: tuple[object, ...], made: Callable[[], Array]) -> Array:
        if key not in self._known:
            make_room(self._known, KEPT)
            self._known[key] = made()
        return self._known[key]


def _numbers(effect: Effect) -> tuple[object, ...]:
    """All that a law depends on, but what it acts on."""
    others = tuple(value for name, value in vars(effect).items() if name not in ("at", "values"))
    return (*effect.key, *effect.values.items(), *others)
