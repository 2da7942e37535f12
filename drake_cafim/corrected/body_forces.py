"""Body force effects as Drake systems with spatial forces as output."""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.reading import array, read
from drake_cafim.dynamics.motion import Motion, free_motion, motion
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.body import BodyForce
from drake_cafim.typing import Array


class BodyForceSystem(LeafSystem):
    """The force of a body effect at its point of application.

    .. pydrake_system::

        name: BodyForceSystem
        input_ports: [state]
        output_ports: [spatial_forces, force]

    `state` (2n,) positions then velocities of the joints of `tree`, or (13,) of a floating one;
    connect `spatial_forces` to the plant's applied_spatial_force, or add `force` (n,) N m or N, its generalized force
    Jᵀf, to the plant's generalized force. The Context's time is the recording's time.
    """

    def __init__(self, effect: BodyForce, tree: Tree, body: BodyIndex) -> None:
        LeafSystem.__init__(self)
        self.effect, self._tree, self._index = effect, tree, body
        self._body = tree.body(effect.at)
        self._p_BP = effect.point(self._body)
        self.DeclareVectorInputPort("state", tree.state_size)
        allocate: Any = Value[list[ExternallyAppliedSpatialForce]]
        self.DeclareAbstractOutputPort("spatial_forces", allocate, self._calc_applied)
        self.DeclareVectorOutputPort("force", len(tree.joints), self._calc_force)

    def _force(self, context: Context) -> Array:
        """The force (3,) N at the effect's point, world axes."""
        body = self._body
        p_WP, v_WP = self._moving(context).point(body.joint, body.p_JB + body.R_JB @ self._p_BP)
        recording = self.effect.episode.recording if self.effect.episode is not None else None
        return array(self.effect.force(p_WP, v_WP, np.array([context.get_time()]), recording)[0])

    def _moving(self, context: Context) -> Motion:
        return motion_at(self._tree, read(self.get_input_port(), context))

    def _calc_applied(self, context: Any, output: Any) -> None:
        output.set_value([applied(self._index, self._p_BP, np.zeros(3), self._force(context))])

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        body = self._body
        unit = self._moving(context).force_at(body.joint, body.p_JB + body.R_JB @ self._p_BP)
        output.SetFromVector(array(unit[0] @ self._force(context)))


def motion_at(tree: Tree, state: Array) -> Motion:
    """The tree's kinematics (one sample) at the state (2n,), positions then velocities; (13,) of a floating body."""
    if tree.floating:
        return free_motion(tree, state[None])
    n = len(tree.joints)
    return motion(tree, np.array(state[None, :n]), np.array(state[None, n:]))


def applied(body: BodyIndex, p_BoBq_B: Array, moment: Array, force: Array) -> ExternallyAppliedSpatialForce:
    """Drake's applied force for a moment (3,) N m and a force (3,) N, world axes, at the point `p_BoBq_B` of a body."""
    result = ExternallyAppliedSpatialForce()
    result.body_index = body
    result.p_BoBq_B = p_BoBq_B
    result.F_Bq_W = SpatialForce(tau=moment, f=force)
    return result
