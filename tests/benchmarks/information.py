"""`python -m tests.benchmarks.information [--draws N] [SCENARIO ...]`: which Fisher information is the truer.

A robot carries out its scenario's scripted motion in the Diagram of `--fisher autodiff`: arm or gripper, joint control,
the planner's contact law at the true parameters. Three claims about the std of an estimate without a prior: `tangent`
along the motion as planned, along the motion as made (what the estimator of a run is given as measured), and `autodiff`
through the robot. Beside them stands what estimates really scatter by over draws of the force noise: of CA-MAP, which
takes the motion as measured, and of maximum likelihood through the Diagram, which knows the commands alone (the Diagram
replaced by its second-order interpolation around the truth). The sensor's noise is a tenth of the scenario's: with the
whole, one experiment leaves the damping so open that its bound at zero counts.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.diagrams.tracked_contact import TrackedEvaluator
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import solve
from drake_cafim.information import fisher_information
from drake_cafim.parameters import Parameters
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.typing import Array

PERIODS = {"pinching": 50, "rubbing": 130, "contouring": 60}
QUIETER = 0.1
"""The noise over the scenario's."""
REACH = 3.0
"""Stds from the truth to the nodes of the interpolation."""
WIDE = 100.0
"""The prior's std over what `autodiff` claims: as good as none."""


@dataclass(frozen=True)
class Compared:
    """By parameter (n,), in per cent of the truth: claimed stds, and those over the draws; milliseconds a motion."""

    names: tuple[str, ...]
    claimed: dict[str, Array]
    realised: dict[str, Array]
    milliseconds: dict[str, float]


def scripted_commands(model: Any, start: Array, periods: int, theta: Array) -> Array:
    """The model's script (T, nu) m/s from `start`, carried out as planned."""
    state, commands = start, []
    for number in range(periods):
        commands.append(np.clip(model.script(number * model.period, state, theta), *model.velocity_bounds))
        state = model.motion(state, np.array(commands[-1])[np.newaxis, np.newaxis])[0, -1, : len(state)]
    return np.array(commands)


def compare(name: str, draws: int, periods: int | None = None) -> Compared:
    """Claimed and realised stds of a scenario's scripted motion."""
    stage = stage_of(load(resolve(name)), name)
    task = stage.task
    model: Any = task.model
    model = replace(model, force_std=QUIETER * model.force_std)
    theta, noise = task.theta, model.noise_std
    evaluator = stage.evaluator(model)
    assert isinstance(evaluator, TrackedEvaluator)
    commands = scripted_commands(model, task.robot_start, PERIODS[name] if periods is None else periods, theta)
    planned = model.motion(task.robot_start, commands[np.newaxis])
    none, clock = model.start(planned[0, 0], theta), {}
    began = time.perf_counter()
    made = evaluator(planned, theta, none)
    clock["autodiff"] = time.perf_counter() - began
    tangent = TangentEvaluator(model)
    began = time.perf_counter()
    as_planned = tangent(planned, theta, none)
    clock["tangent"] = time.perf_counter() - began
    as_made = tangent(model.measured_motion(made.motion), theta, none)
    claims = {"tangent, as planned": as_planned, "tangent, as made": as_made, "autodiff": made}
    claimed = {claim: _std(rollout.sensitivities[0], noise) for claim, rollout in claims.items()}
    q = evaluator._posture(task.robot_start[: commands.shape[1]])

    def through_robot(values: Array) -> Array:
        return evaluator.simulate(task.robot_start, commands, values, q, automatic=False)[2]

    random = np.random.default_rng(1)
    clean = made.measurements[0]
    readings = clean + noise * random.standard_normal((draws, *clean.shape))
    realised = {
        "CA-MAP, motion measured": np.std(_map_estimates(model, made.motion[0], readings, claimed["autodiff"]), axis=0),
        "likelihood, commands alone": np.std(
            _likelihood_estimates(through_robot, readings, theta, claimed["autodiff"], noise), axis=0
        ),
    }
    share = 100.0 / np.abs(theta)
    return Compared(
        model.parameters.names,
        {key: share * value for key, value in claimed.items()},
        {key: share * value for key, value in realised.items()},
        {key: 1e3 * value for key, value in clock.items()},
    )


def _std(slopes: Array, noise: Array) -> Array:
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(fisher_information(slopes, noise)))))


def _map_estimates(model: Any, motion: Array, readings: Array, std: Array) -> Array:
    """Estimates (draws, n) of CA-MAP with a prior of `WIDE` stds."""
    items = [replace(item, std=WIDE * wide) for item, wide in zip(model.parameters.free, std, strict=True)]
    wide = replace(model, parameters=Parameters.of(items))
    found = []
    for reading in readings:
        problem = make_problem(wide, TangentEvaluator(wide), [Data(motion, reading)])
        found.append(solve(problem).belief.mean)
    return np.array(found)


def _likelihood_estimates(predict: Any, readings: Array, theta: Array, std: Array, noise: Array) -> Array:
    """Maximum-likelihood estimates (draws, n) with predictions interpolated between 3ⁿ simulations."""
    nodes = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(theta))))
    values = np.array([predict(theta + REACH * std * node) for node in nodes])
    coefficients = np.linalg.lstsq(_monomials(nodes), values.reshape(len(nodes), -1), rcond=None)[0]

    def residual(z: Array, reading: Array) -> Array:
        return ((_monomials(z[np.newaxis]) @ coefficients - reading.ravel()) / np.tile(noise, len(reading))).ravel()

    solutions = [least_squares(residual, np.zeros(len(theta)), args=(reading,)).x for reading in readings]
    return theta + REACH * std * np.array(solutions)


def _monomials(z: Array) -> Array:
    """All products of at most two of the n coordinates z (m, n)."""
    padded = np.column_stack([np.ones(len(z)), z])
    rows, columns = np.triu_indices(padded.shape[1])
    return np.asarray(padded[:, rows] * padded[:, columns])


def main() -> None:
    """Print a table for each scenario."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", default=list(PERIODS))
    parser.add_argument("--draws", type=int, default=200)
    options = parser.parse_args()
    for name in options.scenario:
        compared = compare(name, options.draws)
        print(f"{name}, {PERIODS[name]} periods, {options.draws} draws: std in per cent of the truth")
        for kind in (compared.claimed, compared.realised):
            for key, std in kind.items():
                row = ", ".join(f"{who} {value:.2f}" for who, value in zip(compared.names, std, strict=True))
                print(f"  {key:28s} {row}")
        print("  " + ", ".join(f"{key} {value:.1f} ms" for key, value in compared.milliseconds.items()), flush=True)


if __name__ == "__main__":
    main()
