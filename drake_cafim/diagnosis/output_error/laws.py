"""Whether an effect at a joint that a servo drives acts as its name says, with the values that a fit gave it."""

from dataclasses import dataclass
from typing import Any

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.problem import ErrorProblem
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import concatenate
from drake_cafim.effects.kinds import ByKind


def acts_as_named(problem: ErrorProblem[Any], model: Model, effect: Effect) -> bool:
    """Whether an effect of `model` is there, with possible values, and acts as its name says along the recordings."""
    return not effect.is_absent and effect.plausible() and _Acts(problem, model)(effect)


@dataclass(frozen=True)
class _Acts(ByKind[bool]):
    """Whether an effect of each kind acts as its name says."""

    problem: ErrorProblem[Any]
    model: Model

    def other(self, effect: Effect) -> bool:
        return True

    def joint_force(self, effect: JointForce) -> bool:
        scene = self.problem.scene
        physics, joint = self.model.physics_before(scene, effect), scene.tree.joint_index(effect.at)
        return effect.plausible_over(
            concatenate([form.joint_samples(physics)[joint] for form in self.problem.errors.forms])
        )
