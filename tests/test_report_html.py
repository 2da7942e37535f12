"""The page that shows a verdict: complete, alone, small, and the same each time."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Evidence
from drake_cafim.diagnosis.joints.missing_forces import missing_force, window_means
from drake_cafim.diagnosis.predict.stepper import State, advance
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.verdict import Rival, Verdict
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction, JointSpring, JointViscousFriction
from drake_cafim.effects.sensor import SensorBias
from drake_cafim.numerics.rounding import short
from drake_cafim.recordings.recording import Recording
from drake_cafim.report import report_html
from drake_cafim.report.law_figures import law_picture
from drake_cafim.report.laws import law_of
from drake_cafim.report.next_experiment import with_next_experiment
from drake_cafim.report.report_html import write_report_page
from drake_cafim.report.wording import probability, rounded, with_interval
from drake_cafim.scene.scene import Scene

PENDULUM = """<robot name="pendulum">
  <link name="base"/>
  <link name="rod">
    <inertial><origin xyz="0 0 -0.3"/><mass value="1.2"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="20"/></joint>
  <transmission name="motor" type="SimpleTransmission"><type>transmission_interface/SimpleTransmission</type>
    <joint name="hinge"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="hinge_motor"/></transmission>
</robot>
"""
STEP = 0.004
SAMPLES = 600
COMMAND = ["cafim", "diagnose", "my robot.yaml", "--recording", "a.parquet", "--held-out", "b.parquet"]


def recorded(scene: Scene, effects: list[Effect], name: str, seed: int) -> Recording:
    """Some seconds of the pendulum under a sum of sines, with noise."""
    rng = np.random.default_rng(seed)
    physics = Model(scene.priors.mean).with_effects(effects).physics(scene)
    time = STEP * np.arange(SAMPLES)
    frequencies, phases = rng.uniform(0.4, 2.0, 4), rng.uniform(0.0, 6.3, 4)
    u = np.sum(1.1 * np.sin(2.0 * np.pi * frequencies * time[:, None] + phases), axis=1)
    state = State(np.array([[0.3]]), np.array([[0.0]]))
    q, v = [], []
    for effort in u:
        q.append(float(state.q[0, 0]))
        v.append(float(state.v[0, 0]))
        for _ in range(2):  # finer than the simulations of the diagnosis itself
            state = advance(physics, state, np.array([[effort]]), np.array([STEP / 2]))
    noisy = {
        "q": np.array(q) + 1e-4 * rng.standard_normal(SAMPLES),
        "v": np.array(v) + 1e-3 * rng.standard_normal(SAMPLES),
    }
    return Recording(name, time, {"q.hinge": noisy["q"], "v.hinge": noisy["v"], "u.hinge": u})


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path = tmp_path_factory.mktemp("model") / "pendulum.urdf"
    path.write_text(PENDULUM)
    return Scene.from_model(path, channels={"q": 1e-4, "v": 1e-3, "u": 0.0}, weld=["base"])


@pytest.fixture(scope="module")
def friction(scene: Scene) -> tuple[Verdict, Outcome, list[Recording]]:
    truth: list[Effect] = [JointViscousFriction("hinge", {"coefficient": 0.2})]
    held = [recorded(scene, truth, "b.parquet", 2)]
    verdict, outcome = examine(scene, [recorded(scene, truth, "folder/a.parquet", 1)], held_out=held)
    return verdict, outcome, held


@pytest.fixture(scope="module")
def nothing(scene: Scene) -> tuple[Verdict, Outcome]:
    return examine(scene, [recorded(scene, [], "a.parquet", 3)])


def page(tmp_path: Path, verdict: Verdict, outcome: Outcome, held: list[Recording]) -> str:
    path = tmp_path / "report.html"
    write_report_page(path, verdict, outcome, held, COMMAND)
    return path.read_text(encoding="utf-8")


def words(html: str) -> str:
    """What a reader sees of the page."""
    body = html[html.index("<body>") :]
    return " ".join(unescape(re.sub(r"<[^>]*>", "", body)).split())


def test_page_of_an_explained_verdict(tmp_path: Path, friction: tuple[Verdict, Outcome, list[Recording]]) -> None:
    verdict, outcome, held = friction
    assert verdict.kind == "explained"
    html = page(tmp_path, verdict, outcome, held)
    seen = words(html)
    assert " ".join(str(verdict).split()) in seen
    assert seen.startswith("explained")
    assert "joint_viscous_friction" in seen
    assert "cafim diagnose 'my robot.yaml' --recording a.parquet --held-out b.parquet" in seen
    assert "b.parquet, held out" in seen
    assert "folder/a.parquet: 600 samples over 2.40 s, every 4.00 ms" in seen
    assert "b.parquet: 600 samples over 2.40 s, every 4.00 ms; held out Nothing was wrong with them" in seen


def test_rivals_come_with_the_command_that_tells_them_apart(
    tmp_path: Path, friction: tuple[Verdict, Outcome, list[Recording]]
) -> None:
    verdict, outcome, held = friction
    rival = Rival("joint_coulomb_friction", "hinge", 0.2, "both oppose the motion")
    seen = words(page(tmp_path, replace(verdict, rivals=(rival,)), outcome, held))
    assert "both oppose the motion A motion that tells them apart" in seen
    assert f"cafim discriminate {outcome.problem.scene.name} report.json" in seen
    pair = ["joint_viscous_friction@hinge", "joint_coulomb_friction@hinge"]
    runs = [{"truth": pair[0], "odds": [[1.0, 5.0]], "settled_after": 0.62}]
    runs.append({"truth": pair[1], "odds": [[1.0, -2.0]], "settled_after": None})
    found = {"separates": [pair], "duration": 2.0, "file": "trajectory.parquet", "simulated": [runs]}
    carried = with_next_experiment(page(tmp_path, verdict, outcome, held), found)
    assert words(carried) == words(page(tmp_path, replace(verdict, next_experiment=found), outcome, held))
    assert f"A motion of 2.00 s, within the robot's limits, that tells {pair[0]} from {pair[1]}" in words(carried)
    assert f"{pair[0]} 150:1 0.620 s {pair[1]} 1:7.4 not yet" in words(carried)
    assert "cafim discriminate" not in words(carried)


def test_an_effect_that_shows_nowhere_by_itself(
    tmp_path: Path, friction: tuple[Verdict, Outcome, list[Recording]]
) -> None:
    verdict, outcome, held = friction
    spread = replace(verdict, mismatch=replace(verdict.mismatch, locations=()))
    assert "No place and no moment stands out by itself" in words(page(tmp_path, spread, outcome, held))


def test_page_stands_alone_and_is_small(tmp_path: Path, friction: tuple[Verdict, Outcome, list[Recording]]) -> None:
    html = page(tmp_path, *friction)
    assert len(html.encode()) < 3_000_000
    assert "http://" not in html
    assert "https://" not in html
    assert "<script" not in html
    assert not re.search(r'(src|href)="(?!data:|#)', html)


def test_same_verdict_same_bytes(tmp_path: Path, friction: tuple[Verdict, Outcome, list[Recording]]) -> None:
    assert page(tmp_path, *friction) == page(tmp_path, *friction)


def test_page_where_nothing_is_missing(tmp_path: Path, nothing: tuple[Verdict, Outcome]) -> None:
    verdict, outcome = nothing
    assert verdict.kind == "none"
    html = page(tmp_path, verdict, outcome, [])
    assert words(html).startswith("nothing missing Nothing is missing")
    assert "with the effects" not in html
    assert "without the effects" not in html
    assert "No recording was held out" in html


def test_unexplained_shows_what_remains(tmp_path: Path, friction: tuple[Verdict, Outcome, list[Recording]]) -> None:
    verdict, outcome, held = friction
    bare = outcome.problem.scene.corrected(np.zeros(0), [])
    left = replace(verdict, kind="unexplained", explanation=(), rivals=(), corrected=bare)
    html = page(tmp_path, left, outcome, held)
    assert "What is not explained The residual of the model, against" in words(html)
    assert "How well the model simulates" in html
    assert "against position, velocity, effort and time" in html


def test_missing_force_is_the_law(scene: Scene, friction: tuple[Verdict, Outcome, list[Recording]]) -> None:
    verdict, outcome, _ = friction
    weak = outcome.problem.runs[0].weak
    row = outcome.problem.pictures.row_labels.index("hinge: forces")
    v = window_means(weak, verdict.corrected.physics).v[:, 0]
    lacking = missing_force(weak, scene.physics)[:, row]
    assert np.ptp(v) > 1.0
    np.testing.assert_allclose(lacking, -0.2 * v, atol=0.02)


@pytest.mark.parametrize(
    "effect", [JointSpring("hinge", {"stiffness": 1.0, "rest": 0.2}), SensorBias("v.hinge", {"bias": 0.1})]
)
def test_any_effect_has_a_picture(effect: Effect, friction: tuple[Verdict, Outcome, list[Recording]]) -> None:
    outcome = friction[1]
    scene = outcome.problem.scene
    with_it = scene.physics.with_effects([effect])
    picture = law_picture(outcome.problem.pictures.evidence(effect, scene.physics, with_it))
    assert picture.svg.startswith("<svg")
    assert picture.caption.endswith(".")


def test_a_picture_shows_the_effect_alone_whatever_the_corrected_scene_has(
    friction: tuple[Verdict, Outcome, list[Recording]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Named effects may be left out of it, and learned laws stand in it: neither is the effect's force."""
    verdict, outcome, held = friction
    drawn: list[Evidence] = []
    monkeypatch.setattr(report_html, "law_picture", lambda evidence: drawn.append(evidence) or law_picture(evidence))
    page(tmp_path, replace(verdict, corrected=outcome.problem.scene), outcome, held)
    [evidence] = drawn
    given = np.concatenate([a - b for a, b in zip(evidence.without, evidence.with_it, strict=True)])
    v = np.concatenate([means.v[:, 0] for means in evidence.means])
    coefficient = verdict.explanation[0].values["coefficient"].value
    np.testing.assert_allclose(given[:, evidence.first_force], -coefficient * v, atol=0.02 * np.ptp(v))


