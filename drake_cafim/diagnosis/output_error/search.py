"""The search for what joints lack that servos with unknown parameters drive, by output errors, all joints at once.

A joint's explanation costs −2 ln p + k ln N + 2 m ln H for k strengths of m effects, chosen from H hypotheses, with N
independent errors (the extended Bayesian information criterion; Chen, Chen, Biometrika 95(3), 2008). It grows by the
effect that lowers that most, or in which a law of another kind takes the place of one of its group, as long as the
errors of recordings that are left out fall by more than a standard error, and an effect is taken out without which they
do not rise by more (Breiman, Friedman, Olshen, Stone, Classification and Regression Trees, 1984, §3.4.3). Of fewer than
four recordings, the quarters of each are left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.output_error import decisions
from drake_cafim.diagnosis.output_error.candidates import screen
from drake_cafim.diagnosis.output_error.comparison import Comparison
from drake_cafim.diagnosis.output_error.found import Found
from drake_cafim.diagnosis.output_error.moves import CHORD_STEPS, Move, Moves, with_values_of
from drake_cafim.diagnosis.output_error.problem import REFIT_STEPS, OutputErrorProblem, SimulationFit, at_joint
from drake_cafim.diagnosis.output_error.scale import ScaleProfile, fit_scale
from drake_cafim.diagnosis.output_error.shapes import fit_shapes
from drake_cafim.diagnosis.output_error.starts import effort_rms, hypotheses
from drake_cafim.diagnosis.output_error.uncertainty import uncertainty
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.servo_effect import CommandDelay

MOST_ROUNDS = 8
"""Most effects that are added to the two that a joint begins with."""
TRIED = 3
"""Candidates of each joint that are fitted in a round."""
SETTLED_SHARE = 0.5
"""Rise of a joint's cost without an effect, over the largest one, from which it is not put down to other joints."""
FRICTION_SHARE = 0.1
"""Torque of the friction at the start, over the root mean square of the servo's effort."""


