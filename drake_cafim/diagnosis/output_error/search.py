"""The search for what joints lack that servos with unknown parameters drive, by output errors, all joints at once.

A joint's explanation costs −2 ln p + k ln N + 2 m ln H for k strengths of m effects, chosen from H hypotheses, with N
independent errors (the extended Bayesian information criterion; Chen, Chen, Biometrika 95(3), 2008). How it grows
is told in `growth`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.comparison import Comparison
from drake_cafim.diagnosis.output_error.found import Found
from drake_cafim.diagnosis.output_error.growth import Growth
from drake_cafim.diagnosis.output_error.moves import CHORD_STEPS, Moves
from drake_cafim.diagnosis.output_error.problem import REFIT_STEPS, OutputErrorProblem, SimulationFit
from drake_cafim.diagnosis.output_error.scale import ScaleProfile, fit_scale
from drake_cafim.diagnosis.output_error.shapes import fit_shapes
from drake_cafim.diagnosis.output_error.starts import effort_rms, hypotheses, largest_asked
from drake_cafim.diagnosis.output_error.uncertainty import uncertainty
from drake_cafim.diagnosis.output_error.velocities import VelocityEffects
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.servo_effect import CommandDelay

MOST_ROUNDS = 8
"""Most rounds in which effects are added to the two that a joint begins with, or taken out."""
FRICTION_SHARE = 0.1
"""Torque of the friction at the start, over the root mean square of the servo's effort."""
REACHED_SHARE = 0.5
"""A servo's limit at the second start of its unknowns, over the largest effort that is asked of it."""
LIMIT = ".servo_limit"
"""An unknown limit's name among the numbers of its joint."""


@dataclass
class Search:
    """A search over all joints of a problem; a joint without a change in a round is done."""

    problem: OutputErrorProblem
    trace: Trace
    progress: Callable[[str], None] = lambda text: None
    velocities: VelocityEffects = field(default_factory=VelocityEffects)
    """What the sensors of velocities do, which simulations begin with."""

    def __post_init__(self) -> None:
        scene, forms = self.problem.scene, self.problem.errors.forms
        own = tuple(tuple(hypotheses(scene, forms, joint)) for joint in self.problem.joints)
        self.moves = Moves(self.problem, own)
        self.growth = Growth(self.moves, self.trace)

    def run(self, most_effects: int = 1) -> Found:
        """The effects of all joints, their strengths, and what is as probable; the unknowns alone with no effects."""
        self.progress("fitting the unknowns of servos to simulations")
        alone = self._fit_unknowns()
        best = self.problem.fit(alone.model.with_effects([*self.velocities.effects, *self._beginning(alone.model)]))
        self.problem.errors.forgetting(best.model.physics(self.problem.scene))
        best = self.problem.counted(self.problem.fit(best.model, steps=REFIT_STEPS))
        best = fit_shapes(self.problem, best, CHORD_STEPS)
        comparison = Comparison(self.moves, self.trace)
        if most_effects:
            best = self._grown(best)
            self.progress("simulating laws that act alike")
            best = self.growth.prune(fit_shapes(self.problem, comparison.of(best), CHORD_STEPS))
        best, scale = self._refined(best)
        present = best.model.keys
        probability = {**self.velocities.probability, **comparison.probability}
        rivals = {**self.velocities.rivals, **comparison.rivals}
        self.progress("simulating how well the servos are known")
        return Found(
            self.problem,
            best,
            self._again(alone),
            uncertainty(self.problem, best, scale).with_strengths(self.velocities.std),
            {key: value for key, value in probability.items() if key in present},
            {key: value for key, value in rivals.items() if key not in present},
        )

    def _grown(self, best: SimulationFit) -> SimulationFit:
        """`best` grown and pruned by turns: without what is taken out, others may be told."""
        for number in range(MOST_ROUNDS):
            self.progress(f"simulating what the joints with servos may lack, round {number + 1}")
            changed = self.growth.grow(best)
            if changed is None:
                changed = self.growth.prune(best)
                if changed is best:
                    return best
            best = self.problem.counted(fit_shapes(self.problem, changed))
        return self.growth.prune(best)

    def _fit_unknowns(self) -> SimulationFit:
        """The unknowns alone, of each joint the better of two fits: from the prior, and with its limit reached.

        A limit that no effort reaches has no slope, and would stay at its prior mean.
        """
        problem = self.problem
        found = problem.fit(Model(problem.scene.priors.mean))
        vector, numbers = found.model.vector.copy(), problem.numbers(found.model)
        physics = found.model.physics(problem.scene)
        for joint, own in zip(problem.joints, numbers, strict=True):
            if LIMIT in own:
                most = largest_asked(problem.errors.forms, physics, problem.scene.tree.joint_index(joint))
                vector[own[LIMIT]] = min(vector[own[LIMIT]], REACHED_SHARE * most)
        if np.array_equal(vector, found.model.vector):
            return found
        reached = problem.fit(found.model.at(vector))
        better = reached.costs < found.costs
        if not np.any(better):
            return found
        vector = found.model.vector.copy()
        for own, lower in zip(numbers, better, strict=True):
            if lower:
                at = list(own.values())
                vector[at] = reached.model.vector[at]
        return problem.fit(found.model.at(vector), steps=REFIT_STEPS)

    def _refined(self, best: SimulationFit) -> tuple[SimulationFit, ScaleProfile]:
        """`best` fitted again with finer steps: those of the search bias a delay by a tenth of them."""
        self.progress("simulating in finer steps")
        self.problem.errors = self.problem.errors.most_finely(best.model.physics(self.problem.scene))
        self.problem.errors.forgetting(best.model.physics(self.problem.scene))
        best = self.problem.counted(self.problem.fit_again(best))
        best = fit_shapes(self.problem, best)
        return fit_scale(self.problem, self.problem.fit(best.model, steps=REFIT_STEPS))

    def _again(self, fitted: SimulationFit) -> SimulationFit:
        """The fit with its errors as they are simulated now."""
        return replace(fitted, errors=self.problem.errors_of(fitted.model))

    def _beginning(self, model: Model) -> list[Effect]:
        """A late command and Coulomb friction at each joint, which would else be taken for stiffness and damping."""
        problem, found = self.problem, list[Effect]()
        scene, forms = problem.scene, problem.errors.forms
        period = float(np.median(np.concatenate([np.diff(form.samples.time) for form in forms])))
        physics = model.physics(scene)
        for joint, own in zip(problem.joints, self.moves.hypotheses, strict=True):
            torque = FRICTION_SHARE * effort_rms(forms, physics, scene.tree.joint_index(joint))
            present = {effect.key for effect in own}
            for effect in (CommandDelay(joint, {"delay": period}), JointCoulombFriction(joint, {"torque": torque})):
                if effect.key in present:
                    found.append(problem.sized(effect))
        return found
