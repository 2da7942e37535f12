"""The state of a search: the problem under its present whitening, and the fits and tests made under it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.fit.evidence import criterion, scale_of
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.screening import Candidate, screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.thresholds import (
    ADEQUACY_LEVEL,
    CANDIDATES_FITTED,
    COMPETING_CRITERION_REACH,
    EXPLANATIONS_CONTINUED,
    FALSE_ALARM_RATE,
    MOST_EFFECTS,
    UNKNOWN_MOVE_IN_PRIOR_STDS,
)
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError
from drake_cafim.parallel.forked import map_forked

ROUNDS = 3
"""Largest number of repetitions, of whitening while unknowns change, and of competitions between explanations."""


@dataclass(frozen=True)
class Settings:
    """Options of a search.

    - `false_alarm_rate`: probability that a mismatch is detected, or an effect accepted, on noise alone.
    - `adequacy_level`: p-value of the goodness-of-fit test above which what remains counts as noise.
    - `most_effects`: largest number of effects of an explanation.
    - `beam`: number of explanations of each size that are continued.
    - `refined`: number of candidates that are fitted exactly beside each of these.
    - `jobs`: processes that compare laws and simulate models, -1 for one per core; the result is the same.

    Raises `InputError` for a rate or a level that is not between 0 and 1, and for a negative number of effects.
    """

    false_alarm_rate: float = FALSE_ALARM_RATE
    adequacy_level: float = ADEQUACY_LEVEL
    most_effects: int = MOST_EFFECTS
    beam: int = EXPLANATIONS_CONTINUED
    refined: int = CANDIDATES_FITTED
    jobs: int = 1

    def __post_init__(self) -> None:
        for name, value in (("false-alarm rate", self.false_alarm_rate), ("adequacy level", self.adequacy_level)):
            if not 0.0 < value < 1.0:
                raise InputError(f"the {name} is {value:g}, expected a number above 0 and below 1")
        if self.most_effects < 0 or min(self.beam, self.refined) < 1:
            raise InputError(
                f"most_effects, beam and refined are {self.most_effects}, {self.beam} and {self.refined}, expected "
                "integers of at least 0, 1 and 1"
            )


@dataclass
class Pool:
    """Every explanation that was fitted, by its effects and its unknowns without prior.

    Fits whose gain is an artefact of noise (`Fit.echo`), or whose χ² is infinite, are no explanations and are left out.
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
    """The state of a search: the problem under its present whitening, and the fits and tests made under it."""

    problem: SearchProblem
    settings: Settings
    effects: Sequence[Effect]
    trials: int
    progress: Callable[[str], None]
    trace: Trace = field(default_factory=Trace)
    pool: Pool = field(default_factory=Pool)
    screens: dict[frozenset[Key], list[Candidate]] = field(default_factory=dict)
    frontier: list[Fit] = field(default_factory=list)
    halted: bool = False
    """Whether `frontier` is where a growth was ended that may go on."""
    rests: list[tuple[Model, Fit]] = field(default_factory=list)

    def rest(self, model: Model) -> Fit:
        """The quick fit of `model`, an explanation without one of its effects; cached."""
        for known, found in self.rests:
            if known.effects == model.effects and known.free == model.free:
                return found
        self.rests.append((model, fit(self.problem, model)))
        return self.rests[-1][1]

    def screen(self, parent: Fit) -> list[Candidate]:
        """First-order candidates for one more effect beside `parent`; cached.

        By this process alone: what it computes of the rows is kept, and serves the next parents in a fifth of the time.
        """
        key = parent.model.keys
        if key not in self.screens:
            self.screens[key] = self._screened(parent)
        return self.screens[key]

    def screen_all(self, parents: Iterable[Fit]) -> None:
        """`screen` of each of `parents`, by several processes."""
        new = {parent.model.keys: parent for parent in parents if parent.model.keys not in self.screens}
        each = list(new.values())
        found = map_forked(lambda number: self._screened(each[number]), len(each), self.settings.jobs)
        self.screens |= dict(zip(new, found, strict=True))

    def _screened(self, parent: Fit) -> list[Candidate]:
        others = parent.model.effects
        free = [effect for effect in self.effects if not any(effect.excludes(other) for other in others)]
        return screen(self.problem, parent, free)

    def dismiss(self, found: Fit) -> None:
        """No longer extends or chooses `found`: what it gains is an artefact of the noise under which it was fitted."""
        self.frontier = [other for other in self.frontier if other.model.keys != found.model.keys]
        self.pool.fits.pop(found.model.keys, None)

    def cost(self, scale: float) -> Callable[[Fit], float]:
        """The information criterion in units of the noise that is left, `scale`."""
        return lambda found: criterion(found, scale, self.trials)

    def ranked(self, fits: Iterable[Fit]) -> list[Fit]:
        """By the information criterion, the best first."""
        return sorted(fits, key=self.cost(1.0))

    def rewhiten(self, best: Fit) -> Fit | None:
        """Whitens under `best`, since its effects change the noise covariance, and fits what still competes again.

        None, with the state unchanged, if under its own covariance the gain of `best` is an artefact of noise.
        """
        cost = self.cost(1.0)
        reach = cost(best) + COMPETING_CRITERION_REACH * scale_of(best)
        competing = [found for found in self.frontier if cost(found) < reach]
        problem, pool = self.problem, Pool()
        for _ in range(ROUNDS):
            problem, pool = problem.rewhitened(best.model), Pool()
            for found in (best, *(other for other in competing if other.model.keys != best.model.keys)):
                # the best width of a change of sign depends on the covariance as well
                pool.add(
                    unbiased_fit(
                        problem,
                        fit_shapes(problem, fit(problem, found.model, tolerance=CONVERGED), None, CONVERGED).model,
                    )
                )
                if best.model.keys not in pool.fits:
                    self.trace.add(decisions.record_echo(best.model))
                    return None
            before, best = best, pool.fits[best.model.keys]
            self.trace.add(decisions.record_whitening(problem, before.model, best.model, UNKNOWN_MOVE_IN_PRIOR_STDS))
            if not has_moved(problem, before.model, best.model):
                break
        self.problem, self.pool, self.screens, self.rests = problem, pool, {}, []
        self.frontier = self.ranked(pool.fits.values())
        return best


def has_moved(problem: SearchProblem, before: Model, after: Model) -> bool:
    """Whether unknowns changed so much that the noise covariance has to be computed again."""
    scene = problem.scene
    size = np.minimum(scene.priors.std, [unknown.typical for unknown in scene.unknown])
    return bool(np.any(np.abs(after.unknown - before.unknown) > UNKNOWN_MOVE_IN_PRIOR_STDS * size))
