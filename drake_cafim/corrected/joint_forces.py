"""Joint force effects as Drake systems with generalized forces as output."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.brakes import beyond_brake
from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.effects.bristle import bristle_after
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.typing import Array


class JointForceSystem(LeafSystem):
    """The generalized force of one joint force effect.

    .. pydrake_system::

        name: JointForceSystem
        input_ports: [state, effort]
        output_ports: [force]

    `state` (2n,) positions then velocities of the joints, `effort` (n,) the acting efforts; `force` (n,) N m or N is
    `effect.force` at element `joint`, plus `level`·tanh(v/w) where the plant has a brake of that level for the effect.
    Of a force that builds up with displacements, discrete state 0 (2,) is the position at the last update of `clock`,
    rad or m, and the state z there; they are NaN before the first one. Between updates z follows the position.
    """

    def __init__(
        self, effect: JointForce, joint: int, joints: int, level: float = 0.0, clock: Clock | None = None
    ) -> None:
        LeafSystem.__init__(self)
        self.effect, self._joint, self._joints, self._level = effect, joint, joints, level
        self.DeclareVectorInputPort("state", 2 * joints)
        self.DeclareVectorInputPort("effort", joints)
        self.DeclareVectorOutputPort("force", joints, self._calc_force)
        if effect.slip is not None:
            if clock is None:
                raise ValueError(f"{effect.name} at {effect.at} builds up with displacements, expected a clock")
            clock.keep(self, np.full(2, np.nan), self._update)

    def _samples(self, context: Context) -> JointSamples:
        state, u = read(self.get_input_port(0), context), read(self.get_input_port(1), context)
        j, n = self._joint, self._joints
        q, v, effort = (np.array(values) for values in (state[j : j + 1], state[n + j : n + j + 1], u[j : j + 1]))
        slip = self.effect.slip
        return JointSamples(q, v, effort, bristles=None if slip is None else {slip: self._bristle(context, q)})

    def _bristle(self, context: Context, q: Array) -> Array:
        """The state z (1,) at the position `q` (1,)."""
        before, z = discrete_state(context)
        assert self.effect.slip is not None
        return bristle_after(np.array([z]), q - before, self.effect.slip) if np.isfinite(z) else np.zeros(1)

    def _update(self, context: Context) -> Array:
        state = read(self.get_input_port(0), context)
        q = np.array(state[self._joint : self._joint + 1])
        return array(np.concatenate([q, self._bristle(context, q)]))

    def _force(self, context: Context) -> float:
        samples = self._samples(context)
        if self._level:
            return float(beyond_brake(self.effect, samples, self._level)[0])
        return float(self.effect.force(samples).value[0])

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        force = np.zeros(self._joints)
        force[self._joint] = self._force(context)
        output.SetFromVector(array(force))
