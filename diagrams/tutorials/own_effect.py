"""An effect that the catalogue does not have: a magnetic catch that holds a joint at one position.

    python -m drake_cafim.diagrams.tutorials.own_effect

One class says it all: screening, fitting, simulation, report and `effects:` in a scenario read it there. A force at a
joint derives from `JointForce`; the other kinds are the abstract classes of `drake_cafim.effects`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim import Scene, Verdict, diagnose
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record
from drake_cafim.effects.effect import Start, Strength
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.typing import Array

WIDTH = 0.08  # rad: how far from its middle the catch pulls most


@dataclass(frozen=True)
class JointCatch(JointForce):
    """−T s exp((1 − s²)/2), s = (q − position)/0.08 rad: most at s = ±1, where it is T."""

    name: ClassVar[str] = "joint_catch"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("torque", "N m", 0.3, lower=0.0),  # the size at which one meets it, and what is physics
        Strength("position", "rad", 0.5, amplitude=False),  # no strength: says what it looks like
    )
    reference: ClassVar[str] = "the magnet's data sheet"
    alike: ClassVar[Mapping[str, str]] = {"joint_spring": "within the catch alone, both pull to one position"}

    def force(self, joint: JointSamples) -> Force:
        """The law over the samples (N,), and its derivatives by q, v, u (N,) and by the strengths (N, 2)."""
        s = (joint.q - self.values["position"]) / WIDTH
        pull = -s * np.exp(0.5 * (1.0 - s**2))
        slope = self.values["torque"] * (s**2 - 1.0) * np.exp(0.5 * (1.0 - s**2)) / WIDTH
        nothing = np.zeros_like(s)
        return Force(self.values["torque"] * pull, slope, nothing, nothing, np.stack([pull, -slope], axis=1))

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        """Looks that are linear in the torque, one at each position where the catch may be."""
        for position in np.arange(joint.q.min(), joint.q.max(), WIDTH):
            unit = JointCatch(self.at, {"torque": 1.0, "position": float(position)})
            yield Start(unit.force(joint).value[:, None], {"position": float(position)})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointCatch":
        """The effect that a look's coefficient stands for, from which an exact fit starts."""
        return JointCatch(self.at, {"torque": float(coefficients[0]), **shape})


def caught_elbow(q: Array, v: Array) -> Array:
    """What the arm really has: a catch of 0.25 N m at 0.2 rad."""
    s = (q[1] - 0.2) / WIDTH
    return np.array([0.0, -0.25 * s * np.exp(0.5 * (1.0 - s**2))])


def main() -> Verdict:
    """The verdict on an arm with a catch, the effect above among what is looked for."""
    scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
    return diagnose(scene, [record(caught_elbow, seed) for seed in (1, 2)], effects=[JointCatch])


if __name__ == "__main__":
    print(main())
