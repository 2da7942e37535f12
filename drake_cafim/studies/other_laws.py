"""Estimates from one run's data under other contact laws than the one it was planned with."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drake_cafim.contact.normal import NormalLaw
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import solve
from drake_cafim.experiment.closed_loop import RunResult
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.pinching import Pinching, hunt_crossley_pinching

LAWS: tuple[NormalLaw, ...] = ("paper", "kelvin_voigt", "hunt_crossley")
"""The laws of a stiffness."""


def other_laws(result: RunResult) -> Mapping[str, dict[str, Any]]:
    """By law: the estimate from all experiments of a pinching run but the last, and χ² per sample of the last."""
    data = [Data(experiment.robot_states, experiment.measured_force) for experiment in result.experiments]
    return {law: _estimated(_model(law, result), data) for law in LAWS}


def _model(law: NormalLaw, result: RunResult) -> Pinching:
    """The model of `law`: the stiffness with the run's prior, damping or dissipation with its default prior."""
    model = hunt_crossley_pinching() if law == "hunt_crossley" else Pinching(law=law)
    stiffness, damping = model.parameters.free
    prior = replace(stiffness, mean=float(result.prior.mean[0]))
    return replace(model, parameters=type(model.parameters).of([prior, damping]))


def _estimated(model: Pinching, data: list[Data]) -> dict[str, Any]:
    evaluator = TangentEvaluator(model)
    train, held = data[:-1] or data, data[-1:]
    found = solve(make_problem(model, evaluator, train)).belief
    predicted = make_problem(model, evaluator, held).predictions(found.mean)[0]
    residual = (held[0].measurements - predicted) / model.noise_std
    return {
        "estimate": dict(zip(found.names, found.mean.tolist(), strict=True)),
        "std": dict(zip(found.names, found.std.tolist(), strict=True)),
        "held_out": float(np.mean(residual**2)),
    }
