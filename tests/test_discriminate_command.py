"""`cafim discriminate` from outside: files, bytes, messages."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from drake_cafim import recordings
from drake_cafim.cli import main
from drake_cafim.commands import discriminate as discriminate_module
from drake_cafim.design.planner import PlannerName
from drake_cafim.diagnosis.diagnose import estimate
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.discrimination.design import Effort, default_effort
from drake_cafim.discrimination.hypotheses import reported_pairs
from drake_cafim.discrimination.motions import Shape
from drake_cafim.discrimination.planned import noise_of
from drake_cafim.discrimination.reported_noise import with_reported_noise
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.next_experiment import next_experiment
from drake_cafim.report.report_json import parameters_of, report_of
from drake_cafim.scene.scene import Scene
from tests.parametrize import long_after

PENDULUM = """<robot name="pendulum">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1.0"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="6"/></joint>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type>
    <joint name="pivot"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="drive"/></transmission>
</robot>"""
SCENARIO = """model: pendulum.urdf
weld: [{body: base}]
channels: {q: {std: 2.0e-3}, v: {std: 2.0e-2}, u: {std: 0.0}}
unknown: [{parameter: mass, body: rod, mean: 1.0, std: 0.1}]
"""
REPORT: dict[str, Any] = {
    "schema": "drake_cafim.report/1",
    "verdict": "explained",
    "explanation": [
        {
            "effect": "joint_coulomb_friction",
            "at": "pivot",
            "probability": 0.99,
            "parameters": {"torque": {"value": 0.2, "std": 0.01, "unit": "N m"}},
        },
        {
            "effect": "actuator_bias",
            "at": "pivot",
            "probability": 0.7,
            "parameters": {"torque": {"value": 0.1, "std": 0.02, "unit": "N m"}},
        },
    ],
    "rivals": [{"effect": "joint_spring", "at": "pivot", "probability": 0.3, "why_alike": "..."}],
    "parameters": [{"parameter": "mass", "at": "rod", "value": 1.02, "std": 0.01, "unit": "kg"}],
    "next_experiment": None,
    "files": {"html": "report.html"},
}


@pytest.fixture
def small_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hundreds of candidate motions instead of thousands."""

    def small(shape: Shape, planner: PlannerName) -> Effort:
        effort = default_effort(shape, planner)
        return replace(effort, config=replace(effort.config, candidates=8), rounds=2, generations=4, rehearsals=1)

    monkeypatch.setattr(discriminate_module, "default_effort", small)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    (tmp_path / "report.json").write_text(json.dumps(REPORT))
    return tmp_path


def discriminate(folder: Path, *arguments: str) -> Result:
    return CliRunner().invoke(main, ["discriminate", str(folder / "scenario.yaml"), *arguments])


@pytest.mark.long
@pytest.mark.usefixtures("small_budget")
def test_a_named_pair_gets_its_motion_and_the_same_seed_the_same_bytes(folder: Path) -> None:
    words = ["--between", "actuator_bias@pivot", "--between", "joint_spring@pivot", "--duration", "0.6", "--no-replay"]
    for out in ("one", "two"):
        result = discriminate(folder, *words, "--out", str(folder / out), "--seed", "4")
        assert result.exit_code == 0, result.output
    assert "actuator_bias@pivot or joint_spring@pivot" in result.output
    for name in ("report.json", "trajectory.parquet"):
        assert (folder / "one" / name).read_bytes() == (folder / "two" / name).read_bytes()
    found = json.loads((folder / "one" / "report.json").read_text())["next_experiment"]
    assert found["separates"] == [["actuator_bias@pivot", "joint_spring@pivot"]]
    assert found["expected_log_odds"] > 3.0
    assert [rehearsal["truth"] for rehearsal in found["simulated"][0]] == ["actuator_bias@pivot", "joint_spring@pivot"]
    assert all(rehearsal["odds"][-1][1] > 3.0 for rehearsal in found["simulated"][0])
    trajectory = recordings.read(folder / "one" / found["file"])
    assert set(trajectory.columns) == {"q.pivot", "v.pivot", "u.pivot"}
    assert np.max(np.abs(trajectory["u.pivot"])) <= 20.0 and np.max(np.abs(trajectory["v.pivot"])) <= 6.0
    again = discriminate(folder, *words, "--out", str(folder / "one"))
    assert again.exit_code == 2 and "not empty" in again.output


