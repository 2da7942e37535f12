"""Efforts in another unit, as a motor's current, are told as that, and neither as gravity taken out nor as physics."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.data_mistakes import correct
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.noise.stated import noise_of
from drake_cafim.diagnosis.notes import data_mistakes as mistakes
from drake_cafim.diagnosis.notes.effort_units import ROTOR, EffortFactors, cost_beside_physics, effort_factors
from drake_cafim.diagnosis.notes.first_order import COMMON, fit_to_first_order
from drake_cafim.diagnosis.notes.suspicions import in_another_unit
from drake_cafim.diagnosis.thresholds import UNKNOWN_FAR_IN_PRIOR_STDS
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests import two_links
from tests.concealed.make import simulate
from tests.test_data_mistakes import _swung, _told, _with


def _drawn(run: Recording, shoulder: float, elbow: float) -> Recording:
    """With currents of motors of these constants, N m/A, in place of efforts."""
    return _with(run, {"u.shoulder": run["u.shoulder"] / shoulder, "u.elbow": run["u.elbow"] / elbow})


@pytest.mark.parametrize("friction", [(0.0, 0.0), (1.5, 0.5)])
@pytest.mark.parametrize("constants", [(12.0, 9.0), (6.0, 15.0)])
def test_currents_in_place_of_efforts_are_told_as_another_unit(
    constants: tuple[float, float], friction: tuple[float, float], tmp_path: Path
) -> None:
    """They look like efforts without gravity: those of the motion alone are small, too."""
    scene = two_links.scene(tmp_path)
    runs = [_drawn(two_links.recording(f"run_{k}.parquet", k, friction=friction), *constants) for k in (1, 2)]
    [told] = _told(scene, runs)
    words, _, numbers = told.partition("multiplied by about ")
    assert words == (
        "u.shoulder and u.elbow of run_1.parquet and run_2.parquet have values in another unit, expected N m (N): "
    )
    times, _, rest = numbers.partition(" they")
    assert [float(it) for it in times.split(" and ")] == pytest.approx(constants, rel=0.05)
    assert rest == " agree with the model, unless its masses are wrong by as much"


def test_motors_that_are_all_weak_are_physics(tmp_path: Path) -> None:
    """By no more than a gain may be. They may look like efforts without gravity."""
    simulate("null", "arm2", 8).write(tmp_path)
    scene, run = Scene.load(tmp_path / "scenario.yaml"), recordings.read(tmp_path / "train_1.parquet")
    efforts = [f"u.{name}" for name in scene.tree.joint_names]
    weak, faint = (_with(run, {name: run[name] / constant for name in efforts}) for constant in (4.0, 8.0))
    [looks] = correct("", mistakes._Excerpts.of(scene, [weak], noise_of(scene, [weak])[0])).mistakes
    assert looks.predicate == "have gravity already taken out"
    assert _told(scene, [weak]) == ()
    [told] = _told(scene, [faint])
    assert "another unit" in told


def test_lighter_links_may_explain_weak_motors_and_efforts_without_gravity_alike(tmp_path: Path) -> None:
    """Where all inertials are unknown none of the three is certain."""
    scene = two_links.scene(tmp_path, unknown="unknown: [{parameter: inertials, body: all, std: 0.2}]")
    slow = [_swung(scene, name, np.array([0.3, -0.4]), 0.7, np.array([2.0, 3.0])) for name in ("slow", "again")]
    weak = [_drawn(run, 4.0, 4.0) for run in slow]
    [looks] = correct("slow", mistakes._Excerpts.of(scene, weak[:1], noise_of(scene, weak)[0])).mistakes
    assert looks.like_physics and _told(scene, weak) == ()


@pytest.mark.parametrize(
    ("constants", "units"),
    [
        ((1.0, 1.0), None),
        ((12.0, 1.0), None),
        ((12.0, 0.1), None),
        ((4.0, 3.0), False),
        ((12.0, 4.0), False),
        ((12.0, 6.0), True),
        ((0.1, 0.15), True),
    ],
)
def test_factors_of_efforts_are_of_all_joints_that_show_them(
    constants: tuple[float, float], units: bool | None, tmp_path: Path
) -> None:
    """Strong and weak motors beside each other are no unit, nor are efforts of which friction is a part."""
    scene = two_links.scene(tmp_path)
    run = _drawn(two_links.recording("run_1.parquet", 1, friction=(1.5, 0.5)), *constants)
    excerpts = mistakes._Excerpts.of(scene, [run], noise_of(scene, [run])[0])

    def scaled(by: Mapping[str, float]) -> WeakProblem:
        parts = [part.weak.samples.recording for part in excerpts.problem.runs]
        return excerpts._correct([in_another_unit(part, by) for part in parts]).problem

    plain = cost_beside_physics(excerpts.problem)
    factors = effort_factors(excerpts.problem, scaled, plain, plain)
    if units is None:
        assert factors is None
    else:
        assert factors is not None and factors.are_units is units
        assert [*factors.by_joint.values()] == pytest.approx(constants, rel=0.1)
        # physics, or another mistake, that leaves as little
        assert effort_factors(excerpts.problem, scaled, 1.0, plain) is None
        assert effort_factors(excerpts.problem, scaled, plain, 1e-3) is None


def test_a_joint_alone_of_several_tells_no_unit() -> None:
    far = {"shoulder": 12.0, "elbow": 12.0}
    assert EffortFactors(far, ("shoulder", "elbow")).are_units and not EffortFactors(far, ("shoulder",)).are_units
    assert EffortFactors({"hinge": 12.0}, ("hinge",)).are_units and not EffortFactors({"hinge": 12.0}, ()).are_units
    assert not EffortFactors({"hinge": 4.0}, ("hinge",)).are_units


def test_a_fit_to_first_order_keeps_to_bounds_and_near_to_priors_where_that_is_asked(tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path)
    run = _drawn(two_links.recording("run_1.parquet", 1), 12.0, 12.0)
    problem = mistakes._Excerpts.of(scene, [run], noise_of(scene, [run])[0]).problem
    near, free = (fit_to_first_order([problem], (*COMMON, ROTOR), bounded=bounded) for bounded in (True, False))
    assert abs(near.change[0]) <= UNKNOWN_FAR_IN_PRIOR_STDS * scene.priors.std[0] * (1.0 + 1e-9) < abs(free.change[0])
    assert all(rotor >= 0.0 for rotor, _ in near.of(ROTOR).values()) and min(free.of(ROTOR).values())[0] < 0.0
    assert free.left[0] < near.left[0]
