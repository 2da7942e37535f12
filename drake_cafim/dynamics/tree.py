"""The kinematic tree and inertias of a Drake plant as plain arrays, for vectorised computation."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, QuaternionFloatingJoint, RevoluteJoint
from pydrake.systems.framework import Context

from drake_cafim.errors import InputError
from drake_cafim.typing import Array, Indices

OneAxisJoint: TypeAlias = RevoluteJoint | PrismaticJoint

FIXED = -1  # the joint index of bodies fixed in the world
FREE = 0  # the frame index of a floating body, whose tree has no joints


@dataclass(frozen=True)
class Joint:
    """A one-axis joint; frame J moves with the child and coincides with F on the parent at zero position."""

    name: str
    parent: int
    """Index of the joint whose moving frame the parent body is fixed in, `FIXED` for the world."""
    R_PF: Array
    p_PF: Array
    axis: Array
    prismatic: bool
    rotor_inertia: float
    damping: float
    position_limits: tuple[float, float]
    velocity_limit: float
    effort_limit: float

    @property
    def effort_unit(self) -> str:
        return "N" if self.prismatic else "N m"

    @property
    def position_unit(self) -> str:
        return "m" if self.prismatic else "rad"


@dataclass(frozen=True)
class Follower:
    """A joint that follows another one: q = multiplier · q_leader + offset; `leader` is an index of `Tree.joints`."""

    joint: Joint
    leader: int
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Body:
    """A rigid body fixed in the moving frame J of joint number `joint` of `Tree.moving`."""

    name: str
    joint: int
    R_JB: Array
    p_JB: Array
    mass: float
    p_BBcm: Array
    """Centre of mass in the body frame, m."""
    I_BBcm_B: Array
    """Rotational inertia about the centre of mass, (3, 3), body axes, kg m²."""


@dataclass(frozen=True)
class Tree:
    """Joints, parents before children, and the bodies fixed to them.

    The tree of a `floating` body has no joints: the body, with those welded to it, is frame `FREE`. `followers` have no
    coordinates of their own: what they move acts on their leaders. There are n joints and m moving frames.
    """

    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    floating: bool = False
    followers: tuple[Follower, ...] = ()

    @property
    def moving(self) -> tuple[Joint, ...]:
        """The m joints whose frames move: `joints`, then the followers."""
        return (*self.joints, *(follower.joint for follower in self.followers))

    @cached_property
    def following(self) -> tuple[Array, Array]:
        """G (m, n) and o (m,) in q of all moving joints = G q + o, with q (n,) of `joints`."""
        n = len(self.joints)
        G, offset = np.zeros((n + len(self.followers), n)), np.zeros(n + len(self.followers))
        G[:n] = np.eye(n)
        for k, follower in enumerate(self.followers, n):
            G[k, follower.leader], offset[k] = follower.multiplier, follower.offset
        return G, offset

    def leader(self, frame: int) -> int:
        """The index of the joint that moves with this frame: itself, or the one that it follows."""
        n = len(self.joints)
        return frame if frame < n else self.followers[frame - n].leader

    @cached_property
    def lumps(self) -> tuple[Array, Array, Array]:
        """Sums over the bodies fixed to each frame J: mass (m,), centre (m, 3) and central inertia (m, 3, 3), in J."""
        n = 1 if self.floating else len(self.moving)
        mass, center, inertia = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
        for joint in range(n):
            riding = [body for body in self.bodies if body.joint == joint]
            centers = [body.p_JB + body.R_JB @ body.p_BBcm for body in riding]
            mass[joint] = sum(body.mass for body in riding)
            if mass[joint] != 0.0:
                center[joint] = sum(b.mass * c for b, c in zip(riding, centers, strict=True)) / mass[joint]
            for body, p in zip(riding, centers, strict=True):
                apart = p - center[joint]
                axes = body.R_JB @ body.I_BBcm_B @ body.R_JB.T
                inertia[joint] += axes + body.mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
        return mass, center, inertia

    @cached_property
    def inertial_parameters(self) -> Array:
        """(m, 10): mass, first moment and inertia about Jo (xx, yy, zz, xy, xz, yz), in J, of the bodies fixed to J.

        Momentum and weight are linear in these parameters.
        """
        result = np.zeros((len(self.moving), 10))
        for body in self.bodies:
            if body.joint == FIXED:
                continue
            c = body.p_JB + body.R_JB @ body.p_BBcm
            I_Jo = body.R_JB @ body.I_BBcm_B @ body.R_JB.T + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
            result[body.joint] += [body.mass, *(body.mass * c), *I_Jo[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]]
        return result

    @cached_property
    def frames(self) -> tuple[Indices, Array, Array, Array, Indices]:
        """Each frame's parent (m,), R_PF (m, 3, 3), p_PF (m, 3) m, axis (m, 3), and whether it is prismatic (m,)."""
        joints = self.moving
        return (
            np.array([joint.parent for joint in joints], dtype=np.int64),
            np.array([joint.R_PF for joint in joints], dtype=float).reshape(-1, 3, 3),
            np.array([joint.p_PF for joint in joints], dtype=float).reshape(-1, 3),
            np.array([joint.axis for joint in joints], dtype=float).reshape(-1, 3),
            np.array([joint.prismatic for joint in joints], dtype=np.int64),
        )

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def state_size(self) -> int:
        """The length of a state: 2n, positions then velocities of n joints; 13 of a floating body (`free_motion`)."""
        return 13 if self.floating else 2 * len(self.joints)

    @property
    def free_body(self) -> Body:
        """The floating body, which has the frame `FREE`; others are welded to it."""
        return next(body for body in self.bodies if body.joint == FREE)

    def joint_index(self, name: str) -> int:
        """The index of the joint of that name; `InputError` where there is none."""
        if name not in self.joint_names:
            raise InputError(f"the model has no joint named {name!r}; it has: {', '.join(self.joint_names)}")
        return self.joint_names.index(name)

    def body(self, name: str) -> Body:
        """The body of that name; `InputError` where there is none."""
        for body in self.bodies:
            if body.name == name:
                return body
        raise InputError(f"the model has no body named {name!r}; it has: {', '.join(b.name for b in self.bodies)}")

    def carriers(self) -> Array:
        """(m, m) with 1 where frame k (column) is frame j (row) or one of its ancestors, 0 elsewhere."""
        joints = self.moving
        carried = np.eye(len(joints))
        for j, joint in enumerate(joints):
            if joint.parent != FIXED:
                carried[j] += carried[joint.parent]
        return carried

    def supports(self) -> Array:
        """(m, n) with 1 where joint k (column) moves frame j (row), by itself or by what follows it, 0 elsewhere."""
        return np.asarray(self.carriers() @ np.abs(self.following[0]) > 0.0, dtype=float)

    def with_bodies(self, bodies: Iterable[Body]) -> "Tree":
        """The tree with the bodies of the same names replaced."""
        changed = {body.name: body for body in bodies}
        return replace(self, bodies=tuple(changed.get(body.name, body) for body in self.bodies))

    def with_joints(self, joints: Iterable[Joint]) -> "Tree":
        """The tree with the joints of the same names replaced."""
        changed = {joint.name: joint for joint in joints}
        return replace(self, joints=tuple(changed.get(joint.name, joint) for joint in self.joints))


