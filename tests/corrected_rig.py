"""Scenes of the corrected plant's tests: an arm of three joints, a tool on a stage before a wall, and a controller."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from drake_cafim.corrected.corrected_plant import CorrectedPlant
from drake_cafim.diagnosis.diagnose import prepare
from drake_cafim.diagnosis.initial_state import state_at
from drake_cafim.dynamics.motion import bias_force, mass_matrix, motion
from drake_cafim.dynamics.tree import Tree
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.vector_log import from_vector_log
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

PERIOD = 0.002
"""s, of controllers and recordings."""
CONTINUOUS = MultibodyPlantConfig(time_step=0.0)
LINK = """<link name="{name}"><inertial><origin xyz="{x} 0.01 -0.02"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{origin}"/><axis xyz="{axis}"/><limit lower="-9" upper="9" effort="900" velocity="90"/>
<dynamics damping="0.1"/></joint>
<transmission name="{name}_t"><type>transmission_interface/SimpleTransmission</type><joint name="{name}">
<hardwareInterface>EffortJointInterface</hardwareInterface></joint><actuator name="{name}">
<drake:rotor_inertia value="0.04"/><drake:gear_ratio value="1"/></actuator></transmission>"""
ARM = (
    '<robot name="arm" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + "".join(LINK.format(name=n, x=x, mass=m) for n, x, m in (("l1", 0.0, 2.0), ("l2", 0.2, 1.5), ("l3", 0.15, 1.0)))
    + "".join(
        JOINT.format(name=n, parent=p, child=c, origin=o, axis=a)
        for n, p, c, o, a in (
            ("turn", "base", "l1", "0 0 0.3", "0 0 1"),
            ("lift", "l1", "l2", "0.05 0 0.1", "0 1 0"),
            ("elbow", "l2", "l3", "0.4 0 0", "0 1 0"),
        )
    )
    + "</robot>"
)
STAGE_LINK = """<link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>"""
STAGE_JOINT = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-9" upper="9" effort="900" velocity="90"/></joint>"""
BALL = """<collision name="ball"><geometry><sphere radius="0.02"/></geometry><drake:proximity_properties>
<drake:compliant_hydroelastic/><drake:hydroelastic_modulus value="1e7"/><drake:mesh_resolution_hint value="0.005"/>
<drake:mu_dynamic value="0.4"/></drake:proximity_properties></collision>"""
WALL = """<collision name="wall"><origin xyz="0 0 -0.05"/><geometry><box size="1 1 0.1"/></geometry>
<drake:proximity_properties><drake:rigid_hydroelastic/><drake:mesh_resolution_hint value="1"/>
<drake:mu_dynamic value="0.4"/></drake:proximity_properties></collision>"""
STAGE = (
    '<robot name="stage" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + STAGE_LINK.format(name="wall", mass=1.0, more=WALL)
    + "".join(
        STAGE_LINK.format(name=n, mass=m, more=more)
        for n, m, more in (("bridge", 2.0, ""), ("carriage", 1.0, ""), ("tool", 0.8, BALL))
    )
    + "".join(
        STAGE_JOINT.format(name=n, parent=p, child=c, axis=a)
        for n, p, c, a in (
            ("x", "base", "bridge", "1 0 0"),
            ("y", "bridge", "carriage", "0 1 0"),
            ("z", "carriage", "tool", "0 0 1"),
        )
    )
    + '<joint name="mount" type="fixed"><parent link="base"/><child link="wall"/></joint></robot>'
)
ROLLER = (
    '<robot name="roller" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + STAGE_LINK.format(name="wall", mass=1.0, more=WALL)
    + "".join(
        STAGE_LINK.format(name=n, mass=m, more=more)
        for n, m, more in (("bridge", 2.0, ""), ("lifter", 1.0, ""), ("tool", 0.8, BALL))
    )
    + "".join(
        STAGE_JOINT.format(name=n, parent=p, child=c, axis=a).replace("prismatic", kind)
        for n, p, c, a, kind in (
            ("x", "base", "bridge", "1 0 0", "prismatic"),
            ("z", "bridge", "lifter", "0 0 1", "prismatic"),
            ("roll", "lifter", "tool", "0 1 0", "revolute"),
        )
    )
    + '<joint name="mount" type="fixed"><parent link="base"/><child link="wall"/></joint></robot>'
)
NOISE = {"q": {"std": 1e-4}, "v": {"std": 2e-3}}
PRESS = {
    "channels": {
        "q": {"std": 2e-6},
        "v": {"std": 2e-4},
        "wrench.wrist": {"body": "tool", "frame": "tool", "std": {"force": 0.02, "torque": 0.001}},
    },
    "contact": [
        {"bodies": ["tool", "wall"], "stiffness": 4000.0, "damping": 40.0, "friction": 0.4, "slip_velocity": 0.004}
    ],
}


