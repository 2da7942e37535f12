"""The kinematic world: the robot tracks its commands exactly, and contacts obey the planning model's own law."""

from itertools import pairwise
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from drake_cafim.experiment.world import World
from drake_cafim.tasks.task import Task
from drake_cafim.typing import Array


class KinematicWorld(LeafSystem):
    """The task's planning model, simulated at the true parameters.

    .. pydrake_system::

        name: KinematicWorld
        input_ports: [command]
        output_ports: [measured_state, measured_force, true_force]

    Numeric parameter 0 holds the number of the experiment, which with `seed` determines the noise. `process_std` m/s
    is the std of white noise that is added to each command; the measured state is the true one.
    """

    def __init__(self, task: Task, *, seed: int = 0, noise_scale: float = 1.0, process_std: float = 0.0) -> None:
        super().__init__()
        self._task, self._seed, self._noise_scale, self._process_std = task, seed, noise_scale, process_std
        model = task.model
        axes, readings = len(model.velocity_bounds[0]), len(model.noise_std)
        motion = model.measured_motion(np.stack([task.robot_start, task.robot_start])[np.newaxis])[0, 0]
        start = model.start(motion, task.theta)
        force = model.contact(start.state, motion, task.theta)
        number: Any = np.zeros(1)  # a bare BasicVector(1) would hold NaN
        self.DeclareNumericParameter(BasicVector(number))
        self.DeclareVectorInputPort("command", axes)
        self._state = self._declare(task.robot_start)
        self._touched = self._declare(start.state)
        self._true = self._declare(model.measurement(start.state, motion, force, task.theta))
        self._measured = self._declare(np.zeros(readings))
        self._step = self._declare(np.zeros(1))
        for name, index in (
            ("measured_state", self._state),
            ("measured_force", self._measured),
            ("true_force", self._true),
        ):
            self.DeclareStateOutputPort(name, DiscreteStateIndex(index))
        # Updated half a period after the controller, so that the order of simultaneous events does not matter.
        self.DeclarePeriodicDiscreteUpdateEvent(model.period, 0.5 * model.period, self._move)

    def _declare(self, value: Any) -> int:
        return int(self.DeclareDiscreteState(value))

    def _move(self, context: Context, update: DiscreteValues) -> None:
        model, theta = self._task.model, self._task.theta
        state: Any = context.get_discrete_state()
        robot = np.array(state.get_vector(self._state).get_value())
        touched = np.array(state.get_vector(self._touched).get_value())
        step = int(state.get_vector(self._step)[0])
        number = int(context.get_numeric_parameter(0)[0])
        command: Array = np.array(self.get_input_port(0).Eval(context))
        shaken = np.random.default_rng([self._seed, 2, number, step]).standard_normal(len(command))
        command = command + self._process_std * shaken
        motion = model.motion(robot, command[np.newaxis, np.newaxis])[0]
        force = model.contact(touched, motion[0], theta)
        for before, after in pairwise(motion):
            touched = model.step(touched, before, after, force, theta)
            force = model.contact(touched, after, theta)
        true = model.measurement(touched, motion[-1], force, theta)
        noise = np.random.default_rng([self._seed, 1, number, step]).standard_normal(len(true))
        values = {
            self._state: motion[-1, : len(robot)],
            self._touched: touched,
            self._true: true,
            self._measured: true + self._noise_scale * model.noise_std * noise,
            self._step: np.array([step + 1.0]),
        }
        written: Any = update
        for index, value in values.items():
            written.get_mutable_vector(index).SetFromVector(value)


def kinematic_world(task: Task, *, seed: int = 0, noise_scale: float = 1.0, process_std: float = 0.0) -> World:
    """The kinematic world of `task`: process noise of `process_std` m/s, and sensor noise times `noise_scale`."""
    system = KinematicWorld(task, seed=seed, noise_scale=noise_scale, process_std=process_std)

    def start_context(experiment: int) -> Context:
        context = system.CreateDefaultContext()
        context.get_mutable_numeric_parameter(0)[0] = float(experiment)
        return context

    return World("model", system, start_context)
