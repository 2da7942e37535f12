"""Contact of a body with an obstacle that the model lacks: a plane that the body's origin touches."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from drake_cafim.dynamics.tree import Body
from drake_cafim.effects.body import BodyForce
from drake_cafim.effects.effect import Strength
from drake_cafim.effects.onset import FREE, Onset
from drake_cafim.typing import Array


@dataclass(frozen=True)
class UnmodeledContact(BodyForce):
    """max(0, k δ + d δ̇) n where δ = offset − n·p > 0, p the body's origin in the world; no friction.

    Only the direction of (nx, ny, nz) matters; a fit normalizes it to a unit vector.
    """

    name: ClassVar[str] = "unmodeled_contact"
    kind: ClassVar[str] = "obstacle"
    stiff: ClassVar[bool] = True
    in_throws: ClassVar[bool] = False  # its screening needs recordings that touch it at rest
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("offset", "m", 0.1, lower=-100.0, upper=100.0, amplitude=False),
        Strength("stiffness", "N/m", 1000.0, lower=0.0),
        Strength("damping", "N s/m", 10.0, lower=0.0),
        Strength("nx", "1", 1.0, lower=-2.0, upper=2.0, amplitude=False),
        Strength("ny", "1", 1.0, lower=-2.0, upper=2.0, amplitude=False),
        Strength("nz", "1", 1.0, lower=-2.0, upper=2.0, amplitude=False),
    )
    reference: ClassVar[str] = "Haddadin, De Luca, Albu-Schäffer, IEEE Trans. Robotics 33(6), 2017"
    formula: ClassVar[str] = "<i>k</i> δ + <i>d</i> δ̇ below the plane"
    words: ClassVar[str] = "pushes back where the model has nothing to touch"
    alike: ClassVar[Mapping[str, str]] = {
        "external_disturbance": "a short touch is a push; only a second one at the same place tells them apart",
        "joint_hard_stop": "both push back beyond a position, one of the joint and one of the body in the world",
        "joint_spring": "a plane that is always touched is a spring",
    }

    def with_values(self, values: Mapping[str, float] | Array) -> Self:
        found = super().with_values(values)
        unit = dict(zip(("nx", "ny", "nz"), found.normal.tolist(), strict=True))
        return type(self)(self.at, {**found.values, **unit})

    @property
    def normal(self) -> Array:
        """The unit normal (3,), pointing out of the obstacle, world axes."""
        n = np.array([self.values["nx"], self.values["ny"], self.values["nz"]])
        return np.asarray(n / max(float(np.linalg.norm(n)), 1e-12))

    def point(self, body: Body) -> Array:
        return np.zeros(3)

    def force(
        self, p_WP: Array, v_WP: Array, time: Array | None, recording: str | None, lasting: Array | float = 0.0
    ) -> Array:
        onset, rate = self._touch(p_WP, v_WP, lasting)
        push = self.values["stiffness"] * onset.depth + self.values["damping"] * rate * onset.share
        return np.asarray(np.maximum(push, 0.0)[:, None] * self.normal)

    def slopes(self, p_WP: Array, v_WP: Array, lasting: Array | float = 0.0) -> Array:
        """∂force/∂strengths (N, 3, 6); zero along the normal's length, which does not affect the force."""
        onset, rate = self._touch(p_WP, v_WP, lasting)
        k, d, n = self.values["stiffness"], self.values["damping"], self.normal
        push = k * onset.depth + d * rate * onset.share
        across = np.eye(3) - np.outer(n, n)
        by_depth = k * onset.share + d * rate * onset.slope
        along = np.stack([by_depth, onset.depth, rate * onset.share], axis=1)
        turned = -(by_depth[:, None] * p_WP + d * onset.share[:, None] * v_WP) @ across
        columns = np.concatenate([along, turned], axis=1)[:, None, :] * n[:, None]
        columns[:, :, 3:] += push[:, None, None] * across
        return np.asarray(np.where((push > 0.0)[:, None, None], columns, 0.0))

    def _touch(self, p_WP: Array, v_WP: Array, lasting: Array | float) -> tuple[Onset, Array]:
        """The averaged depth δ, and its rate δ̇ (N,) m/s."""
        depth, rate = self.values["offset"] - p_WP @ self.normal, -(v_WP @ self.normal)
        return Onset.of(depth, 0.5 * np.abs(rate) * lasting), rate

    def contradiction(self) -> str:
        normal = np.array([self.values[name] for name in ("nx", "ny", "nz")])
        return "" if np.any(normal) else "the normal nx, ny, nz is zero, expected a direction"

    def plausible(self) -> bool:
        # without stiffness it is not a contact
        return super().plausible() and self.values["stiffness"] > 0.0

    def touched_and_left(self, p_WP: Array) -> bool:
        """Whether the body's origin, at `p_WP` (N, 3) m, is out of contact for more than the fraction `FREE`.

        A plane that is always touched acts as a spring, a damper and a bias, and cannot be told from them.
        """
        return float(np.mean(p_WP @ self.normal > self.values["offset"])) > FREE
