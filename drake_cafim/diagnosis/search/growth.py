"""Forward selection of effects: screen to first order, refit exactly, accept another effect while the tests pass."""

from collections.abc import Callable, Iterable

from scipy.stats import chi2

from drake_cafim.diagnosis.fit.evidence import (
    SHARE_OF_RECORDINGS,
    UNDER_ITS_OWN_NOISE,
    Check,
    checks,
    leaves_noise,
    scale_of,
)
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import candidate_decisions, decisions
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.state import State
from drake_cafim.diagnosis.thresholds import CANDIDATE_GAIN_SHARE_REFITTED, GAIN_SHARE_FAR_LESS


def grow(state: State, best: Fit, ends: Callable[[State, Fit], bool] | None = None) -> Fit:
    """The explanation, grown from `best` effect by effect, that no further effect improves significantly.

    Where one improves only some recordings, two are tried together: in the others the second may hide the first. With
    `ends`, it is halted once that holds of it, and goes on from there when it is called again.
    """
    together = False
    if not state.halted:
        state.frontier = [best]
    state.halted = False
    for depth in range(len(best.model.effects) + 1, state.settings.most_effects + 1):
        if ends is not None and not together and best.model.effects and ends(state, best):
            state.halted = True
            return best
        if not together and not _is_worth_more(state, best):
            break
        _expand(state, depth)
        failed = set()
        for candidate in tuple(state.frontier):
            # the quick fits rank candidates, but noise in their regressors biases them: tests need the unbiased fit
            larger = unbiased_fit(state.problem, candidate.model)
            state.pool.add(larger)
            done = _tested(state, best, larger)
            if all(check.passed for check in done):
                grown = state.rewhiten(larger)
                if grown is not None:
                    best, together = grown, False
                    break
                continue
            failed.add(done[-1].name)
            if done[-1].name == UNDER_ITS_OWN_NOISE:
                state.dismiss(candidate)
        else:
            state.trace.add(candidate_decisions.record_none_admitted(best))
            if together or SHARE_OF_RECORDINGS not in failed:
                break
            together = True
    state.trace.add(*candidate_decisions.record_effect_limit(best, state.settings.most_effects))
    return best


def _is_worth_more(state: State, best: Fit) -> bool:
    """Whether the score test of any further effect rejects, at the false-alarm rate, that it is absent."""
    scale, alpha, candidates = scale_of(best), state.settings.false_alarm_rate, state.screen(best)
    worth = any(chi2.sf(c.gain / scale, c.strengths) * state.trials <= alpha for c in candidates)
    state.trace.add(*candidate_decisions.record_next_effect(best, candidates, state.trials, alpha, worth))
    go_on = _go_on(state) if worth else None
    state.trace.add(*candidate_decisions.record_screening(best, candidates, state.effects, state.trials, alpha, go_on))
    return worth


def _go_on(state: State) -> candidate_decisions.GoOn:
    return candidate_decisions.GoOn(state.settings.refined, CANDIDATE_GAIN_SHARE_REFITTED)


def _tested(state: State, best: Fit, larger: Fit) -> list[Check]:
    """The tests of `larger` against `best`, up to the first that fails."""
    done = list(checks(state.problem, best, larger, state.trials, state.settings.false_alarm_rate))
    state.trace.add(*decisions.record_admission(best, larger, done))
    return done


def _expand(state: State, depth: int) -> None:
    """Replaces the frontier by the best explanations with one more effect, `depth` in all."""
    found: dict[frozenset[Key], Fit] = {}
    promised: dict[frozenset[Key], float] = {}
    for parent in state.frontier:
        present = parent.model.keys
        candidates = state.screen(parent)
        for candidate in _go_on(state).fitted(candidates):
            key = frozenset({*present, candidate.effect.key})
            if key in found or _is_far_less(state, parent, found.values(), candidate):
                continue
            state.progress(f"{depth} effect{'s' * (depth > 1)}: {candidate.effect.name} at {candidate.effect.at}")
            grown = fit(state.problem, parent.model.with_effects([candidate.effect]), tolerance=CONVERGED)
            if state.problem.plausible(grown.model):
                found[key], promised[key] = grown, parent.chi_square - candidate.gain
    least = min((explanation.chi_square for explanation in found.values()), default=0.0)
    for key, explanation in found.items():
        # an exact fit that ended elsewhere than the first order, which promises the best of all, is begun again
        if promised[key] < min(least, explanation.chi_square):
            found[key] = _begin_again(state.problem, explanation)
    ranked = state.ranked(found.values())
    carried_on = [
        fit_shapes(state.problem, explanation, None, CONVERGED) for explanation in ranked[: state.settings.beam]
    ]
    for explanation in (*ranked[state.settings.beam :], *carried_on):
        state.pool.add(explanation)
    state.frontier = state.ranked(carried_on)
    state.trace.add(*decisions.record_fits(ranked, state.settings.beam, state.cost(1.0)))


def _begin_again(problem: SearchProblem, found: Fit) -> Fit:
    """The fit from a better start than that of `found`, where there is one and the fit from there is plausible."""
    start = problem.better_start(found.model)
    if start is None:
        return found
    again = fit(problem, start, tolerance=CONVERGED)
    return again if again.chi_square < found.chi_square and problem.plausible(again.model) else found


def _is_far_less(state: State, parent: Fit, found: Iterable[Fit], candidate: Candidate) -> bool:
    """Whether the candidate's first-order gain is far below that of an explanation that leaves only noise.

    Such a candidate cannot become a rival, so it need not be fitted.
    """
    # where rows bend with the strengths, a first-order gain is no bound
    if state.problem.whitened_by_model:
        return False
    return any(
        candidate.gain < GAIN_SHARE_FAR_LESS * (parent.chi_square - other.chi_square)
        and leaves_noise(state.problem, other, state.settings.adequacy_level)
        for other in found
    )
