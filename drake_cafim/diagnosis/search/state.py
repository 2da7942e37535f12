"""A search under way: what was fitted and screened under the present whitening of the noise."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.fit.evidence import criterion, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.screening import Candidate, screen
from drake_cafim.diagnosis.thresholds import COMPETING_CRITERION_REACH, UNKNOWN_MOVE_IN_PRIOR_STDS
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect

ROUNDS = 3
"""Times, at most, that the noise is whitened anew as unknowns move."""


@dataclass(frozen=True)
class Settings:
    """How hard to search and how sure to be; nothing here depends on the case.

    - `false_alarm_rate`: probability that anything is named where nothing is missing.
    - `most_effects`: how many an explanation may have.
    - `beam`: explanations of each size that are carried on; `refined`: candidates each of them is refitted with.
    """

    false_alarm_rate: float = 0.01
    most_effects: int = 3
    beam: int = 3
    refined: int = 4


@dataclass
class Pool:
    """Every explanation that was fitted, by what is in it.

    Echoes of noise, and fits that ran away, are no explanations and are left out.
    """

    fits: dict[frozenset[Key], Fit] = field(default_factory=dict)

    def add(self, found: Fit) -> None:
        """Keep `found` instead of an earlier fit of its effects; where it is an echo of noise, those were as well."""
        if found.echo or not np.isfinite(found.chi_square):
            self.fits.pop(found.model.keys, None)
        else:
            self.fits[found.model.keys] = found


@dataclass
class State:
    """A search under way: the problem under its present whitening, and what was fitted and screened under it."""

    problem: SearchProblem
    settings: Settings
    effects: Sequence[Effect]
    trials: int
    progress: Callable[[str], None]
    trace: Trace = field(default_factory=Trace)
    pool: Pool = field(default_factory=Pool)
    screens: dict[frozenset[Key], list[Candidate]] = field(default_factory=dict)
    frontier: list[Fit] = field(default_factory=list)
    rests: list[tuple[Model, Fit]] = field(default_factory=list)

    def rest(self, model: Model) -> Fit:
        """The fit of an explanation without one of its effects, computed once."""
        for known, found in self.rests:
            if known.effects == model.effects and known.free == model.free:
                return found
        self.rests.append((model, fit(self.problem, model)))
        return self.rests[-1][1]

    def screen(self, parent: Fit) -> list[Candidate]:
        """Candidates that may join `parent`, screened once."""
        key = parent.model.keys
        if key not in self.screens:
            others = parent.model.effects
            free = [effect for effect in self.effects if not any(effect.excludes(other) for other in others)]
            self.screens[key] = screen(self.problem, parent, free)
        return self.screens[key]

    def cost(self, scale: float) -> Callable[[Fit], float]:
        """The information criterion in units of the noise that is left, `scale`."""
        return lambda found: criterion(found, scale, self.trials)

    def ranked(self, fits: Iterable[Fit]) -> list[Fit]:
        """By the information criterion, the best first."""
        return sorted(fits, key=self.cost(1.0))

    def rewhiten(self, best: Fit) -> Fit | None:
        """Whiten under `best`, since accepted physics moves the noise too; what still competes is fitted anew.

        None, and nothing is whitened anew, where under its own noise `best` is an echo of it.
        """
        cost = self.cost(1.0)
        reach = cost(best) + COMPETING_CRITERION_REACH * scale_of(best)
        competing = [found for found in self.frontier if cost(found) < reach]
        problem, pool = self.problem, Pool()
        for _ in range(ROUNDS):
            problem, pool = problem.rewhitened(best.model), Pool()
            for found in (best, *(other for other in competing if other.model.keys != best.model.keys)):
                # the width of a sign change is chosen anew as well
                pool.add(unbiased_fit(problem, fit_shapes(problem, fit(problem, found.model)).model))
                if best.model.keys not in pool.fits:
                    self.trace.add(decisions.echo(best.model))
                    return None
            before, best = best, pool.fits[best.model.keys]
            self.trace.add(decisions.whitened(problem, before.model, best.model, UNKNOWN_MOVE_IN_PRIOR_STDS))
            if not has_moved(problem, before.model, best.model):
                break
        self.problem, self.pool, self.screens, self.rests = problem, pool, {}, []
        self.frontier = self.ranked(pool.fits.values())
        return best


def has_moved(problem: SearchProblem, before: Model, after: Model) -> bool:
    """Whether unknowns moved so far that the noise is to be whitened anew."""
    return bool(np.any(np.abs(after.unknown - before.unknown) > UNKNOWN_MOVE_IN_PRIOR_STDS * problem.scene.priors.std))