def scene_of(folder: Path, model: str, *effects: Mapping[str, Any], **more: Any) -> Scene:
    """The scene of a model's text with these entries of `effects:` and other keys of a scenario."""
    (folder / "model.urdf").write_text(model)
    raw = {"model": "model.urdf", "weld": [{"body": "base"}], "channels": NOISE, **more, "effects": list(effects)}
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(raw))
    return Scene.load(path)


Desired = Callable[[float], tuple[Array, Array, Array]]
"""Time s to positions, velocities and accelerations (n,)."""


def waves(centre: Sequence[float], size: Sequence[float], seed: int = 0, slowest: float = 0.4) -> Desired:
    """A few sines a joint about `centre`, of about `size`, that start at rest in position."""
    rng = np.random.default_rng(seed)
    n, parts = len(centre), 4
    rates = 2.0 * np.pi * slowest * (1.0 + np.arange(parts)) * rng.uniform(0.9, 1.1, (n, parts))
    sizes = np.asarray(size)[:, None] * rng.uniform(0.4, 1.0, (n, parts)) / (1.0 + np.arange(parts))
    phases = rng.uniform(0.0, 2.0 * np.pi, (n, parts))

    def desired(t: float) -> tuple[Array, Array, Array]:
        angle = rates * t + phases
        q = np.asarray(centre) + np.sum(sizes * np.sin(angle), axis=1)
        v, a = np.sum(sizes * rates * np.cos(angle), axis=1), -np.sum(sizes * rates**2 * np.sin(angle), axis=1)
        return q, v, a

    return desired


class Held(LeafSystem):
    """An effort of n joints that is sampled every `period` s and held.

    Beside a discrete plant the sample at t_k acts from t_k on, and the log has it there. A continuous plant's
    integrator looks at t_k from both sides: there the sample acts, and is logged, only after t_k; see `Rig.recording`.
    """

    def __init__(self, joints: int, period: float, continuous: bool) -> None:
        LeafSystem.__init__(self)
        self.period, self.continuous = period, continuous
        self.DeclareVectorOutputPort("effort", joints, self._calc_effort)
        self.DeclareDiscreteState(np.full(joints, np.nan))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._hold)

    def sampled(self, context: Context) -> Array:
        """The effort at a sample's time."""
        raise NotImplementedError

    def _calc_effort(self, context: Context, output: BasicVector) -> None:
        held = context.get_discrete_state(0).get_value()
        phase = context.get_time() / self.period
        now = not self.continuous and abs(phase - round(phase)) < 1e-6
        output.SetFromVector(self.sampled(context) if now or not np.isfinite(held[0]) else held)

    def _hold(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(0, self.sampled(context))


class Controller(Held):
    """Nominal inverse dynamics and a PD of `rate` 1/s, from measured q and v."""

    def __init__(self, scene: Scene, desired: Desired, period: float, rate: float, continuous: bool) -> None:
        n = len(scene.tree.joints)
        super().__init__(n, period, continuous)
        self.tree, self.gravity, self.desired, self.rate = scene.tree, scene.scenario.gravity, desired, rate
        for name in "qv":
            self.DeclareVectorInputPort(name, n)

    def sampled(self, context: Context) -> Array:
        q, v = (self.get_input_port(k).Eval(context) for k in (0, 1))
        q_d, v_d, a_d = self.desired(context.get_time())
        a = a_d + self.rate**2 * (q_d - q) + 1.6 * self.rate * (v_d - v)
        return inverse_dynamics(self.tree, np.array(self.gravity), q_d, v_d, a)


class Replay(Held):
    """A recording's efforts."""

    def __init__(self, recording: Recording, joints: Sequence[str]) -> None:
        super().__init__(len(joints), PERIOD, True)
        self.start, self.efforts = recording.time[0], recording.matrix("u", joints)

    def sampled(self, context: Context) -> Array:
        k = round((context.get_time() - self.start) / self.period)
        return np.array(self.efforts[min(k, len(self.efforts) - 1)])


def inverse_dynamics(tree: Tree, gravity: Array, q: Array, v: Array, a: Array) -> Array:
    moving = motion(tree, q[None], v[None])
    rotors, dampings = (np.array([getattr(one, key) for one in tree.joints]) for key in ("rotor_inertia", "damping"))
    M = mass_matrix(moving, moving.link_inertias)[0] + np.diag(rotors)
    return np.asarray(M @ a + bias_force(moving, moving.link_inertias, gravity)[0] + dampings * v)


@dataclass
class Rig:
    """A built Diagram of a corrected plant under control, and its log."""

    diagram: Diagram
    corrected: CorrectedPlant
    simulator: Simulator
    sink: Any

    def recording(self, name: str = "rig") -> Recording:
        log = from_vector_log(self.sink.FindLog(self.simulator.get_context()), self.corrected.columns, name)
        if self.corrected.plant.time_step() > 0.0:
            return log
        # the effort that acts from a sample on is in the log of the next one
        columns = {c: x[1:] if c.startswith("u.") else x[:-1] for c, x in log.columns.items()}
        return Recording(name=name, time=log.time[:-1], columns=columns, notes=log.notes)


def rig(
    scene: Scene,
    desired: Desired,
    *,
    config: MultibodyPlantConfig = CONTINUOUS,
    period: float = PERIOD,
    integrator_step: float = 5e-4,
    rate: float = 20.0,
    **more: Any,
) -> Rig:
    """The scene under a controller from the desired motion's start; recorded every `period` s."""
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, config, **more)
    controller = builder.AddNamedSystem("controller", Controller(scene, desired, period, rate, config.time_step == 0.0))
    for name in "qv":
        builder.Connect(corrected.measured[name], controller.GetInputPort(name))
    builder.Connect(controller.get_output_port(), corrected.effort)
    sink = LogVectorOutput(corrected.measured["channels"], builder, publish_period=period)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    if config.time_step == 0.0:
        settings = SimulatorConfig(
            integration_scheme="runge_kutta3", max_step_size=integrator_step, use_error_control=False
        )
        ApplySimulatorConfig(settings, simulator)
    q, v, _ = desired(0.0)
    place(corrected, simulator, q, v)
    return Rig(diagram, corrected, simulator, sink)


