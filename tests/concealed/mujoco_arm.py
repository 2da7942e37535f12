"""The arm in MuJoCo: one model that holds a copy of the robot for each recording of the batch."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from .inverse import Moving
from .laws import BodyLaw
from .robots import Array, Robot


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _body_xml(robot: Robot, index: int, copy: int) -> str:
    link, joint = robot.links[index], robot.joints[index]
    x, y, z, w = Rotation.from_euler("xyz", joint.rpy).as_quat()
    i = link.inertia
    inertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    kind = "hinge" if joint.kind == "revolute" else "slide"
    inside = "".join(
        _body_xml(robot, child, copy) for child in range(index + 1, robot.size) if robot.joints[child].parent == index
    )
    return (
        f'<body name="{link.name}_{copy}" pos="{_numbers(joint.origin)}" quat="{_numbers(np.array([w, x, y, z]))}">'
        f'<inertial pos="{_numbers(link.com)}" mass="{link.mass!r}" fullinertia="{_numbers(np.array(inertia))}"/>'
        f'<joint name="{joint.name}_{copy}" type="{kind}" axis="{_numbers(joint.axis)}" '
        f'armature="{joint.rotor_inertia!r}" damping="{joint.damping!r}"/>{inside}</body>'
    )


def mjcf(robot: Robot, copies: int) -> str:
    """The model as MJCF: no contact, no limits, joint axes and inertias exactly those of the URDF."""
    roots = [index for index in range(robot.size) if robot.joints[index].parent < 0]
    bodies = "".join(_body_xml(robot, root, copy) for copy in range(copies) for root in roots)
    return (
        f'<mujoco model="{robot.name}"><compiler angle="radian" autolimits="false"/>'
        f'<option gravity="{_numbers(robot.gravity)}">'
        '<flag contact="disable" constraint="disable" eulerdamp="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )


class ArmPlant:
    """Accelerations of `copies` arms at once; the parts of joints behind a transmission lose their rotor inertia."""

    hidden = 0

    def __init__(self, robot: Robot, copies: int, bodies: tuple[BodyLaw, ...] = ()) -> None:
        self.robot, self.copies, self.bodies = robot, copies, bodies
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot, copies))
        self.data = mujoco.MjData(self.model)
        n = robot.size
        order = [self.model.joint(f"{joint.name}_{copy}").dofadr[0] for copy in range(copies) for joint in robot.joints]
        if not np.array_equal(order, np.arange(copies * n)):
            raise ValueError("joints are to be in the engine's order, depth first")
        data = self.data
        # the engine's own arrays, each looked up once and seen as (copies, n)
        self._q, self._v, self._applied, self._found = (
            own.reshape(copies, n) for own in (data.qpos, data.qvel, data.qfrc_applied, data.qacc_smooth)
        )
        self._rows = [
            np.array([self.model.body(f"{robot.links[law.link].name}_{copy}").id for copy in range(copies)])
            for law in bodies
        ]
        self._touching = [index for index, law in enumerate(bodies) if law.boundary is not None]

    def _place(self, q: Array, v: Array) -> None:
        self._q[:], self._v[:] = q, v
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)

    def acceleration(self, t: Array, q: Array, v: Array, z: Array, mode: np.ndarray, tau: Array) -> tuple[Array, Array]:
        """(B, n) under the joint efforts tau (B, n)."""
        self._place(q, v)
        if self.bodies:
            self._apply(t)
        self._applied[:] = tau
        mujoco.mj_fwdAcceleration(self.model, self.data)
        return self._found.copy(), z

    def _apply(self, t: Array) -> None:
        self.data.xfrc_applied[:] = 0.0
        for law, rows in zip(self.bodies, self._rows, strict=True):
            p, rotation, v, omega = self._point(law, rows)
            force, point = law.force(t, p, rotation, v, omega)
            self.data.xfrc_applied[rows, :3] += force
            self.data.xfrc_applied[rows, 3:] += np.cross(point - self.data.xipos[rows], force)

    def _point(self, law: BodyLaw, rows: np.ndarray) -> tuple[Array, Array, Array, Array]:
        rotation = self.data.xmat[rows].reshape(-1, 3, 3)
        p = self.data.xpos[rows] + rotation @ law.point_of_body
        omega = self.data.cvel[rows, :3]
        origin = self.data.subtree_com[self.model.body_rootid[rows]]
        return p, rotation, self.data.cvel[rows, 3:] + np.cross(omega, p - origin), omega

    def boundary(self, t: Array, q: Array, v: Array, z: Array) -> Array:
        """(B, m): positive where a body law's point touches."""
        if not self._touching:
            return np.zeros((len(q), 0))
        self._place(q, v)
        columns = []
        for index in self._touching:
            law = self.bodies[index]
            p, _, _, _ = self._point(law, self._rows[index])
            assert law.boundary is not None
            columns.append(law.boundary(t, p))
        return np.column_stack(columns)

    def initial_hidden(self, q: Array) -> Array:
        return np.zeros((len(q), 0))


class ArmInverse:
    """Inverse dynamics, mass matrix and body points of one arm, for tests, excitations and strengths."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot, 1))
        self.data = mujoco.MjData(self.model)
        self._order = np.array([self.model.joint(f"{joint.name}_0").dofadr[0] for joint in robot.joints])
        self._full = np.zeros((self.model.nv, self.model.nv))

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """M a + bias + damping v for rows of q, v, a (N, n)."""
        return Moving(self.robot, q, v, a).efforts()

    def mass_matrix(self, q: Array) -> Array:
        """(n, n) at q (n,)."""
        self.data.qpos[self._order] = q
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fullM(self.model, self.data, self._full)
        return self._full[np.ix_(self._order, self._order)].copy()

    def point(self, q: Array, link: int, point: Array) -> Array:
        """World positions (N, 3) of a point of a link."""
        body = self.model.body(f"{self.robot.links[link].name}_0").id
        out = np.empty((len(q), 3))
        for row in range(len(q)):
            self.data.qpos[self._order] = q[row]
            mujoco.mj_kinematics(self.model, self.data)
            out[row] = self.data.xpos[body] + self.data.xmat[body].reshape(3, 3) @ point
        return out
