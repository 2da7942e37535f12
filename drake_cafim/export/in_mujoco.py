"""The exported MJCF in MuJoCo, under the same efforts."""

from pathlib import Path
from typing import Any

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.export.parity import DURATION, STEP, Motion
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

FINE = 1e-4
"""s, step of the integration."""
HEAVY = 1e9
"""kg m² (kg), rotor inertia of joints that the scenario locks."""


def in_mujoco(file: Path, original: Path, scene: Scene, moved: Motion) -> Array:
    """(N, n) positions every `STEP` s: no contact, limit or coupling acts, as in the scene's equations of motion.

    Motors get the controls that would give the efforts in the `original` file, all other joints the efforts themselves.
    Gravity is the scenario's unless the file was given another one. Raises `InputError` where MuJoCo is not installed,
    cannot read the file, or lacks a joint of the scene.
    """
    try:
        import mujoco
    except ImportError:
        raise InputError("MuJoCo is not installed, expected `pip install mujoco` for this check") from None
    model, before = (_loaded(mujoco, path) for path in (file, original))
    joints = {model.joint(k).name: model.joint(k) for k in range(model.njnt)}
    lacking = [name for name in scene.tree.joint_names if name not in joints]
    if lacking or any(int(joints[name].type[0]) == int(mujoco.mjtJoint.mjJNT_FREE) for name in joints):
        raise InputError(f"joints without a name ({', '.join(lacking)}) or a floating base cannot be set")
    for flag in ("CONTACT", "LIMIT", "EQUALITY", "CLAMPCTRL"):
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, FINE
    model.opt.density = model.opt.viscosity = 0.0
    model.body_gravcomp[:] = 0.0
    if np.array_equal(model.opt.gravity, before.opt.gravity):
        model.opt.gravity[:] = scene.scenario.gravity
    motors = _motors(mujoco, before)
    others = [k for k in range(model.nu) if k not in motors.values()]
    model.actuator_gainprm[others], model.actuator_biasprm[others] = 0.0, 0.0
    locked = [name for name in joints if name not in scene.tree.joint_names]
    for name in locked:
        model.dof_armature[joints[name].dofadr[0]] = HEAVY
    data = mujoco.MjData(model)
    held = scene.scenario.lock if isinstance(scene.scenario.lock, dict) else {}
    for name in locked:
        data.qpos[joints[name].qposadr[0]] = held.get(name, 0.0)
    q = np.array([joints[name].qposadr[0] for name in scene.tree.joint_names])
    v = np.array([joints[name].dofadr[0] for name in scene.tree.joint_names])
    data.qpos[q], data.qvel[v] = moved.q, moved.v
    found = []
    for k in range(round(DURATION / FINE) + 1):
        if k % round(STEP / FINE) == 0:
            found.append(data.qpos[q].copy())
        effort = moved.u[max(int(np.searchsorted(moved.time, k * FINE + 1e-9)) - 1, 0)]
        for j, name in enumerate(scene.tree.joint_names):
            if name in motors:
                own = motors[name]
                data.ctrl[own] = effort[j] / (before.actuator_gear[own, 0] * before.actuator_gainprm[own, 0])
            else:
                data.qfrc_applied[v[j]] = effort[j]
        mujoco.mj_step(model, data)
    return np.array(found)


def _loaded(mujoco: Any, path: Path) -> Any:
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"MuJoCo cannot read {path.name} ({' '.join(str(error).split())[:200]})") from None


def _motors(mujoco: Any, model: Any) -> dict[str, int]:
    """By joint, the one actuator that drives it, where its force is proportional to its control."""
    driving: dict[str, list[int]] = {}
    for k in range(model.nu):
        if int(model.actuator_trntype[k]) == int(mujoco.mjtTrn.mjTRN_JOINT):
            driving.setdefault(model.joint(int(model.actuator_trnid[k, 0])).name, []).append(k)
    plain = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtDyn.mjDYN_NONE))

    def is_motor(k: int) -> bool:
        kinds = (model.actuator_gaintype[k], model.actuator_biastype[k], model.actuator_dyntype[k])
        return tuple(map(int, kinds)) == plain and model.actuator_gear[k, 0] * model.actuator_gainprm[k, 0] != 0.0

    return {joint: own[0] for joint, own in driving.items() if len(own) == 1 and is_motor(own[0])}
