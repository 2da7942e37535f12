"""Effects with internal states: their discrete states in the Context against the laws on whole recordings."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput, Sine
from scipy.integrate import solve_ivp

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.contacts import ContactSystem
from drake_cafim.corrected.efforts import actuator_system
from drake_cafim.corrected.sensors import sensor_system
from drake_cafim.dynamics.motion import motion
from drake_cafim.effects.actuator import ActuatorDelay, ActuatorEffect, ActuatorLag, Effort
from drake_cafim.effects.coupling import JointBacklash, JointCoupling, JointElasticity
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.timing import ClockSkew, SensorDelay, SensorLag
from drake_cafim.errors import InputError
from drake_cafim.typing import Array
from tests.recoveries.cases import CASES, REMEMBERING, Case
from tests.recoveries.models import PRESS, STAGE, scene_of
from tests.recoveries.rig import CONTINUOUS, Rig, rig

PERIOD = 1e-3
CLOCK = Clock(PERIOD)


class Playback(LeafSystem):
    """Rows of a table, one every `PERIOD`."""

    def __init__(self, rows: Array) -> None:
        LeafSystem.__init__(self)
        self.rows = rows
        self.DeclareVectorOutputPort("row", rows.shape[1], self._calc_row)

    def _calc_row(self, context: Context, output: BasicVector) -> None:
        index = int(context.get_time() / PERIOD + 1e-6)
        output.SetFromVector(self.rows[min(index, len(self.rows) - 1)])


def through(system: LeafSystem, rows: Array, output: str) -> Array:
    """The output's value at the time of each row."""
    builder = DiagramBuilder()
    source = builder.AddSystem(Playback(rows))
    builder.AddSystem(system)
    builder.Connect(source.get_output_port(), system.get_input_port())
    sink = LogVectorOutput(system.GetOutputPort(output), builder, publish_period=PERIOD)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((len(rows) - 1) * PERIOD)
    return np.array(sink.FindLog(simulator.get_context()).data()).T


@pytest.mark.parametrize(
    "effect",
    [
        ActuatorDelay("j", {"delay": 0.0073}),
        ActuatorDelay("j", {"delay": 0.0004}),
        ActuatorLag("j", {"time_constant": 0.012}),
        ActuatorLag("j", {"time_constant": 0.0003}),
    ],
)
def test_efforts_come_through_late(effect: ActuatorEffect) -> None:
    rows = np.cumsum(np.random.default_rng(1).normal(size=(60, 3)), axis=0)
    time = PERIOD * np.arange(60)
    found = through(actuator_system(effect, 1, 3, CLOCK), rows, "acting")
    np.testing.assert_array_equal(found[:, [0, 2]], rows[:, [0, 2]])
    # the law takes an exponential in steps of its own, with its integral
    expected = effect.drive(Effort(time, rows[:, 1])).means(time)
    np.testing.assert_allclose(found[:-1, 1], expected[:-1], atol=1e-9)


