"""What a wrench sensor and a motion tracker would record of the body that touches, as output ports of a world."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder

from drake_cafim.corrected.drake_contact import DrakeContactWrench, about_origin
from drake_cafim.diagrams.arrays import as_array


class AppliedWrench(LeafSystem):
    """The sum of those externally applied spatial forces that act on one body.

    .. pydrake_system::

        name: AppliedWrench
        input_ports: [spatial_forces, body_poses]
        output_ports: [wrench]

    `wrench` (6,) N m and N on `body` is about the world's origin, moment first, in world axes.
    """

    def __init__(self, body: BodyIndex) -> None:
        LeafSystem.__init__(self)
        self._body = body
        forces: Any = Value[list[ExternallyAppliedSpatialForce]]
        self.DeclareAbstractInputPort("spatial_forces", forces())
        self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        applied: Any = self.get_input_port(0).Eval(context)
        poses: Any = self.get_input_port(1).Eval(context)
        total = np.zeros(6)
        for each in applied:
            if each.body_index == self._body:
                p_WBq = np.asarray(poses[int(self._body)].multiply(each.p_BoBq_B))
                total += about_origin(p_WBq, each.F_Bq_W.rotational(), each.F_Bq_W.translational())
        output.SetFromVector(as_array(total))


class TrackedPose(LeafSystem):
    """The pose of one body, as a motion tracker sees it.

    .. pydrake_system::

        name: TrackedPose
        input_ports: [body_poses]
        output_ports: [pose]

    `pose` (7,) is X_WB: x y z in m, quaternion w x y z.
    """

    def __init__(self, body: BodyIndex) -> None:
        LeafSystem.__init__(self)
        self._body = int(body)
        self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("pose", 7, self._calc_pose)

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        poses: Any = self.get_input_port().Eval(context)
        X_WB = poses[self._body]
        output.SetFromVector(as_array([*X_WB.translation(), *X_WB.rotation().ToQuaternion().wxyz()]))


def drake_wrench(builder: DiagramBuilder, plant: MultibodyPlant, bodies: Sequence[str]) -> OutputPort:
    """The wrench (6,) of Drake's contacts on `bodies`, which form one link, about the world's origin, moment first."""
    sensor = builder.AddNamedSystem("contact_wrench", DrakeContactWrench(plant, bodies))
    builder.Connect(plant.get_contact_results_output_port(), sensor.get_input_port())
    return sensor.get_output_port()


def applied_wrench(
    builder: DiagramBuilder, plant: MultibodyPlant, spatial_forces: OutputPort, body: RigidBody
) -> OutputPort:
    """The wrench (6,) of `spatial_forces` on `body`, about the world's origin, moment first."""
    sensor = builder.AddNamedSystem("contact_wrench", AppliedWrench(body.index()))
    builder.Connect(spatial_forces, sensor.get_input_port(0))
    builder.Connect(plant.get_body_poses_output_port(), sensor.get_input_port(1))
    return sensor.get_output_port()


def export_touch(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    wrench: OutputPort,
    tracked: RigidBody,
    concealed: Sequence[OutputPort] = (),
) -> None:
    """Exports `contact_wrench` (6,), `wrench` with what effects on contacts add, and `tracked_pose` (7,), X_WB.

    Wrenches are about the world's origin, in its axes, moment N m first.
    """
    if concealed:
        total = builder.AddNamedSystem("contact_wrench with what is concealed", Adder(1 + len(concealed), 6))
        for number, port in enumerate((wrench, *concealed)):
            builder.Connect(port, total.get_input_port(number))
        wrench = total.get_output_port()
    builder.ExportOutput(wrench, "contact_wrench")
    tracker = builder.AddNamedSystem("tracker", TrackedPose(tracked.index()))
    builder.Connect(plant.get_body_poses_output_port(), tracker.get_input_port())
    builder.ExportOutput(tracker.get_output_port(), "tracked_pose")
