"""Forward selection and pruning of what joints lack, by errors of each joint, all joints at once.

An explanation of a joint grows by the effect that lowers its cost most, or in which a law of another kind takes the
place of one of its group, as long as the errors of recordings that are left out do not grow; and an effect is taken
out without which they do not. Of fewer than four recordings, the quarters of each are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.output_error import decisions
from drake_cafim.diagnosis.output_error.candidates import screen
from drake_cafim.diagnosis.output_error.moves import Move, Moves, with_values_of
from drake_cafim.diagnosis.output_error.problem import REFIT_STEPS, SimulationFit, at_joint
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect

TRIED = 3
"""Candidates of each joint that are fitted together: those that lower the cost most to first order, then the next."""
SETTLED_SHARE = 0.5
"""Rise of a joint's cost without an effect, over the largest one, from which it is not put down to other joints."""


@dataclass(frozen=True)
class Growth:
    """Changes of explanations by `moves`, which the `trace` records."""

    moves: Moves
    trace: Trace

    def grow(self, best: SimulationFit) -> SimulationFit | None:
        """`best` with one change at each joint that has one; None where no joint has.

        Those that gain most to first order are tried first, and the others as long as none of these passes anywhere.
        """
        problem = self.moves.problem
        present = best.model.effects
        free = [
            [law for law in own if not any(self.moves.excludes(law, other) for other in present)]
            for own in self.moves.hypotheses
        ]
        added = screen(problem, best, best.slopes_without(()), free, self.moves.price, best.model)
        replacing = self._replacing(best)
        most = max([*map(len, added), *map(len, replacing)], default=0)
        for first in range(0, most, TRIED):
            until = first + TRIED
            for joint, own in zip(problem.joints, added, strict=True):
                self.trace.add(*decisions.record_screening(joint, own[first:until], True))
            moves = [
                [*instead[first:until], *(((), candidate.effect) for candidate in own[first:until])]
                for instead, own in zip(replacing, added, strict=True)
            ]
            grown = self._accept(best, moves)
            if grown is not None:
                for joint, own in zip(problem.joints, added, strict=True):
                    self.trace.add(*decisions.record_screening(joint, own[until : until + 1], False))
                return grown
        return None

    def _replacing(self, best: SimulationFit) -> list[list[Move]]:
        """By joint, laws of the group of one that is present, each with that one, which it replaces."""
        problem = self.moves.problem
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
        """`best` with the moves of joints that lower their costs most, as far as these pass, fitted.

        Where none of them does, those that lower the costs next most are tried; None where none is left.
        """
        problem = self.moves.problem
        for taken in zip_longest(*self._lowering(best, moves)):
            fitted = problem.fit(self.moves.changed(best.model, taken), steps=REFIT_STEPS)
            passed = self._passes(best, fitted, taken)
            if all(passed):
                return fitted
            some = [move if good else None for move, good in zip(taken, passed, strict=True)]
            if any(some):
                return problem.fit(self.moves.changed(best.model, some, fitted.model), steps=REFIT_STEPS)
        return None

    def _lowering(self, best: SimulationFit, moves: Sequence[Sequence[Move]]) -> list[list[Move]]:
        """By joint, the moves that lower its cost in a quick fit, the one that lowers it most first; or the best one.

        A quick fit keeps the slopes that it begins with: one of a supply's sag, with which a servo's limit rises by a
        quarter, lowered the cost by .4, and the exact one by 23.
        """
        costs = self.moves.costs(best)
        found: list[list[tuple[float, Move]]] = [[] for _ in moves]
        tried = list(zip_longest(*moves))
        trials = self.moves.problem.for_each(lambda own: self.moves.chord(best, own), tried)
        for own, trial in zip(tried, trials, strict=True):
            after = self.moves.costs(trial)
            for j, move in enumerate(own):
                if move is not None:
                    found[j].append((float(after[j]), (move[0], with_values_of(trial.model, move[1]))))
        ordered = [sorted(own, key=lambda tried: tried[0]) for own in found]
        return [
            [move for k, (after_it, move) in enumerate(own) if k == 0 or after_it < cost]
            for own, cost in zip(ordered, costs, strict=True)
        ]

    def _passes(self, best: SimulationFit, fitted: SimulationFit, taken: Sequence[Move | None]) -> list[bool]:
        """By joint, whether the change lowers the cost and the errors of parts that are left out, and its law acts."""
        before, after, passed = self.moves.costs(best), self.moves.costs(fitted), []
        for j, move in enumerate(taken):
            if move is None:
                passed.append(True)
                continue
            worse, error = _left_out(best, fitted, j)
            law = with_values_of(fitted.model, move[1])
            good = bool(after[j] < before[j] and worse < 0.0 and self.moves.acts(fitted.model, law))
            key, replaced = law.key, [effect.key for effect in move[0]]
            self.trace.add(decisions.record_trial(key, replaced, float(before[j] - after[j]), worse, error, good))
            passed.append(good)
        return passed

    def prune(self, best: SimulationFit) -> SimulationFit:
        """`best` without the effects whose joint costs less without them, one of each joint at a time.

        What one joint then misses shows at others, so that of those that cost more, only the joints that cost most are
        settled, and the others are tried again without them.
        """
        problem = self.moves.problem
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
                stays = bool(risen[j] > 0.0 and worse > 0.0 and self.moves.acts(best.model, effect))
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
        own = [e for e in best.model.effects if at_joint(e.at, self.moves.problem.joints[joint]) and e.key not in kept]
        return own[-1] if own else None


def _left_out(before: SimulationFit, after: SimulationFit, joint: int) -> tuple[float, float]:
    """By how much ln of the mean squared error of parts that are left out rises at a joint, and its standard error."""
    rise = after.equations[joint].left_out() - before.equations[joint].left_out()
    return float(np.mean(rise)), float(np.std(rise, ddof=1) / np.sqrt(len(rise))) if len(rise) > 1 else 0.0
