"""The packaged arm of seven joints with a load beyond its flange, recorded in MuJoCo under a computed-torque servo."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import drake_cafim.models
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.schema import parse
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

ARM = Path(drake_cafim.models.__file__).parent / "arm7.urdf"
LAST, FLANGE = "link7", 0.107
"""The last link, and where on its z axis the flange is, m."""
JOINTS = [f"joint{j}" for j in range(1, 8)]
STEP, PARTS = 0.004, 4
"""s between samples, and MuJoCo's steps in one."""
NOISE = {"q": 2.0e-4, "v": 2.0e-3, "u": 0.0}
MIDDLE = np.array([0.0, -0.4, 0.0, -1.8, 0.0, 1.6, 0.5])
STIFFNESS = np.array([600.0, 600.0, 400.0, 400.0, 150.0, 150.0, 80.0])
DAMPING = np.array([40.0, 40.0, 30.0, 30.0, 12.0, 12.0, 8.0])


def beyond_flange(distance: float) -> list[float]:
    """A point, in the last link's frame, at this distance from the flange, ahead of it and to one side."""
    return [0.6 * distance, 0.0, FLANGE + 0.8 * distance]


def loaded(place: Sequence[float], mass: float) -> Any:
    """MuJoCo's model of the arm with a point mass (kg) at a `place` of its last link."""
    text = re.sub(r"(?s)<(visual|collision|transmission)\b.*?</\1>", "", ARM.read_text())
    spec = mujoco.MjSpec.from_string(
        re.sub(r'(?s)<joint name="flange_mount".*?</joint>|<link name="flange"/>', "", text)
    )
    if mass > 0.0:
        load = spec.body(LAST).add_body(name="load", pos=place)
        load.mass, load.ipos, load.inertia, load.explicitinertial = mass, [0.0, 0.0, 0.0], [1e-9, 1e-9, 1e-9], True
    model = spec.compile()
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, STEP / PARTS
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_armature[:] = [float(value) for value in re.findall(r'rotor_inertia value="([^"]+)"', ARM.read_text())]
    return model


def recording(place: Sequence[float], mass: float, seed: int, duration: float = 4.0) -> Recording:
    """The loaded arm about its middle position, under three sines a joint; efforts are held from sample to sample."""
    model, rng = loaded(place, mass), np.random.default_rng(seed)
    data = mujoco.MjData(model)
    time = STEP * np.arange(round(duration / STEP))
    rate = 2.0 * np.pi * np.array([[0.3], [0.7], [1.3]]) * rng.uniform(0.8, 1.2, (3, 7))
    size = np.array([[0.25], [0.12], [0.04]]) * rng.uniform(0.7, 1.3, (3, 7))
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, 7))
    rows: dict[str, Array] = {kind: np.zeros((len(time), 7)) for kind in NOISE}
    for k, t in enumerate(time):
        q = MIDDLE + np.sum(size * np.sin(rate * t + phase), axis=0)
        v = np.sum(size * rate * np.cos(rate * t + phase), axis=0)
        if k == 0:
            data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        rows["q"][k], rows["v"][k] = data.qpos, data.qvel
        rows["u"][k] = STIFFNESS * (q - data.qpos) + DAMPING * (v - data.qvel) + data.qfrc_bias
        data.qfrc_applied[:] = rows["u"][k]
        mujoco.mj_step(model, data, PARTS)
    read = {kind: rows[kind] + std * rng.standard_normal(rows[kind].shape) for kind, std in NOISE.items()}
    columns = {f"{kind}.{joint}": read[kind][:, j] for kind in NOISE for j, joint in enumerate(JOINTS)}
    return Recording("loaded", time, columns)


def scene(unknown: Sequence[dict[str, Any]]) -> Scene:
    """The arm as its maker describes it, with these entries of `unknown:`."""
    raw = {
        "model": ARM.name,
        "weld": [{"body": "link0"}],
        "channels": {kind: {"std": std} for kind, std in NOISE.items()},
        "unknown": list(unknown),
    }
    return Scene.build(parse(raw, "arm.yaml"), ARM.parent, "arm.yaml")


def payload(mass: float = 1.0, place: float = 0.2) -> list[dict[str, Any]]:
    """Entries of `unknown:`: a payload on the last link of which nothing but these stds (kg, m) is known."""
    load = {"effect": "payload", "at": LAST}
    return [load | {"parameter": "mass", "std": mass}, *(load | {"parameter": axis, "std": place} for axis in "xyz")]


def link(mass: float = 1.0, place: float = 0.1) -> list[dict[str, Any]]:
    """Entries of `unknown:`: the last link's own mass and centre of mass, with these stds (kg, m)."""
    com = [{"body": LAST, "parameter": f"com_{axis}", "std": place} for axis in "xyz"]
    return [{"body": LAST, "parameter": "mass", "std": mass}, *com]
