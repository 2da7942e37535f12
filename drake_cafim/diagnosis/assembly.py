"""Assembles the verdict of a judgement: explanations, rivals, parameters, locations, and figures of fit."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.intervals import changes_beside, standard_deviations, unknowns_std
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.left_out.law_words import words_of
from drake_cafim.diagnosis.left_out.selection import Selection
from drake_cafim.diagnosis.likelihood.efficiency import efficiencies
from drake_cafim.diagnosis.notes.effort_scale import effort_scale_notes
from drake_cafim.diagnosis.notes.overstated import Overstated
from drake_cafim.diagnosis.preparation import PreparedRecordings
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.pushes import locate_named
from drake_cafim.diagnosis.thresholds import RIVAL_BY_SIMULATION, RIVAL_EXCESS_CHI_SQUARE
from drake_cafim.diagnosis.trace import names_of, spoken
from drake_cafim.diagnosis.verdict import (
    Comparison,
    Correction,
    Explanation,
    Learned,
    LeftOut,
    Location,
    Mismatch,
    NominalParameter,
    Quality,
    Rival,
    Value,
    Verdict,
)
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.learned_force import table_name
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.scenario.inertials import INERTIALS, PHYSICAL, LinkInertials, distance_together
from drake_cafim.scenario.unknown import UnknownParameter, inertials
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

FAR_ALIKE = "with a value far from its prior it changes the measurements alike"
NOTHING_MOVES = "nothing moves in the recordings beyond its noise, so that no effect was looked for"
MORE_THAN_NOISE = (
    "the efficiency of the parameters' intervals is not computed: more than noise remains, so that the likelihood of "
    "the recordings is not that of any model that was found"
)
Progress = Callable[[str], None]


def verdict_of(
    prepared: PreparedRecordings, judgement: Judgement, selection: Selection, progress: Progress, jobs: int = 1
) -> Verdict:
    """The verdict by a judgement of `prepared` recordings, with what was selected of it in the corrected scene.

    A figure that cannot be computed is NaN, with a note. `jobs` processes simulate, -1 for one per core.
    """
    scene, outcome, best, kind = prepared.scene, judgement.outcome, judgement.best, judgement.kind
    # locate what remains, or, once all is explained, what the nominal physics lacks at the fitted unknowns
    lacking = best.model if kind == "unexplained" else Model(best.model.unknown)
    nominally = outcome.nominal_problem
    locations: tuple[Location, ...] = ()
    where: tuple[str, ...] = ()
    remains = kind != "none" and not judgement.adequate
    found = compute(lambda: locate_named(nominally, best.model, lacking)) if remains else ()
    if isinstance(found, NotComputable):
        where = (f"mismatch.locations cannot be computed: {found.reason}",)
    else:
        locations = found
    kept = selection.fitted
    laws = tuple(law.in_file(table_name(law.at)) for law in selection.learned)
    corrected = scene.corrected(kept.model.unknown, (*kept.model.effects, *laws))
    notes = (*prepared.notes, *judgement.notes, *where, *(() if prepared.moves else (NOTHING_MOVES,)))
    progress("simulating with and without the effects")
    # a law has no strengths, so that the covariance is that of the named model
    whole = replace(kept, model=kept.model.with_effects(laws))
    nominal = prepared.estimated or outcome.nominal
    comparisons = comparisons_of(prepared, [nominal, whole, *([kept] if laws else [])], jobs)
    train, *held_out = comparisons
    bound, unbounded = _bounds_where_noise_remains(prepared, judgement, jobs)
    explanation, unknown_std = _explanations(scene, judgement, bound)
    overstated = prepared.overstated or Overstated({}, {}, 1.0)
    notes = (
        *notes,
        *unknown_std,
        *unbounded,
        *train.missing("train"),
        *(held_out[0].missing("held_out") if held_out else ()),
        *effort_scale_notes(outcome.problem, best),
        *overstated.words,
    )
    known = unknowns_std(outcome.problem.scene, best) if judgement.std is None else judgement.std
    parameters = parameters_of(scene, best, known, bound)
    unknown = far_unknowns(scene, best.model) if kind == "unexplained" and not prepared.mistakes else ()
    far = tuple(parameters[scene.unknown.index(parameter)] for parameter in unknown)
    # two-sided p-value of the farthest unknown by its prior, times the number of unknowns (Bonferroni)
    chance = min((2.0 * float(norm.sf(parameter.distance)) * len(scene.unknown) for parameter in far), default=1.0)
    too_large = {at for joints in overstated.joints.values() for at in joints}
    wrong = len(unknown) + len(too_large)
    share = 1.0 / wrong if judgement.adequate and wrong else 0.0
    places = [_location(parameter, share) for parameter in unknown]
    places += [Location("joint", at, share) for at in sorted(too_large)]
    return Verdict(
        kind=kind,
        mismatch=Mismatch(
            kind != "none", min(outcome.detection_p_value, chance, overstated.p_value), (*locations, *places)
        ),
        explanation=explanation,
        rivals=_rivals(scene, judgement),
        parameters=parameters,
        train=train,
        held_out=held_out[0] if held_out else None,
        corrected=corrected,
        data_mistakes=prepared.mistakes,
        noise_remarks=(*prepared.noise_remarks, *judgement.noise_remarks),
        overstated=overstated.joints,
        notes=notes,
        reduced_chi_square=(
            outcome.nominal.reduced_chi_square,
            best.reduced_chi_square if judgement.left is None else judgement.left,
        ),
        far=far,
        adequate=judgement.adequate,
        noise=prepared.channel_noise,
        correction=Correction(
            selection.as_given,
            tuple(LeftOut(effect.name, effect.at, why) for effect, why in selection.left_out),
            selection.unknowns_held,
        ),
        learned=tuple(Learned(law, words_of(law, scene.tree)) for law in laws),
    )


def _location(unknown: UnknownParameter, share: float) -> Location:
    """The location of a mismatch that is an unknown far from its prior."""
    kind = unknown.kind if unknown.effect is None else effect_named(unknown.effect).place.value
    kind = "body" if kind == INERTIALS else kind
    return Location(kind, unknown.at, share)


def _bounds_where_noise_remains(
    prepared: PreparedRecordings, judgement: Judgement, jobs: int
) -> tuple[Array | None, tuple[str, ...]]:
    """`bounds_of` the judgement's model; none where more than noise remains."""
    if judgement.kind != "unexplained" or judgement.adequate:
        return bounds_of(prepared, judgement.best.model, jobs)
    if not len(judgement.best.model.vector):
        return None, ()
    return None, (MORE_THAN_NOISE,)