@pytest.mark.usefixtures("small_budget")
@pytest.mark.parametrize("planner", long_after(1, ["gradient", "cem", "mppi"]))
def test_every_planner_designs(folder: Path, planner: str) -> None:
    words = ["--duration", "0.6", "--no-replay", "--planner", planner, "--criterion", "time"]
    result = discriminate(folder, str(folder), *words, "--out", str(folder / "out"))
    assert result.exit_code == 0, result.output


@pytest.mark.usefixtures("small_budget")
def test_a_report_is_copied_with_its_next_experiment_and_a_replay(folder: Path) -> None:
    (folder / "report.html").write_text(f"<p>before</p>{next_experiment(None, 'cafim discriminate')}<p>after</p>")
    result = discriminate(folder, str(folder), "--out", str(folder / "out"), "--duration", "0.8", "--json")
    assert result.exit_code == 0, result.output
    page = (folder / "out" / "report.html").read_text()
    assert page.startswith("<p>before</p>") and page.endswith("<p>after</p>") and "cafim discriminate" not in page
    assert "tells <b>actuator_bias@pivot</b> from <b>joint_spring@pivot</b>" in page
    written = json.loads((folder / "out" / "report.json").read_text())
    assert written["explanation"] == REPORT["explanation"] and written["files"]["html"] == "report.html"
    assert written["next_experiment"]["separates"] == [["actuator_bias@pivot", "joint_spring@pivot"]]
    assert (folder / "out" / "replay.html").stat().st_size > 1e6


def test_a_rival_takes_the_place_of_what_it_is_like(folder: Path) -> None:
    scene = Scene.load(folder / "scenario.yaml")
    [pair] = reported_pairs(scene, REPORT, "report.json")
    assert [effect.key for effect in pair.first.effects] == [
        ("joint_coulomb_friction", "pivot"),
        ("actuator_bias", "pivot"),
    ]
    assert [effect.key for effect in pair.second.effects] == [
        ("joint_coulomb_friction", "pivot"),
        ("joint_spring", "pivot"),
    ]
    assert pair.first.unknown.tolist() == [1.02] and isinstance(pair.second, Model)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "expected a report.json, or --between"),
        (["--between", "actuator_bias@pivot"], "expected two"),
        (["--between", "actuator_bias@pivot", "--between", "joint_sprang@pivot"], "joint_sprang"),
        (["--between", "actuator_bias@pivot", "--between", "joint_spring@knee"], "pivot"),
        (["--between", "actuator_bias@pivot", "--between", "joint_spring@pivot", "--duration", "0"], "--duration"),
        (["REPORT", "--criterion", "d-optimal"], "odds, time"),
        (["REPORT", "--planner", "newton"], "predictive-sampling, cem"),
        (["scenario.yaml"], "it is no JSON"),
        (["no_rivals.json"], "already tell joint_coulomb_friction@pivot and actuator_bias@pivot from every other"),
        (["no_rivals.json"], "add --between joint_coulomb_friction@pivot EFFECT@PLACE"),
        (["nothing.json"], "because nothing is missing; cafim why says what was looked for"),
        (["unnamed.json"], "because no effect is named; cafim why"),
        (["estimate.json"], "it is of an estimation, which names no explanations; give the report of cafim diagnose"),
        (["mistaken.json"], "mend the recordings and diagnose again"),
        (["parameter.json"], "measure mass of rod, state the smaller std under unknown, and diagnose again"),
        (["other.json"], "mass of rod"),
    ],
)
def test_what_cannot_be_designed_for_ends_with_one_sentence(folder: Path, arguments: list[str], said: str) -> None:
    reports: dict[str, dict[str, Any]] = {
        "no_rivals": {"rivals": []},
        "nothing": {"rivals": [], "explanation": [], "verdict": "none"},
        "unnamed": {"rivals": [], "explanation": [], "verdict": "unexplained"},
        "estimate": {"rivals": [], "explanation": [], "verdict": None},
        "mistaken": {"rivals": [], "explanation": [], "data_mistakes": ["u.pivot of a.csv has its sign turned"]},
        "parameter": {"rivals": [{"parameter": "mass", "at": "rod", "probability": 0.3, "why_alike": "..."}]},
        "other": {"parameters": []},
    }
    for name, changed in reports.items():
        (folder / f"{name}.json").write_text(json.dumps(REPORT | changed))
    files = {"REPORT": "report.json"}
    words = [
        str(folder / files.get(argument, argument))
        if argument.endswith((".json", ".yaml")) or argument in files
        else argument
        for argument in arguments
    ]
    result = discriminate(folder, *words, "--out", str(folder / "out"))
    assert result.exit_code == 2, result.output
    assert said in result.output and "Traceback" not in result.output
    assert not list((folder / "out").glob("*")) or not (folder / "out" / "report.json").exists()


