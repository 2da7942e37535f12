"""A search with unknown forces at the joints as noise, after a search under the channels' noise ended unexplained.

A real machine lacks many effects at once, and something always remains that has no name. So each joint has a white
force that nobody knows, whose density is what the residual there makes likeliest. An effect is weighed against the
force at its own joint, and as effects are admitted the densities fall and show the fainter ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.places import joint_of
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import compare_by_place
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import MISFIT_SHARE_TO_EXPLAIN, MOST_EFFECTS
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.actuator import ActuatorGainError
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.numerics.computation import compute
from drake_cafim.scenario.inertials import INERTIALS
from drake_cafim.typing import Array

_REGRESSED = (ActuatorGainError.name, JointViscousFriction.name, JointCoulombFriction.name)
"""The laws that are fitted together at all joints."""
UNKNOWN_FORCES = "unknown forces"
"""Name of this search in a trace."""


def search_again(
    outcome: Outcome,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    trace: Trace | None = None,
    begin: Sequence[Effect] = (),
    more: bool = True,
) -> Outcome | None:
    """The effects that stand out of unknown white forces at the joints; None where none does.

    `outcome` is of a search that ended unexplained; where effects to `begin` with are given, they take the place of
    those that it found. Unless `more` may be found, none is looked for beyond these. Each decision is added to `trace`.
    """
    trace = Trace(UNKNOWN_FORCES) if trace is None else trace
    for ended in (outcome.problem, outcome.nominal_problem):
        ended.forget()
    nominal = outcome.nominal.model
    first = nominal.with_effects(begin) if begin else outcome.best.model
    # what is only fitted again is weighed against the forces that all of it leaves
    start = nominal if more else first
    growth = GrowthByPlace.of(outcome.nominal_problem, start, outcome.hypotheses, settings, progress)
    if growth is None:
        return None
    growth.trace = trace
    if not more:
        growth.take(growth.best.model)
    elif first.effects:
        # as far as they stand out of unknown forces
        growth.settle(first)
    # whoever asks for fewer effects than usual wants those, and no search for more
    grows = more and settings.most_effects >= MOST_EFFECTS
    if grows:
        growth.grow()
        if _settles_with_gains(growth):
            growth.grow()
    # what explained more than was left under more noise is no less sure under less, of which more is left
    supported, known = ((), None) if more else (outcome.best.model.keys, outcome.rivals)
    grown = growth.best.model
    compared = compare_by_place(growth, supported, known)
    if grows and _grows_beside_others(growth, grown):
        compared = compare_by_place(growth, supported, compared.rivals)
    if not growth.best.model.effects:
        trace.add(decisions.record_unknown_forces_failure(growth.best))
        return None
    best = unbiased_fit(growth.problem, growth.best.model)
    return replace(
        outcome,
        problem=growth.problem,
        best=best,
        competing=(best, *compared.others),
        probability=compared.probability,
        compare=None,
        unsupported=compared.unsupported,
        rivals=compared.rivals,
    )


def _settles_with_gains(growth: GrowthByPlace) -> bool:
    """Whether an explanation that begins with friction and a gain of the efforts at all joints is more likely.

    With unknown inertias, one wrong gain looks like other gains and inertias at all joints, some of them far from their
    priors: where none is, that is not so. Of laws that are added one after another the first are then wrong ones, and
    no exchange of one or two leads away from them. So all are fitted together, as a robot is identified by regression,
    and those that fail a test are dropped.
    """
    far = far_unknowns(growth.nominal.scene, growth.best.model)
    if not any(unknown.kind in ("body", INERTIALS) for unknown in far):
        return False
    if leaves_noise(growth.problem, growth.best, growth.settings.adequacy_level):
        return False
    growth.progress("friction and gains at all joints together")
    model = growth.best.model
    laws = list(model.effects)
    for law in growth.effects:
        if law.name in _REGRESSED and not any(law.key == other.key or law.excludes(other) for other in laws):
            laws.append(law)
    settled = compute(lambda: growth.settle(Model(model.unknown, tuple(laws), model.free)))
    return settled is True


def _grows_beside_others(growth: GrowthByPlace, grown: Model) -> bool:
    """Whether effects stand out beside the laws that have taken the places of some that had `grown`.

    A law that stood for two may have gone, and one of the two with it; and of two that are gone from one joint, each
    may have failed by the other's fault. What else was found and dropped is not tried again.
    """
    compared = growth.best.model
    gone = [effect for effect in grown.effects if effect.key not in compared.keys]
    joints = [joint_of(effect) for effect in gone]
    alone = [effect for effect in gone if joints.count(joint_of(effect)) == 1]
    if compared.keys <= grown.keys and len(alone) == len(gone):
        return False
    growth.refused.add(alone, compared)
    growth.grow()
    return growth.best.model.keys != compared.keys


def is_explained(outcome: Outcome, nominal: Fit, settings: Settings, trace: Trace) -> bool:
    """Whether what remains is as the noise and small white forces at the joints predict.

    Forces of any size would explain everything: under the channels' noise, the effects must explain nearly all.
    """
    trace.add(*decisions.record_residual(outcome.problem, outcome.best, settings.adequacy_level))
    if not leaves_noise(outcome.problem, outcome.best, settings.adequacy_level):
        return False
    left, had = _excess(outcome.nominal_problem, outcome.best), _excess(outcome.nominal_problem, nominal)
    trace.add(decisions.record_unknown_forces_share(outcome.best, left, had, MISFIT_SHARE_TO_EXPLAIN))
    return left <= MISFIT_SHARE_TO_EXPLAIN * had


def mean_square(problem: Problem, fit: Fit) -> float:
    """Mean square of the rows under a fit, whitened with the noise of the channels alone."""
    return float(np.mean(problem.rewhitened(fit.model).rows_of(fit.model) ** 2))


def geometric_misfit(problem: SearchProblem, fit: Fit) -> float:
    """The geometric mean of the mean squares of each kind of row, each `apart`, under the noise of the channels alone.

    The likelihood under a force of unknown size at each joint: a joint that is explained counts as much as another one
    that is far more noise variances away.
    """
    return geometric_mean(misfit_by_row(problem, fit.model))


def geometric_mean(misfit: Array) -> float:
    """The geometric mean of what is left of each kind of row."""
    return float(np.exp(np.mean(np.log(np.maximum(misfit, 1e-300)))))


def misfit_by_row(problem: SearchProblem, model: Model) -> Array:
    """(r,) mean square of each kind of row, each `apart`, under the noise of the channels alone."""
    return _by_row(problem.rewhitened(model), model)


def misfits_by_row(problem: SearchProblem, model: Model, others: Sequence[Model]) -> Array:
    """`misfit_by_row` (k + 1, r) of `model` and of k `others`, all whitened by the noise that `model` has."""
    whitened = problem.rewhitened(model)
    return np.stack([_by_row(whitened, each) for each in (model, *others)])


def _by_row(whitened: SearchProblem, model: Model) -> Array:
    rows = np.concatenate([z for _, z in by_run(whitened, whitened.apart(whitened.rows_of(model)))])
    return np.asarray(np.mean(rows**2, axis=0))


def _excess(problem: Problem, fit: Fit) -> float:
    return max(mean_square(problem, fit) - 1.0, 0.0)
