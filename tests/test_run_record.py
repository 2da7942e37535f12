"""run.json holds what the contract lists."""

import json
from dataclasses import replace

from pydrake.solvers import SolutionResult

from drake_cafim.estimation.shooting import SolverReport
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.experiment.run_record import run_record
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.hefting import hefting

PER_EXPERIMENT = {
    "solver",
    "estimate", "std", "error_percent", "fisher", "scaled_trace", "first_contact", "contact_fraction",
    "sliding_fraction", "airborne_fraction", "reversals", "make_breaks", "faces", "max_force", "tracking_error",
    "history", "planning_ms", "recording", "not_found", "searching",
}  # fmt: skip


def test_every_key_is_there_and_survives_json():
    for task, seed in ((replace(hefting(), periods=8), 1), (replace(contouring(), periods=12), 2)):
        result = run(task, Options(seed=seed, experiments=1, search=False))
        record = run_record(result, ["experiment_1.parquet"], {"replay": "replay.html", "figures": []})
        again = json.loads(json.dumps(record, allow_nan=False))
        assert again == record
        assert again["schema"] == "drake_cafim.run/1" and again["scenario"] == task.name
        assert set(again["truth"]) == set(again["prior"]) == set(task.truth)
        (experiment,) = again["experiments"]
        several = {"rank", "combinations"} if len(task.truth) > 1 else set()
        assert set(experiment) == PER_EXPERIMENT | several
        assert len(experiment["history"]) == (0 if task.name == "hefting" else 3)


def test_what_the_solver_said_is_kept() -> None:
    result = run(replace(hefting(), periods=8), Options(seed=1, experiments=1))
    limited = SolverReport(False, int(SolutionResult.kIterationLimit.value))
    stopped = replace(result.experiments[0], solver=limited, on_bound=("mass",))
    (experiment,) = run_record(replace(result, experiments=(stopped,)), ["a.parquet"], {})["experiments"]
    assert experiment["solver"] == {"solved": False, "message": limited.message, "on_bound": ["mass"]}
    assert "kIterationLimit" in limited.message
