"""An effect of a user's own is looked for, named, fitted, written, read and drawn like those of the catalogue."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_cafim import InputError, Recording, Scene, Verdict
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagrams.tutorials.own_effect import JointCatch, caught_elbow
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.report.law_figures import law_picture

TRUTH = {"torque": 0.25, "position": 0.2}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.from_model(ARM, channels=NOISE, weld=["base"])


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record(caught_elbow, 1, "caught")


@pytest.fixture(scope="module")
def found(scene: Scene, recording: Recording) -> tuple[Verdict, Outcome]:
    return examine(scene, [recording], effects=[JointCatch])


def test_it_is_named_with_its_strengths(found: tuple[Verdict, Outcome]) -> None:
    verdict = found[0]
    (explanation,) = verdict.explanation
    assert (verdict.kind, explanation.effect.key) == ("explained", ("joint_catch", "elbow"))
    for name, value in explanation.values.items():
        assert abs(value.value - TRUTH[name]) < 4.0 * value.std < 0.05 * TRUTH[name]


def test_its_scenario_needs_its_class(
    tmp_path: Path, found: tuple[Verdict, Outcome], scene: Scene, recording: Recording
) -> None:
    report = write_artifacts(tmp_path, *found, [recording], [], ["a command"], replay=False)
    assert report["explanation"][0]["effect"] == "joint_catch"
    page = (tmp_path / "report.html").read_text()
    assert "−T s exp((1 − s²)/2)" in page and "position of elbow (rad)" in page
    with pytest.raises(InputError, match="there is no effect named 'joint_catch'"):
        Scene.load(tmp_path / "scenario.corrected.yaml")
    again = Scene.load(tmp_path / "scenario.corrected.yaml", effects=[JointCatch])
    (force,) = again.physics.joint_forces
    assert force.values["torque"] == pytest.approx(TRUTH["torque"], rel=0.02)


def test_without_its_class_it_is_not_named(scene: Scene) -> None:
    assert "joint_catch" not in [effect.name for effect in scene.vocabulary]
    assert [effect.name for effect in scene.with_effect_classes([JointCatch]).vocabulary].count("joint_catch") == 1
    assert scene.with_effect_classes([JointViscousFriction]).vocabulary == scene.vocabulary


def test_a_name_that_is_taken_is_refused(scene: Scene) -> None:
    class Another(JointViscousFriction):
        pass

    with pytest.raises(InputError, match="effect class Another: the name 'joint_viscous_friction' is taken"):
        scene.with_effect_classes([Another])


def test_the_tutorial_s_derivatives_are_right() -> None:
    q, nothing = np.linspace(-0.3, 0.6, 50), np.zeros(50)
    effect, h = JointCatch("elbow", TRUTH), 1e-6
    law = effect.force(JointSamples(q, nothing, nothing))

    def value(q: np.ndarray, torque: float, position: float) -> np.ndarray:
        moved = JointCatch("elbow", {"torque": torque, "position": position})
        return np.asarray(moved.force(JointSamples(q, nothing, nothing)).value)

    np.testing.assert_allclose(law.d_q, (value(q + h, 0.25, 0.2) - value(q - h, 0.25, 0.2)) / (2 * h), atol=1e-7)
    by_torque = (value(q, 0.25 + h, 0.2) - value(q, 0.25 - h, 0.2)) / (2 * h)
    by_position = (value(q, 0.25, 0.2 + h) - value(q, 0.25, 0.2 - h)) / (2 * h)
    np.testing.assert_allclose(law.d_strengths, np.stack([by_torque, by_position], axis=1), atol=1e-7)


def test_its_picture_is_over_what_moves_it(found: tuple[Verdict, Outcome]) -> None:
    verdict, outcome = found
    physics = outcome.problem.scene.physics
    effect = verdict.explanation[0].effect
    picture = law_picture(outcome.problem.pictures.evidence(effect, physics, verdict.corrected.physics))
    assert "against position of elbow" in picture.svg


def test_it_simulates_in_a_diagram(found: tuple[Verdict, Outcome], recording: Recording) -> None:
    builder = DiagramBuilder()
    robot = found[0].corrected.add_to(builder)
    effort = PiecewisePolynomial.ZeroOrderHold(recording.time, recording.matrix("u", robot.joints).T)
    builder.Connect(builder.AddSystem(TrajectorySource(effort)).get_output_port(), robot.effort)
    simulator = Simulator(builder.Build())
    context = robot.plant.GetMyContextFromRoot(simulator.get_context())
    # from where the stand-in starts, at rest at zero: the catch multiplies the noise of a recorded start by six
    simulator.AdvanceTo(1.0)
    reached = recording.window(1.0, 2.0).matrix("q", robot.joints)[0]
    np.testing.assert_allclose(robot.plant.GetPositions(context), reached, atol=1e-3)
