"""Joints that follow others: one column moves all of them, and what they do acts on the joint that they follow."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_cafim import diagnose
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.dynamics.motion import equations_of_motion, momentum_balance, motion
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

LINK = """<link name="{name}"><inertial><origin xyz="{x} 0.01 -0.1"/><mass value="{mass}"/>
  <inertia ixx="0.004" iyy="0.005" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
  <axis xyz="{axis}"/><limit lower="-2" upper="2" effort="50" velocity="9"/>{more}</joint>"""
JOINTS = (
    ("wrist", "revolute", "base", "hand", "0 0 0", "0 1 0", '<dynamics damping="0.05"/>'),
    ("finger", "prismatic", "hand", "left", "0.05 0 -0.1", "1 0 0", '<dynamics damping="2" friction="0.4"/>'),
    ("other_finger", "prismatic", "hand", "right", "-0.05 0 -0.1", "-1 0 0", '<dynamics damping="3" friction="0.6"/>'),
    ("nail", "revolute", "right", "tip", "0 0 -0.1", "0 1 0", '<dynamics damping="0.02"/>'),
)
MIMICS = {"other_finger": ("finger", 1.0, 0.01), "nail": ("other_finger", -4.0, 0.3)}
G, OFFSET = np.array([[1, 0], [0, 1], [0, 1], [0, -4]]), np.array([0, 0, 0.01, 0.3 - 4 * 0.01])
"""q of wrist, finger, other_finger and nail = G q of wrist and finger + OFFSET."""
STDS = {"q.wrist": 2e-4, "q.finger": 2e-5, "v.wrist": 2e-3, "v.finger": 2e-4}


def gripper(mimics: bool = True) -> str:
    links = "".join(
        LINK.format(name=name, mass=mass, x=x)
        for name, mass, x in (("hand", 1.0, 0.0), ("left", 0.4, 0.02), ("right", 0.5, -0.03), ("tip", 0.2, 0.0))
    )
    joints = ""
    for name, kind, parent, child, at, axis, more in JOINTS:
        if mimics and name in MIMICS:
            leader, multiplier, offset = MIMICS[name]
            more += f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>'
        joints += JOINT.format(name=name, kind=kind, parent=parent, child=child, at=at, axis=axis, more=more)
    return f'<robot name="gripper"><link name="base"/>{links}{joints}</robot>'


def scene_of(folder: Path, text: str, name: str = "gripper") -> Scene:
    (folder / f"{name}.urdf").write_text(text, encoding="utf-8")
    channels = ", ".join(f"{column}: {{std: {std}}}" for column, std in STDS.items())
    content = f"model: {name}.urdf\nweld: [{{body: base}}]\nchannels: {{{channels}, u: {{std: 0.0}}}}\n"
    (folder / f"{name}.yaml").write_text(content, encoding="utf-8")
    return Scene.load(folder / f"{name}.yaml")


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return scene_of(tmp_path, gripper())


@pytest.fixture
def free(tmp_path: Path) -> Scene:
    """The same links and joints, of which none follows another."""
    return scene_of(tmp_path, gripper(mimics=False), "free")


def equations(scene: Scene, q: Array, v: Array) -> tuple[Array, Array]:
    """M with rotors (N, n, n), and the force (N, n) for which v̇ = 0, with all laws of the model's joints."""
    M, bias = equations_of_motion(motion(scene.tree, q, v), scene.physics.gravity)
    samples = [JointSamples(q[:, j], v[:, j], np.zeros(len(q))) for j in range(q.shape[1])]
    return M + np.diag(scene.physics.rotor_inertias), bias - scene.physics.applied_at_joints(samples)[0]


def test_their_columns_are_not_needed_and_a_note_says_so(scene: Scene) -> None:
    assert scene.tree.joint_names == ("wrist", "finger")
    assert any("nail = -4 finger + 0.26" in note for note in scene.stated.notes)
    time = np.arange(0.0, 1.0, 0.01)
    columns = {f"{kind}.{name}": np.sin(time) for kind in "qvu" for name in ("wrist", "finger", "nail")}
    assert prepare(scene, [Recording("run.csv", time, columns)]).scene.tree.joint_names == ("wrist", "finger")


def test_what_they_move_acts_on_their_leader(scene: Scene, free: Scene) -> None:
    """M, bias, momentum and its force are Gᵀ those of the free joints along q = G q_leaders + o, frictions included."""
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(2, 5, 2))
    M, bias = equations(scene, q, v)
    M_free, bias_free = equations(free, q @ G.T + OFFSET, v @ G.T)
    np.testing.assert_allclose(M, G.T @ M_free @ G, rtol=1e-12)
    np.testing.assert_allclose(bias, bias_free @ G, rtol=1e-9, atol=1e-12)
    ours = momentum_balance(motion(scene.tree, q, v), scene.physics.gravity)
    theirs = momentum_balance(motion(free.tree, q @ G.T + OFFSET, v @ G.T), free.physics.gravity)
    np.testing.assert_allclose(ours.momentum, theirs.momentum @ G, rtol=1e-12)
    np.testing.assert_allclose(ours.force, theirs.force @ G, rtol=1e-12, atol=1e-12)


