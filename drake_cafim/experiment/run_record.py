"""The contents of run.json for a finished run."""

from typing import Any

import numpy as np

from drake_cafim.belief import Belief, LawBelief
from drake_cafim.experiment.closed_loop import ExperimentResult, RunResult
from drake_cafim.information import identifiable_combinations
from drake_cafim.parameters import Parameters
from drake_cafim.tasks.task import Candidate, Task
from drake_cafim.typing import Array

SCHEMA = "drake_cafim.run/1"
MOST_ODDS = 1e12
"""Odds are given up to this."""


def run_record(result: RunResult, recordings: list[str], files: dict[str, Any]) -> dict[str, Any]:
    """The JSON object of run.json; `recordings` names each experiment's recording, `files` what else was written."""
    task = result.task
    return {
        "schema": SCHEMA,
        "scenario": task.name,
        "world": result.world,
        "policy": result.options.policy,
        "planner": result.options.planner,
        "criterion": result.options.criterion,
        "fisher": result.options.fisher,
        "estimator": result.options.estimator,
        "force_guard": result.options.force_guard,
        "belief_samples": result.options.belief_samples,
        "seed": result.options.seed,
        "truth": {name: float(value) for name, value in task.truth.items()},
        "prior": _prior(task.model.parameters),
        **_other_laws(task),
        "experiments": [
            _experiment(experiment, task.candidates[experiment.over_laws.best], recording)
            for experiment, recording in zip(result.experiments, recordings, strict=True)
        ],
        "files": files,
    }


def _prior(parameters: Parameters) -> dict[str, Any]:
    return {parameter.name: {"mean": parameter.mean, "std": parameter.std} for parameter in parameters.free}


def _other_laws(task: Task) -> dict[str, Any]:
    """The contact laws that are candidates beside the task's own, with their priors and their true values."""
    if not task.others:
        return {}
    others = {each.law: {"truth": dict(each.truth), "prior": _prior(each.model.parameters)} for each in task.candidates}
    return {"candidates": others}


def _experiment(experiment: ExperimentResult, candidate: Candidate, recording: str) -> dict[str, Any]:
    belief, prior = experiment.belief, Belief.prior(candidate.model.parameters)
    return {
        **_laws(experiment.over_laws),
        **_estimate(experiment.over_laws),
        "error_percent": dict(experiment.error_percent),
        "fisher": experiment.fisher.tolist(),
        "scaled_trace": experiment.scaled_trace,
        **describe_combinations(prior, belief, experiment.information),
        **experiment.behaviour,
        "solver": {
            "solved": experiment.solver.solved,
            "message": experiment.solver.message,
            "on_bound": list(experiment.on_bound),
        },
        "not_found": dict(experiment.not_found),
        "searching": experiment.searching,
        "tracking_error": experiment.tracking_error,
        "history": [
            {"time": time, **_estimate(over_laws), **_laws(over_laws)} for time, over_laws in experiment.history
        ],
        "planning_ms": {
            "median": float(np.median(experiment.planning_ms)),
            "p95": float(np.percentile(experiment.planning_ms, 95)),
        },
        "recording": recording,
    }


def _estimate(over_laws: LawBelief) -> dict[str, Any]:
    belief = over_laws.beliefs[over_laws.best]
    return {"estimate": _by_name(belief, belief.mean), "std": _by_name(belief, belief.std)}


def _laws(over_laws: LawBelief) -> dict[str, Any]:
    """The most probable law and the odds of each against all others together; empty for a single law."""
    if len(over_laws.laws) < 2:
        return {}
    probability = over_laws.probability
    rest = np.array([np.delete(probability, k).sum() for k in range(len(probability))])
    odds = np.minimum(probability / np.maximum(rest, 1e-300), MOST_ODDS)
    return {"law": over_laws.laws[over_laws.best], "laws": dict(zip(over_laws.laws, odds.tolist(), strict=True))}


def describe_combinations(prior: Belief, belief: Belief, fisher: Array) -> dict[str, Any]:
    """The rank of the information `fisher` (n, n) of all data so far, and the combinations with their stds.

    What the belief's covariance is smaller by than the prior's would not do: it may be the posterior's own spread (see
    `estimation/support.py`), whose inverse has full rank whatever was measured.

    Empty for a single parameter, and for priors of infinite std, to which no combination can be compared.
    """
    if len(belief.names) == 1 or not np.isfinite(prior.std).all():
        return {}
    combinations = identifiable_combinations(fisher, prior.information, belief.mean)
    return {
        "rank": sum(combination.identified for combination in combinations),
        "combinations": [
            {
                "text": combination.text(belief.names),
                "exponents": _by_name(belief, combination.exponents),
                "std_percent": 100.0 * combination.std,
                "prior_std_percent": 100.0 * combination.prior_std,
                "identified": combination.identified,
            }
            for combination in combinations
        ],
    }


def _by_name(belief: Belief, values: Any) -> dict[str, float]:
    return dict(zip(belief.names, np.asarray(values, dtype=float).tolist(), strict=True))