def tree_of(
    plant: MultibodyPlant,
    locked: Mapping[str, float] | None = None,
    following: Mapping[str, tuple[str, float, float]] | None = None,
) -> Tree:
    """The tree of a finalized plant whose joints are revolute, prismatic or welds, or of one body that floats.

    Joints keep the order of the plant's velocities; those of `locked` are welds at that position, rad or m. `following`
    gives leader, multiplier and offset of joints that follow another one; one that carries a joint with coordinates of
    its own is kept as a joint.
    Raises `InputError` for any other kind of joint, and for a locked joint that the plant lacks.
    """
    locked = locked or {}
    joints_of_plant = [plant.get_joint(i) for i in plant.GetJointIndices()]
    if any(isinstance(joint, QuaternionFloatingJoint) for joint in joints_of_plant):
        return _floating(plant)
    context = plant.CreateDefaultContext()
    zero: Array = np.zeros(plant.num_positions())
    plant.SetPositions(context, zero)
    for name, position in locked.items():
        _lock(plant, context, name, position)
    moving: list[OneAxisJoint] = []
    for i in plant.GetJointIndices():
        joint = plant.get_joint(i)
        if joint.num_velocities() == 0 or joint.name() in locked:
            continue
        if isinstance(joint, RevoluteJoint | PrismaticJoint):
            moving.append(joint)
        else:
            raise InputError(
                f"joint {joint.name()}: its type {type(joint).__name__} is not supported here, "
                "expected revolute, continuous, prismatic or fixed"
            )
    moving.sort(key=lambda joint: int(joint.velocity_start()))
    followed = _followed(plant, moving, following or {})
    moving.sort(key=lambda joint: joint.name() in followed)  # followers last, otherwise in the same order
    index = {joint.name(): k for k, joint in enumerate(moving)}
    rides = _rides(plant, index)
    rotors = _rotor_inertias(plant)
    frames = [_joint(plant, context, joint, moving, rides, rotors) for joint in moving]
    joints = tuple(joint for joint in frames if joint.name not in followed)
    followers = tuple(
        Follower(joint, index[leader], multiplier, offset)
        for joint in frames
        if joint.name in followed
        for leader, multiplier, offset in [followed[joint.name]]
    )
    bodies = tuple(
        _body(plant, context, moving, name, rides[name]) for name in rides if name != plant.world_body().name()
    )
    return Tree(joints, bodies, followers=followers)