@pytest.mark.parametrize(
    ("effect", "tolerance"),
    [
        (SensorDelay("wrench.w", {"delay": 0.0067}), 1e-9),
        (SensorDelay("wrench.w", {"delay": 0.05}), 1e-9),
        (ClockSkew("wrench.w", {"skew": -0.02}), 1e-9),
        (ClockSkew("wrench.w", {"skew": 0.005}), 1e-5),
        (SensorLag("wrench.w", {"time_constant": 0.015}), 1e-5),
    ],
)
def test_channels_come_late(effect: SensorEffect, tolerance: float) -> None:
    time = PERIOD * np.arange(400)
    columns = ("wrench.w.fx", "wrench.w.fy", "other")
    rows = np.stack([np.sin(9.0 * time), np.cos(14.0 * time) + time, time], axis=1)
    found = through(sensor_system(effect, columns, CLOCK), rows, "measured")
    # a clock that runs ahead shows what the table does not hold yet
    longer = PERIOD * np.arange(450)
    true = np.stack([np.sin(9.0 * longer), np.cos(14.0 * longer) + longer], axis=1)
    expected = effect.measured(longer, true)[:400]
    np.testing.assert_array_equal(found[:, 2], rows[:, 2])
    # at the ends local polynomials lean on other samples
    np.testing.assert_allclose(found[4:, :2], expected[4:], atol=tolerance)
    assert np.max(np.abs(expected - rows[:, :2])) > 0.01


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("contact_presliding", {"distance": 3e-4}),
        ("contact_viscoelastic_relaxation", {"stiffness": 4000.0, "time_constant": 0.03}),
    ],
)
def test_contacts_remember(name: str, values: dict[str, float], tmp_path: Path) -> None:
    scene = scene_of(tmp_path, STAGE, {"effect": name, "at": "tool/wall", **values}, **PRESS)
    time = PERIOD * np.arange(500)
    q = np.stack(
        [0.002 * np.sin(25.0 * time), 0.001 * np.sin(17.0 * time), 0.0196 + 6e-4 * np.cos(15.0 * time)], axis=1
    )
    v = np.stack([0.05 * np.cos(25.0 * time), 0.017 * np.cos(17.0 * time), -9e-3 * np.sin(15.0 * time)], axis=1)
    [contact] = scene.physics.contacts
    index = scene.plant.GetBodyByName("tool").index()
    system = ContactSystem(contact, scene.tree, scene.tree.body("tool"), index, CLOCK)
    found = through(system, np.concatenate([q, v], axis=1), "wrench")
    moving = motion(scene.tree, q, v)
    touch = contact.touch(moving)
    expected = contact.wrench(moving, contact.recall(time, touch, touch))
    size = np.max(np.abs(expected), axis=0)
    np.testing.assert_allclose(found, expected, atol=0.02 * float(np.max(size)))
    without = scene_of(tmp_path, STAGE, **PRESS).physics.contacts[0].wrench(moving)
    assert np.max(np.abs(expected - without)) > 0.1 * np.max(size)


@pytest.mark.parametrize("model", ["point", "hydroelastic"])
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("contact_presliding", {"distance": 3e-4}),
        ("contact_viscoelastic_relaxation", {"stiffness": 4000.0, "time_constant": 0.03}),
    ],
)
def test_drakes_own_contacts_remember(name: str, values: dict[str, float], model: str, tmp_path: Path) -> None:
    """Beside Drake's contact acts what the law, with what it remembers of the whole way, has beyond the nominal one."""
    scene = scene_of(tmp_path, STAGE, {"effect": name, "at": "tool/wall", **values}, **PRESS)
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, MultibodyPlantConfig(time_step=1e-3, contact_model=model), contact="drake")
    there_and_back = Sine([9.0, 6.0, 0.0], [60.0, 45.0, 1.0], [0.0, 1.0, 0.0])
    builder.Connect(builder.AddSystem(there_and_back).get_output_port(0), corrected.effort)
    wrench = builder.GetSubsystemByName("contact tool/wall").GetOutputPort("wrench")
    ports = [builder.GetSubsystemByName("joint state").get_output_port(), wrench]
    sinks = [LogVectorOutput(port, builder, publish_period=PERIOD) for port in ports]
    simulator = Simulator(builder.Build())
    plant = corrected.plant
    own = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositionsAndVelocities(own, [0.0, 0.0, 0.0195, 0.0, 0.0, -0.02])
    simulator.AdvanceTo(0.15)
    state, found = (sink.FindLog(simulator.get_context()).data().T for sink in sinks)
    moving, time = motion(scene.tree, state[:, :3], state[:, 3:]), PERIOD * np.arange(len(state))
    [contact], [nominal] = scene.physics.contacts, scene.nominal_contacts
    touch = contact.touch(moving)
    assert np.all(touch.penetration[-50:] > 0.0)
    expected = contact.wrench(moving, contact.recall(time, touch, touch)) - nominal.wrench(moving)
    size = float(np.max(np.abs(expected[:, 3:])))
    assert size > 0.1
    np.testing.assert_allclose(found, expected, atol=0.02 * size)


