"""Withholds names that the recordings do not support: other laws explain as much, or the law is refuted.

An explanation may leave nothing but noise and yet share that with other laws. Then none has earned its name: the place
is told, and the laws that may act there stand as rivals. Or it leaves more than a law would that holds there, or needs
other strengths in every part of the recordings: then it is refuted, and the place alone is told. Or more than noise
remains, and it acts in one of the recordings alone: then no other one confirms it. Or others are refuted beside which
it was found, and without them another law does as well in its place.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from drake_cafim.diagnosis.fit.constancy import constancy_of
from drake_cafim.diagnosis.fit.evidence import share_improved
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.robust_covariance import p_value_of_no_better
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.fit.without_effects import parts_that_show
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns
from drake_cafim.diagnosis.search.judgement import Judgement, narrowed
from drake_cafim.diagnosis.search.search_under_unknown_force import mean_square, misfit_by_row, misfits_by_row
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import (
    GAIN_SHARE_FAR_LESS,
    LEAST_PARTS_THAT_SHOW,
    LEAST_PROBABILITY,
    MEASURED_FORCE_EXCESS_SHARE_LEFT,
    MISFIT_REDUCED_CHI_SQUARE,
    MISFIT_SHARE_TO_EXPLAIN,
    NAMED_EXCESS_SHARE,
    RECORDINGS_SHARE_IMPROVED,
    RIVALS_FITTED_PER_PARENT,
    SENSOR_MISS_IN_STDS,
    SHARE_LEFT_BESIDE_EXACT,
    VARYING_SHARE,
    VARYING_SHARE_BESIDE_FORCES,
)
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.parallel.forked import map_forked
from drake_cafim.typing import Flags

_Test = Callable[[Judgement, Settings, Trace], list[Effect]]


def withhold_shared(judgement: Judgement, trace: Trace) -> Judgement:
    """The judgement without the names that fail `failures`, which are its `withheld`; each failure is added to `trace`.

    Its kind is then `unexplained`, since what these effects explained has no name.
    """
    own = trace.of_search(judgement.search)
    while failed := list(failures(judgement)):
        own.add(*(record for _, record in failed))
        judgement = withhold(judgement, [effect for effect, _ in failed])
    return judgement


def withhold(judgement: Judgement, effects: Sequence[Effect]) -> Judgement:
    """The judgement without the names of `effects`, which are `withheld`, all others fitted again."""
    return replace(_without(judgement, effects), withheld=(*judgement.withheld, *effects))


def withhold_refuted(judgement: Judgement, settings: Settings, trace: Trace) -> Judgement:
    """The judgement without the laws that the recordings refute; each test is added to `trace`.

    A sensor's reading of a contact's force refutes laws of joints that make up for it (`_of_forces_that_are_read`).
    What is left while only some equations hold to the noise refutes the laws there (`_refuted_at_place`), and so do
    numbers of a contact that are not plausible (`_of_implausible_contacts`), strengths that vary, the least constant
    first (`_varying`), and recordings of which most are no better with it (`_helping_some`). What acts in one recording
    alone is `_unconfirmed`.
    """
    # what was judged by simulations has no rows
    if judgement.std is not None or judgement.kind == "none":
        return judgement
    own = trace.of_search(judgement.search)
    found = judgement.best
    for refuted in (_of_forces_that_are_read, _refuted_at_place, _of_implausible_contacts, _varying, _helping_some):
        # what one test cannot tell, the others may
        judgement = narrowed(judgement, partial(_withhold, refuted, settings, own))
    if judgement.best is not found and not judgement.search:
        judgement = narrowed(judgement, lambda it: _without_replaceable(it, found.model.keys, settings, own))
    return narrowed(judgement, lambda it: _without_unconfirmed(it, own))


def _withhold(refuted: _Test, settings: Settings, trace: Trace, judgement: Judgement) -> Judgement:
    """The judgement without the effects that are `refuted`, and those that are without these."""
    while failed := refuted(judgement, settings, trace):
        judgement = _without(judgement, failed)
    return judgement


def _of_forces_that_are_read(judgement: Judgement, settings: Settings, trace: Trace) -> list[Effect]:
    """The laws of joints and actuators that make up for a contact's force, by the sensor that reads this.

    With the reading in the place of the predicted force hardly anything is missing in the joint's equation without any
    law there, or without any effect at all, and with this one more is.
    """
    problem, model = judgement.outcome.nominal_problem, judgement.best.model
    refuted = []
    for effect in model.effects:
        if effect.place not in (Place.JOINT, Place.ACTUATOR):
            continue
        elsewhere = replace(model, effects=tuple(other for other in model.effects if other.at != effect.at))
        for bare in (elsewhere, judgement.outcome.nominal.model):
            without, beside = problem.with_reading(bare), problem.with_reading(bare.with_effects([effect]))
            if without is None or beside is None:
                return []
            joint = problem.scene.tree.joint_index(effect.at)
            predicted, read, law = (float(values[joint]) for values in (*without, beside[1]))
            # a law that holds, but hardly shows with the noise of the reading, may raise χ² by chance
            more = law - read > SENSOR_MISS_IN_STDS**2
            makes_up = more and read < MEASURED_FORCE_EXCESS_SHARE_LEFT * predicted
            if makes_up:
                break
        trace.add(decisions.record_read(model, effect, read, law, not makes_up))
        refuted += [effect] if makes_up else []
    return refuted


def _refuted_at_place(judgement: Judgement, settings: Settings, trace: Trace) -> list[Effect]:
    """The laws that leave far more than noise in the equations that they explain best, while others hold to the noise.

    A machine of which no equation holds to the noise has a model that is inexact everywhere, and a law that explains
    more than is left may be right. Where some do, model and noise are exact, and what is left elsewhere is of the laws
    that are named there: together they have to explain nearly all of it, though small unknown forces may be called
    `explained`.
    """
    best, outcome = judgement.best, judgement.outcome
    lasting = [effect for effect in best.model.effects if effect.episode is None]
    remains = judgement.kind == "unexplained" or outcome.problem.forced_joints
    if not remains or judgement.adequate or not lasting:
        return []
    problem = outcome.nominal_problem
    left, *had = misfits_by_row(problem, best.model, [best.model.without(effect) for effect in lasting])
    left = left[problem.equations]
    standing = left > MISFIT_REDUCED_CHI_SQUARE
    most = _share_that_laws_leave(problem, best.model, standing)
    if most is None:
        return []
    at: dict[int, list[Effect]] = {}
    for effect, misfit in zip(lasting, had, strict=True):
        at.setdefault(int(np.argmax(misfit[problem.equations] - left)), []).append(effect)
    # what holds to the noise is not asked
    asked = [(row, effects) for row, effects in at.items() if standing[row]]

    def misfit_without(number: int) -> float:
        row, effects = asked[number]
        kept = tuple(effect for effect in best.model.effects if effect not in effects)
        rest = replace(best.model, effects=kept)
        model = fit(outcome.problem, rest, tolerance=CONVERGED).model if kept else outcome.nominal.model
        return float(misfit_by_row(problem, model)[problem.equations][row])

    refuted = []
    for (row, effects), without in zip(asked, map_forked(misfit_without, len(asked), settings.jobs), strict=True):
        share = float((left[row] - 1.0) / max(without - 1.0, 1e-300))
        passed = share <= most
        for effect in effects:
            trace.add(decisions.record_left_at_place(best.model, effect, share, most, passed))
        refuted += [] if passed else effects
    return refuted


def _share_that_laws_leave(problem: SearchProblem, model: Model, standing: Flags) -> float | None:
    """The largest share of the misfit at their place that laws leave which hold there; None where that is not known.

    It is where some equations hold to the noise, and all do that are not `standing` (r,), beside the forces that
    remain: a large misfit disturbs the rows of other joints, too, until a force at its joint is counted as noise. A
    joint whose noise would hide a force as large beside its efforts, as one at rest does, says nothing of whether the
    model is exact; nor do rows with far less than the stated noise, which is not that of the recordings. A throw has no
    forces at joints: its rows are of one motion, and tell less of what is exact.
    """
    force = problem.likeliest_force(model) if np.any(standing) else None
    beside = problem if force is None else problem.with_unknown_force(force, model)
    left = misfit_by_row(beside, model)[problem.equations][~standing]
    hidden = len(left) in (0, len(standing)) or not (force is None or beside.exact_joints)
    if hidden or np.any(left < 1.0 / MISFIT_REDUCED_CHI_SQUARE):
        return None
    return MISFIT_SHARE_TO_EXPLAIN if force is None else SHARE_LEFT_BESIDE_EXACT


def _of_implausible_contacts(judgement: Judgement, settings: Settings, trace: Trace) -> list[Effect]:
    """The laws of contacts of which a known number is far from its prior, while more than noise remains.

    Those of the contacts' surfaces are among them. A law that needs another stiffness than the contact is known to
    have, and yet leaves much, is not how that yields.
    """
    if judgement.kind != "unexplained" or judgement.adequate:
        return []
    model = judgement.best.model
    far = {unknown.at: unknown for unknown in far_unknowns(judgement.outcome.problem.scene, model)}
    # a contact is "body/surface"
    far |= {at.partition("/")[2]: unknown for at, unknown in far.items() if "/" in at}
    implausible = [effect for effect in model.effects if effect.of_contact and effect.at in far]
    trace.add(*(decisions.record_implausible_contact(model, effect, far[effect.at]) for effect in implausible))
    return implausible


def _varying(judgement: Judgement, settings: Settings, trace: Trace) -> list[Effect]:
    """The law that needs other strengths in other parts of the recordings, the least constant one.

    Where noise alone is left, nothing else that is missing can make a strength vary: there it is refuted at the
    adequacy's level, unless it varies by less than `VARYING_SHARE`. Where unknown forces are a part of that noise,
    effects too faint to be found may be missing beside it: it has to vary by more than these could make it, and by
    `VARYING_SHARE_BESIDE_FORCES`. Where more is left, that varies too, and what a law explains with the same strengths
    throughout has to be at least half of what it explains with strengths of its own in each part.
    """
    problem = judgement.outcome.problem
    tested = constancy_of(problem, judgement.best)
    alone = judgement.kind == "explained" or judgement.adequate
    level, least = settings.adequacy_level / max(len(tested), 1), VARYING_SHARE
    if alone and problem.forced_joints:
        level = settings.false_alarm_rate / max(judgement.outcome.hypotheses, 1)
        least = VARYING_SHARE_BESIDE_FORCES
    varying = [it for it in tested if it.p_value < level and it.share < 1.0 - least]
    failed = [it for it in varying if alone or it.share < NAMED_EXCESS_SHARE]
    for it in tested:
        trace.add(decisions.record_constancy(judgement.best.model, it, level, it not in failed))
    return [min(failed, key=lambda it: it.share).effect] if failed else []


def _without_replaceable(judgement: Judgement, found: Collection[Key], settings: Settings, trace: Trace) -> Judgement:
    """The judgement without the laws whose places another one may take that predicts about as well (`_replacements`).

    What stands after others of those `found` are refuted was compared with other laws beside these only: what they made
    up for decided which of several it is. They are rivals then, by the probabilities that each predicts better.
    """
    rivals: dict[Key, float] = {}
    shared = []
    for effect in judgement.best.model.effects:
        others = _replacements(judgement, effect, found, settings, trace) if effect.episode is None else {}
        if others:
            weights = {effect.key: 1.0 - max(others.values())} | others
            rivals |= {key: weight / sum(weights.values()) for key, weight in weights.items()}
            shared.append(effect)
    return replace(_without(judgement, shared), rivals={**judgement.rivals, **rivals}) if shared else judgement


def _replacements(
    judgement: Judgement, effect: Effect, found: Collection[Key], settings: Settings, trace: Trace
) -> dict[Key, float]:
    """The laws in the place of `effect` than which it does not predict surely better, and the p-values of that.

    All are fitted to the rows as they are without any effect: those of the search were made under what is refuted.
    """
    problem, model = judgement.outcome.nominal_problem, judgement.best.model
    best, rest = unbiased_fit(problem, model), unbiased_fit(problem, model.without(effect))
    laws = [law for law in problem.hypotheses() if law.key not in found and not any(map(law.excludes, model.effects))]
    # a push cannot take the place of what lasts
    looks = [it for it in screen(problem, rest, laws, jobs=settings.jobs) if it.effect.episode is None]
    needed, alike = GAIN_SHARE_FAR_LESS * (rest.chi_square - best.chi_square), {}
    for candidate in looks[:RIVALS_FITTED_PER_PARENT]:
        other = unbiased_fit(problem, rest.model.with_effects([candidate.effect]))
        if candidate.gain <= needed or not problem.plausible(other.model):
            continue
        p_value = p_value_of_no_better(problem, best, other)
        trace.add(decisions.record_replacement(best, effect, other, p_value, settings.false_alarm_rate))
        if p_value > settings.false_alarm_rate:
            alike[other.model.effects[-1].key] = p_value
    return alike


def _helping_some(judgement: Judgement, settings: Settings, trace: Trace) -> list[Effect]:
    """The law, where more than noise remains, that improves the fewest of the recordings, if these are too few.

    Of a search for few effects: those of one for many were asked this in the end. A law that came in the place of
    another was not, and may have lost since what it helped beside.
    """
    if judgement.kind != "unexplained" or judgement.adequate or judgement.search:
        return []
    problem, best = judgement.outcome.problem, judgement.best
    lasting = [effect for effect in best.model.effects if effect.episode is None]
    shares = [share_improved(problem, unbiased_fit(problem, best.model.without(effect)), best) for effect in lasting]
    for effect, share in zip(lasting, shares, strict=True):
        trace.add(decisions.record_helped(best.model, effect, share, RECORDINGS_SHARE_IMPROVED))
    few = [k for k, share in enumerate(shares) if share < RECORDINGS_SHARE_IMPROVED]
    return [lasting[min(few, key=lambda k: shares[k])]] if few else []


def _without_unconfirmed(judgement: Judgement, trace: Trace) -> Judgement:
    """The judgement without the laws that are `_unconfirmed`, which are then `withheld`."""
    alone = _unconfirmed(judgement, trace)
    return withhold(judgement, alone) if alone else judgement


def _unconfirmed(judgement: Judgement, trace: Trace) -> list[Effect]:
    """The laws, where more than noise remains, that fewer than `LEAST_PARTS_THAT_SHOW` of the recordings show.

    They may stand for whatever else that part lacks. A push is known to act once: see `rivals_by_place`.
    """
    problem, best = judgement.outcome.problem, judgement.best
    if judgement.kind != "unexplained":
        return []
    lasting = [effect for effect in best.model.effects if effect.episode is None]
    shown = [parts_that_show(problem, best, effect) for effect in lasting]
    alone = [k for k, parts in enumerate(shown) if np.count_nonzero(parts) < LEAST_PARTS_THAT_SHOW]
    trace.add(
        *(decisions.record_unconfirmed("prune", best.model, lasting[k], shown[k], LEAST_PARTS_THAT_SHOW) for k in alone)
    )
    return [lasting[k] for k in alone]


def _without(judgement: Judgement, effects: Sequence[Effect]) -> Judgement:
    """The judgement without the names of `effects`, all others fitted again."""
    rest = _refitted_without(judgement, effects)
    # the rows of the search are whitened under the effects that are left out
    left = mean_square(judgement.outcome.nominal_problem, rest)
    return replace(judgement, best=rest, kind="unexplained", left=left, adequate=False)


def _refitted_without(judgement: Judgement, effects: Sequence[Effect]) -> Fit:
    best, outcome = judgement.best, judgement.outcome
    kept = tuple(effect for effect in best.model.effects if effect not in effects)
    return unbiased_fit(outcome.problem, replace(best.model, effects=kept)) if kept else outcome.nominal


def failures(judgement: Judgement) -> Iterator[tuple[Effect, Record]]:
    """The named effects that have less than half of the probability that they share with other laws, and the record."""
    for effect in judgement.best.model.effects:
        probability = judgement.outcome.probability.get(effect.key, 1.0)
        if probability < LEAST_PROBABILITY:
            yield effect, decisions.record_shared(judgement.best.model, effect, probability, LEAST_PROBABILITY)