def _followed(
    plant: MultibodyPlant, moving: Sequence[OneAxisJoint], following: Mapping[str, tuple[str, float, float]]
) -> dict[str, tuple[str, float, float]]:
    """Of the moving joints those that follow one with coordinates of its own: that one, multiplier and offset."""
    names = [joint.name() for joint in moving]
    found = {name: following[name] for name in names if name in following and following[name][0] in names}
    rides = _rides(plant, {name: k for k, name in enumerate(names)})
    carried_by = [rides[joint.parent_body().name()] for joint in moving]
    for name, carrier in reversed(list(zip(names, carried_by, strict=True))):  # what carries such a one is one itself
        if name not in found and carrier != FIXED:
            found.pop(names[carrier], None)
    for name in found:
        leader, multiplier, offset = found[name]
        while leader in found and leader != name:
            leader, by, more = found[leader]
            multiplier, offset = multiplier * by, multiplier * more + offset
        found[name] = leader, multiplier, offset
    return {name: entry for name, entry in found.items() if entry[0] != name}


def _floating(plant: MultibodyPlant) -> Tree:
    """The tree of the one body that floats; the others are welded to it or to the world."""
    joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
    moving = [joint for joint in joints if joint.num_velocities() > 0]
    if len(moving) != 1:
        names = ", ".join(joint.child_body().name() for joint in moving)
        raise InputError(f"bodies {names} move and nothing holds them all: expected one floating body, or a `weld:`")
    context = plant.CreateDefaultContext()
    X_JW = plant.EvalBodyPoseInWorld(context, moving[0].child_body()).inverse()
    rides = _rides(plant, {moving[0].name(): FREE})
    bodies = []
    for name, frame in rides.items():
        if name == plant.world_body().name():
            continue
        X_WB = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name))
        bodies.append(_placed(plant, name, frame, X_JW.multiply(X_WB) if frame == FREE else X_WB))
    return Tree((), tuple(bodies), floating=True)


def _lock(plant: MultibodyPlant, context: Context, name: str, position: float) -> None:
    if not plant.HasJointNamed(name):
        names = ", ".join(plant.get_joint(i).name() for i in plant.GetJointIndices())
        raise InputError(f"lock names the joint {name!r}, which the model lacks; it has: {names}")
    joint = plant.GetJointByName(name)
    if not isinstance(joint, RevoluteJoint | PrismaticJoint):
        raise InputError(f"lock names the joint {name!r}, which is {type(joint).__name__}, expected one axis")
    if isinstance(joint, RevoluteJoint):
        joint.set_angle(context, position)
    else:
        joint.set_translation(context, position)


