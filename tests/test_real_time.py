"""A planning step takes less than its period: all contact laws are candidates, and the force guard is reckoned with."""

import time
from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.design import system
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve


@pytest.mark.parametrize("name", ["pinching", "rubbing", "contouring", "hefting"])
def test_planning_keeps_up(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # processor time: what else runs on the machine does not count
    monkeypatch.setattr(system, "perf_counter", time.thread_time)
    stage = stage_of(load(resolve(name)), name)
    task = stage.with_laws(stage.task.with_prior_mean(1.3), "all")
    task = replace(task, periods=25, experiments=1, estimate_every=0)
    limited = hasattr(task.model, "force_limit")
    [experiment] = run(task, Options(seed=1, force_guard=limited, search=False)).experiments
    period = 1e3 * task.model.period
    assert np.median(experiment.planning_ms) < period
    assert np.percentile(experiment.planning_ms, 95) < 2.0 * period
