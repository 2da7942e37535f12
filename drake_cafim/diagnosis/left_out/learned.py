"""Learns what remains at the joints after the names: laws without a name, where they predict left-out parts better.

The rows of the named model are linear in a force at a joint, z + X c, with X the columns of the terms of `law_terms`.
Without part p the coefficients minimise |z + X c|² over the other parts plus a penalty λ cᵀS c. Joint by joint, the
term and the λ are added that lower χ² of the left-out parts most, as long as they lower it by more than a standard
error over the parts. What is found so stays where simulations agree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.left_out import decisions
from drake_cafim.diagnosis.left_out.law_terms import Candidate, candidates, with_steps_in_one_term
from drake_cafim.diagnosis.left_out.parts import Part, parts_of
from drake_cafim.diagnosis.left_out.simulations import (
    ByColumn,
    Predictions,
    both_horizons,
    errors_over,
    mean_differences,
    mean_with_error,
    surprisals,
)
from drake_cafim.diagnosis.predict.forecast import SHORT_HORIZON
from drake_cafim.diagnosis.trace import Record
from drake_cafim.effects.joint import DRY_FRICTION
from drake_cafim.effects.learned_force import MEMORY, LearnedForce
from drake_cafim.typing import Array

SMOOTHNESS = (1e-4, 1e-2, 1.0)
"""λ that are tried, over that at which the penalty's trace is that of the data's information."""
FAINT = 1e-8
"""Share of the information that is added to that of every coefficient, for efforts that are all zero."""


@dataclass(frozen=True)
class _Products:
    """Products of the columns [X, z] of one joint in each part, (p, c + 1, c + 1), and the penalties of its terms."""

    terms: tuple[Candidate, ...]
    products: Array
    known: float = 0.0
    """Information on every coefficient before any recording: σ²/s², see `by_rows`."""

    def coefficients(self, chosen: Sequence[tuple[int, float]], left_out: int | None) -> Array:
        """(c,) coefficients of the chosen terms, each with its λ, without a part or by all parts."""
        kept = self.products if left_out is None else np.delete(self.products, left_out, axis=0)
        total = np.sum(kept, axis=0)
        starts = np.cumsum([0, *(term.count for term in self.terms)])
        active = np.concatenate([np.arange(starts[k], starts[k + 1]) for k, _ in chosen])
        information = total[np.ix_(active, active)].copy()
        first = 0
        for k, smoothness in chosen:
            own = slice(first, first + self.terms[k].count)
            penalty, size = self.terms[k].penalty, float(np.trace(information[own, own]))
            information[own, own] += smoothness * size / max(float(np.trace(penalty)), 1e-12) * penalty
            information[own, own] += max(self.known, FAINT * size) * np.eye(self.terms[k].count)
            first = own.stop
        result = np.zeros(starts[-1])
        result[active] = -np.linalg.solve(information, total[active, -1])
        return result

    def chi_square(self, chosen: Sequence[tuple[int, float]]) -> Array:
        """(p,) χ² of each part by the coefficients of the others."""
        found = []
        for part, product in enumerate(self.products):
            c = self.coefficients(chosen, part) if chosen else np.zeros(product.shape[0] - 1)
            combined = np.append(c, 1.0)
            found.append(float(combined @ product @ combined))
        return np.array(found)

    def terms_of(self, chosen: Sequence[tuple[int, float]], left_out: int | None) -> LearnedForce:
        """The law of the chosen terms, at no joint yet."""
        c = self.coefficients(chosen, left_out)
        starts = np.cumsum([0, *(term.count for term in self.terms)])
        found = [self.terms[k].term(c[starts[k] : starts[k + 1]]) for k, _ in chosen]
        return LearnedForce("", {}, tuple(with_steps_in_one_term(found)))


_Law = tuple[_Products, list[tuple[int, float]]]
"""The products of a joint, and the terms that are chosen there, each with its λ."""


def _memory_of(products: _Products, chosen: Sequence[tuple[int, float]]) -> _Law:
    """The law with its memory alone, if it has one."""
    return products, [(k, smoothness) for k, smoothness in chosen if products.terms[k].variables == MEMORY]


def _is_memory(products: _Products, chosen: Sequence[tuple[int, float]]) -> bool:
    return all(products.terms[k].variables == MEMORY for k, _ in chosen)


@dataclass
class Learning:
    """The laws that are learned beside a named model, by joint, and the records of how they were chosen."""

    problem: SearchProblem
    model: Model
    predictions: Predictions
    chosen: dict[str, _Law] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of the recordings."""
        return parts_of(self.problem.runs)

    def laws(self, left_out: int | None = None, but: str = "") -> tuple[LearnedForce, ...]:
        """The laws, fitted to all parts or without one, but that at the joint `but`."""
        return tuple(
            replace(products.terms_of(chosen, left_out), at=joint)
            for joint, (products, chosen) in self.chosen.items()
            if joint != but
        )

    def by_rows(self) -> None:
        """Chooses the terms of each joint by the rows of left-out parts.

        Before any recording a coefficient is known to be about as large as the joint's effort: its prior is normal with
        the effort's root mean square s as standard deviation, which counts as σ²/s², σ² the mean square of z. Terms of
        position and of velocity that no recording tells apart would otherwise be large and cancel, until a faster
        motion leads them apart.
        """
        z, samples = self.problem.rows_of(self.model), self.problem.law_samples(self.model)
        masks = [part.rows(self.problem.runs) for part in self.parts]
        taken = {effect.at for effect in self.problem.scene.known if effect.law_table}
        laws = self.model.physics(self.problem.scene).joint_forces
        dry = {law.at: law for law in laws if law.group == DRY_FRICTION}
        for j, name in enumerate(self.problem.scene.tree.joint_names):
            own = [recording[j] for recording in samples]
            terms = [] if name in taken or not own else candidates(own, dry.get(name))
            if not terms:
                continue
            columns = [np.concatenate([term.columns(part) for term in terms], axis=1) for part in own]
            X = np.column_stack([self.problem.joint_columns(j, columns), z])
            effort = float(np.mean(np.concatenate([part.u for part in own]) ** 2))
            known = float(z @ z) / len(z) / effort if effort > 0.0 else 0.0
            products = _Products(tuple(terms), np.stack([X[mask].T @ X[mask] for mask in masks]), known)
            chosen = _greedy(products)
            if chosen:
                gain = float(np.mean(products.chi_square([]) - products.chi_square(chosen)))
                variables = [terms[k].variables for k, _ in chosen]
                self.records.append(decisions.learned_by_rows(name, variables, gain, len(masks)))
                self.chosen[name] = (products, chosen)

    def by_simulation(self) -> None:
        """Drops laws with which simulations of left-out parts are worse; both measures must be better in each part."""
        gains = {}
        now = self._short("")
        for joint in tuple(self.chosen):
            mean, error = mean_with_error(mean_differences(now, self._short(joint)))
            gains[joint] = -mean
            record = decisions.by_simulation(f"{LearnedForce.name}@{joint}", mean, error, "0.1 s")
            self.records.append(replace(record, step=decisions.LEARN))
            if not record.passed:
                del self.chosen[joint], gains[joint]
        base = [self.model] * len(self.parts)
        before = both_horizons(self.predictions, base, self.parts)
        likelihood: Array | None = None
        for laws in self._fewer(gains):
            self.chosen = laws
            models = [self.model.with_effects(self.laws(part)) for part in range(len(self.parts))]
            worse = both_horizons(self.predictions, models, self.parts).worse_than(before)
            # tables have many numbers and a few recordings vouch for them: it must be so in each of these
            if np.any(worse > 0.0):
                # the likelihood, which takes long, would be asked in vain
                less_likely, scores = np.full(len(worse), np.nan), (mean_with_error(worse)[0], np.nan)
            else:
                likelihood = self._surprisal(base) if likelihood is None else likelihood
                less_likely = self._surprisal(models) - likelihood
                scores = mean_with_error(worse)[0], mean_with_error(less_likely)[0]
            known = np.concatenate([part[np.isfinite(part)] for part in (worse, less_likely)])
            passed = bool(len(known)) and float(np.max(known)) <= 0.0 and min(scores) < 0.0
            short = [joint for joint, (products, chosen) in self.chosen.items() if _is_memory(products, chosen)]
            self.records.append(decisions.learned_together(list(self.chosen), short, passed, scores, known))
            if passed:
                break
        else:
            self.chosen = {}

    def _fewer(self, gains: Mapping[str, float]) -> list[dict[str, _Law]]:
        """The laws, then with fewer numbers each time, since simulations of a second take long.

        Those stay whole that matter most over 0.1 s, by their `gains`. At the other joints at first the memory stays,
        one number beside a friction that is named, which other motions hardly refute; then nothing.
        """
        ordered = sorted(self.chosen, key=lambda joint: -gains[joint])
        alone = {joint: _memory_of(*law) for joint, law in self.chosen.items()}
        memories = {joint: law for joint, law in alone.items() if law[1] and _resists(*law)}
        halves = [len(ordered) // 2**k for k in range(len(ordered).bit_length())]
        found: dict[tuple[tuple[str, int], ...], dict[str, _Law]] = {}
        for count, beside in [(n, True) for n in (*halves[:2], 0)] + [(n, False) for n in halves]:
            laws = {joint: law for joint, law in self.chosen.items() if joint in ordered[:count]}
            if beside:
                laws |= {joint: law for joint, law in memories.items() if joint not in laws}
            if laws:
                found.setdefault(tuple(sorted((joint, len(chosen)) for joint, (_, chosen) in laws.items())), laws)
        return list(found.values())

    def _short(self, but: str) -> Sequence[ByColumn]:
        models = [self.model.with_effects(self.laws(part, but)) for part in range(len(self.parts))]
        return errors_over(self.predictions, models, self.parts, SHORT_HORIZON)[0]

    def _surprisal(self, models: Sequence[Model]) -> Array:
        return surprisals(self.predictions, models, self.parts)


def _greedy(products: _Products) -> list[tuple[int, float]]:
    """The terms, each with its λ, that are added one at a time as long as they pay in the left-out parts."""
    chosen: list[tuple[int, float]] = []
    now = products.chi_square(chosen)
    while len(chosen) < len(products.terms):
        trials = [
            [*chosen, (k, smoothness)]
            for k in range(len(products.terms))
            if _adds(products, chosen, k)
            # one number has no smoothness
            for smoothness in (SMOOTHNESS[:1] if products.terms[k].count == 1 else SMOOTHNESS)
        ]
        outcomes = [products.chi_square(trial) for trial in trials]
        gains = [mean_with_error(now - outcome) for outcome in outcomes]
        paying = [k for k, (gain, error) in enumerate(gains) if gain > error and _resists(products, trials[k])]
        if not paying:
            break
        best = max(paying, key=lambda index: gains[index][0])
        chosen, now = trials[best], outcomes[best]
    return chosen


def _resists(products: _Products, chosen: Sequence[tuple[int, float]]) -> bool:
    """Whether the friction that builds up, where there is a memory, resists, as friction does."""
    starts = np.cumsum([0, *(term.count for term in products.terms)])
    c = products.coefficients(chosen, None)
    return all(c[starts[k]] <= 0.0 for k, _ in chosen if products.terms[k].variables == MEMORY)


def _adds(products: _Products, chosen: Sequence[tuple[int, float]], k: int) -> bool:
    """Whether the term `k` may be added: it is new, and not a second memory."""
    taken = [products.terms[other].variables for other, _ in chosen]
    remembered = products.terms[k].variables == MEMORY and MEMORY in taken
    return k not in [other for other, _ in chosen] and not remembered


def learn(
    problem: SearchProblem, model: Model, predictions: Predictions
) -> tuple[tuple[LearnedForce, ...], list[Record]]:
    """The laws that `model`, the named one, lacks at its joints, and the records of their choice."""
    learning = Learning(problem, model, predictions)
    learning.by_rows()
    if learning.chosen:
        learning.by_simulation()
    return learning.laws(), learning.records