def _rides(plant: MultibodyPlant, index: dict[str, int]) -> dict[str, int]:
    """Body name to the index of the nearest moving joint between it and the world."""
    rides = {plant.world_body().name(): FIXED}
    waiting = [plant.get_joint(i) for i in plant.GetJointIndices()]
    while waiting:
        known = [joint for joint in waiting if joint.parent_body().name() in rides]
        if not known:
            names = ", ".join(joint.child_body().name() for joint in waiting)
            raise InputError(f"bodies {names} are not connected to the world by joints; weld the base (`weld:`)")
        for joint in known:
            parent = rides[joint.parent_body().name()]
            rides[joint.child_body().name()] = index.get(joint.name(), parent)
            waiting.remove(joint)
    return rides


def _rotor_inertias(plant: MultibodyPlant) -> dict[str, float]:
    """Joint name to reflected rotor inertia, gear ratio squared times rotor inertia, kg m² (kg)."""
    rotors: dict[str, float] = {}
    for i in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(i)
        reflected = actuator.default_gear_ratio() ** 2 * actuator.default_rotor_inertia()
        name = actuator.joint().name()
        rotors[name] = rotors.get(name, 0.0) + float(reflected)
    return rotors


def _joint(
    plant: MultibodyPlant,
    context: Context,
    joint: OneAxisJoint,
    moving: Sequence[OneAxisJoint],
    rides: dict[str, int],
    rotors: dict[str, float],
) -> Joint:
    parent = rides[joint.parent_body().name()]
    X_WF: RigidTransform = joint.frame_on_parent().CalcPoseInWorld(context)
    X_WP = _moving_frame(context, moving, parent)
    X_PF = X_WP.inverse().multiply(X_WF)
    axis = joint.translation_axis() if isinstance(joint, PrismaticJoint) else joint.revolute_axis()
    effort = [
        plant.get_joint_actuator(i).effort_limit()
        for i in plant.GetJointActuatorIndices()
        if plant.get_joint_actuator(i).joint().name() == joint.name()
    ]
    return Joint(
        name=joint.name(),
        parent=parent,
        R_PF=np.array(X_PF.rotation().matrix()),
        p_PF=np.array(X_PF.translation()),
        axis=np.array(axis, dtype=float) / np.linalg.norm(axis),
        prismatic=isinstance(joint, PrismaticJoint),
        rotor_inertia=rotors.get(joint.name(), 0.0),
        damping=float(joint.default_damping()),
        position_limits=(float(joint.position_lower_limit()), float(joint.position_upper_limit())),
        velocity_limit=float(joint.velocity_upper_limit()),
        effort_limit=float(sum(effort)) if effort else np.inf,
    )


def _moving_frame(context: Context, moving: Sequence[OneAxisJoint], joint: int) -> RigidTransform:
    """X_WJ of the joint of that index, the identity for `FIXED`."""
    return RigidTransform() if joint == FIXED else moving[joint].frame_on_child().CalcPoseInWorld(context)


def _body(plant: MultibodyPlant, context: Context, moving: Sequence[OneAxisJoint], name: str, joint: int) -> Body:
    X_WJ = _moving_frame(context, moving, joint)
    X_JB = X_WJ.inverse().multiply(plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)))
    return _placed(plant, name, joint, X_JB)


def _placed(plant: MultibodyPlant, name: str, joint: int, X_JB: RigidTransform) -> Body:
    body = plant.GetBodyByName(name)
    M_BBo_B = body.default_spatial_inertia()
    about_center = M_BBo_B.Shift(M_BBo_B.get_com())
    return Body(
        name=name,
        joint=joint,
        R_JB=np.array(X_JB.rotation().matrix()),
        p_JB=np.array(X_JB.translation()),
        mass=float(M_BBo_B.get_mass()),
        p_BBcm=np.array(M_BBo_B.get_com(), dtype=float),
        I_BBcm_B=np.array(about_center.CalcRotationalInertia().CopyToFullMatrix3(), dtype=float),
    )
