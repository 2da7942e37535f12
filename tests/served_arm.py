"""An arm of two joints in MuJoCo, driven by position actuators or by torques, and its recordings."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from drake_cafim.recordings.recording import Recording

STEP, PERIOD = 2.5e-5, 0.008
"""s, of MuJoCo and of the recording. A step h adds kv h/2 to a joint's inertia: χ² is 2.9 a row at .25 ms, 1.1 here."""
FRICTION_SETTLES = 2e-4
"""s, in which MuJoCo's soft friction brings a joint to rest; its default of 20 ms is a creep of .04 rad/s."""
QUANTUM = 2.0 * np.pi / 4096
KP, KV, LIMIT = 30.0, 1.2, 12.0
ARM = """
<mujoco model="arm"><compiler angle="radian" autolimits="true"/>
<worldbody><body name="upper" pos="0 0 1">
<joint name="shoulder" type="hinge" axis="0 1 0" range="-3 3" armature="0.02"/>
<inertial pos="0 0 -0.15" mass="0.8" diaginertia="0.006 0.006 0.001"/>
<body name="lower" pos="0 0 -0.3"><joint name="elbow" type="hinge" axis="0 1 0" range="-3 3" armature="0.02"/>
<inertial pos="0 0 -0.12" mass="0.5" diaginertia="0.003 0.003 0.001"/></body></body></worldbody>
<actuator>{actuators}</actuator></mujoco>
"""
POSITION = f'<position joint="{{joint}}" kp="{KP}" kv="{KV}" forcerange="-{LIMIT} {LIMIT}"/>'
MOTOR = '<motor joint="{joint}"/>'


def written(folder: Path, **drives: str) -> Path:
    """The model's file, with the actuator of each joint."""
    path = folder / "arm.xml"
    path.write_text(ARM.format(actuators="".join(drive.format(joint=joint) for joint, drive in drives.items())))
    return path


def wave(seed: int, joint: int, time: float) -> float:
    """A sum of sines about 0.3 rad."""
    rng = np.random.default_rng([seed, joint])
    rates, phases = 2.0 * np.pi * rng.uniform(0.2, 1.1, 4), rng.uniform(0.0, 2.0 * np.pi, 4)
    return float(0.3 + 0.25 * np.sum(np.sin(rates * time + phases)))


def recorded(
    path: Path,
    seed: int,
    duration: float = 5.0,
    *,
    stiffer: float = 1.0,
    friction: Sequence[float] = (0.0, 0.0),
    off: bool = False,
) -> Recording:
    """A recording of commands, or torques, and of quantised positions.

    `stiffer` is a factor of the elbow's kp, `friction` N m that of the joints; `off`: no actuator acts at all, and the
    recorded torques are 0.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_frictionloss[:] = friction
    model.dof_solref[:, 0] = FRICTION_SETTLES
    served = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    if served[1]:
        model.actuator_gainprm[1, 0] *= stiffer
        model.actuator_biasprm[1, 1] *= stiffer
    data = mujoco.MjData(model)
    data.qpos[:] = [wave(seed, 0, 0.0), wave(seed, 1, 0.0)]
    rows = []
    for k in range(round(duration / PERIOD)):
        goal = np.array([wave(seed, j, k * PERIOD) for j in (0, 1)])
        # torques follow a soft feedback, as an effort-controlled joint's do
        torque = 12.0 * (goal - data.qpos) - 0.6 * data.qvel
        sent = np.where(served, goal, np.round(torque, 3))
        data.ctrl[:] = sent
        if off:
            data.ctrl[:] = 0.0
            model.actuator_gainprm[:, 0] = 0.0
            model.actuator_biasprm[:] = 0.0
        rows.append([*(QUANTUM * np.round(data.qpos / QUANTUM)), *(0.0 * sent if off else sent)])
        mujoco.mj_step(model, data, nstep=round(PERIOD / STEP))
    table = np.array(rows)
    names = ("shoulder", "elbow")
    columns = {f"q.{name}": table[:, j] for j, name in enumerate(names)}
    for j, name in enumerate(names):
        columns[f"u.{name}" if off or not served[j] else f"cmd.{name}"] = table[:, 2 + j]
    return Recording(f"seed {seed}", PERIOD * np.arange(len(rows)), columns)
