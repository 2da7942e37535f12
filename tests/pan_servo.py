"""One joint under a position servo, as a table of commands and quantised positions at 50 Hz."""

from pathlib import Path

import numpy as np

from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

KP, DAMPING, INERTIA = 17.8, 0.6, 0.03
"""N m/rad, N m s/rad and kg m²: a hobby servo behind its gears."""
PERIOD, COUNT = 0.02, 2.0 * np.pi / 4096
"""s and rad, of the table and of the encoder."""


def pan_scene(tmp_path: Path) -> Scene:
    (tmp_path / "pan.urdf").write_text(
        '<robot name="pan"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/><mass value="0.5"/>'
        f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="pan" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        f'<dynamics damping="{DAMPING}"/></joint></robot>'
    )
    (tmp_path / "pan.yaml").write_text(f"model: pan.urdf\nweld: [{{body: base}}]\nservo: {{kp: {KP}, kv: 0.0}}\n")
    return Scene.load(tmp_path / "pan.yaml")


def pan_recorded(seed: int, friction: float = 0.0, late: int = 0, samples: int = 600, parts: int = 400) -> Recording:
    """Commands and positions; while the joint stands, it is held by whatever force that takes, up to the `friction`.

    Commands act `late` samples after they are recorded; friction is in N m.
    """
    random = np.random.default_rng(seed)
    time = PERIOD * np.arange(samples)
    rates, phases = 2.0 * np.pi * random.uniform(0.1, 1.2, 4), random.uniform(0.0, 6.0, 4)
    command = 0.1 * np.sum(np.sin(rates * time[:, None] + phases), axis=1)
    h, q, v, read = PERIOD / parts, float(command[0]), 0.0, []
    for goal in np.concatenate([np.full(late, command[0]), command[: samples - late]]):
        read.append(q)
        for _ in range(parts):
            pushed = v + h / INERTIA * (KP * (goal - q) - DAMPING * v)
            v = float(np.sign(pushed)) * max(abs(pushed) - h / INERTIA * friction, 0.0)
            q += h * v
    positions = np.round((np.array(read) + 1e-4 * random.normal(size=samples)) / COUNT) * COUNT
    return Recording(f"pan_{seed}", time, {"q.pan": positions, "cmd.pan": command})
