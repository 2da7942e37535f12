"""Small scenes of thrown bodies, and recordings simulated in them."""

from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.diagnosis.tosses.flight import fly
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.dynamics.free_body_state import State
from drake_cafim.dynamics.rotations import exponential, product, rotation_matrices
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

BALL = '<sphere radius="0.04"/>'
BLOCK = '<box size="0.1 0.08 0.06"/>'
URDF = """<robot name="thrown"><link name="body"><inertial><origin xyz="{com}"/><mass value="0.3"/>
<inertia ixx="{i}" iyy="{i}" izz="{j}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry>{shape}</geometry></collision></link></robot>"""
SCENARIO = """
model: body.urdf
channels: {pose.body: {std: {position: 2.0e-4, rotation: 2.0e-3}}}
unknown:
  - {parameter: stiffness, contact: [body, ground], mean: 3000.0, std: 300.0}
  - {parameter: friction, contact: [body, ground], mean: 0.3, std: 0.03}
contact:
  - {bodies: [body, ground], ground: {point: [0, 0, 0], normal: [0, 0, 1]}, stiffness: 3000.0, damping: 5.0,
     friction: 0.3, slip_velocity: 0.01}
"""
STEP, DURATION = 0.004, 0.9


def thrown_scene(folder: Path, shape: str = BALL, com: str = "0 0 0", scenario: str = SCENARIO) -> Scene:
    """A ball or a block thrown on the ground; 0.3 kg."""
    i = 1.9e-4 if shape == BALL else 3e-4
    (folder / "body.urdf").write_text(URDF.format(shape=shape, com=com, i=i, j=i if shape == BALL else 4e-4))
    (folder / "scenario.yaml").write_text(scenario)
    return Scene.load(folder / "scenario.yaml")


def beginnings(rng: np.random.Generator, count: int) -> State:
    """States of bodies that turn, some 0.3 m above the ground."""
    return State.of(
        np.stack([rng.uniform(-0.1, 0.1, 3) + np.array([0.0, 0.0, 0.3]) for _ in range(count)]),
        exponential(rng.normal(0.0, 1.0, (count, 3))),
        np.stack([rng.uniform(-1.0, 1.0, 3) * np.array([1.0, 1.0, 0.3]) for _ in range(count)]),
        rng.normal(0.0, 5.0, (count, 3)),
    )


def thrown_in_drake(scene: Scene, start: State, times: Array) -> Array:
    """(N, 7) measured poses at `times` (N,) s, simulated by Drake from `start` (1) with the effects of the scene."""
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, MultibodyPlantConfig(time_step=0.0))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    own, body = corrected.plant.GetMyMutableContextFromRoot(context), corrected.plant.GetBodyByName("body")
    X_WB = RigidTransform(RotationMatrix(rotation_matrices(start.quaternion)[0]), start.p[0])
    corrected.plant.SetFreeBodyPose(own, body, X_WB)
    corrected.plant.SetFreeBodySpatialVelocity(own, body, SpatialVelocity(start.w[0], start.v[0]))
    simulator.get_mutable_integrator().set_target_accuracy(1e-6)
    simulator.get_mutable_integrator().set_maximum_step_size(2e-3)
    simulator.Initialize()
    port, poses = corrected.measured["pose.body"], []
    for time in times:
        simulator.AdvanceTo(time)
        poses.append(np.array(port.Eval(port.get_system().GetMyContextFromRoot(context))))
    return np.array(poses)


def thrown(physics: Physics, seed: int, count: int = 3, noise: tuple[float, float] = (2e-4, 2e-3)) -> list[Recording]:
    """Recordings of throws under `physics`, 4 ms apart, with white noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, DURATION, STEP)
    times = np.tile(time, (count, 1))
    start = beginnings(rng, count)
    names = tuple(f"toss_{k}" for k in range(count))
    tight = np.array([1e-6] * 3 + [1e-5] * 3)
    flights = fly(FreeBody(physics), start, times, np.full(count, len(time)), np.arange(count), names, tight)
    p = flights.at_samples.p.reshape(count, -1, 3)
    quaternion = flights.at_samples.quaternion.reshape(count, -1, 4)
    recordings = []
    for k, name in enumerate(names):
        seen = p[k] + rng.normal(0.0, noise[0], p[k].shape)
        turned = product(exponential(rng.normal(0.0, noise[1], p[k].shape)), quaternion[k])
        pose = np.concatenate([seen, turned], axis=1)
        columns = {f"pose.body.{axis}": pose[:, i] for i, axis in enumerate(POSE_COMPONENTS)}
        recordings.append(Recording(name, time, columns))
    return recordings
