"""Compares the laws that were found with others that act alike: the probability of each, and its rivals."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np

from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.output_error import decisions
from drake_cafim.diagnosis.output_error.candidates import screen
from drake_cafim.diagnosis.output_error.moves import Move, Moves, with_values_of
from drake_cafim.diagnosis.output_error.problem import REFIT_STEPS, Errors, SimulationFit, at_joint
from drake_cafim.diagnosis.output_error.shapes import fit_shapes
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

FAR = 40.0
"""Excess of the criterion beyond which a law is no rival, to first order."""
NEAR = 1.0
"""Difference of the logarithms of two laws' mean squared errors below which they are compared in fine steps."""
MOST_REPLACED = 4
"""Most laws of a joint that others take the place of."""

Lead = tuple[float, Effect]
"""By how much a joint costs more with a law in the place of another one, and that law."""


@dataclass
class Comparison:
    """Laws compared one by one, each with all that act alike: of these p ∝ exp(−cost/2)."""

    moves: Moves
    trace: Trace
    probability: dict[Key, float] = field(default_factory=dict)
    rivals: dict[Key, float] = field(default_factory=dict)
    _latest: tuple[SimulationFit, tuple[Errors, SimulationFit]] | None = None

    def of(self, best: SimulationFit) -> SimulationFit:
        """`best`, or the fit with laws that cost less in the place of its own, these compared as well."""
        joints = self.moves.problem.joints
        left = [[effect.key for effect in best.model.effects if at_joint(effect.at, joint)] for joint in joints]
        replaced = [0] * len(joints)
        while any(left):
            present = {effect.key: effect for effect in best.model.effects}
            asked = [present[own.pop(0)] if own else None for own in left]
            leads = self._leads(best, asked)
            moves: list[Move | None] = [None] * len(joints)
            for j, effect in enumerate(asked):
                if effect is None:
                    continue
                self._record(effect, leads[j])
                lead, other = min(leads[j], key=lambda it: it[0], default=(0.0, effect))
                if lead < 0.0 and replaced[j] < MOST_REPLACED:
                    moves[j] = ((effect,), other)
                    replaced[j] += 1
                    left[j].append(other.key)
            if any(moves):
                best = self.moves.problem.fit(self.moves.changed(best.model, moves), steps=REFIT_STEPS)
        return best

    def _leads(self, best: SimulationFit, asked: list[Effect | None]) -> list[list[Lead]]:
        """By joint, the laws that act like the one that is asked about, fitted in its place."""
        dropped = [effect for effect in asked if effect is not None]
        base = self.moves.without(best, dropped)
        tried = [
            [] if effect is None else [it for it in own if self._acts_alike(it, effect, base.model.effects)]
            for own, effect in zip(self.moves.hypotheses, asked, strict=True)
        ]
        slopes = best.slopes_without(dropped)
        looks = screen(self.moves.problem, base, slopes, tried, self.moves.price, best.model)
        costs, leads = self.moves.costs(best), [list[Lead]() for _ in asked]
        finely = self._finely(best)
        # a law that is far worse to first order would show at the other joints
        near: list[list[Move]] = [
            [((effect,), look.effect) for look in own if effect is not None and look.excess > own[0].excess - FAR]
            for effect, own in zip(asked, looks, strict=True)
        ]

        def compared(moves: Sequence[Move | None]) -> tuple[SimulationFit, Array]:
            problem = self.moves.problem
            trial = problem.fit(self.moves.chord(best, moves).model, steps=REFIT_STEPS)
            apart = self.moves.costs(trial) - costs
            near = np.abs(apart) < NEAR * problem.errors.likelihood.independent
            if any(close and move is not None for close, move in zip(near, moves, strict=True)):
                errors, fine = finely
                with problem.simulating(errors):
                    among = [move[1].key for move in moves if move is not None]
                    again = fit_shapes(problem, problem.fit_again(trial), among=among)
                    apart = np.where(near, self.moves.costs(again) - self.moves.costs(fine), apart)
            return trial, apart

        rounds = list(zip_longest(*near))
        for moves, (trial, apart) in zip(rounds, self.moves.problem.for_each(compared, rounds), strict=True):
            for j, move in enumerate(moves):
                if move is not None:
                    leads[j].append((float(apart[j]), with_values_of(trial.model, move[1])))
        return leads

    def _acts_alike(self, law: Effect, effect: Effect, others: tuple[Effect, ...]) -> bool:
        """Whether a law may be taken for an effect, and may act beside the `others`."""
        alike = law.name in effect.alike or effect.name in law.alike
        return alike and law.key != effect.key and not any(self.moves.excludes(law, other) for other in others)

    def _finely(self, best: SimulationFit) -> tuple[Errors, SimulationFit]:
        """`best` fitted in fine steps, and its errors by these."""
        if self._latest is None or self._latest[0] is not best:
            problem, errors = self.moves.problem, self.moves.problem.errors.finely()
            with problem.simulating(errors):
                self._latest = (
                    best,
                    (errors, problem.counted(fit_shapes(problem, problem.fit_again(best)))),
                )
        return self._latest[1]

    def _record(self, effect: Effect, leads: list[Lead]) -> None:
        """The probabilities of an effect and of the laws in its place.

        A law of which the effect is a special case does not speak against it: what it costs more shows in the price.
        """
        others = [(lead, other) for lead, other in leads if effect.name not in other.narrows]
        self.probability[effect.key] = _shares([0.0, *(lead for lead, _ in others)])[0]
        shares = _shares([0.0, *(lead for lead, _ in leads)])[1:]
        for (lead, other), share in zip(leads, shares, strict=True):
            self.trace.add(decisions.record_alike(effect.key, other.key, lead))
            self.rivals[other.key] = max(self.rivals.get(other.key, 0.0), share)


def _shares(costs: list[float]) -> list[float]:
    """p ∝ exp(−cost/2)."""
    weights = np.exp(-0.5 * (np.array(costs) - min(costs)))
    return [float(weight / np.sum(weights)) for weight in weights]
