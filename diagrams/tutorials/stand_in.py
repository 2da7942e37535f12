"""Stands in for your robot: an arm, simulated by Drake with something that its URDF lacks, and its bags.

    python -m drake_cafim.diagrams.tutorials.stand_in FOLDER

writes arm.urdf and three bags, run_1.mcap to run_3.mcap, of an arm with stiff grease in its elbow.
"""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput, ZeroOrderHold

from drake_cafim import Recording, write
from drake_cafim.recordings import from_vector_log
from drake_cafim.typing import Array

ARM = Path(__file__).with_name("arm.urdf")
STEP, DURATION = 0.004, 4.0  # s
NOISE = {"q": 2e-4, "v": 2e-3, "u": 0.0}  # rad, rad/s, N m: standard deviations of one sample

Law = Callable[[Array, Array], Array]
"""Positions (2,) rad and velocities (2,) rad/s to the torques (2,) N m that the URDF lacks."""


def stiff_grease(q: Array, v: Array) -> Array:
    """Viscous friction of 0.15 N m s/rad in the elbow."""
    return np.array([0.0, -0.15 * v[1]])


class Torques(LeafSystem):
    """A law as a Drake system: the plant's `state` (4,) in, generalized forces (2,) N m out.

    .. pydrake_system::

        name: Torques
        input_ports: [state]
        output_ports: [generalized_force]
    """

    def __init__(self, law: Law) -> None:
        super().__init__()
        self.law = law
        self.DeclareVectorInputPort("state", 4)
        self.DeclareVectorOutputPort("generalized_force", 2, self.calc)

    def calc(self, context: Context, output: Any) -> None:
        q, v = np.split(np.asarray(self.get_input_port().Eval(context)), 2)
        output.SetFromVector(self.law(q, v))


class Controller(LeafSystem):
    """Torques that make both joints follow sums of sines: the plant's `state` (4,) in, efforts (2,) N m out.

    .. pydrake_system::

        name: Controller
        input_ports: [state]
        output_ports: [effort]
    """

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__()
        self.rate = 2.0 * np.pi * rng.uniform(0.2, 1.4, (3, 2))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (3, 2))
        self.kp, self.kd = np.array([60.0, 20.0]), np.array([6.0, 1.2])
        self.DeclareVectorInputPort("state", 4)
        self.DeclareVectorOutputPort("effort", 2, self.calc)

    def calc(self, context: Context, output: Any) -> None:
        q, v = np.split(np.asarray(self.get_input_port().Eval(context)), 2)
        time = context.get_time()
        wanted = 0.35 * min(time, 1.0) * np.sin(self.rate * time + self.phase).sum(axis=0)
        output.SetFromVector(self.kp * (wanted - q) - self.kd * v)


def record(law: Law, seed: int, name: str = "run") -> Recording:
    """Four seconds of the arm, moved by its controller and by `law`, with the noise of its sensors."""
    builder = DiagramBuilder()
    plant: MultibodyPlant
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(ARM)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    rng = np.random.default_rng(seed)
    controller = builder.AddSystem(Controller(rng))
    hold = builder.AddSystem(ZeroOrderHold(STEP, 2))
    torques = builder.AddSystem(Torques(law))
    builder.Connect(plant.get_state_output_port(), controller.get_input_port())
    builder.Connect(controller.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), plant.get_actuation_input_port())
    builder.Connect(plant.get_state_output_port(), torques.get_input_port())
    builder.Connect(torques.get_output_port(), plant.get_applied_generalized_force_input_port())
    # the controller's output at a sample is what the hold keeps until the next; the hold's own is still the last one
    logs = [
        LogVectorOutput(port, builder, STEP) for port in (plant.get_state_output_port(), controller.get_output_port())
    ]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="runge_kutta3", accuracy=1e-7, max_step_size=STEP), simulator
    )
    simulator.AdvanceTo(DURATION)
    states, efforts = (
        from_vector_log(log.FindLog(simulator.get_context()), columns)
        for log, columns in zip(
            logs, (["q.shoulder", "q.elbow", "v.shoulder", "v.elbow"], ["u.shoulder", "u.elbow"]), strict=True
        )
    )
    columns = dict(states.columns) | dict(efforts.columns)
    noisy = {column: values + rng.normal(0.0, NOISE[column[0]], values.shape) for column, values in columns.items()}
    return Recording(name, states.time, noisy)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(ARM, folder)
    for seed in (1, 2, 3):
        write(record(stiff_grease, seed), folder / f"run_{seed}.mcap")