ONE = """<robot name="one" xmlns:drake="http://drake.mit.edu"><link name="base"/><link name="l"><inertial>
<mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/></joint>
<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="j"/><actuator name="j">
<drake:rotor_inertia value="{rotor}"/><drake:gear_ratio value="1"/></actuator></transmission></robot>"""
LINK, ROTOR = 0.1, 0.04


def swung(coupling: JointCoupling, config: MultibodyPlantConfig, folder: Path) -> Rig:
    scene = scene_of(folder, ONE.format(rotor=ROTOR), {"effect": coupling.name, "at": "j", **coupling.values})
    closed = rig(scene, lambda t: (0.1 * np.sin([7.0 * t]), 0.7 * np.cos([7.0 * t]), -4.9 * np.sin([7.0 * t])),
              config=config, rate=8.0)  # fmt: skip
    closed.simulator.AdvanceTo(0.6)
    return closed


@pytest.mark.long
@pytest.mark.parametrize(("config", "tolerance"), [(CONTINUOUS, 2e-3), (MultibodyPlantConfig(time_step=2e-4), 2e-2)])
@pytest.mark.parametrize(
    "coupling",
    [
        JointElasticity("j", {"stiffness": 150.0, "damping": 0.2}),
        JointBacklash("j", {"gap": 0.01, "stiffness": 300.0, "damping": 0.5}),
    ],
)
def test_rotor_and_link_swing_as_the_law_says(
    coupling: JointCoupling, config: MultibodyPlantConfig, tolerance: float, tmp_path: Path
) -> None:
    recording = swung(coupling, config, tmp_path).recording()
    effort = recording["u.j"]
    state = np.array([0.0, 0.7, coupling.balance(float(effort[0])), 0.7])
    velocities = [state[1]]
    for k in range(len(effort) - 1):

        def rate(t: float, x: Array, u: float = float(effort[k])) -> list[float]:
            torque = coupling.torque(x[2] - x[0], x[3] - x[1])
            return [x[1], torque / LINK, x[3], (u - torque) / ROTOR]

        state = solve_ivp(rate, (0.0, 0.002), state, max_step=1e-4, rtol=1e-8, atol=1e-12).y[:, -1]
        velocities.append(state[1])
    size = float(np.std(velocities))
    assert np.sqrt(np.mean((recording["v.j"] - velocities) ** 2)) < tolerance * size


@pytest.mark.parametrize("config", [CONTINUOUS, MultibodyPlantConfig(time_step=1e-3)], ids=["continuous", "discrete"])
@pytest.mark.parametrize("case", [case for case in CASES if case.name in REMEMBERING], ids=lambda case: case.name)
def test_the_memory_is_the_contexts(case: Case, config: MultibodyPlantConfig, tmp_path: Path) -> None:
    """A Context that is copied in the middle goes on as the first does, and initializing again changes nothing."""
    closed = rig(case.scene(tmp_path, True), case.desired(1), config=config)
    closed.simulator.AdvanceTo(0.04)
    again = Simulator(closed.diagram, closed.simulator.get_context().Clone())
    again.get_mutable_integrator().set_maximum_step_size(5e-4)
    again.Initialize()
    port = closed.corrected.measured["channels"]
    ends = []
    for simulator in (closed.simulator, again):
        simulator.AdvanceTo(0.06)
        ends.append(port.Eval(port.get_system().GetMyContextFromRoot(simulator.get_context())))
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-6, atol=1e-6)


def test_a_rotor_needs_inertia(tmp_path: Path) -> None:
    effect = {"effect": "joint_elasticity", "at": "j", "stiffness": 100.0, "damping": 1.0}
    with pytest.raises(InputError, match="rotor inertia is 0, expected a positive value"):
        scene_of(tmp_path, ONE.format(rotor=0.0), effect).add_to(DiagramBuilder())
