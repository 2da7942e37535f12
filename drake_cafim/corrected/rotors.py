"""Joint couplings (elasticity, backlash) as Drake systems: the rotor's position and velocity are their state."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    EventStatus,
    LeafSystem,
    State,
)

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.effects.coupling import JointCoupling
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

MOST_TURN = 0.5
"""Largest ω h: rotor eigenfrequency on its coupling, rad/s, times a discrete plant's step; unstable from 2 on."""


class RotorSystem(LeafSystem):
    """A rotor of reflected inertia J, driven by the effort u and coupled to its link by the torque f: J θ̈ = u − f.

    .. pydrake_system::

        name: RotorSystem
        input_ports: [state, effort]
        output_ports: [force]

    `state` (2n,) positions then velocities of the joints, `effort` (n,) the efforts on their rotors; `force` (n,) N m
    or N is the effort with element `joint` replaced by f(θ − q, θ̇ − q̇). The plant's joint has no rotor inertia.
    """

    def __init__(self, effect: JointCoupling, inertia: float, joint: int, joints: int) -> None:
        LeafSystem.__init__(self)
        self.effect, self._inertia, self._joint, self._joints = effect, inertia, joint, joints
        self.DeclareVectorInputPort("state", 2 * joints)
        self.DeclareVectorInputPort("effort", joints)
        self.DeclareVectorOutputPort("force", joints, self._calc_force)

    def _rotor(self, context: Context) -> Array:
        """Position θ and velocity θ̇ of the rotor, (2,)."""
        raise NotImplementedError

    def _link(self, context: Context) -> Array:
        state = read(self.get_input_port(0), context)
        return np.array([state[self._joint], state[self._joints + self._joint]])

    def _effort(self, context: Context) -> float:
        return float(read(self.get_input_port(1), context)[self._joint])

    def _balanced(self, context: Context) -> Array:
        """(2,) The rotor's state in static equilibrium with the effort: the link's state plus the static twist."""
        twist = self.effect.balance(self._effort(context))
        return array(self._link(context) + np.array([twist, 0.0]))

    def _torque(self, context: Context) -> float:
        twist, rate = self._rotor(context) - self._link(context)
        return self.effect.torque(float(twist), float(rate))

    def _acceleration(self, context: Context) -> float:
        return (self._effort(context) - self._torque(context)) / self._inertia

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        force = read(self.get_input_port(1), context)
        force[self._joint] = self._torque(context)
        output.SetFromVector(array(force))


class DiscreteRotor(RotorSystem):
    """`RotorSystem` beside a discrete plant: discrete state 0 is θ, θ̇, stepped as Drake steps the link.

    It starts in static equilibrium with the first effort.
    """

    def __init__(self, effect: JointCoupling, inertia: float, joint: int, joints: int, clock: Clock) -> None:
        super().__init__(effect, inertia, joint, joints)
        self._period = clock.period
        clock.keep(self, np.full(2, np.nan), self._step)

    def _rotor(self, context: Context) -> Array:
        rotor = discrete_state(context)
        return rotor if np.isfinite(rotor[0]) else self._balanced(context)

    def _step(self, context: Context) -> Array:
        position, velocity = self._rotor(context)
        velocity += self._period * self._acceleration(context)
        return array(np.array([position + self._period * velocity, velocity]))


class ContinuousRotor(RotorSystem):
    """`RotorSystem` beside a continuous plant: continuous state θ, θ̇.

    At the first initialization of a Simulator it starts in static equilibrium with the effort; discrete state 0 is 1
    after that, so that a later initialization keeps the rotor's state.
    """

    def __init__(self, effect: JointCoupling, inertia: float, joint: int, joints: int) -> None:
        super().__init__(effect, inertia, joint, joints)
        self.DeclareContinuousState(2)
        self.DeclareDiscreteState(1)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)

    def _rotor(self, context: Context) -> Array:
        return np.array(context.get_continuous_state_vector().CopyToVector(), dtype=float)

    def _start(self, context: Context, state: State) -> EventStatus:
        if not discrete_state(context)[0]:
            state.get_mutable_continuous_state().SetFromVector(self._balanced(context))
            state.get_mutable_discrete_state(0).SetFromVector(array(np.ones(1)))
        return EventStatus.Succeeded()

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:
        velocity = float(self._rotor(context)[1])
        derivatives.SetFromVector(array([velocity, self._acceleration(context)]))


def rotor_system(effect: JointCoupling, inertia: float, joint: int, joints: int, clock: Clock | None) -> RotorSystem:
    """The rotor's system for a discrete plant with this `clock`, or for a continuous plant where that is None.

    Raises `InputError` for a joint without rotor inertia, and where the step is too long for the coupling's stiffness.
    """
    place = f"effect {effect.name} at {effect.at}"
    if inertia <= 0.0:
        raise InputError(f"{place}: the joint's rotor inertia is {inertia:g}, expected a positive value in the model")
    if clock is None:
        return ContinuousRotor(effect, inertia, joint, joints)
    rate = float(np.sqrt(effect.values["stiffness"] / inertia))
    if clock.period * rate > MOST_TURN:
        raise InputError(
            f"{place}: on its spring the rotor swings at {rate:.4g} rad/s, too fast for a step of {clock.period:g} s; "
            f"expected at most {MOST_TURN / rate:.2g} s, or 0 for a continuous plant"
        )
    return DiscreteRotor(effect, inertia, joint, joints, clock)