@pytest.mark.parametrize(("slip", "told"), [({}, "the line is the law."), ({"slip": 0.05}, "builds up after the")])
def test_friction_that_builds_up_is_no_line(
    slip: dict[str, float], told: str, friction: tuple[Verdict, Outcome, list[Recording]]
) -> None:
    outcome, effect = friction[1], JointCoulombFriction("hinge", {"torque": 0.3, **slip})
    scene = outcome.problem.scene
    evidence = outcome.problem.pictures.evidence(effect, scene.physics, scene.physics.with_effects([effect]))
    assert told in law_picture(evidence).caption


def test_every_effect_has_a_law_in_words(scene: Scene) -> None:
    for effect in EFFECTS:
        assert effect.formula and law_of(effect("somewhere"), scene.tree).words


def test_the_law_of_friction_that_builds_up_says_so(scene: Scene) -> None:
    law = law_of(JointCoulombFriction(scene.tree.joint_names[0], {"torque": 1.0, "slip": 0.01}), scene.tree)
    assert law.formula == "−<i>T</i> <i>z</i>" and "builds up over 0.01 rad" in law.words


def test_numbers_read_well() -> None:
    assert with_interval(203.4567, 0.51) == "203.5 ± 1.0"
    assert with_interval(-0.02513, 0.0004) == "−0.02513 ± 0.00078"
    assert rounded(0.0123456) == "0.0123"
    assert (rounded(float("inf")), short(float("-inf"))) == ("∞", "−∞")
    assert (rounded(123456.0), rounded(1234.5), rounded(99.96)) == ("123\u202f000", "1230", "100")
    assert (rounded(1.23456e7), rounded(2.5e-9, 2), short(0.25), short(4.1e4)) == (
        "1.23 × 10⁷",
        "2.5 × 10⁻⁹",
        "0.25",
        "41\u202f000",
    )
    assert (probability(0.99999), probability(0.25)) == ("> 99.9 %", "25.0 %")
