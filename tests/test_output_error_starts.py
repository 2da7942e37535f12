"""Where searches by simulations begin: limits that no effort reached, free recordings, and friction by the load."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.errors import OutputErrors
from drake_cafim.diagnosis.output_error.problem import MOST_STEPS, REFIT_STEPS, OutputErrorProblem
from drake_cafim.diagnosis.output_error.search import LIMIT as LIMIT_NUMBER
from drake_cafim.diagnosis.output_error.search import Search
from drake_cafim.diagnosis.output_error.shapes import STICKING, _other_shapes
from drake_cafim.diagnosis.output_error.starts import StartsByKind, effort_rms, largest_asked
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.friction import JointLoadDependentFriction, JointStribeckFriction
from drake_cafim.effects.joint import (
    SLIP_VELOCITY,
    JointAsymmetricCoulombFriction,
    JointCoulombFriction,
    JointViscousFriction,
)
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

KP, KV, LIMIT, FRICTION, INERTIA, WEIGHT = 12.0, 0.8, 1.2, 0.3, 0.03, 1.0
"""N m/rad, N m s/rad, N m, N m, kg m² and N m of a pendulum."""
PERIOD, PARTS, SAMPLES = 0.01, 20, 400


@pytest.mark.parametrize("mean", [0.5 * LIMIT, 8.0 * LIMIT])
def test_a_limit_is_found_from_below_and_from_where_no_effort_reaches_it(tmp_path: Path, mean: float) -> None:
    prepared = _prepared(tmp_path, mean, [_recorded(seed, friction=0.0) for seed in (1, 2)])
    problem = OutputErrorProblem(prepared.scene, OutputErrors(tuple(prepared.weak), ("pan",)))
    given = Model(prepared.scene.priors.mean)
    asked = largest_asked(prepared.weak, given.physics(prepared.scene), 0)
    assert asked > effort_rms(prepared.weak, given.physics(prepared.scene), 0)
    if mean > LIMIT:
        # without a slope it stays where it is
        assert problem.fit(given).model.unknown[2] == pytest.approx(mean) and asked < mean
    kp, kv, limit = Search(problem, Trace())._fit_unknowns().model.unknown
    assert (kp, kv, limit) == pytest.approx((KP, KV, LIMIT), rel=0.05)


def test_each_joint_takes_the_better_of_the_two_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers are kp and the limit of a first joint, then kp of a second one without a limit and a third one's two."""
    numbers: list[dict[str, int]] = [
        {".servo_stiffness": 0, LIMIT_NUMBER: 1},
        {".servo_stiffness": 2},
        {".servo_stiffness": 3, LIMIT_NUMBER: 4},
    ]
    fitted: list[tuple[list[float], int]] = []
    costs = [[5.0, 5.0, 5.0], [3.0, 6.0, 7.0], [2.0, 4.0, 4.0], [1.0, 1.0, 1.0]]

    def fit(model: Model, steps: int = MOST_STEPS) -> Any:
        fitted.append((model.unknown.tolist(), steps))
        moved = model.unknown + (0.1 if len(fitted) == 2 else 0.0)
        return SimpleNamespace(model=Model(moved), costs=np.array(costs[len(fitted) - 1]))

    tree = SimpleNamespace(joint_index=lambda joint: "abc".index(joint))
    scene = SimpleNamespace(priors=SimpleNamespace(mean=np.array([1.0, 9.0, 1.0, 1.0, 9.0])), tree=tree)
    search = object.__new__(Search)
    search.problem = SimpleNamespace(  # type: ignore[assignment]
        joints=("a", "b", "c"), scene=scene, fit=fit, numbers=lambda model: numbers, errors=SimpleNamespace(forms=())
    )
    monkeypatch.setattr("drake_cafim.diagnosis.output_error.search.largest_asked", lambda forms, physics, joint: 4.0)
    monkeypatch.setattr(Model, "physics", lambda model, scene: None)
    found = search._fit_unknowns()
    assert fitted[1] == ([1.0, 2.0, 1.0, 1.0, 2.0], MOST_STEPS)
    # the first joint's numbers alone are those of the second fit
    assert fitted[2] == ([1.1, 2.1, 1.0, 1.0, 9.0], REFIT_STEPS)
    assert found.costs.tolist() == costs[2]
    # where the limits are reached from the beginning, one fit is enough
    scene.priors.mean = np.array([1.0, 1.5, 1.0, 1.0, 2.0])
    search._fit_unknowns()
    assert len(fitted) == 4


