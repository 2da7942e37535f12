"""By how much each effect that a joint may lack lowers its output errors, to first order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.problem import ErrorProblem, SimulationFit
from drake_cafim.diagnosis.output_error.starts import Start, StartsByKind
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

FAR = 3.0
"""Largest number of times that a change is extrapolated."""


@dataclass(frozen=True)
class Candidate:
    """An effect at the values of first order, the `gain` by which −2 ln p falls, and the `excess` over its price."""

    effect: Effect
    gain: float
    excess: float


def screen(
    problem: ErrorProblem[Any],
    base: SimulationFit,
    slopes: Sequence[Array],
    tried: Sequence[Sequence[Effect]],
    price: Callable[[Effect], float],
    beside: Model,
) -> list[list[Candidate]]:
    """By joint, the best start of each of the `tried` effects beside `base`, the best effect first.

    What friction begins with is taken from `beside`, the model of which `base` may be a part.

    The change d of a joint's errors e by each part is simulated, and with its own numbers' `slopes` J the coefficients
    are those that minimise |e + J x + D c|². Every joint has one part in each simulation.
    """
    starts_of = StartsByKind(problem.scene, problem.errors.forms, beside)
    starts = [[start for effect in own for start in starts_of(effect)] for own in tried]
    changes = _changes(problem, base, [[part for start in own for part in start.parts] for own in starts])
    found: list[list[Candidate]] = []
    for j, own in enumerate(starts):
        error, J, best, first = base.errors[:, j], slopes[j], dict[str, Candidate](), 0
        Q = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-30))[0] if J.shape[1] else J
        rest = error - Q @ (Q.T @ error)

        def cost(left: Array, j: int = j) -> float:
            return float(problem.errors.likelihood.cost(left, j))

        for start in own:
            stop = first + len(start.parts)
            D = changes[j][:, first:stop] / np.array(start.sizes)
            first = stop
            candidate = _candidate(start, D - Q @ (Q.T @ D), rest, cost, price)
            if candidate is not None and candidate.excess > getattr(best.get(candidate.effect.name), "excess", -np.inf):
                best[candidate.effect.name] = candidate
        found.append(sorted(best.values(), key=lambda found: -found.excess))
    return found


def _changes(problem: ErrorProblem[Any], base: SimulationFit, parts: Sequence[Sequence[Effect]]) -> list[Array]:
    """By joint (S, p), the changes of its errors by each of its parts."""
    changes = [np.zeros((len(base.errors), len(own))) for own in parts]
    together = [[part for part in row if part is not None] for row in zip_longest(*parts)]
    simulated = problem.for_each(lambda own: problem.errors_of(base.model.with_effects(own)), together)
    for k, errors in enumerate(simulated):
        change = errors - base.errors
        for j, own in enumerate(parts):
            if k < len(own):
                changes[j][:, k] = change[:, j]
    return changes


def _candidate(
    start: Start, D: Array, rest: Array, cost: Callable[[Array], float], price: Callable[[Effect], float]
) -> Candidate | None:
    """The effect at the best coefficients; with one part alone where those of all are implausible."""
    best: Candidate | None = None
    sizes, count = np.array(start.sizes), len(start.sizes)
    for chosen in ([*range(count)], *([k] for k in range(count) if count > 1)):
        own = D[:, chosen]
        if not np.all(np.linalg.norm(own, axis=0) > 0.0):
            continue
        c = -np.linalg.lstsq(own, rest, rcond=1e-9)[0]
        c = np.clip(c, -FAR * sizes[chosen], FAR * sizes[chosen])
        whole = np.zeros(count)
        whole[chosen] = c
        effect = start.law(whole)
        if effect is None or not effect.plausible():
            continue
        left = rest + own @ c
        gain = cost(rest) - cost(left)
        if best is None or gain - price(effect) > best.excess:
            best = Candidate(effect, gain, gain - price(effect))
    return best
