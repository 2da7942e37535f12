"""Dry friction that grows with the load, in a discrete plant: the part beyond a brake, whose level is constant.

With A = M⁻¹ the joints' velocities at the end of a step h are v⁺ = v_free + h A f, with v_free from all other forces.
Each friction f_j brings its joint to rest if its level allows, and is at its level against the motion if not: a linear
complementarity problem, solved by projected Gauss-Seidel sweeps (Acary, Brogliato, Numerical Methods for Nonsmooth
Dynamical Systems, 2008, §13.7). Contact forces are not in v_free; only the brake balances them.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.brakes import beyond_brake, rest_level, sliding_speed
from drake_cafim.corrected.reading import array, read
from drake_cafim.corrected.second_order import dampings
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.typing import Array

SWEEPS = 30


class StickingFriction(LeafSystem):
    """The friction forces of several joints beyond their brakes.

    .. pydrake_system::

        name: StickingFriction
        input_ports: [plant_state, effort, force]
        output_ports: [friction]

    `plant_state` (nx,) is the plant's state; `effort` (n,) the acting efforts, on which the laws depend; `force` (n,)
    the sum of all other forces at the joints, the effort included; `friction` (n,) N m or N. `selection` (2n, nx) maps
    the plant's state to the joints' positions, then velocities.
    """

    def __init__(
        self, effects: Sequence[JointForce], joints: Sequence[int], plant: MultibodyPlant, selection: Array
    ) -> None:
        LeafSystem.__init__(self)
        n = len(selection) // 2
        self._effects, self._joints, self._plant = tuple(effects), tuple(joints), plant
        self._levels = [rest_level(effect) for effect in effects]
        self._pick_q, self._pick_v = selection[:n], selection[n:]
        self._places = selection[n:, plant.num_positions() :].T
        self._scratch, self._dampings = plant.CreateDefaultContext(), dampings(plant)
        self.DeclareVectorInputPort("plant_state", selection.shape[1])
        self.DeclareVectorInputPort("effort", n)
        self.DeclareVectorInputPort("force", n)
        self.DeclareVectorOutputPort("friction", n, self._calc_friction)

    def _calc_friction(self, context: Context, output: BasicVector) -> None:
        state, effort, force = (read(self.get_input_port(k), context) for k in range(3))
        free, A = self._free_motion(state, force)
        q, v = self._pick_q @ state, self._pick_v @ state
        bounds = [
            _bounds(effect, JointSamples(q[j : j + 1], v[j : j + 1], effort[j : j + 1]), level)
            for effect, j, level in zip(self._effects, self._joints, self._levels, strict=True)
        ]
        output.SetFromVector(array(sticking(free, self._plant.time_step() * A, self._joints, bounds)))

    def _free_motion(self, state: Array, force: Array) -> tuple[Array, Array]:
        """v_free (n,) rad/s or m/s at the end of the step without friction, and A = M⁻¹ (n, n) of the joints."""
        plant, context = self._plant, self._scratch
        plant.SetPositionsAndVelocities(context, state)
        v = state[plant.num_positions() :]
        A = np.linalg.inv(plant.CalcMassMatrix(context))
        bias = array(plant.CalcBiasTerm(context)) - array(plant.CalcGravityGeneralizedForces(context))
        free = v + plant.time_step() * (A @ (self._places @ force - bias - self._dampings * v))
        return np.asarray(self._places.T @ free), np.asarray(self._places.T @ A @ self._places)


def _bounds(effect: JointForce, joint: JointSamples, level: float) -> tuple[float, float]:
    """The smallest and the largest friction force beyond the brake, at the joint's speed and load."""
    speed = np.maximum(np.abs(joint.v), sliding_speed(effect))
    ends = [float(beyond_brake(effect, JointSamples(joint.q, sign * speed, joint.u), level)[0]) for sign in (1.0, -1.0)]
    return min(ends), max(ends)


def sticking(free: Array, change: Array, joints: Sequence[int], bounds: Sequence[tuple[float, float]]) -> Array:
    """The friction forces f (n,), zero except at `joints`, by projected Gauss-Seidel sweeps.

    They bring the velocity `free` + `change` f to zero at `joints`, as far as the bounds (smallest, largest) allow.
    """
    friction = np.zeros(len(free))
    for _ in range(SWEEPS):
        for j, (least, most) in zip(joints, bounds, strict=True):
            end = free[j] + change[j] @ friction
            friction[j] = min(max(friction[j] - end / change[j, j], least), most)
    return friction
