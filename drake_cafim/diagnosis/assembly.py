"""The verdict put together: explanations, rivals, parameters, and how each model does."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import PreparedRecordings
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.push_locations import locate_named
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.thresholds import RIVAL_EXCESS_CHI_SQUARE
from drake_cafim.diagnosis.verdict import (
    Comparison,
    Explanation,
    Location,
    Mismatch,
    NominalParameter,
    Quality,
    Rival,
    Value,
    Verdict,
)
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.scene.scene import Scene

MADE_UP_FOR = (
    "the unknowns, fitted alone, make up for what is missing and predict these recordings worse than as given; in the "
    "corrected scenario they are as given"
)

FAR_ALIKE = "with another value, far from its prior, it moves the measurements alike"
NOTHING_MOVES = "nothing moves in the recordings beyond its noise, so that no effect was looked for"
Progress = Callable[[str], None]


def verdict_of(prepared: PreparedRecordings, judgement: Judgement, progress: Progress) -> Verdict:
    """The verdict that a judgement of `prepared` recordings comes to; what cannot be computed is NaN, with a note."""
    scene, outcome, best, kind = prepared.scene, judgement.outcome, judgement.best, judgement.kind
    # where the mismatch is: of the nominal physics at the numbers that the explanation found, or of what remains
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
    corrected = scene.corrected(best.model.unknown, best.model.effects)
    notes = (*prepared.notes, *judgement.notes, *where, *(() if prepared.moves else (NOTHING_MOVES,)))
    progress("simulating with and without the effects")
    comparisons = comparisons_of(prepared, [outcome.nominal, best])
    given, fitted = comparisons[0].nominal_as_given.nll, comparisons[0].corrected.nll
    if kind == "unexplained" and not best.model.effects and fitted > given:
        corrected, notes = scene.corrected(scene.priors.mean, ()), (*notes, MADE_UP_FOR)
        comparisons = [replace(one, corrected=one.nominal_as_given) for one in comparisons]
    train, *held_out = comparisons
    explanation, unknown_std = _explanations(scene, outcome, best)
    notes = (*notes, *unknown_std, *train.missing("train"), *(held_out[0].missing("held_out") if held_out else ()))
    parameters = parameters_of(scene, best)
    unknown = far_unknowns(scene, best.model) if kind == "unexplained" and not prepared.mistakes else ()
    far = tuple(parameters[scene.unknown.index(one)] for one in unknown)
    # what two sides of a normal distribution say, of the farthest of all unknowns
    chance = min((2.0 * float(norm.sf(one.distance)) * len(scene.unknown) for one in far), default=1.0)
    places = [_place_of(one, 1.0 / len(unknown) if judgement.adequate else 0.0) for one in unknown]
    return Verdict(
        kind=kind,
        mismatch=Mismatch(kind != "none", min(outcome.detection_p_value, chance), (*locations, *places)),
        explanation=explanation,
        rivals=_rivals(scene, outcome, best),
        parameters=parameters,
        train=train,
        held_out=held_out[0] if held_out else None,
        corrected=corrected,
        data_mistakes=prepared.mistakes,
        noise_remarks=(*prepared.noise_remarks, *judgement.noise_remarks),
        notes=notes,
        reduced_chi_square=(
            outcome.nominal.reduced_chi_square,
            best.reduced_chi_square,
        ),
        far=far,
        adequate=judgement.adequate,
        noise=prepared.channel_noise,
    )


def _place_of(unknown: UnknownParameter, share: float) -> Location:
    """Where an unknown that is far from its prior is."""
    kind = unknown.kind if unknown.effect is None else effect_named(unknown.effect).place.value
    return Location(kind, unknown.at, share)


def _explanations(scene: Scene, outcome: Outcome, best: Fit) -> tuple[tuple[Explanation, ...], tuple[str, ...]]:
    """The accepted effects, and a note where their standard deviations cannot be computed."""
    std = compute(lambda: standard_deviations(outcome.problem, best, outcome.scale))
    notes: tuple[str, ...] = ()
    if isinstance(std, NotComputable):
        notes = (f"the std of the named effects' parameters cannot be computed: {std.reason}",)
        std = np.full(len(best.model.vector), np.nan)
    position = len(best.model.unknown)
    found = []
    for effect in best.model.effects:
        values = {}
        for strength in effect.strengths:
            unit = effect.unit(strength, scene.tree)
            values[strength.name] = Value(effect.values[strength.name], float(std[position]), unit)
            position += 1
        values |= {one.name: Value(value, None, one.unit) for one, value in effect.choices.items()}
        sentence = effect.sentence(scene.tree)
        found.append(Explanation(effect, outcome.probability.get(effect.key, 1.0), values, sentence))
    return tuple(sorted(found, key=lambda e: -e.probability)), notes


def _rivals(scene: Scene, outcome: Outcome, best: Fit) -> tuple[Rival, ...]:
    """What is in explanations that fit as well as the accepted one, which is preferred for its fewer numbers."""
    present, unknown = best.model.keys, {(one.parameter, one.at) for one in scene.unknown}
    as_good = [
        other.model.keys
        for other in outcome.competing
        if other.chi_square - best.chi_square < RIVAL_EXCESS_CHI_SQUARE * outcome.scale
        and not present <= other.model.keys
        and len(other.model.keys) <= len(present) + 1
    ]
    # what an explanation that is as good without it holds besides, stands for nothing
    least = [keys for keys in as_good if not any(fewer < keys for fewer in as_good)]
    found = {key: outcome.probability[key] for keys in least if present for key in keys - present}
    return tuple(
        Rival(None, at, value, FAR_ALIKE, name)
        if (name, at) in unknown
        else Rival(name, at, value, _why_alike(best, name))
        for (name, at), value in sorted(found.items(), key=lambda item: (-item[1], item[0]))
    )


def _why_alike(best: Fit, name: str) -> str:
    reasons = [effect.alike[name] for effect in best.model.effects if name in effect.alike]
    return reasons[0] if reasons else "over these motions the two move the measurements alike"


def parameters_of(scene: Scene, best: Fit) -> tuple[NominalParameter, ...]:
    return tuple(
        NominalParameter(
            one.parameter,
            one.at,
            float(value),
            float(std),
            one.prior.unit,
            one.prior.mean,
            one.prior.std,
            one.effect,
        )
        for one, value, std in zip(scene.unknown, best.model.unknown, best.std, strict=False)
    )


def comparisons_of(prepared: PreparedRecordings, fits: Sequence[Fit]) -> list[Comparison]:
    """Each group of recordings under the scene as given, and under the two `fits`."""
    priors, n = prepared.scene.priors, len(prepared.scene.unknown)
    candidates = [(Model(priors.mean), np.diag(priors.std**2))]
    candidates += [(one.model, one.covariance[:n, :n]) for one in fits]
    found: list[list[Quality]] = []
    for k, (model, covariance) in enumerate(candidates):
        # where nothing is missing, two of the three are the same
        same = [
            j
            for j, (other, doubt) in enumerate(candidates[:k])
            if other.effects == model.effects
            and np.all(other.vector == model.vector)
            and np.array_equal(doubt, covariance)
        ]
        found.append(found[same[0]] if same else prepared.qualities(model, covariance))
    return [Comparison(*(one[k] for one in found)) for k in range(len(found[0]))]
