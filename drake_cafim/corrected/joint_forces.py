"""Joint force effects as Drake systems with generalized forces as output."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.brakes import beyond_brake
from drake_cafim.corrected.reading import array, read
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import JointSamples


class JointForceSystem(LeafSystem):
    """The generalized force of one joint force effect.

    .. pydrake_system::

        name: JointForceSystem
        input_ports: [state, effort]
        output_ports: [force]

    `state` (2n,) positions then velocities of the joints, `effort` (n,) the acting efforts; `force` (n,) N m or N is
    `effect.force` at element `joint`, plus `level`·tanh(v/w) where the plant has a brake of that level for the effect.
    """

    def __init__(self, effect: JointForce, joint: int, joints: int, level: float = 0.0) -> None:
        LeafSystem.__init__(self)
        self.effect, self._joint, self._joints, self._level = effect, joint, joints, level
        self.DeclareVectorInputPort("state", 2 * joints)
        self.DeclareVectorInputPort("effort", joints)
        self.DeclareVectorOutputPort("force", joints, self._calc_force)

    def _samples(self, context: Context) -> JointSamples:
        state, u = read(self.get_input_port(0), context), read(self.get_input_port(1), context)
        j, n = self._joint, self._joints
        return JointSamples(np.array(state[j : j + 1]), np.array(state[n + j : n + j + 1]), np.array(u[j : j + 1]))

    def _force(self, context: Context) -> float:
        samples = self._samples(context)
        if self._level:
            return float(beyond_brake(self.effect, samples, self._level)[0])
        return float(self.effect.force(samples).value[0])

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        force = np.zeros(self._joints)
        force[self._joint] = self._force(context)
        output.SetFromVector(array(force))