def bounds_of(prepared: PreparedRecordings, model: Model, jobs: int = 1) -> tuple[Array | None, tuple[str, ...]]:
    """(n + k,) least standard deviations that the recordings allow, and a note where they cannot be computed."""
    if not len(model.vector):
        return None, ()
    found = prepared.bounds(model, jobs)
    if isinstance(found, NotComputable):
        return None, (f"the efficiency of the parameters' intervals is not computed: {found.reason}",)
    return found, ()


def _unnamed(judgement: Judgement) -> list[Effect]:
    """The effects that stand out of the noise, or of unknown forces, and have no name; none of what has no rows."""
    if judgement.std is not None:
        return []
    model, found = judgement.best.model, (*judgement.outcome.unsupported, *judgement.withheld)
    return [
        effect
        for effect in {effect.key: effect for effect in found}.values()
        if effect.key not in model.keys and not any(effect.excludes(other) for other in model.effects)
    ]


def _std_of(judgement: Judgement, unnamed: Sequence[Effect]) -> Array:
    """(n + k,) standard deviations of unknowns and strengths, whether the `unnamed` effects are there or not."""
    problem, best = judgement.outcome.problem, judgement.best
    std = standard_deviations(problem, best, judgement.outcome.scale)
    return np.asarray(np.hypot(std, changes_beside(problem, best, unnamed)))


def _explanations(
    scene: Scene, judgement: Judgement, bound: Array | None
) -> tuple[tuple[Explanation, ...], tuple[str, ...]]:
    """The accepted effects, and notes on their standard deviations.

    These allow for what stands out of the noise without a name.
    """
    outcome, best, unnamed = judgement.outcome, judgement.best, _unnamed(judgement)
    notes: tuple[str, ...] = ()
    if unnamed and best.model.effects:
        beside = spoken(names_of(effect.key for effect in unnamed))
        notes = (f"the std of what is named allows for effects that stand out and are not named: {beside}",)
    std = compute(lambda: _std_of(judgement, unnamed)) if judgement.std is None else judgement.std
    if isinstance(std, NotComputable):
        notes = (f"the std of the named effects' parameters cannot be computed: {std.reason}",)
        std = np.full(len(best.model.vector), np.nan)
    used = _used(bound, std)
    position = len(best.model.unknown)
    found = []
    for effect in best.model.effects:
        values = {}
        for strength in effect.strengths:
            unit = effect.unit(strength, scene.tree)
            values[strength.name] = Value(effect.values[strength.name], float(std[position]), unit, used[position])
            position += 1
        values |= {choice.name: Value(value, None, choice.unit) for choice, value in effect.choices.items()}
        sentence = effect.sentence(scene.tree)
        found.append(Explanation(effect, outcome.probability.get(effect.key, 1.0), values, sentence))
    return tuple(sorted(found, key=lambda e: -e.probability)), notes


