"""A planning model as a Drake Diagram, for float and AutoDiffXd: systems for the contact and the touched object."""

from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, Diagram, DiagramBuilder, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@TemplateSystem.define("ModelContact_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def ModelContact_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """The model's contact force and measurement.

        .. pydrake_system::

            name: ModelContact
            input_ports: [motion, object_state]
            output_ports: [contact_force, measurement]

        θ is numeric parameter 0. The port `object_state` exists if the touched object has a state.
        """

        def _construct(self, model: PlanningModel, motion_size: int, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter)
            self.model, self.motion_size = model, motion_size
            theta = model.parameters.mean
            self.DeclareNumericParameter(BasicVector_[T](theta))
            self.DeclareVectorInputPort("motion", motion_size)
            if model.state_size:
                self.DeclareVectorInputPort("object_state", model.state_size)
            rest = model.contact(np.zeros(model.state_size), np.zeros(motion_size), theta)
            self.DeclareVectorOutputPort("contact_force", len(rest), self._calc_force)
            self.DeclareVectorOutputPort("measurement", len(model.noise_std), self._calc_measurement)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other.model, other.motion_size, converter=converter)

        def _inputs(self, context: Any) -> tuple[Any, Any, Any]:
            motion = np.asarray(self.get_input_port(0).Eval(context))
            state = np.zeros(0)
            if self.model.state_size:
                state = np.asarray(self.get_input_port(1).Eval(context))
            return state, motion, context.get_numeric_parameter(0).CopyToVector()

        def _calc_force(self, context: Any, output: Any) -> None:
            output.SetFromVector(self.model.contact(*self._inputs(context)))

        def _calc_measurement(self, context: Any, output: Any) -> None:
            state, motion, theta = self._inputs(context)
            force = np.asarray(self.get_output_port(0).Eval(context))
            output.SetFromVector(self.model.measurement(state, motion, force, theta))

    return Impl


@TemplateSystem.define("ModelObject_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def ModelObject_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """The touched object, stepped in discrete time.

        .. pydrake_system::

            name: ModelObject
            input_ports: [motion, following_motion, contact_force]
            output_ports: [object_state]

        θ is numeric parameter 0; the discrete state is the model's.
        """

        def _construct(self, model: PlanningModel, motion_size: int, force_size: int, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter)
            self.model, self.motion_size, self.force_size = model, motion_size, force_size
            self.DeclareNumericParameter(BasicVector_[T](model.parameters.mean))
            self.DeclareVectorInputPort("motion", motion_size)
            self.DeclareVectorInputPort("following_motion", motion_size)
            self.DeclareVectorInputPort("contact_force", force_size)
            state = self.DeclareDiscreteState(model.state_size)
            self.DeclareStateOutputPort("object_state", state)
            self.DeclarePeriodicDiscreteUpdateEvent(model.period / model.substeps, 0.0, self._update)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other.model, other.motion_size, other.force_size, converter=converter)

        def _update(self, context: Any, state: Any) -> None:
            motion, following, force = (np.asarray(self.get_input_port(i).Eval(context)) for i in range(3))
            theta = context.get_numeric_parameter(0).CopyToVector()
            x = context.get_discrete_state_vector().CopyToVector()
            state.get_mutable_vector().SetFromVector(self.model.step(x, motion, following, force, theta))

    return Impl


def build_diagram(model: PlanningModel, motion_size: int) -> Diagram:
    """The model's Diagram: inputs `motion` and `following_motion` (nr,), outputs `contact_force`, `measurement`.

    Its subsystems are "contact" and, if the touched object has a state, "object".
    """
    builder = DiagramBuilder()
    contact = builder.AddNamedSystem("contact", ModelContact_[float](model, motion_size))
    builder.ExportInput(contact.GetInputPort("motion"), "motion")
    if model.state_size:
        force = contact.GetOutputPort("contact_force")
        body = builder.AddNamedSystem("object", ModelObject_[float](model, motion_size, force.size()))
        builder.ConnectInput("motion", body.GetInputPort("motion"))
        builder.ExportInput(body.GetInputPort("following_motion"), "following_motion")
        builder.Connect(force, body.GetInputPort("contact_force"))
        builder.Connect(body.GetOutputPort("object_state"), contact.GetInputPort("object_state"))
    builder.ExportOutput(contact.GetOutputPort("contact_force"), "contact_force")
    builder.ExportOutput(contact.GetOutputPort("measurement"), "measurement")
    return builder.Build()


def set_parameters(diagram: Diagram, context: Any, theta: Array) -> None:
    """Write θ (n,), of the Diagram's scalar type, to numeric parameter 0 of every subsystem."""
    for leaf in diagram.GetSystems():
        parameter = leaf.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(0)
        parameter.SetFromVector(theta)
