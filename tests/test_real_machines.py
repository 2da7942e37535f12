"""Recordings of real machines whose friction is published: named, and the held-out simulation improves."""

from pathlib import Path

import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.scene.scene import Scene

FRICTION = {"joint_viscous_friction", "joint_coulomb_friction", "joint_asymmetric_coulomb_friction",
            "joint_stribeck_friction", "joint_load_dependent_friction"}  # fmt: skip


def _diagnosed(
    folder: Path, held_out: set[str], only: set[str] | None = None, settings: Settings | None = None
) -> Verdict:
    """The verdict on a machine's recordings, or on those named in `only`, but for those held out."""
    runs = sorted((folder / "runs").glob("*.parquet"))
    if only is not None:
        runs = [path for path in runs if path.stem in only | held_out]
    train = [recordings.read(path) for path in runs if path.stem not in held_out]
    held = [recordings.read(path) for path in runs if path.stem in held_out]
    return diagnose(Scene.load(folder / "scenario.yaml"), train, held_out=held, settings=settings)


def test_emps_drive_lacks_its_published_friction(data_folder: Path) -> None:
    """Published: viscous 203.5034 N s/m, Coulomb 20.3935 N, offset −3.1648 N (Janot, Gautier, Brunot, 2019)."""
    verdict = _diagnosed(data_folder / "data" / "emps_drive", {"ident_2"})
    found = {accepted.effect.name: accepted.values for accepted in verdict.explanation}
    assert found["joint_viscous_friction"]["coefficient"].value == pytest.approx(203.5034, rel=0.1)
    asymmetric = found["joint_asymmetric_coulomb_friction"]
    positive, negative = asymmetric["torque_positive"].value, asymmetric["torque_negative"].value
    assert 0.5 * (positive + negative) == pytest.approx(20.3935, rel=0.1)
    assert 0.5 * (positive - negative) == pytest.approx(-3.1648, rel=0.2)
    assert verdict.held_out is not None
    assert verdict.held_out.corrected.rmse["q.carriage"] <= 2.5e-3
    assert verdict.held_out.nominal_as_given.rmse["q.carriage"] > 0.08
    # the published offset and Coulomb friction fit 3.9 standard deviations worse than this, of what is left by both
    assert all(rival.effect != "joint_coulomb_friction" for rival in verdict.rivals)


@pytest.mark.parametrize(
    ("held_out", "only"),
    [
        pytest.param(
            {"trajectory_05"}, {"trajectory_01", "trajectory_12"}, marks=pytest.mark.long, id="two recordings"
        ),
        # two minutes, by the same code
        pytest.param({"trajectory_03", "trajectory_05", "trajectory_11"}, None, marks=pytest.mark.long, id="all"),
    ],
)
def test_double_pendulum_lacks_friction_at_both_joints(
    held_out: set[str], only: set[str] | None, data_folder: Path
) -> None:
    verdict = _diagnosed(data_folder / "data" / "double_pendulum_A0", held_out, only)
    rubbing = {accepted.effect.at for accepted in verdict.explanation if accepted.effect.name in FRICTION}
    assert rubbing == {"shoulder", "elbow"}
    # the measured torque lags the command, which nothing here explains away
    assert verdict.kind == "unexplained"
    assert verdict.held_out is not None
    nominal, corrected = verdict.held_out.nominal, verdict.held_out.corrected
    assert corrected.nll < nominal.nll
    for joint in ("shoulder", "elbow"):
        assert corrected.rmse[f"q.{joint}"] < nominal.rmse[f"q.{joint}"]


@pytest.mark.long
def test_simple_pendulum_lacks_its_motors_friction_and_inertia(data_folder: Path) -> None:
    """Its motor shakes at 30 Hz behind the gear, which hides both from windows of 60 ms.

    Published, with another load: Coulomb friction 0.1839 N m (Wiebe et al., JOSS, 2022).
    """
    verdict = _diagnosed(data_folder / "data" / "simple_pendulum", {"ilqr"})
    found = {item.effect.name: item.values for item in verdict.explanation}
    assert set(found) == {"joint_coulomb_friction", "rotor_inertia"}
    assert found["joint_coulomb_friction"]["torque"].value == pytest.approx(0.1839, rel=0.1)
    assert verdict.kind == "unexplained"
    # in these two stretches of `energy`
    shaking = [item for item in verdict.mismatch.standing if item.recording is not None and "energy" in item.recording]
    assert any(start < 4.0 and stop > 5.0 for item in shaking for start, stop in item.intervals)
    assert any("average out" in note for note in verdict.notes)
    assert verdict.held_out is not None
    given, corrected = verdict.held_out.nominal_as_given, verdict.held_out.corrected
    assert corrected.nll < given.nll
    assert corrected.rmse["q.shoulder"] < 0.25 * given.rmse["q.shoulder"]


@pytest.mark.long
def test_simple_pendulum_lacks_friction_though_one_recording_is_slow(data_folder: Path) -> None:
    """At 50 Hz the windows of `ilqr` are twice as wide; its law cannot be told, which is friction all the same."""
    verdict = _diagnosed(data_folder / "data" / "simple_pendulum", {"energy"})
    assert verdict.kind == "unexplained"
    assert {(item.effect.name in FRICTION, item.effect.at) for item in verdict.explanation} == {(True, "shoulder")}
    assert verdict.train.corrected.nll < verdict.train.nominal_as_given.nll


@pytest.mark.long
def test_simple_pendulum_is_not_made_worse_by_what_cannot_be_explained(data_folder: Path) -> None:
    """Where nothing is named its mass, fitted without the missing physics, compensates for it."""
    verdict = _diagnosed(data_folder / "data" / "simple_pendulum", {"energy"}, settings=Settings(most_effects=0))
    assert verdict.kind == "unexplained" and not verdict.explanation
    assert verdict.held_out is not None
    assert verdict.held_out.nominal.rmse["q.shoulder"] > verdict.held_out.nominal_as_given.rmse["q.shoulder"]
    for comparison in (verdict.train, verdict.held_out):
        assert comparison.corrected == comparison.nominal_as_given
    (mass,) = verdict.corrected.scenario.unknown
    assert mass.mean == 0.676
    assert "The corrected scene is the one given" in str(verdict)
