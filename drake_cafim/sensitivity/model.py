"""The interface of planning models: discrete-time contact models driven by the motion of the robot.

The robot's motion r (its end-effector, in the planner's coordinates) is commanded or measured and does not
depend on θ; the touched object may have a state x, which does:

    λ_t = contact(x_t, r_t, θ)      y_t = measurement(x_t, r_t, λ_t, θ)      x_{t+1} = step(x_t, r_t, r_{t+1}, λ_t, θ)

A measurement is read at the end of each period of the planner, after its command has acted.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drake_cafim.parameters import Parameters
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Jacobians:
    """A value (..., k) and its derivatives by state, contact force and parameters.

    wrt_state (..., k, nx), wrt_force (..., k, nλ), wrt_parameters (..., k, n); leading axes may broadcast.
    """

    value: Array
    wrt_state: Array
    wrt_force: Array
    wrt_parameters: Array


@dataclass(frozen=True)
class Start:
    """Initial state x_0 (nx,) of the touched object, and S_0 = ∂x_0/∂θ (nx, n)."""

    state: Array
    sensitivity: Array


@dataclass(frozen=True)
class Rollout:
    """A batch of predicted trajectories; the first axis is the candidate, the second time.

    motion (B, T+1, nr), states (B, T+1, nx) at the ends of the periods; forces (B, T, nλ),
    measurements (B, T, ny) and sensitivities G = dy/dθ (B, T, ny, n) after each command.
    `state_sensitivities` S = dx/dθ are (B, T+1, nx, n).
    """

    motion: Array
    states: Array
    forces: Array
    measurements: Array
    sensitivities: Array
    state_sensitivities: Array

    def window(self, first: int, last: int) -> "Rollout":
        """The rollout of periods first … last − 1."""
        return Rollout(
            self.motion[:, first : last + 1],
            self.states[:, first : last + 1],
            self.forces[:, first:last],
            self.measurements[:, first:last],
            self.sensitivities[:, first:last],
            self.state_sensitivities[:, first : last + 1],
        )


class PlanningModel(Protocol):
    """A model for the three evaluators, CA-OED and CA-MAP. Batch axes (...) come first; θ is (n,)."""

    @property
    def period(self) -> float:
        """Length of a planning step, s."""
        ...

    @property
    def substeps(self) -> int:
        """Integration steps in a period."""
        ...

    @property
    def parameters(self) -> Parameters:
        """The unknown parameters with priors and bounds; θ is in this order."""
        ...

    @property
    def noise_std(self) -> Array:
        """Standard deviation of one measurement's noise, (ny,)."""
        ...

    @property
    def state_size(self) -> int:
        """The size nx of the touched object's state; 0 if it does not move."""
        ...

    @property
    def velocity_bounds(self) -> tuple[Array, Array]:
        """Least and greatest commanded velocity, each (nu,), m/s."""
        ...

    def motion(self, robot_state: Array, commands: Array) -> Array:
        """Motion (B, T·substeps + 1, nr) from the robot state (2 nu,) under commands (B, T, nu) m/s."""
        ...

    def measured_motion(self, robot_states: Array) -> Array:
        """Motion (B, T·substeps + 1, nr) through measured robot states (B, T+1, 2 nu)."""
        ...

    def start(self, motion: Array, theta: Array) -> Start:
        """Initial state of the touched object while the robot is still at motion (nr,), with its sensitivity."""
        ...

    def contact(self, state: Array, motion: Array, theta: Array) -> Array:
        """Contact force λ (..., nλ) in N; scalar-generic, so that AutoDiffXd passes through.

        Without a state, and behind a force guard, θ may be (..., n), its leading axes broadcasting with the motion's.
        """
        ...

    def step(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Array:
        """Next state (..., nx) after one integration step; scalar-generic."""
        ...

    def measurement(self, state: Array, motion: Array, force: Array, theta: Array) -> Array:
        """Predicted measurement (..., ny); scalar-generic."""
        ...

    def contact_jacobians(self, state: Array, motion: Array, theta: Array) -> Jacobians:
        """`contact` with its analytic derivatives (no wrt_force)."""
        ...

    def step_jacobians(self, state: Array, motion: Array, following: Array, force: Array, theta: Array) -> Jacobians:
        """`step` with its analytic derivatives."""
        ...

    def measurement_jacobians(self, state: Array, motion: Array, force: Array, theta: Array) -> Jacobians:
        """`measurement` with its analytic derivatives."""
        ...

    def cost(self, rollout: Rollout, theta: Array) -> Array:
        """The cost (B,) that is subtracted from a motion's information score: force limits, workspace, distance."""
        ...

    def touching(self, forces: Array) -> Array:
        """Whether there is contact, (...,) bool, for forces (..., nλ)."""
        ...

    def script(self, time: float, robot_state: Array, theta: Array) -> Array:
        """The command (nu,) m/s of a reasonable fixed motion, the policy `scripted`."""
        ...

    def behaviour(self, motion: Array, forces: Array) -> Mapping[str, object]:
        """Statistics of an executed experiment for run.json, from motion (T+1, nr) and forces (T, nλ)."""
        ...
