"""The efforts that a motion takes: here, and by the libraries that others trust."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

DRY = "joint_coulomb_friction"
"""A constraint elsewhere, a smoothed sign here: compared by its torque."""


def efforts_here(scene: Scene, q: Array, v: Array, a: Array) -> Array:
    """(N, n) N m of motions (N, n) against all that the file says acts, but dry friction."""
    physics = scene.physics
    M, bias = equations_of_motion(motion(scene.tree, q, v), physics.gravity)
    smooth = replace(physics, joint_forces=tuple(effect for effect in physics.joint_forces if effect.name != DRY))
    samples = [JointSamples(q[:, j], v[:, j], np.zeros(len(q))) for j in range(q.shape[1])]
    applied = smooth.applied_at_joints(samples)[0]
    return np.asarray(np.einsum("nij,nj->ni", M + np.diag(physics.rotor_inertias), a) + bias - applied)


def frictions_here(scene: Scene) -> dict[str, float]:
    """N m of dry friction in each joint."""
    found = dict.fromkeys(scene.tree.joint_names, 0.0)
    for effect in scene.physics.joint_forces:
        if effect.name == DRY:
            found[effect.at] += effect.values["torque"]
    return found


def efforts_by_mujoco(scene: Scene, path: Path, q: Array, v: Array, a: Array) -> tuple[Array, dict[str, float]]:
    """The same by MuJoCo from the file itself, without contacts, limits and what flows; and its dry frictions."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_EQUALITY)
    model.opt.disableflags &= ~int(off.mjDSBL_GRAVITY)
    model.opt.gravity, model.opt.density, model.opt.viscosity = scene.scenario.gravity, 0.0, 0.0
    names = [model.joint(k).name for k in range(model.njnt)]
    # a joint without a name is known here by its place
    order = [names.index(name) if name in names else k for k, name in enumerate(scene.tree.joint_names)]
    place, degree = model.jnt_qposadr[order], model.jnt_dofadr[order]
    friction = dict(zip(scene.tree.joint_names, model.dof_frictionloss[degree].tolist(), strict=True))
    model.dof_frictionloss[:] = 0.0
    data, found = mujoco.MjData(model), []
    for k in range(len(q)):
        data.qpos[place], data.qvel[degree], data.qacc[degree] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse[degree].copy())
    return np.array(found), friction


def efforts_by_pinocchio(scene: Scene, path: Path, q: Array, v: Array, a: Array) -> tuple[Array, dict[str, float]]:
    """The same by Pinocchio, its damping added; and its dry frictions."""
    import pinocchio

    whole = pinocchio.buildModelFromUrdf(str(path))
    assert isinstance(scene.scenario.lock, Mapping)
    held = {name: value for name, value in scene.scenario.lock.items() if whole.existJointName(name)}
    at = pinocchio.neutral(whole)
    for name, value in held.items():
        at[whole.joints[whole.getJointId(name)].idx_q] = value
    # names of frames that stand for several things trouble the reduction alone
    model = pinocchio.buildReducedModel(whole, [whole.getJointId(name) for name in held], at) if held else whole
    joints = [model.joints[model.getJointId(joint.name)] for joint in scene.tree.moving]
    order = [joint.idx_v for joint in joints]
    G, offset = scene.tree.following  # what moves a follower comes from its leader
    q, v, a = q @ G.T + offset, v @ G.T, a @ G.T
    data, found = model.createData(), []
    for k in range(len(q)):
        configuration, rates, accelerations = pinocchio.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for joint, value in zip(joints, q[k], strict=True):
            turned = (np.cos(value), np.sin(value)) if joint.nq == 2 else (value,)
            configuration[joint.idx_q : joint.idx_q + joint.nq] = turned
        rates[order], accelerations[order] = v[k], a[k]
        torque = pinocchio.rnea(model, data, configuration, rates, accelerations)
        found.append((torque + model.damping * rates)[order] @ G)
    friction = model.friction[order] @ np.abs(G)
    return np.array(found), dict(zip(scene.tree.joint_names, friction.tolist(), strict=True))