def _rivals(scene: Scene, judgement: Judgement) -> tuple[Rival, ...]:
    """Effects and unknowns of explanations that fit as well as the accepted one, which the criterion prefers.

    An explanation that contains the accepted one is no rival, nor is one with more than one part in addition. Effects
    whose names are withheld stand among their rivals.
    """
    outcome, best = judgement.outcome, judgement.outcome.best if judgement.withheld else judgement.best
    present, unknown = best.model.keys, {(known.parameter, known.at) for known in scene.unknown}
    as_good = [
        other.model.keys
        for other in outcome.competing
        if other.chi_square - best.chi_square < RIVAL_EXCESS_CHI_SQUARE * outcome.scale
        and not present <= other.model.keys
        and len(other.model.keys) <= len(present) + 1
    ]
    # what an explanation that is as good without it holds besides, stands for nothing
    least = [keys for keys in as_good if not any(fewer < keys for fewer in as_good)]
    besides = {key for keys in least if present for key in keys - present}
    found = {key: outcome.probability[key] for key in besides & outcome.probability.keys()}
    found |= {key: value for key, value in judgement.rivals.items() if value >= RIVAL_BY_SIMULATION}
    found |= {effect.key: outcome.probability.get(effect.key, 1.0) for effect in judgement.withheld}
    return tuple(
        Rival(None, at, value, FAR_ALIKE, name)
        if (name, at) in unknown
        else Rival(name, at, value, _why_alike(best, name))
        for (name, at), value in sorted(found.items(), key=lambda item: (-item[1], item[0]))
    )


def _why_alike(best: Fit, name: str) -> str:
    reasons = [effect.alike[name] for effect in best.model.effects if name in effect.alike]
    return reasons[0] if reasons else "over these motions the two change the measurements alike"


def _used(bound: Array | None, std: Array) -> list[float | None]:
    """The efficiencies of intervals of `std` (m,); None where they are not known."""
    if bound is None:
        return [None] * len(std)
    used = efficiencies(bound[: len(std)], std).tolist()
    return [share if np.isfinite(share) else None for share in used]


def parameters_of(
    scene: Scene, best: Fit, std: Array | None = None, bound: Array | None = None
) -> tuple[NominalParameter, ...]:
    """The scenario's unknowns with their fitted values, and with `std` (n,) or else the fit's standard deviations.

    Of a link's inertials these are the physical parameters, with standard deviations to first order. `bound` (n + k,)
    are the least standard deviations that the recordings allow, if they are known; a link's is of its
    log-Cholesky parameters, so that the efficiency of its inertials is not stated.
    """
    values, priors, n = best.model.unknown, scene.priors, len(best.model.unknown)
    deviations = np.asarray(best.std if std is None else std)[:n]
    found = [
        NominalParameter(
            unknown.parameter,
            unknown.at,
            float(value),
            float(deviation),
            unknown.prior.unit,
            unknown.prior.mean,
            unknown.prior.std,
            unknown.effect,
            efficiency=used,
        )
        for unknown, value, deviation, used in zip(
            scene.unknown, values, deviations, _used(bound, deviations), strict=True
        )
    ]
    known = np.sqrt(np.clip(np.diag(best.covariance)[:n], 0.0, None))
    wider = np.divide(deviations, known, where=known > 0.0, out=np.ones(n))
    covariance = best.covariance[:n, :n] * np.outer(wider, wider)
    for link, own in inertials(scene.unknown).items():
        found[own] = _inertials_of(scene, link, values[own], covariance[own, own], priors.mean[own], priors.std[own])
    return tuple(found)


def _inertials_of(
    scene: Scene, link: str, theta: Array, covariance: Array, mean: Array, std: Array
) -> list[NominalParameter]:
    """The ten physical parameters of a `link` at log-Cholesky parameters `theta` (10,) of that `covariance`."""
    of_link = LinkInertials((scene.bare or scene.physics).tree.body(link))
    slopes, about = of_link.slopes(theta), of_link.slopes(mean)
    deviations, prior = np.sqrt(np.diag(slopes @ covariance @ slopes.T)), np.sqrt((about**2) @ std**2)
    rows = zip(PHYSICAL.items(), of_link.physical(theta), deviations, of_link.physical(mean), prior, strict=True)
    together = distance_together((theta - mean) / std)
    return [
        NominalParameter(name, link, float(value), float(known), unit, float(expected), float(wide), None, together=far)
        for ((name, unit), value, known, expected, wide), far in zip(
            rows, [together, *[0.0] * (len(PHYSICAL) - 1)], strict=True
        )
    ]


def comparisons_of(prepared: PreparedRecordings, fits: Sequence[Fit], jobs: int = 1) -> list[Comparison]:
    """For each group of recordings, the figures of fit of the scene as given and of the two or three `fits`."""
    priors, n = prepared.scene.priors, len(prepared.scene.unknown)
    candidates = [(Model(priors.mean), np.diag(priors.std**2))]
    candidates += [(fit.model, np.diag(priors.std**2) if fit.model.held else fit.covariance[:n, :n]) for fit in fits]
    # where nothing is missing, two of the three are the same
    first = [next(j for j, other in enumerate(candidates) if _same(candidate, other)) for candidate in candidates]
    distinct = sorted(set(first))
    by_model: list[list[Quality]] = prepared.qualities([candidates[j] for j in distinct], jobs)
    found = [by_model[distinct.index(j)] for j in first]
    return [Comparison(*(qualities[k] for qualities in found)) for k in range(len(found[0]))]


def _same(own: tuple[Model, Array], other: tuple[Model, Array]) -> bool:
    """Whether two models and the covariances of their unknowns are equal."""
    (model, doubt), (twin, its) = own, other
    return model.effects == twin.effects and bool(np.all(model.vector == twin.vector)) and np.array_equal(doubt, its)