def test_recordings_without_commands_are_simulated_beside_those_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A free swing tells friction apart from what the servo damps; without a servo anywhere nothing is simulated."""
    runs = [_recorded(1), _recorded(2, driven=False)]
    monkeypatch.setattr(Search, "run", lambda search, most_effects: search.problem.errors)

    def simulated(own: list[Recording]) -> Any:
        return _prepared(tmp_path, LIMIT, own).search_by_simulation(0, lambda text: None, Trace())

    errors = simulated(runs)
    assert [form.samples.recording.name for form in errors.forms] == ["pan 1", "pan 2"]
    physics = _prepared(tmp_path, LIMIT, runs).scene.physics
    missed, free = errors.of(physics)[:, 0], errors.block >= 4
    # a model without friction swings on
    assert len(missed) == len(free) and np.max(np.abs(missed[free])) > 0.1
    assert simulated(runs[1:]) is None


@pytest.mark.parametrize("width", [SLIP_VELOCITY.grid[0], STICKING, 0.7 * SLIP_VELOCITY.grid[1]])
def test_laws_of_friction_are_tried_with_the_width_that_acts(tmp_path: Path, width: float) -> None:
    """That of a joint that sticks lies off the grid: no law could take the place of its friction, Coulomb's neither."""
    prepared = _prepared(tmp_path, LIMIT, [_recorded(1)])
    present = JointAsymmetricCoulombFriction(
        "pan", {"torque_positive": 0.3, "torque_negative": 0.3, "slip_velocity": width}
    )
    starts = StartsByKind(prepared.scene, prepared.weak, Model(prepared.scene.priors.mean, (present,)))
    for law in (JointCoulombFriction("pan"), JointStribeckFriction("pan"), JointLoadDependentFriction("pan")):
        found = list(starts(law))
        assert found and all(part.values["slip_velocity"] == width for start in found for part in start.parts)
        tried = [start.law(np.ones(len(start.sizes))) for start in found]
        assert all(it is not None and it.values["slip_velocity"] == width for it in tried)
    # a law without a width keeps its shape
    assert all("slip_velocity" not in part.values for s in starts(JointViscousFriction("pan")) for part in s.parts)


def test_friction_by_the_outside_load_alone_acts() -> None:
    by_load = JointLoadDependentFriction("pan", {"torque": 0.0, "coefficient": 0.0, "external": 0.2})
    assert not by_load.is_absent
    assert JointLoadDependentFriction("pan", {"torque": 0.0, "coefficient": 0.0}).is_absent


def test_friction_by_load_is_tried_as_that_of_the_load_from_outside() -> None:
    """In sum as large; a law without it stays one where no servo drives."""
    law = JointLoadDependentFriction("pan", {"torque": 0.1, "coefficient": 0.4})
    assert all(other.external == 0.0 for other in law.restarts())
    tried = [other for other in _other_shapes(law) if isinstance(other, JointLoadDependentFriction)]
    shared = [other for other in tried if other.external > 0.0]
    assert [other.external for other in shared] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert all(other.values["coefficient"] + other.external == pytest.approx(0.4) for other in shared)
    assert all(other.values["torque"] == 0.1 for other in shared)
    coulomb = JointCoulombFriction("pan", {"torque": 0.1})
    assert [*coulomb.restarts_under_servo()] == [*coulomb.restarts()]


def _prepared(folder: Path, limit: float, runs: list[Recording]) -> Prepared:
    (folder / "pan.urdf").write_text(
        '<robot name="pan"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.2"/>'
        f'<mass value="{WEIGHT / 9.81 / 0.2}"/><inertia ixx="{INERTIA - WEIGHT / 9.81 * 0.2}" '
        f'iyy="{INERTIA - WEIGHT / 9.81 * 0.2}" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="pan" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>'
        "</robot>"
    )
    (folder / "pan.yaml").write_text(
        "model: pan.urdf\nweld: [{body: base}]\nchannels: {q: {std: 3.0e-4}, v: {std: 1.0e-2}, u: {std: 0.0}}\n"
        f"servo: {{kp: 8.0, kv: 1.2, limit: {limit}}}\n"
        "unknown:\n- {parameter: servo_stiffness, joint: pan, std: 4.0}\n"
        "- {parameter: servo_damping, joint: pan, std: 0.6}\n"
        f"- {{parameter: servo_limit, joint: pan, std: {limit}}}\n"
    )
    found = prepare(Scene.load(folder / "pan.yaml"), runs)
    assert isinstance(found, Prepared)
    return found


def _recorded(seed: int, friction: float = FRICTION, driven: bool = True) -> Recording:
    """A pendulum that hangs, under commands that its servo cannot follow, or swinging freely."""
    random = np.random.default_rng(seed)
    time, h = PERIOD * np.arange(SAMPLES), PERIOD / PARTS
    rates, phases = 2.0 * np.pi * random.uniform(0.2, 1.0, 4), random.uniform(0.0, 6.0, 4)
    command = 0.35 * np.sum(np.sin(rates * time[:, None] + phases), axis=1)
    q, v, read = (float(command[0]), 0.0, []) if driven else (1.2, 0.0, [])
    for goal in command:
        read.append((q, v))
        for _ in range(PARTS):
            asked = float(np.clip(KP * (goal - q), -LIMIT, LIMIT)) if driven else 0.0
            resisting = INERTIA + h * (KV if driven else 0.0)
            pushed = (INERTIA * v + h * (asked - WEIGHT * np.sin(q))) / resisting
            v = float(np.sign(pushed) * max(abs(pushed) - h * friction / resisting, 0.0))
            q += h * v
    positions, velocities = np.array(read).T
    columns = {
        "q.pan": positions + 3e-4 * random.normal(size=SAMPLES),
        "v.pan": velocities + 1e-2 * random.normal(size=SAMPLES),
        **({"cmd.pan": command} if driven else {"u.pan": np.zeros(SAMPLES)}),
    }
    return Recording(f"pan {seed}", time, columns)
