"""Stands in for a robot that is commanded by position: an arm with servos, simulated by Drake, and its tables.

    python -m drake_cafim.diagrams.tutorials.stand_in_servo FOLDER

writes arm.urdf and three tables of commands and encoder readings, run_1.csv to run_3.csv. No torque is measured.
"""

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from drake_cafim import Recording, write
from drake_cafim.recordings import from_vector_log
from drake_cafim.typing import Array

ARM = Path(__file__).with_name("arm.urdf")
STEP, DURATION = 0.01, 8.0  # s
QUANTUM = 2.0 * np.pi / 4096  # rad, of the encoders
KP, KV, FRICTION = np.array([60.0, 25.0]), np.array([4.0, 1.5]), np.array([0.0, 0.4])  # N m/rad, N m s/rad, N m


class Servos(LeafSystem):
    """Position servos with dry friction in the elbow: the plant's `state` (4,) in, efforts (2,) N m out.

    .. pydrake_system::

        name: Servos
        input_ports: [state]
        output_ports: [effort]
    """

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__()
        self.rate = 2.0 * np.pi * rng.uniform(0.1, 0.9, (4, 2))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (4, 2))
        self.DeclareVectorInputPort("state", 4)
        self.DeclareVectorOutputPort("effort", 2, self.calc)

    def command(self, time: float) -> Array:
        """The commanded positions (2,) rad, held from each sample to the next."""
        at = STEP * np.floor(time / STEP + 1e-6)
        return np.asarray(0.5 * min(at, 1.0) * np.sin(self.rate * at + self.phase).sum(axis=0) / 2.0)

    def calc(self, context: Context, output: Any) -> None:
        q, v = np.split(np.asarray(self.get_input_port().Eval(context)), 2)
        effort = KP * (self.command(context.get_time()) - q) - KV * v - FRICTION * np.tanh(v / 0.005)
        output.SetFromVector(effort)


def record(seed: int) -> Recording:
    """Eight seconds of commands and of what the encoders read."""
    builder = DiagramBuilder()
    plant: MultibodyPlant
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(ARM)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    servos = Servos(np.random.default_rng(seed))
    builder.AddSystem(servos)
    builder.Connect(plant.get_state_output_port(), servos.get_input_port())
    builder.Connect(servos.get_output_port(), plant.get_actuation_input_port())
    log = LogVectorOutput(plant.get_state_output_port(), builder, STEP)
    simulator = Simulator(builder.Build())
    integrator = SimulatorConfig(integration_scheme="runge_kutta3", accuracy=1e-6, max_step_size=STEP / 10)
    ApplySimulatorConfig(integrator, simulator)
    simulator.AdvanceTo(DURATION)
    names = ("shoulder", "elbow")
    states = from_vector_log(
        log.FindLog(simulator.get_context()), [f"{kind}.{name}" for kind in "qv" for name in names]
    )
    columns = {f"q.{name}": QUANTUM * np.round(states[f"q.{name}"] / QUANTUM) for name in names}
    sent = np.stack([servos.command(time) for time in states.time])
    columns |= {f"cmd.{name}": sent[:, j] for j, name in enumerate(names)}
    return Recording(f"run {seed}", states.time, columns)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(ARM, folder)
    for seed in (1, 2, 3):
        write(record(seed), folder / f"run_{seed}.csv")
