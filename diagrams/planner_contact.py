"""The planner's contact law as a Drake system that applies its force to the tool: the contact of world `model`.

For float and AutoDiffXd.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce_
from pydrake.multibody.plant import ExternallyAppliedSpatialForce_
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class TouchedPoint:
    """A point T of a body, at p_BT (3,) m, where the contact force acts, along `directions` (nλ, 3) in W."""

    body: BodyIndex
    p_BT: Array
    directions: Array


@TemplateSystem.define("PlannerContact_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def PlannerContact_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """The force λ = contact(r, θ) of a planning model whose touched object is fixed, applied to the tool.

        .. pydrake_system::

            name: PlannerContact
            input_ports: [tool_state]
            output_ports: [spatial_forces, contact_force]

        `tool_state` (2 nu,) is the measured motion r; `contact_force` is λ (nλ,) N; connect `spatial_forces` to the
        plant's applied_spatial_force. θ (n,) is numeric parameter 0.
        """

        def _construct(
            self,
            model: PlanningModel,
            theta: Array,
            *,
            coordinates: int,
            points: Sequence[TouchedPoint],
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter)
            self._model, self._coordinates, self._points = model, coordinates, points
            self._theta = np.asarray(theta, dtype=float)
            self.DeclareNumericParameter(BasicVector_[T](self._theta))
            self.DeclareVectorInputPort("tool_state", 2 * coordinates)
            count = len(model.contact(np.zeros(0), np.zeros(2 * coordinates), self._theta))
            allocate: Any = Value[list[ExternallyAppliedSpatialForce_[T]]]
            self.DeclareAbstractOutputPort("spatial_forces", allocate, self._calc_applied)
            self.DeclareVectorOutputPort("contact_force", count, self._calc_force)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(
                self,
                other._model,
                other._theta,
                coordinates=other._coordinates,
                points=other._points,
                converter=converter,
            )

        def _calc_force(self, context: Any, output: Any) -> None:
            motion = np.asarray(self.get_input_port().Eval(context))
            theta = context.get_numeric_parameter(0).CopyToVector()
            output.SetFromVector(self._model.contact(np.zeros(0), motion, theta))

        def _calc_applied(self, context: Any, output: Any) -> None:
            force = np.asarray(self.GetOutputPort("contact_force").Eval(context))
            applied = []
            for point in self._points:
                item = ExternallyAppliedSpatialForce_[T]()
                item.body_index = point.body
                item.p_BoBq_B = point.p_BT
                item.F_Bq_W = SpatialForce_[T](tau=np.zeros(3), f=force @ point.directions)
                applied.append(item)
            output.set_value(applied)

    return Impl


PlannerContact = PlannerContact_[float]
