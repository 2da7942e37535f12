"""Dry friction under a position servo is not taken for a dead band of it, which holds a joint about as well."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.predict.innovations import innovations
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.rivals_by_place import compare_by_place
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

KP, DAMPING, INERTIA, FRICTION = 17.8, 0.6, 0.03, 0.3
"""N m/rad, N m s/rad, kg m² and N m: a hobby servo behind its gears."""
BAND = effect_named("servo_dead_band")("pan", {"width": FRICTION / KP})
PERIOD, COUNT = 0.02, 2.0 * np.pi / 4096
"""s and rad, of the table and of the encoder."""


def test_a_dead_band_gives_way_to_dry_friction(tmp_path: Path) -> None:
    growth = _growth(tmp_path)
    assert growth.settle(growth.best.model.with_effects([BAND]))
    _require_friction_alone(growth)


def test_a_dead_band_found_first_does_not_outlive_dry_friction_found_beside_it(tmp_path: Path) -> None:
    growth = _growth(tmp_path)
    friction = effect_named("joint_coulomb_friction")("pan", {"torque": 0.1})
    # beside a band that holds the joint, friction explains little
    growth.take(growth.best.model.with_effects([BAND, friction]))
    _require_friction_alone(growth)


@pytest.mark.parametrize("slip_velocity", [1e-2, 1e-3, 1e-4])
def test_friction_of_any_width_predicts_each_sample(tmp_path: Path, slip_velocity: float) -> None:
    prepared = prepare(_scene(tmp_path), [_recorded(1)])
    physics = prepared.scene.physics
    friction = effect_named("joint_coulomb_friction")("pan", {"torque": FRICTION, "slip_velocity": slip_velocity})
    [without] = innovations(prepared.weak, physics)
    [found] = innovations(prepared.weak, physics.with_effects([friction]))
    assert found.lost is None and np.all(found.negative_log_likelihood < 10.0)
    assert found.mean < without.mean - 10.0


def _require_friction_alone(growth: GrowthByPlace) -> None:
    compare_by_place(growth)
    (found,) = growth.best.model.effects
    assert found.name == "joint_coulomb_friction"
    assert found.values["torque"] == pytest.approx(FRICTION, rel=0.01)


def _growth(tmp_path: Path) -> GrowthByPlace:
    problem = prepare(_scene(tmp_path), [_recorded(seed) for seed in (1, 2)]).problem()
    assert isinstance(problem, WeakProblem)
    growth = GrowthByPlace.of(problem, problem.nominal(), 100, Settings(), lambda text: None)
    assert growth is not None
    return growth


def _scene(tmp_path: Path) -> Scene:
    (tmp_path / "pan.urdf").write_text(
        '<robot name="pan"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/><mass value="0.5"/>'
        f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="pan" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        f'<dynamics damping="{DAMPING}"/></joint></robot>'
    )
    (tmp_path / "pan.yaml").write_text(f"model: pan.urdf\nweld: [{{body: base}}]\nservo: {{kp: {KP}, kv: 0.0}}\n")
    return Scene.load(tmp_path / "pan.yaml")


def _recorded(seed: int, samples: int = 600, parts: int = 400) -> Recording:
    """Commands and positions; while the joint stands, it is held by whatever force that takes, up to the friction."""
    random = np.random.default_rng(seed)
    time = PERIOD * np.arange(samples)
    rates, phases = 2.0 * np.pi * random.uniform(0.1, 1.2, 4), random.uniform(0.0, 6.0, 4)
    command = 0.1 * np.sum(np.sin(rates * time[:, None] + phases), axis=1)
    h, q, v, read = PERIOD / parts, float(command[0]), 0.0, []
    for goal in command:
        read.append(q)
        for _ in range(parts):
            pushed = v + h / INERTIA * (KP * (goal - q) - DAMPING * v)
            v = float(np.sign(pushed)) * max(abs(pushed) - h / INERTIA * FRICTION, 0.0)
            q += h * v
    positions = np.round((np.array(read) + 1e-4 * random.normal(size=samples)) / COUNT) * COUNT
    return Recording(f"pan_{seed}", time, {"q.pan": positions, "cmd.pan": command})
