"""Two effects that hide each other: each alone leaves what the other does, and so hardly shows, or fits worse."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.columns import Nuisance, whitened
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import equations_of
from drake_cafim.diagnosis.fit.rivals import Lead
from drake_cafim.diagnosis.fit.screening import solve_beside
from drake_cafim.diagnosis.fit.search_problem import Build, SearchProblem
from drake_cafim.diagnosis.fit.without_effects import fit_without
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

MOST_STEPS = 2
"""Steps of a fit without the effects that a joint has."""


@dataclass(frozen=True)
class Pair:
    """Two `effects` that may take the place of those that are `present` at their joint, to first order."""

    effects: tuple[Effect, Effect]
    present: tuple[Effect, ...]
    rest: Fit
    """The fit without those."""

    def in_place(self, model: Model) -> Model:
        """`model` with them instead."""
        rest = tuple(effect for effect in model.effects if effect not in self.present)
        return Model(model.unknown, (*rest, *self.effects), model.free)


def best_pairs(
    problem: SearchProblem, best: Fit, effects: Sequence[Effect], price: Callable[[Effect], float], tolerance: float
) -> Iterator[Pair]:
    """For each joint with forces that nobody knows the two lasting effects that lower the criterion most, if any do.

    They take the place of what `best` has there; `price` is what the criterion asks for an effect. A law that makes no
    sense alone, as a spring that pushes away, may do so beside another one. `tolerance` is that of a fit.
    """
    for joint in problem.forced_joints:
        present = tuple(effect for effect in best.model.effects if equations_of(effect) == joint)
        others = [effect for effect in best.model.effects if effect not in present]
        laws = [law for law in effects if equations_of(law) == joint and not law.brief]
        laws = [law for law in laws if not any(law.excludes(other) for other in others)]
        rest = _without(problem, best, present, tolerance) if present else best
        lost = rest.chi_square - best.chi_square - sum(price(effect) for effect in present)
        pair = _best_of(problem, rest, laws, price, lost)
        if pair is not None and {law.key for law in pair} != {effect.key for effect in present}:
            yield Pair(pair, present, rest)


def pairs_in_place(found: Mapping[Key, Sequence[Lead]]) -> list[dict[Key, Effect]]:
    """Two laws for the places of two effects, of `found` that fit worse alone: those that do so least first.

    A gain at one joint and one at another, with all inertias unknown, make up for a gain at a third and for what else
    is missing there; one law in the place of one of them then leaves what the other makes up for.
    """
    single = [(lead, key, law) for key, leads in found.items() for lead, _, law in leads]
    pairs = []
    for (first, key, law), (second, other_key, other) in itertools.combinations(single, 2):
        if key != other_key and not law.excludes(other) and not other.excludes(law):
            pairs.append((first + second, {key: law, other_key: other}))
    return [pair for _, pair in sorted(pairs, key=lambda entry: entry[0])]


def _without(problem: SearchProblem, best: Fit, present: Sequence[Effect], tolerance: float) -> Fit:
    """The fit without effects that are `present`, by few steps: pairs are chosen to first order."""
    return fit(problem, fit_without(problem, best, present).model, MOST_STEPS, tolerance, own_noise=False)


def _best_of(
    problem: SearchProblem, rest: Fit, laws: Sequence[Effect], price: Callable[[Effect], float], least: float
) -> tuple[Effect, Effect] | None:
    """The two of the `laws` that gain most beyond their prices, more than `least`, and act as their names say."""
    nuisance = Nuisance.of(rest)
    looks = [(law, look) for law in laws if (look := _best_look(problem, rest, law, nuisance)) is not None]
    best, most = None, least
    for (first, (own, build_first)), (second, (beside, build_second)) in itertools.combinations(looks, 2):
        if first.excludes(second) or second.excludes(first):
            continue
        columns = np.concatenate([own, beside], axis=1)
        solved = solve_beside(columns, nuisance)
        if solved is None or solved[1] - price(first) - price(second) <= most:
            continue
        built = build_first(solved[0][: own.shape[1]]), build_second(solved[0][own.shape[1] :])
        if built[0] is not None and built[1] is not None and built[0].plausible() and built[1].plausible():
            best, most = (built[0], built[1]), solved[1] - price(first) - price(second)
    return best


def _best_look(problem: SearchProblem, rest: Fit, law: Effect, nuisance: Nuisance) -> tuple[Array, Build] | None:
    """The look at a law that gains most, whether it makes sense alone or not, with its whitened columns (R, c)."""
    best, most = None, 0.0
    for look in problem.looks(rest, law).found:
        solved = solve_beside(look[0], nuisance)
        if solved is not None and solved[1] > most:
            best, most = look, solved[1]
    return None if best is None else (whitened(best[0]), best[1])
