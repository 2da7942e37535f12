"""The planner's contact law as a Drake system that applies its force to the tool: the contact of world `model`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class TouchedPoint:
    """A point T of a body, at p_BT (3,) m, where the contact force acts, along `directions` (nλ, 3) in W."""

    body: BodyIndex
    p_BT: Array
    directions: Array


class PlannerContact(LeafSystem):
    """The force λ = contact(r, θ) of a planning model whose touched object is fixed, applied to the tool.

    .. pydrake_system::

        name: PlannerContact
        input_ports: [tool_state]
        output_ports: [spatial_forces, contact_force]

    `tool_state` (2 nu,) is the measured motion r; `contact_force` is λ (nλ,) N; connect `spatial_forces` to the
    plant's applied_spatial_force.
    """

    def __init__(self, model: PlanningModel, theta: Array, *, coordinates: int, points: Sequence[TouchedPoint]) -> None:
        LeafSystem.__init__(self)
        self._model, self._theta, self._points = model, theta, points
        self._count = len(model.contact(np.zeros(0), np.zeros(2 * coordinates), theta))
        self.DeclareVectorInputPort("tool_state", 2 * coordinates)
        allocate: Any = Value[list[ExternallyAppliedSpatialForce]]
        self.DeclareAbstractOutputPort("spatial_forces", allocate, self._calc_applied)
        self.DeclareVectorOutputPort("contact_force", self._count, self._calc_force)

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        motion = as_array(self.get_input_port().Eval(context))
        output.SetFromVector(as_array(self._model.contact(np.zeros(0), motion, self._theta)))

    def _calc_applied(self, context: Any, output: Any) -> None:
        force = np.asarray(self.GetOutputPort("contact_force").Eval(context))
        applied = []
        for point in self._points:
            item = ExternallyAppliedSpatialForce()
            item.body_index = point.body
            item.p_BoBq_B = point.p_BT
            item.F_Bq_W = SpatialForce(tau=as_array(np.zeros(3)), f=as_array(force @ point.directions))
            applied.append(item)
        output.set_value(applied)
