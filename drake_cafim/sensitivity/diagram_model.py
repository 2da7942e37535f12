"""A planning model of a user's own Drake Diagram, with derivatives by AutoDiffXd."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.framework import Diagram

from drake_cafim.errors import InputError
from drake_cafim.numerics.motion_counts import count_make_breaks, count_reversals
from drake_cafim.parameters import Parameters
from drake_cafim.sensitivity.model import Jacobians, Rollout, Start
from drake_cafim.typing import Array

SetParameters = Callable[[Any, Any, Any], None]
"""(diagram, context, θ): write θ (n,) into the context; all three of one scalar type, float or AutoDiffXd."""


@dataclass(frozen=True)
class DiagramModel:
    """A Diagram with one group of discrete state as a planning model for CA-OED and CA-MAP.

    `robot` lists the indices of the robot's positions, then of its velocities, in that state: they follow the
    prescribed motion, whatever forces act. The output port named `measurement_port` gives the measurement, which
    depends on the state and on θ. Derivatives are computed by AutoDiffXd through the Diagram. The methods are those of
    `PlanningModel`.
    """

    diagram: Diagram
    set_parameters: SetParameters
    parameters: Parameters
    noise_std: Array
    robot: Sequence[int]
    measurement_port: str
    period: float  # s, a whole number of the Diagram's own steps
    workspace_lower: tuple[float, ...]
    workspace_upper: tuple[float, ...]
    speed_limit: float
    planning_cost: Callable[[Rollout, Array], Array] | None = None  # (B,) of a rollout at θ

    def __post_init__(self) -> None:
        groups = self.diagram.CreateDefaultContext().num_discrete_state_groups()
        if groups != 1:
            raise InputError(f"DiagramModel: {groups} groups of discrete state, expected exactly one")
        steps = self.period / self._step_length
        if abs(steps - round(steps)) > 1e-6:
            raise InputError(
                f"DiagramModel: period {self.period} s is {steps:g} of the Diagram's steps, expected a whole number"
            )

    @cached_property
    def _step_length(self) -> float:
        timing = self.diagram.GetUniquePeriodicDiscreteUpdateAttribute()
        if timing is None:
            raise InputError("DiagramModel: the Diagram has no unique periodic discrete update")
        return float(timing.period_sec())

    @cached_property
    def _double(self) -> tuple[Any, Any]:
        return self.diagram, self.diagram.CreateDefaultContext()

    @cached_property
    def _automatic(self) -> tuple[Any, Any]:
        converted = self.diagram.ToAutoDiffXd()
        context = converted.CreateDefaultContext()
        # a plant's default pose does not survive the conversion
        context.SetTimeStateAndParametersFrom(self.diagram.CreateDefaultContext())
        return converted, context

    @property
    def substeps(self) -> int:
        return round(self.period / self._step_length)

    @cached_property
    def _default_state(self) -> Array:
        return np.array(self.diagram.CreateDefaultContext().get_discrete_state_vector().CopyToVector())

    @property
    def state_size(self) -> int:
        return len(self._default_state)

    @property
    def velocity_bounds(self) -> tuple[Array, Array]:
        bound = np.full(len(self.robot) // 2, self.speed_limit)
        return -bound, bound

    def motion(self, robot_state: Array, commands: Array) -> Array:
        """p' = p + u·period, clipped to the workspace, and the mean velocity (p' − p)/period."""
        size = commands.shape[-1]
        lower, upper = np.asarray(self.workspace_lower), np.asarray(self.workspace_upper)
        states = np.empty((commands.shape[0], commands.shape[1] + 1, 2 * size))
        states[:, 0] = robot_state
        for index in range(commands.shape[1]):
            position = states[:, index, :size]
            following = np.clip(position + self.period * commands[:, index], lower, upper)
            states[:, index + 1] = np.concatenate([following, (following - position) / self.period], axis=-1)
        return self.measured_motion(states)

    def measured_motion(self, robot_states: Array) -> Array:
        """The measured states; between them, at substeps, linear positions and the velocity of the period's end."""
        size, steps = robot_states.shape[-1] // 2, self.substeps
        fraction = (np.arange(1, steps + 1) / steps)[:, np.newaxis]
        before, after = robot_states[..., :-1, np.newaxis, :], robot_states[..., 1:, np.newaxis, :]
        position = before[..., :size] + fraction * (after[..., :size] - before[..., :size])
        velocity = np.broadcast_to(after[..., size:], position.shape)
        fine = np.concatenate([position, velocity], axis=-1).reshape(*robot_states.shape[:-2], -1, 2 * size)
        return np.concatenate([robot_states[..., :1, :], fine], axis=-2)

    def start(self, motion: Array, theta: Array) -> Start:
        """The Diagram's default state, with the robot's part from `motion`; it does not depend on θ."""
        state = self._default_state.copy()
        state[list(self.robot)] = motion
        return Start(state, np.zeros((len(state), len(theta))))

    def contact(self, state: Array, motion: Array, theta: Array) -> Array:
        """The Diagram's measurement (..., ny), which takes the place of the contact force."""
        return self._rows(self._read, state, motion, theta)

    def step(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Array:
        """The Diagram's state after one of its steps, with the robot's part from `following`."""

        def advance(system: Any, context: Any) -> Any:
            return system.EvalUniquePeriodicDiscreteUpdate(context).value(0).copy()

        stepped = self._rows(advance, state, motion, theta)
        stepped[..., list(self.robot)] = following
        return stepped

    def measurement(self, state: Array, motion: Array, force: Array, theta: Array) -> Array:
        return force

    def contact_jacobians(self, state: Array, motion: Array, theta: Array) -> Jacobians:
        return self._differentiate(lambda x, values: self.contact(x, motion, values), state, theta)

    def step_jacobians(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Jacobians:
        return self._differentiate(lambda x, values: self.step(x, motion, following, force, values), state, theta)

    def measurement_jacobians(self, state: Array, motion: Array, force: Array, theta: Array) -> Jacobians:
        size = force.shape[-1]
        return Jacobians(force, np.zeros((size, self.state_size)), np.eye(size), np.zeros((size, len(theta))))

    def cost(self, rollout: Rollout, theta: Array) -> Array:
        if self.planning_cost is None:
            return np.zeros(len(rollout.motion))
        return self.planning_cost(rollout, theta)

    def touching(self, forces: Array) -> Array:
        return np.asarray((np.asarray(forces) ** 2).sum(axis=-1) > 0)

    def script(self, time: float, robot_state: Array, theta: Array) -> Array:
        return np.zeros(len(self.robot) // 2)

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        size, touching = len(self.robot) // 2, self.touching(forces)
        return {
            "first_contact": float((np.argmax(touching) + 1) * self.period) if touching.any() else None,
            "contact_fraction": float(touching.mean()),
            "airborne_fraction": 0.0,
            "sliding_fraction": 0.0,
            "reversals": max(count_reversals(motion[1:, size + axis]) for axis in range(size)),
            "make_breaks": count_make_breaks(touching),
            "faces": [],
            "max_force": float(np.abs(forces).max()),
        }

    def _read(self, system: Any, context: Any) -> Any:
        return np.array(system.GetOutputPort(self.measurement_port).Eval(context))

    def _rows(self, function: Callable[[Any, Any], Any], state: Array, motion: Array, theta: Array) -> Array:
        """`function` of the Diagram and its context at each state (..., nx) and motion (..., nr), (..., k)."""
        automatic = state.dtype == object or np.asarray(theta).dtype == object
        system, context = self._automatic if automatic else self._double
        self.set_parameters(system, context, theta)
        states = state.reshape(-1, state.shape[-1])
        motions = np.broadcast_to(motion, (*state.shape[:-1], motion.shape[-1])).reshape(len(states), -1)
        rows = []
        for x, r in zip(states, motions, strict=True):
            placed = np.array(x, dtype=object if automatic else float)
            placed[list(self.robot)] = r
            context.SetDiscreteState(placed)
            rows.append(function(system, context))
        return np.stack(rows).reshape(*state.shape[:-1], -1)

    def _differentiate(self, function: Callable[[Array, Array], Array], state: Array, theta: Array) -> Jacobians:
        """Value and derivatives of `function` of state and θ by AutoDiffXd; all rows share the same nx + n seeds."""
        nx, flat = state.shape[-1], state.reshape(-1, state.shape[-1])
        origin: Any = np.concatenate([np.zeros(nx), theta])
        seeds: Any = InitializeAutoDiff(origin).ravel()
        value: Any = function((flat + seeds[:nx]).reshape(state.shape), seeds[nx:])
        # the prescribed robot states are constants without derivatives: adding zero gives them zero derivatives
        rows: Any = (value + 0.0 * seeds[0]).reshape(-1, 1)
        plain = np.asarray(ExtractValue(rows)).reshape(value.shape)
        gradient: Any = ExtractGradient(rows)
        gradient = gradient.reshape((*value.shape, nx + len(theta)))
        nothing = np.zeros((value.shape[-1], self._force_size))
        return Jacobians(plain, gradient[..., :nx], nothing, gradient[..., nx:])

    @cached_property
    def _force_size(self) -> int:
        return int(self.diagram.GetOutputPort(self.measurement_port).size())