def test_a_force_on_what_follows_reaches_the_leader(scene: Scene) -> None:
    """The transposed Jacobian of a point of the tip, against finite differences of its place."""
    q, v, step = np.array([[0.3, 0.02]]), np.zeros((1, 2)), 1e-6
    body = scene.tree.body("tip")
    along = motion(scene.tree, q, v).force_at(body.joint, body.p_JB + np.array([0.02, 0.0, -0.1]))[0]
    for j, shift in enumerate(step * np.eye(2)):
        there, here = (
            motion(scene.tree, q + sign * shift, v).point(body.joint, body.p_JB + np.array([0.02, 0.0, -0.1]))[0][0]
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(along[j], (there - here) / (2.0 * step), atol=1e-8)


def slope(free: Scene, x: Array, effort: Array, drag: float = 0.0) -> Array:
    """ẋ of x = (q, v) of wrist and finger, with the free joints held together by d'Alembert's principle."""
    q, v = x[:2], x[2:]
    M, bias = equations(free, (G @ q + OFFSET)[None], (G @ v)[None])
    return np.concatenate([v, np.linalg.solve(G.T @ M[0] @ G, effort - bias[0] @ G - np.array([0.0, drag * v[1]]))])


def recorded(free: Scene, drag: float, seed: int, duration: float = 4.0) -> Recording:
    """A run with `drag` N s/m more on the finger than the model has."""
    rng, step, parts = np.random.default_rng(seed), 0.004, 8
    time = step * np.arange(round(duration / step))
    rate, phase = rng.uniform(3.0, 8.0, (2, 2, 3))[:, 0], rng.uniform(0.0, 6.0, (2, 3))
    shares = zip((0.8, 3.0), rate, phase, strict=True)
    asked = np.stack([size * np.sin(np.outer(time, r) + p).sum(axis=1) for size, r, p in shares], axis=1)

    x, rows, u = np.zeros(4), np.zeros((len(time), 4)), np.zeros((len(time), 2))
    h = step / parts
    for k in range(len(time)):
        rows[k], u[k] = x, asked[k] - np.array([4.0, 120.0]) * x[:2]
        for _ in range(parts):
            k1 = slope(free, x, u[k], drag)
            k2 = slope(free, x + 0.5 * h * k1, u[k], drag)
            k3 = slope(free, x + 0.5 * h * k2, u[k], drag)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(free, x + h * k3, u[k], drag))
    columns = {name: rows[:, j] + std * rng.standard_normal(len(time)) for j, (name, std) in enumerate(STDS.items())}
    return Recording(f"run_{seed}", time, columns | {"u.wrist": u[:, 0], "u.finger": u[:, 1]})


@pytest.mark.long
def test_a_gripper_is_diagnosed_by_one_column(scene: Scene, free: Scene) -> None:
    """Nothing is named where nothing is missing; a drag on the finger is, with its strength."""
    assert diagnose(scene, [recorded(free, 0.0, seed) for seed in (1, 2)]).kind == "none"
    verdict = diagnose(scene, [recorded(free, 2.0, seed) for seed in (3, 4)], held_out=[recorded(free, 2.0, 5)])
    (found,) = verdict.explanation
    assert (found.effect.name, found.effect.at) == ("joint_viscous_friction", "finger")
    assert abs(found.values["coefficient"].value - 2.0) < 4.0 * found.values["coefficient"].std
    assert verdict.kind == "explained"


def test_drake_moves_them_together(scene: Scene, free: Scene) -> None:
    """The scene in a Diagram against the same equations, and a continuous plant refused in one sentence."""
    builder = DiagramBuilder()
    plant = scene.add_to(builder, MultibodyPlantConfig(time_step=2e-4))
    builder.ExportInput(plant.effort, "effort")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    diagram.get_input_port(0).FixValue(simulator.get_mutable_context(), np.array([0.3, 6.0]))
    simulator.AdvanceTo(0.1)
    context = plant.plant.GetMyContextFromRoot(simulator.get_context())
    names = [name for name, *_ in JOINTS]
    q = np.array([plant.plant.GetJointByName(name).GetOnePosition(context) for name in names])
    np.testing.assert_allclose(q, G @ q[:2] + OFFSET, atol=1e-4)
    x, effort, h = np.zeros(4), np.array([0.3, 6.0]), 1e-4
    for _ in range(1000):  # explicit midpoint
        x = x + h * slope(free, x + 0.5 * h * slope(free, x, effort), effort)
    np.testing.assert_allclose(q[:2], x[:2], rtol=0.01)
    with pytest.raises(InputError, match="follows finger, which only a discrete plant can simulate"):
        scene.add_to(DiagramBuilder(), MultibodyPlantConfig(time_step=0.0))


def test_one_that_carries_a_joint_of_its_own_is_refused(tmp_path: Path) -> None:
    text = gripper().replace('<mimic joint="other_finger" multiplier="-4.0" offset="0.3"/>', "")
    with pytest.raises(InputError, match=r"'other_finger' follows 'finger' and carries joints.*`lock: \[finger\]`"):
        scene_of(tmp_path, text)
