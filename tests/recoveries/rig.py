"""A scene in Drake under a controller or under recorded efforts, and its recording."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from drake_cafim.corrected.corrected_plant import CorrectedPlant
from drake_cafim.dynamics.motion import bias_force, mass_matrix, motion
from drake_cafim.dynamics.tree import Tree
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.vector_log import from_vector_log
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

PERIOD = 0.002
"""s, of controllers and recordings."""
CONTINUOUS = MultibodyPlantConfig(time_step=0.0)
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


class Commands(Held):
    """The desired positions, as commands to servos."""

    def __init__(self, desired: Desired, joints: int, period: float, continuous: bool) -> None:
        super().__init__(joints, period, continuous)
        self.desired = desired

    def sampled(self, context: Context) -> Array:
        return self.desired(context.get_time())[0]


class Replay(Held):
    """A recording's efforts, or its commands."""

    def __init__(self, recording: Recording, joints: Sequence[str], kind: str = "u") -> None:
        super().__init__(len(joints), PERIOD, True)
        self.start, self.efforts = recording.time[0], recording.matrix(kind, joints)

    def sampled(self, context: Context) -> Array:
        k = round((context.get_time() - self.start) / self.period)
        return np.array(self.efforts[min(k, len(self.efforts) - 1)])


def inverse_dynamics(tree: Tree, gravity: Array, q: Array, v: Array, a: Array) -> Array:
    moving = motion(tree, q[None], v[None])
    rotors, dampings = (
        np.array([getattr(joint, key) for joint in tree.joints]) for key in ("rotor_inertia", "damping")
    )
    M = mass_matrix(moving)[0] + np.diag(rotors)
    return np.asarray(M @ a + bias_force(moving, gravity)[0] + dampings * v)


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
    if corrected.servo:
        commands = builder.AddSystem(Commands(desired, len(corrected.joints), period, config.time_step == 0.0))
        builder.Connect(commands.get_output_port(), corrected.servo["command"])
    else:
        controller = builder.AddNamedSystem(
            "controller", Controller(scene, desired, period, rate, config.time_step == 0.0)
        )
        for name in "qv":
            builder.Connect(corrected.measured[name], controller.GetInputPort(name))
        builder.Connect(controller.get_output_port(), corrected.effort)
    found = logged(builder, corrected, period, integrator_step)
    q, v, _ = desired(0.0)
    place(corrected, found.simulator, q, v)
    return found


def logged(builder: DiagramBuilder, corrected: CorrectedPlant, period: float, integrator_step: float) -> Rig:
    """The built Diagram with a log of all channels; a continuous plant is integrated in steps of `integrator_step`."""
    sink = LogVectorOutput(corrected.measured["channels"], builder, publish_period=period)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    if corrected.plant.time_step() == 0.0:
        settings = SimulatorConfig(
            integration_scheme="runge_kutta3", max_step_size=integrator_step, use_error_control=False
        )
        ApplySimulatorConfig(settings, simulator)
    return Rig(diagram, corrected, simulator, sink)


def replayed(scene: Scene, recording: Recording, start: Array, duration: float, integrator_step: float) -> Recording:
    """What the scene does for `duration` s under the recording's efforts, from its positions and velocities (2n,)."""
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, CONTINUOUS)
    replay = builder.AddSystem(Replay(recording, corrected.joints, "cmd" if corrected.servo else "u"))
    builder.Connect(replay.get_output_port(), corrected.servo.get("command", corrected.effort))
    found = logged(builder, corrected, PERIOD, integrator_step)
    found.simulator.get_mutable_context().SetTime(float(recording.time[0]))
    place(corrected, found.simulator, *np.split(start, 2))
    # of the last sample the effort is not in the log yet
    found.simulator.AdvanceTo(float(recording.time[0]) + duration + PERIOD)
    return found.recording("replayed")


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
    found = rig(scene, desired, **more)
    found.simulator.AdvanceTo(duration)
    clean, rng = found.recording(), np.random.default_rng(seed)
    if found.corrected.servo:
        sent = np.stack([desired(t)[0] for t in clean.time])
        known = {name: values for name, values in clean.columns.items() if not name.startswith("u.")}
        known |= {f"cmd.{name}": sent[:, j] for j, name in enumerate(found.corrected.joints)}
        clean = Recording(clean.name, clean.time, known)
    columns = {
        name: values + (scene.std(name) or 0.0) * rng.normal(size=len(values)) for name, values in clean.columns.items()
    }
    return Recording(name=f"seed {seed}", time=clean.time, columns=columns, notes=())
