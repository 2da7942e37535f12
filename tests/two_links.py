"""A double pendulum whose two joints are driven: recordings of a few seconds, integrated far finer than sampled."""

from pathlib import Path

import numpy as np

from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MODEL = """<robot name="two_links">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.25"/><mass value="2.0"/>
    <inertia ixx="0.04" iyy="0.04" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.2"/><mass value="1.0"/>
    <inertia ixx="0.015" iyy="0.015" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-6" upper="6" effort="50" velocity="50"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.5"/>
    <axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="50" velocity="50"/></joint>
</robot>"""
CHANNELS = "channels: {q: {std: 2.0e-4}, v: {std: 2.0e-3}, u: {std: 0.0}}"
UNKNOWN = "unknown: [{parameter: mass, body: lower, mean: 1.0, std: 0.1}]"
LENGTH, COM_1, COM_2, MASS_1, MASS_2, INERTIA_1, INERTIA_2, GRAVITY = 0.5, 0.25, 0.2, 2.0, 1.0, 0.04, 0.015, 9.81
JOINTS = ("shoulder", "elbow")
STEP, PARTS = 0.004, 4


def scenario(folder: Path, channels: str = CHANNELS, unknown: str = UNKNOWN) -> Path:
    """The address of the arm's scenario, written into `folder`."""
    (folder / "two_links.urdf").write_text(MODEL)
    (folder / "scenario.yaml").write_text(f"model: two_links.urdf\nweld: [{{body: base}}]\n{channels}\n{unknown}\n")
    return folder / "scenario.yaml"


def scene(folder: Path, channels: str = CHANNELS, unknown: str = UNKNOWN) -> Scene:
    """The arm's scene, its files in `folder`."""
    return Scene.load(scenario(folder, channels, unknown))


def recording(
    name: str,
    seed: int,
    *,
    duration: float = 3.0,
    friction: tuple[float, float] = (0.0, 0.0),
    noise: tuple[float, float, float] = (2e-4, 2e-3, 0.0),
    ramped: bool = False,
    step: float = STEP,
    limit: float = np.inf,
    rotor: float = 0.0,
) -> Recording:
    """The arm under sums of sines as efforts, with Coulomb `friction` (N m) and `noise` of q, v and u (std).

    At the elbow a rotor's inertia `rotor` (kg m²) acts, as reflected through its gear.

    Efforts are held from their sample to the next or, `ramped`, go straight from one to the next. What acts of them is
    cut at ±`limit` N m.
    """
    rng = np.random.default_rng(seed)
    time = step * np.arange(round(duration / step))
    phase, rate = rng.uniform(0.0, 2.0 * np.pi, (2, 3)), np.array([0.5, 1.3, 2.9]) * rng.uniform(0.9, 1.1, 3)
    size = np.array([[4.0, 3.0, 2.0], [1.0, 0.8, 0.5]])
    u = np.stack([np.sin(2 * np.pi * np.outer(time, rate) + phase[j]) @ size[j] for j in range(2)], axis=1)
    state, states = np.zeros(4), np.zeros((len(time), 4))
    h = step / PARTS
    for k in range(len(time)):
        states[k] = state
        slope = (u[min(k + 1, len(u) - 1)] - u[k]) / step if ramped else np.zeros(2)
        for part in range(PARTS):
            asked = (u[k] + slope * h * (part + share) for share in (0.0, 0.5, 1.0))
            begin, middle, end = (np.clip(effort, -limit, limit) for effort in asked)
            first = _rate(state, begin, friction, rotor)
            second = _rate(state + 0.5 * h * first, middle, friction, rotor)
            third = _rate(state + 0.5 * h * second, middle, friction, rotor)
            fourth = _rate(state + h * third, end, friction, rotor)
            state = state + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    columns = {}
    for kind, values, std in zip("qvu", (states[:, :2], states[:, 2:], u), noise, strict=True):
        read = values + std * rng.standard_normal(values.shape)
        columns |= {f"{kind}.{joint}": read[:, j] for j, joint in enumerate(JOINTS)}
    return Recording(name, time, columns)


def _rate(state: Array, u: Array, friction: tuple[float, float], rotor: float) -> Array:
    """d/dt of (q, v) of a planar double pendulum (Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, §7.3)."""
    (q, p, v, w), g = state, GRAVITY
    inner, coupling = MASS_2 * LENGTH * COM_2, MASS_2 * COM_2**2 + INERTIA_2
    m11 = INERTIA_1 + MASS_1 * COM_1**2 + MASS_2 * LENGTH**2 + coupling + 2.0 * inner * np.cos(p)
    m12 = coupling + inner * np.cos(p)
    twist = inner * np.sin(p)
    outer = g * MASS_2 * COM_2 * np.sin(q + p)
    f1 = u[0] + twist * (2.0 * v * w + w**2) - g * (MASS_1 * COM_1 + MASS_2 * LENGTH) * np.sin(q) - outer
    f2 = u[1] - twist * v**2 - outer
    f1, f2 = f1 - friction[0] * np.tanh(v / 0.005), f2 - friction[1] * np.tanh(w / 0.005)
    m22 = coupling + rotor
    a = np.array([m22 * f1 - m12 * f2, m11 * f2 - m12 * f1]) / (m11 * m22 - m12**2)
    return np.array([v, w, *a])
