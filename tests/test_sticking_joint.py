"""Joints that stick: dry friction that the model lacks is told by the simplest law that explains as much."""

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.nested_laws import simplify
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.joint import JointAsymmetricCoulombFriction
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests import two_links
from tests.turntable import write_turntable

SEED = 1
STEP, PARTS, FINE = 0.004, 16, 200
STD = (2e-4, 1e-2)
"""rad and rad/s."""
INERTIA, FRICTION = 0.05, 0.5
"""kg m² and N m, of the plate."""
TORQUES = (2.0, 0.6)
"""N m, of the arm's joints."""


def _wanted(rng: np.random.Generator, joints: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,), and positions, velocities and accelerations (N, n) that a controller is asked for."""
    time = np.arange(0.0, 6.0, STEP)
    rate = 2.0 * np.pi * np.array([0.3, 0.7])[:, None] * rng.uniform(0.8, 1.2, (2, joints))
    size, angle = np.array([[0.4], [0.15]]), rate * time[:, None, None] + rng.uniform(0.0, 6.0, (2, joints))
    moved = (size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle))
    q, v, a = (part.sum(axis=1) for part in moved)
    return time, q, v, a


def _plate(seed: int, static: float, speed: float) -> pd.DataFrame:
    """A plate under a controller that sees its noisy sensors and makes up for most of its Stribeck friction.

    By exact pieces: it rests at each turn until the effort has changed by enough.
    """
    rng = np.random.default_rng(seed)
    time, *wanted = _wanted(rng, 1)
    q_wanted, v_wanted, a_wanted = (part[:, 0] for part in wanted)
    noise = np.array(STD) * rng.normal(size=(len(time), 2))
    q, v, h, rows = q_wanted[0], v_wanted[0], STEP / FINE, []
    for k in range(len(time)):
        read = np.array([q, v]) + noise[k]
        a = a_wanted[k] + 64.0 * (q_wanted[k] - read[0]) + 12.8 * (v_wanted[k] - read[1])
        u = INERTIA * a + 0.8 * FRICTION * np.tanh(v_wanted[k] / 0.05)
        rows.append((*read, u))
        for _ in range(FINE):
            free = v + h * u / INERTIA
            friction = FRICTION + (static - FRICTION) * np.exp(-((v / speed) ** 2))
            slowed = free - np.sign(free) * min(abs(free), h * friction / INERTIA)
            q, v = q + 0.5 * h * (v + slowed), slowed
    read_q, read_v, effort = np.array(rows).T
    return pd.DataFrame({"time": time, "q.axis": read_q, "v.axis": read_v, "u.axis": effort})


def _arm(rng: np.random.Generator, name: str) -> Recording:
    """An arm in MuJoCo under a computed torque that sees noisy sensors: its joints stick for a tenth of the time."""
    robot, model = (mujoco.MjSpec.from_string(two_links.MODEL).compile() for _ in range(2))
    robot.opt.timestep, robot.opt.integrator = STEP / PARTS, mujoco.mjtIntegrator.mjINT_RK4
    robot.dof_frictionloss[:] = TORQUES
    robot.dof_solref[:], robot.dof_solimp[:, :2] = (2.0 * STEP / PARTS, 1.0), 0.999
    robot.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    time, q_wanted, v_wanted, a_wanted = _wanted(rng, 2)
    noise = np.array(STD)[:, None] * rng.standard_normal((len(time), 2, 2))
    data, asked, rows = mujoco.MjData(robot), mujoco.MjData(model), []
    data.qpos[:], data.qvel[:] = q_wanted[0], v_wanted[0]
    for k in range(len(time)):
        q, v = data.qpos + noise[k, 0], data.qvel + noise[k, 1]
        asked.qpos[:], asked.qvel[:] = q, v
        asked.qacc[:] = a_wanted[k] + 64.0 * (q_wanted[k] - q) + 12.8 * (v_wanted[k] - v)
        mujoco.mj_inverse(model, asked)
        data.qfrc_applied[:] = asked.qfrc_inverse + 0.8 * np.array(TORQUES) * np.tanh(v_wanted[k] / 0.05)
        rows.append(np.concatenate([q, v, data.qfrc_applied]))
        mujoco.mj_step(robot, data, nstep=PARTS)
    columns = [f"{channel}.{joint}" for channel in "qvu" for joint in two_links.JOINTS]
    return Recording(name, time, dict(zip(columns, np.array(rows).T, strict=True)))


def _recording(name: str, table: pd.DataFrame) -> Recording:
    return Recording(name, table["time"].to_numpy(), {key: table[key].to_numpy() for key in table if key != "time"})


def _diagnosed(folder: Path, *tables: pd.DataFrame) -> Verdict:
    write_turntable(folder, tables[0], STD, INERTIA)
    return diagnose(Scene.load(folder / "scenario.yaml"), [_recording(f"run {k}", it) for k, it in enumerate(tables)])


@pytest.mark.long
def test_joints_that_stick_lack_coulomb_friction(tmp_path: Path) -> None:
    """Friction that rises towards rest would fit better by what it leaves to chance there."""
    channels = f"channels: {{q: {{std: {STD[0]}}}, v: {{std: {STD[1]}}}, u: {{std: 0.0}}}}"
    scene, rng = two_links.scene(tmp_path, channels, unknown=""), np.random.default_rng(SEED)
    verdict = diagnose(scene, [_arm(rng, "first"), _arm(rng, "second")])
    assert verdict.kind == "explained"
    told = {(found.effect.name, found.effect.at): found.values["torque"] for found in verdict.explanation}
    assert set(told) == {("joint_coulomb_friction", joint) for joint in two_links.JOINTS}
    for (_, joint), torque in told.items():
        truth = TORQUES[two_links.JOINTS.index(joint)]
        assert torque.std is not None and abs(torque.value - truth) < 4.0 * torque.std < 0.01 * truth


@pytest.mark.long
def test_a_joint_that_sticks_with_more_than_it_slides_with_has_stribeck_friction(tmp_path: Path) -> None:
    verdict = _diagnosed(tmp_path, _plate(1, 0.8, 0.3), _plate(101, 0.8, 0.3))
    [found] = verdict.explanation
    assert found.effect.name == "joint_stribeck_friction"
    static = found.values["static"]
    assert static.std is not None and abs(static.value - 0.8) < 4.0 * static.std < 0.4


@pytest.mark.parametrize("backward", [FRICTION, 1.5 * FRICTION])
def test_a_larger_law_stands_only_where_it_explains_more(tmp_path: Path, backward: float) -> None:
    write_turntable(tmp_path, _plate(1, FRICTION, 1.0), STD, INERTIA)
    scene = Scene.load(tmp_path / "scenario.yaml")
    table = _plate(1, FRICTION, 1.0)
    # the same motion needs more effort where friction is larger
    table["u.axis"] += np.where(table["v.axis"] < 0.0, FRICTION - backward, 0.0)
    problem = prepare(scene, [_recording("run", table)]).problem()
    values = {"torque_positive": FRICTION, "torque_negative": backward, "slip_velocity": 0.005}
    model = problem.nominal().with_effects([JointAsymmetricCoulombFriction("axis", values)])
    problem = problem.rewhitened(model)
    _, simplest, descents = simplify(problem, unbiased_fit(problem, model), 1e-4, 0.01)
    [effect] = simplest.model.effects
    if backward == FRICTION:
        assert effect.name == "joint_coulomb_friction" and descents[0].law is effect
        assert descents[0].gain is not None and descents[0].luck is not None and descents[0].gain < descents[0].luck
    else:
        assert effect.name == "joint_asymmetric_coulomb_friction" and not descents
