"""Forces on bodies as systems that give spatial forces."""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import LeafSystem

from drake_cafim.corrected.reading import read
from drake_cafim.dynamics.motion import Motion, motion
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.body import BodyForce
from drake_cafim.typing import Array


class BodyForceSystem(LeafSystem):
    """The force of a body effect at its point.

    .. pydrake_system::

        name: BodyForceSystem
        input_ports: [state]
        output_ports: [spatial_forces]

    `state` (2n,) positions then velocities of the joints of `tree`; connect `spatial_forces` to the plant's
    applied_spatial_force. The Context's time is the recording's.
    """

    def __init__(self, effect: BodyForce, tree: Tree, body: BodyIndex) -> None:
        LeafSystem.__init__(self)
        self.effect, self._tree, self._index = effect, tree, body
        self._body = tree.body(effect.at)
        self._p_BP = effect.point(self._body)
        self.DeclareVectorInputPort("state", 2 * len(tree.joints))
        allocate: Any = Value[list[ExternallyAppliedSpatialForce]]
        self.DeclareAbstractOutputPort("spatial_forces", allocate, self._calc_applied)

    def _calc_applied(self, context: Any, output: Any) -> None:
        body = self._body
        moving = motion_at(self._tree, read(self.get_input_port(), context))
        p_WP, v_WP = moving.point(body.joint, body.p_JB + body.R_JB @ self._p_BP)
        recording = getattr(self.effect, "recording", None)
        force = self.effect.force(p_WP, v_WP, np.array([context.get_time()]), recording)[0]
        output.set_value([applied(self._index, self._p_BP, np.zeros(3), force)])


def motion_at(tree: Tree, state: Array) -> Motion:
    """The motion of the tree in one state (2n,)."""
    n = len(tree.joints)
    return motion(tree, np.array(state[None, :n]), np.array(state[None, n:]))


def applied(body: BodyIndex, p_BoBq_B: Array, moment: Array, force: Array) -> ExternallyAppliedSpatialForce:
    """A moment (3,) N m and a force (3,) N, world axes, at a point of a body."""
    one = ExternallyAppliedSpatialForce()
    one.body_index = body
    one.p_BoBq_B = p_BoBq_B
    one.F_Bq_W = SpatialForce(tau=moment, f=force)
    return one
