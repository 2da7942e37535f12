"""The contents of run.json for a finished run."""

from typing import Any

import numpy as np

from drake_cafim.belief import Belief
from drake_cafim.experiment.closed_loop import ExperimentResult, RunResult
from drake_cafim.information import identifiable_combinations

SCHEMA = "drake_cafim.run/1"


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
        "force_guard": result.options.force_guard,
        "belief_samples": result.options.belief_samples,
        "seed": result.options.seed,
        "truth": {name: float(value) for name, value in task.truth.items()},
        "prior": {
            name: {"mean": float(mean), "std": float(std)}
            for name, mean, std in zip(result.prior.names, result.prior.mean, result.prior.std, strict=True)
        },
        "experiments": [
            _experiment(experiment, result.prior, recording)
            for experiment, recording in zip(result.experiments, recordings, strict=True)
        ],
        "files": files,
    }


def _experiment(experiment: ExperimentResult, prior: Belief, recording: str) -> dict[str, Any]:
    belief = experiment.belief
    return {
        "estimate": _by_name(belief, belief.mean),
        "std": _by_name(belief, belief.std),
        "error_percent": dict(experiment.error_percent),
        "fisher": experiment.fisher.tolist(),
        "scaled_trace": experiment.scaled_trace,
        **describe_combinations(prior, belief),
        **experiment.behaviour,
        "solver": {
            "solved": experiment.solver.solved,
            "message": experiment.solver.message,
            "on_bound": list(experiment.on_bound),
        },
        "tracking_error": experiment.tracking_error,
        "history": [
            {"time": time, "estimate": _by_name(belief, mean), "std": _by_name(belief, std)}
            for time, mean, std in experiment.history
        ],
        "planning_ms": {
            "median": float(np.median(experiment.planning_ms)),
            "p95": float(np.percentile(experiment.planning_ms, 95)),
        },
        "recording": recording,
    }


def describe_combinations(prior: Belief, belief: Belief) -> dict[str, Any]:
    """The rank of the information of all data so far, and the combinations of parameters with their stds.

    Empty for a single parameter, and for priors of infinite std, to which no combination can be compared.
    """
    if len(belief.names) == 1 or not np.isfinite(prior.std).all():
        return {}
    combinations = identifiable_combinations(belief.information - prior.information, prior.information, belief.mean)
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