@dataclass
class Search:
    """A search over all joints of a problem; a joint without a change in a round is done."""

    problem: OutputErrorProblem
    trace: Trace
    progress: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        scene, forms = self.problem.scene, self.problem.errors.forms
        own = tuple(tuple(hypotheses(scene, forms, joint)) for joint in self.problem.joints)
        self.moves = Moves(self.problem, own)

    def run(self, most_effects: int = 1) -> Found:
        """The effects of all joints, their strengths, and what is as probable; the unknowns alone with no effects."""
        self.progress("fitting the unknowns of servos to simulations")
        alone = self.problem.fit(Model(self.problem.scene.priors.mean))
        best = self.problem.fit(alone.model.with_effects(self._beginning(alone.model)))
        self.problem.forget_first_states(best.model)
        best = self.problem.counted(self.problem.fit(best.model, steps=REFIT_STEPS))
        best = fit_shapes(self.problem, best, CHORD_STEPS)
        for number in range(MOST_ROUNDS if most_effects else 0):
            self.progress(f"simulating what the joints with servos may lack, round {number + 1}")
            grown = self._grow(best)
            if grown is None:
                break
            best = self.problem.counted(fit_shapes(self.problem, grown))
        comparison = Comparison(self.moves, self.trace)
        if most_effects:
            best = self._prune(best)
            self.progress("simulating laws that act alike")
            best = self._prune(fit_shapes(self.problem, comparison.of(best), CHORD_STEPS))
        best, scale = self._refined(best)
        present = best.model.keys
        self.progress("simulating how well the servos are known")
        return Found(
            self.problem,
            best,
            self._again(alone),
            uncertainty(self.problem, best, scale),
            {key: value for key, value in comparison.probability.items() if key in present},
            {key: value for key, value in comparison.rivals.items() if key not in present},
        )

    def _refined(self, best: SimulationFit) -> tuple[SimulationFit, ScaleProfile]:
        """`best` fitted again with finer steps: those of the search bias a delay by a tenth of them."""
        self.progress("simulating in finer steps")
        self.problem.errors = self.problem.errors.most_finely(best.model.physics(self.problem.scene))
        self.problem.forget_first_states(best.model)
        best = self.problem.counted(self.problem.fit_again(best))
        best = fit_shapes(self.problem, best)
        return fit_scale(self.problem, self.problem.fit(best.model, steps=REFIT_STEPS))

    def _again(self, fitted: SimulationFit) -> SimulationFit:
        """The fit with its errors as they are simulated now."""
        return replace(fitted, errors=self.problem.errors_of(fitted.model))

    # --- growth -------------------------------------------------------------------------------------------------

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

    def _grow(self, best: SimulationFit) -> SimulationFit | None:
        """`best` with one change at each joint that has one; None where no joint has."""
        problem = self.problem
        present = best.model.effects
        free = [[e for e in own if not any(e.excludes(p) for p in present)] for own in self.moves.hypotheses]
        added = screen(problem, best, best.slopes_without(()), free, self.moves.price, best.model)
        for joint, own in zip(problem.joints, added, strict=True):
            self.trace.add(*decisions.record_screening(joint, own, TRIED))
        replacing = self._replacing(best)
        moves = [
            [*instead[:TRIED], *(((), candidate.effect) for candidate in own[:TRIED])]
            for instead, own in zip(replacing, added, strict=True)
        ]
        return self._accept(best, moves)

    def _replacing(self, best: SimulationFit) -> list[list[Move]]:
        """By joint, laws of the group of one that is present, each with that one, which it replaces."""
        problem = self.problem
        out = []
        for joint in problem.joints:
            grouped = [e for e in best.model.effects if e.group is not None and at_joint(e.at, joint)]
            out.append(grouped[0] if grouped else None)
        if not any(out):
            return [[] for _ in out]
        dropped = [effect for effect in out if effect is not None]
        base = self.moves.without(best, dropped)
        tried = [
            [e for e in laws if own is not None and e.name != own.name and e.excludes(own)]
            for laws, own in zip(self.moves.hypotheses, out, strict=True)
        ]
        looks = screen(problem, base, best.slopes_without(dropped), tried, self.moves.price, best.model)
        return [
            [((own,), look.effect) for look in found] if own is not None else []
            for own, found in zip(out, looks, strict=True)
        ]

    def _accept(self, best: SimulationFit, moves: Sequence[Sequence[Move]]) -> SimulationFit | None:
        """`best` with the move of each joint that lowers its cost most, fitted; None where none is accepted."""
        problem, costs = self.problem, self.moves.costs(best)
        chosen: list[tuple[float, Move] | None] = [None] * len(moves)
        tried = list(zip_longest(*moves))
        trials = problem.for_each(lambda own: self.moves.chord(best, own), tried)
        for own, trial in zip(tried, trials, strict=True):
            after = self.moves.costs(trial)
            for j, move in enumerate(own):
                lead = chosen[j]
                if move is not None and after[j] < min(costs[j], np.inf if lead is None else lead[0]):
                    chosen[j] = (float(after[j]), (move[0], with_values_of(trial.model, move[1])))
        taken = [None if lead is None else lead[1] for lead in chosen]
        if not any(taken):
            return None
        model = self.moves.changed(best.model, taken)
        fitted = problem.fit(model, steps=REFIT_STEPS)
        passed = self._passes(best, fitted, taken)
        if all(passed):
            return fitted
        taken = [move if good else None for move, good in zip(taken, passed, strict=True)]
        if not any(taken):
            return None
        return problem.fit(self.moves.changed(best.model, taken, fitted.model), steps=REFIT_STEPS)

    def _passes(self, best: SimulationFit, fitted: SimulationFit, taken: Sequence[Move | None]) -> list[bool]:
        """By joint, whether the change lowers the cost and the errors of parts that are left out, and its law acts."""
        before, after, passed = self.moves.costs(best), self.moves.costs(fitted), []
        for j, move in enumerate(taken):
            if move is None:
                passed.append(True)
                continue
            worse, error = _left_out(best, fitted, j)
            law = with_values_of(fitted.model, move[1])
            good = bool(after[j] < before[j] and worse < -error and not law.is_absent)
            key, replaced = law.key, [effect.key for effect in move[0]]
            self.trace.add(decisions.record_trial(key, replaced, float(before[j] - after[j]), worse, error, good))
            passed.append(good)
        return passed

    # --- what stays ---------------------------------------------------------------------------------------------

    def _prune(self, best: SimulationFit) -> SimulationFit:
        """`best` without the effects whose joint costs less without them, one of each joint at a time.

        What one joint then misses shows at others, so that of those that cost more, only the joints that cost most are
        settled, and the others are tried again without them.
        """
        problem = self.problem
        kept = set[Key]()
        while True:
            latest = [self._latest(best, j, kept) for j in range(len(problem.joints))]
            dropped = [effect for effect in latest if effect is not None]
            if not dropped:
                return best
            rest = problem.fit(self.moves.model_without(best.model, dropped))
            risen, gone = self.moves.costs(rest) - self.moves.costs(best), []
            most = max(float(risen[j]) for j, effect in enumerate(latest) if effect is not None)
            for j, effect in enumerate(latest):
                if effect is None:
                    continue
                worse, error = _left_out(best, rest, j)
                stays = bool(risen[j] > 0.0 and worse > error)
                if stays and risen[j] < SETTLED_SHARE * most:
                    continue
                self.trace.add(decisions.record_prune(effect.key, float(risen[j]), worse, error, stays))
                if stays:
                    kept.add(effect.key)
                else:
                    gone.append(effect)
            if len(gone) == len(dropped):
                best = rest
            elif gone:
                best = problem.fit(self.moves.model_without(best.model, gone), steps=REFIT_STEPS)

    def _latest(self, best: SimulationFit, joint: int, kept: set[Key]) -> Effect | None:
        """The latest effect at a joint of those not `kept`."""
        own = [e for e in best.model.effects if at_joint(e.at, self.problem.joints[joint]) and e.key not in kept]
        return own[-1] if own else None


def _left_out(before: SimulationFit, after: SimulationFit, joint: int) -> tuple[float, float]:
    """By how much ln of the mean squared error of parts that are left out rises at a joint, and its standard error."""
    rise = after.equations[joint].left_out() - before.equations[joint].left_out()
    return float(np.mean(rise)), float(np.std(rise, ddof=1) / np.sqrt(len(rise))) if len(rise) > 1 else 0.0
