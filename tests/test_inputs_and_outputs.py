"""Details of files and tables: a stop's side, the solver's status, planners' rollouts, packaged files."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from pydrake.solvers import SolutionResult

from drake_cafim.commands.run import table
from drake_cafim.design.planner import PlannerConfig, PlannerName, Scored
from drake_cafim.design.policies import make_planner
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.verdict import Value
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.transmission import JointHardStop
from drake_cafim.estimation.shooting import SolverReport
from drake_cafim.report.report_json import report_of
from drake_cafim.report.wording import with_interval
from drake_cafim.scene.scene import Scene
from drake_cafim.studies.comparisons import rollouts_in_words
from tests.test_report_html import PENDULUM, recorded

ROOT = Path(__file__).parents[1]


def test_the_side_of_a_stop_is_told_and_read_back() -> None:
    stop = JointHardStop("j", {"position": -0.5, "stiffness": 10.0, "side": -1.0})
    tree: Any = SimpleNamespace(joints=[SimpleNamespace(prismatic=False)], joint_index=lambda name: 0)
    assert "side -1" in stop.sentence(tree)
    assert {choice.name: value for choice, value in stop.choices.items()} == {"side": -1.0}
    assert with_interval(-1.0, Value(-1.0, None, "1").std) == "−1"
    assert stop.with_values({"position": -0.4, "stiffness": 10.0, "damping": 0.0}).values["side"] == -1.0


@pytest.mark.long
@pytest.mark.parametrize(("side", "position"), [(-1.0, -0.2), (1.0, 0.25)])
def test_a_report_says_on_which_side_a_stop_is(side: float, position: float, tmp_path: Path) -> None:
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    scene = Scene.from_model(tmp_path / "pendulum.urdf", channels={"q": 1e-4, "v": 1e-3, "u": 0.0}, weld=["base"])
    stop = JointHardStop("hinge", {"position": position, "stiffness": 60.0, "damping": 0.5, "side": side})
    beside = replace(scene, vocabulary=(JointViscousFriction, JointHardStop))
    verdict = diagnose(beside, [recorded(scene, [stop], "a", 1)], settings=Settings(most_effects=1))
    (found,) = report_of(verdict, (), None, {})["explanation"]
    assert found["effect"] == "joint_hard_stop"
    assert found["parameters"]["side"] == {"value": side, "std": None, "unit": "1", "efficiency": None}
    assert verdict.corrected.known[0].values["side"] == side


def test_what_the_solver_said_is_a_sentence_that_names_its_status() -> None:
    assert SolverReport(True, int(SolutionResult.kSolutionFound.value)).message == "SNOPT found an optimum"
    stopped = SolverReport(False, int(SolutionResult.kIterationLimit.value))
    assert stopped.message.startswith("SNOPT ended before an optimum (kIterationLimit)")


@pytest.mark.parametrize(
    ("solver", "told"),
    [
        ({"solved": True, "message": "", "on_bound": []}, None),
        ({"solved": False, "message": "SNOPT stopped", "on_bound": []}, "the estimate: SNOPT stopped"),
        ({"solved": True, "message": "", "on_bound": ["mu"]}, "the estimate of mu stands at a bound of its range"),
    ],
)
def test_the_table_tells_of_a_solver_that_was_not_plain(solver: dict[str, Any], told: str | None) -> None:
    experiment = {
        "estimate": {"mu": 0.4},
        "std": {"mu": 0.1},
        "error_percent": {"mu": 1.0},
        "contact_fraction": 1.0,
        "reversals": 1,
        "max_force": 1.0,
        "planning_ms": {"median": 1.0},
        "solver": solver,
    }
    record = {
        "scenario": "s",
        "world": "w",
        "policy": "p",
        "seed": 1,
        "truth": {"mu": 0.4},
        "experiments": [experiment],
    }
    lines = table(record).splitlines()
    assert lines[2:] == ([] if told is None else [f"    {told}"])


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("name", get_args(PlannerName))
def test_planners_spend_the_rollouts_that_they_say(name: PlannerName, axes: int) -> None:
    spent = 0

    def score(commands: np.ndarray[Any, Any]) -> Scored:
        nonlocal spent
        spent += len(commands)
        return Scored(np.asarray(np.sum(commands, axis=(1, 2))), np.zeros((len(commands), 1, 1)))

    config = PlannerConfig()
    planner = make_planner(name, config)
    bounds = (-np.ones(axes), np.ones(axes))
    planner(np.zeros((config.knots, axes)), score, bounds, np.random.default_rng(0))
    assert spent == planner.rollouts(config.knots * axes)


def test_the_study_of_planners_says_how_many_rollouts_each_spends() -> None:
    assert rollouts_in_words() == "predictive-sampling 10, cem 10, mppi 9, gradient 10 or 12"


def test_packaged_files_are_found_where_there_are_no_symbolic_links(tmp_path: Path) -> None:
    package = tmp_path / "drake_cafim"
    package.mkdir()
    for part in (ROOT / "drake_cafim").iterdir():
        if part.name not in ("diagrams", "models"):
            (package / part.name).symlink_to(part)
    script = f"""
import importlib.util, sys
FOLDERS = {{"drake_cafim": {str(package)!r}, "drake_cafim.diagrams": {str(ROOT / "diagrams")!r},
           "drake_cafim.models": {str(ROOT / "models")!r}}}
class Finder:  # as an editable install has it
    def find_spec(self, name, path=None, target=None):
        if name in FOLDERS:
            folder = FOLDERS[name]
            return importlib.util.spec_from_file_location(
                name, folder + "/__init__.py", submodule_search_locations=[folder])
sys.meta_path.insert(0, Finder())
from drake_cafim.scene.scene import Scene
assert len(Scene.load("rubbing").tree.joints) == 7
"""
    subprocess.run([sys.executable, "-c", script], check=True, cwd=tmp_path)


def test_what_is_packaged_loads_by_its_name() -> None:
    assert len(Scene.load("rubbing").tree.joints) == 7
