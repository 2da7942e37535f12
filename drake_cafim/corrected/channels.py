"""Ideal wrench and pose sensors as Drake systems."""

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.body_forces import motion_at
from drake_cafim.corrected.reading import array, read
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.tree import FIXED, Body, Tree


class TrueWrench(LeafSystem):
    """The reading of an ideal wrench sensor.

    .. pydrake_system::

        name: TrueWrench
        input_ports: [state, wrench_0, ...]
        output_ports: [wrench]

    `state` (2n,) positions then velocities of the joints of `tree`; `count` wrenches (6,) on the bodies fixed to the
    sensor's joint, about the world's origin, moment first. `wrench` (6,) is their sum as force N then torque N m, in
    the sensor's axes about its origin.
    """

    def __init__(self, tree: Tree, sensor: WrenchSensor, count: int) -> None:
        LeafSystem.__init__(self)
        self._tree, self._sensor, self._count = tree, sensor, count
        self.DeclareVectorInputPort("state", tree.state_size)
        for k in range(count):
            self.DeclareVectorInputPort(f"wrench_{k}", 6)
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        moving = motion_at(self._tree, read(self.get_input_port(0), context))
        total = np.zeros((1, 6))
        for k in range(self._count):
            total += read(self.get_input_port(1 + k), context)
        output.SetFromVector(array(self._sensor.reading(moving, total)[0]))


class TruePose(LeafSystem):
    """The pose of a tracked body.

    .. pydrake_system::

        name: TruePose
        input_ports: [state]
        output_ports: [pose]

    `state` (2n,) positions then velocities of the joints of `tree`, or (13,) of a floating one; `pose` (7,) is X_WB:
    x y z m, quaternion w x y z.
    """

    def __init__(self, tree: Tree, body: Body) -> None:
        LeafSystem.__init__(self)
        self._tree, self._body = tree, body
        self.DeclareVectorInputPort("state", tree.state_size)
        self.DeclareVectorOutputPort("pose", 7, self._calc_pose)

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        body = self._body
        moving = motion_at(self._tree, read(self.get_input_port(), context))
        p_WB, _ = moving.point(body.joint, body.p_JB)
        R_WB = body.R_JB if body.joint == FIXED else moving.R_WJ[0, body.joint] @ body.R_JB
        output.SetFromVector(array(np.concatenate([p_WB[0], Quaternion(R_WB).wxyz()])))