LOOK_BACK, HORIZON = 0.05, 1.0
"""s"""


def followed(scene: Scene, recording: Recording, integrator_step: float = 5e-4) -> dict[str, float]:
    """Root mean square of the scene's simulation in Drake against the recording over 1 s, by column with noise.

    Open loop in the recorded efforts; the state at the horizon's start is that which a diagnosis finds in the 50 ms
    before it, through which the scene is simulated first, for what it remembers.
    """
    prepared = prepare(scene, [recording])
    [weak] = prepared.weak
    start = int(np.searchsorted(recording.time, recording.time[0] + LOOK_BACK))
    q, v, *_ = state_at(weak.samples, weak.measurement(scene.physics), start)
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, CONTINUOUS)
    replay = builder.AddSystem(Replay(recording, corrected.joints))
    builder.Connect(replay.get_output_port(), corrected.effort)
    sink = LogVectorOutput(corrected.measured["channels"], builder, publish_period=PERIOD)
    simulator = Simulator(builder.Build())
    settings = SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=integrator_step, use_error_control=False
    )
    ApplySimulatorConfig(settings, simulator)
    measured = weak.measurement(scene.physics)
    simulator.get_mutable_context().SetTime(float(recording.time[0]))
    place(corrected, simulator, measured.q[0], measured.v[0])
    simulator.AdvanceTo(float(recording.time[start]))
    place(corrected, simulator, q, v)
    simulator.AdvanceTo(float(recording.time[start]) + HORIZON)
    log = from_vector_log(sink.FindLog(simulator.get_context()), corrected.columns, "Drake")
    rows = slice(start + 1, len(log))
    np.testing.assert_allclose(log.time[rows], recording.time[rows], atol=1e-9)
    noisy = [column for column in corrected.columns if scene.std(column)]
    return {c: float(np.sqrt(np.mean((log[c][rows] - recording[c][rows]) ** 2))) for c in noisy}


def place(corrected: CorrectedPlant, simulator: Simulator, q: Array, v: Array) -> None:
    """Sets the joints' positions and velocities (n,)."""
    plant = corrected.plant
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    positions, velocities = plant.GetPositions(context).copy(), plant.GetVelocities(context).copy()
    for k, name in enumerate(corrected.joints):
        joint = plant.GetJointByName(name)
        positions[joint.position_start()], velocities[joint.velocity_start()] = q[k], v[k]
    plant.SetPositions(context, positions)
    plant.SetVelocities(context, velocities)


def recorded(scene: Scene, desired: Desired, duration: float, seed: int = 1, **more: Any) -> Recording:
    """The scene's recording of a controlled motion, with the noise that its channels state."""
    one = rig(scene, desired, **more)
    one.simulator.AdvanceTo(duration)
    clean, rng = one.recording(), np.random.default_rng(seed)
    columns = {
        name: values + (scene.std(name) or 0.0) * rng.normal(size=len(values)) for name, values in clean.columns.items()
    }
    return Recording(name=f"seed {seed}", time=clean.time, columns=columns, notes=())
