"""`python -m tests.benchmarks.planning [--seeds N] [SCENARIO ...]`: how long a planning step takes beside its period.

All contact laws are candidates, the prior is 30 % too high, and the force guard is reckoned with where the scenario has
a limit. The time is the planning thread's processor time, so that other work on the machine counts little. Wanted: the
median below the period (a ratio below 1), the 95th percentile below twice the period.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from drake_cafim.design import system
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.typing import Array

SCENARIOS = ("pinching", "rubbing", "contouring", "hefting")


def planning_milliseconds(name: str, seed: int, periods: int | None = None) -> tuple[float, Array]:
    """The scenario's period, and each planning step's time (steps,), in ms."""
    stage = stage_of(load(resolve(name)), name)
    task = stage.with_laws(stage.task.with_prior_mean(1.3), "all")
    task = replace(task, experiments=1, estimate_every=0, periods=task.periods if periods is None else periods)
    limited = hasattr(task.model, "force_limit")
    with patch.object(system, "perf_counter", time.thread_time):
        [experiment] = run(task, Options(seed=seed, force_guard=limited, search=False)).experiments
    return 1e3 * task.model.period, np.asarray(experiment.planning_ms)


def main() -> None:
    """Print a row for each scenario."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", default=list(SCENARIOS))
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    print(f"{'scenario':12s} {'period ms':>9s} {'steps':>6s} {'median ms':>10s} {'95 % ms':>8s} {'ratio':>6s}")
    for name in options.scenario:
        runs = [planning_milliseconds(name, seed) for seed in range(1, options.seeds + 1)]
        period, steps = runs[0][0], np.concatenate([times for _, times in runs])
        median, late = np.percentile(steps, [50, 95])
        print(f"{name:12s} {period:9.0f} {len(steps):6d} {median:10.1f} {late:8.1f} {median / period:6.2f}", flush=True)


if __name__ == "__main__":
    main()