NOISE = {
    "q.pivot": {"std": 3e-3, "unit": "rad", "correlation_time": 0.0, "stated": False},
    "v.pivot": {"std": 0.02, "unit": "rad/s", "correlation_time": 0.004, "stated": False},
    "u.pivot": {"std": 0.05, "unit": "N m", "correlation_time": 0.0, "stated": False},
}


def test_noise_that_the_scenario_does_not_state_is_that_of_the_report(folder: Path) -> None:
    """What the scenario states stays, a wrench's axes share one std, and joints without a column are held."""
    (folder / "scenario.yaml").write_text(SCENARIO.replace("v: {std: 2.0e-2}, u: {std: 0.0}", "u: {}"))
    scene = with_reported_noise(Scene.load(folder / "scenario.yaml"), NOISE)
    assert noise_of(scene) == {"q.pivot": 2e-3, "v.pivot": 0.02, "u.pivot": 0.05}
    channel = scene.channel("v.pivot")
    assert channel is not None and channel.correlation_time == 0.004
    wrench = {f"wrench.w.{axis}": {"std": std} for axis, std in (("fx", 0.1), ("fy", 0.2), ("fz", 0.2), ("tx", 0.01))}
    (folder / "scenario.yaml").write_text(SCENARIO.replace("q: {std", "wrench.w: {body: rod}, q: {std"))
    felt = with_reported_noise(Scene.load(folder / "scenario.yaml"), wrench)
    assert felt.std("wrench.w.fz") == pytest.approx(np.sqrt(0.03)) and felt.std("wrench.w.tz") == 0.01
    (folder / "scenario.yaml").write_text(SCENARIO + "lock: unrecorded\n")
    assert with_reported_noise(Scene.load(folder / "scenario.yaml"), NOISE).tree.joint_names == ("pivot",)


@pytest.mark.long
@pytest.mark.usefixtures("small_budget")
def test_a_diagnosis_of_unstated_noise_leads_to_a_motion(folder: Path) -> None:
    """From a recording to a motion: the report of one command is all that the other needs, with a pair named too."""
    (folder / "scenario.yaml").write_text(SCENARIO.replace("q: {std: 2.0e-3}, v: {std: 2.0e-2}, u: {std: 0.0}", ""))
    between = ["--between", "actuator_bias@pivot", "--between", "joint_spring@pivot"]
    refused = discriminate(folder, *between, "--out", str(folder / "out"))
    assert refused.exit_code == 2 and "give the report.json of a diagnosis, which estimates it" in refused.output
    rng, time = np.random.default_rng(1), np.arange(0.0, 3.0, 0.005)
    q, v, a = 0.5 * np.sin(4.0 * time), 2.0 * np.cos(4.0 * time), -8.0 * np.sin(4.0 * time)
    u = 0.27 * a + 9.81 * 0.5 * np.sin(q)
    columns = {"q.pivot": q + rng.normal(0.0, 2e-3, q.shape), "v.pivot": v + rng.normal(0.0, 2e-2, q.shape)}
    # of 0.05 N m, a fiftieth of the variance that the other noise gives the equations, 3 s of a recording tell nothing
    recording = Recording("a.csv", time, columns | {"u.pivot": u + rng.normal(0.0, 0.5, q.shape)})
    found = estimate(Scene.load(folder / "scenario.yaml"), [recording])
    report = report_of(None, parameters_of(found.parameters), None, {}, found)
    assert report["noise"]["q.pivot"]["std"] == pytest.approx(2e-3, rel=0.15)
    effort = dict(report["noise"]["u.pivot"])
    assert effort.pop("std") == pytest.approx(0.5, rel=0.3)
    assert effort == {"unit": "N m", "correlation_time": 0.0, "stated": False}
    (folder / "report.json").write_text(json.dumps(report))
    words = ["--duration", "0.6", "--no-replay", "--out", str(folder / "out")]
    result = discriminate(folder, str(folder), *between, *words)
    assert result.exit_code == 0, result.output
    written = json.loads((folder / "out" / "report.json").read_text())
    assert written["next_experiment"]["separates"] == [["actuator_bias@pivot", "joint_spring@pivot"]]
