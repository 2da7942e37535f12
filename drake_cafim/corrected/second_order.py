"""Makes the steps of a discrete plant second order in the velocities, as they are in the positions.

A step of length h of Drake's discrete plant is M(q_k) (v_{k+1} − v_k)/h = f(q_k) − C(q_k, v_k) v_k − D v_{k+1}, and
q_{k+1} = q_k + h v_{k+1}. Hence v_k is the velocity half a step before q_k, and acceleration, M and f belong to the
instant of q_k. The Coriolis term has the velocity half a step before that instant, and damping that half a step after:
a damping D looks like an additional inertia D h/2, which a diagnosis of many samples finds. With velocities that are
extrapolated by half a step (Adams and Bashforth), both belong to the instant of the acceleration as well.
"""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.typing import Array


class MidpointState(LeafSystem):
    """A state with its velocities half a step later, v_k + (v_k − v_{k−1})/2: those to which the acceleration belongs.

    .. pydrake_system::

        name: MidpointState
        input_ports: [state]
        output_ports: [midpoint]

    Both (n_q + n_v,), positions then velocities. Discrete state 0 holds the velocities (n_v,) before the last step, NaN
    before the first.
    """

    def __init__(self, positions: int, velocities: int, clock: Clock) -> None:
        LeafSystem.__init__(self)
        self._positions = positions
        self.DeclareVectorInputPort("state", positions + velocities)
        self.DeclareVectorOutputPort("midpoint", positions + velocities, self._calc_midpoint)
        clock.keep(self, np.full(velocities, np.nan), lambda context: self._velocity(context))

    def _velocity(self, context: Context) -> Array:
        return array(read(self.get_input_port(), context)[self._positions :])

    def _calc_midpoint(self, context: Context, output: BasicVector) -> None:
        state, before = read(self.get_input_port(), context), discrete_state(context)
        if np.isfinite(before).all():
            state[self._positions :] += 0.5 * (state[self._positions :] - before)
        output.SetFromVector(array(state))


class MidpointCorrection(LeafSystem):
    """The force that gives a discrete plant its Coriolis terms and its damping at the velocities of `MidpointState`.

    .. pydrake_system::

        name: MidpointCorrection
        input_ports: [plant_state, midpoint]
        output_ports: [force]

    `plant_state` (nx,) is the plant's state, `midpoint` (nx,) the same with velocities half a step later; `force` (n,)
    N m or N is C(q, v) v − C(q, v_m) v_m + D (v_m − v), of the velocities that `places` (n_v, n) selects. The plant
    applies D to the velocity after the step, which to second order is as far from v_m as v_m from v.
    """

    def __init__(self, plant: MultibodyPlant, places: Array) -> None:
        LeafSystem.__init__(self)
        self._plant, self._places, self._damping = plant, places, dampings(plant)
        self._scratch = plant.CreateDefaultContext()
        for name in ("plant_state", "midpoint"):
            self.DeclareVectorInputPort(name, plant.num_multibody_states())
        self.DeclareVectorOutputPort("force", places.shape[1], self._calc_force)

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        now, midpoint = (read(self.get_input_port(k), context) for k in range(2))
        change = (midpoint - now)[self._plant.num_positions() :]
        force = self._bias(now) - self._bias(midpoint) + self._damping * change
        output.SetFromVector(array(self._places.T @ force))

    def _bias(self, state: Array) -> Array:
        """C(q, v) v (n_v,)."""
        self._plant.SetPositionsAndVelocities(self._scratch, state)
        return array(self._plant.CalcBiasTerm(self._scratch))


def dampings(plant: MultibodyPlant) -> Array:
    """The damping coefficients (n_v,) of all velocities of the finalized plant's joints."""
    result = np.zeros(plant.num_velocities())
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        start = joint.velocity_start()
        result[start : start + joint.num_velocities()] = joint.default_damping_vector()
    return result
