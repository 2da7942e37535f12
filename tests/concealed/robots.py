"""Random serial and branched arms, from whose parameters both the URDF and the MuJoCo model are written."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Link:
    """A rigid link: kg, m, kg m^2; the centre of mass in the link frame, the inertia about it in link axes."""

    name: str
    mass: float
    com: Array  # (3,)
    inertia: Array  # (3, 3)

    def with_mass(self, mass: float) -> Link:
        """This link with another mass; the inertia scales with it, the centre of mass stays."""
        return replace(self, mass=mass, inertia=self.inertia * (mass / self.mass))

    def with_point_mass(self, mass: float, position: Array) -> Link:
        """This link with a point mass rigidly attached at `position` of its frame."""
        total = self.mass + mass
        com = (self.mass * self.com + mass * position) / total
        inertia = self.inertia + _parallel(self.mass, self.com - com) + _parallel(mass, position - com)
        return Link(self.name, total, com, inertia)


def _parallel(mass: float, arm: Array) -> Array:
    return mass * (np.dot(arm, arm) * np.eye(3) - np.outer(arm, arm))


@dataclass(frozen=True)
class Joint:
    """A revolute or prismatic joint; `parent` is a link's index, -1 the base; the child link has the joint's index."""

    name: str
    kind: str  # revolute | prismatic
    parent: int
    origin: Array  # (3,) m, in the parent's frame
    rpy: Array  # (3,) rad, fixed axes
    axis: Array  # (3,) unit vector
    damping: float = 0.0
    rotor_inertia: float = 0.0


@dataclass(frozen=True)
class Robot:
    """A tree of links; link i hangs on joint i. Gravity is that of the world, m/s^2."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    gravity: Array

    @property
    def size(self) -> int:
        return len(self.joints)

    def joint_index(self, name: str) -> int:
        return [joint.name for joint in self.joints].index(name)

    def link_index(self, name: str) -> int:
        return [link.name for link in self.links].index(name)

    def descendants(self, joint: int) -> list[int]:
        """Indices of the links that joint `joint` moves."""
        moved = [joint]
        for index in range(joint + 1, self.size):
            if self.joints[index].parent in moved:
                moved.append(index)
        return moved

    def replace_link(self, index: int, link: Link) -> Robot:
        links = list(self.links)
        links[index] = link
        return replace(self, links=tuple(links))

    def replace_joint(self, index: int, **changes: float) -> Robot:
        joints = list(self.joints)
        joints[index] = replace(joints[index], **changes)
        return replace(self, joints=tuple(joints))


def _random_link(rng: np.random.Generator, name: str, mass: float, reach: Array, width: float) -> Link:
    """A box-like link from its frame's origin to `reach`, its axes turned a little."""
    length = float(np.linalg.norm(reach)) + width
    along = reach / max(float(np.linalg.norm(reach)), 1e-9)
    com = 0.5 * reach * rng.uniform(0.7, 1.2) + rng.normal(0.0, 0.12 * width, 3)
    extents = np.array([length, width * rng.uniform(0.7, 1.3), width * rng.uniform(0.7, 1.3)])
    squares = extents**2
    principal = mass / 12.0 * (squares.sum() - squares)
    helper = np.eye(3)[np.argmin(np.abs(along))]
    second = np.cross(along, helper)
    second /= np.linalg.norm(second)
    frame = np.column_stack([along, second, np.cross(along, second)])
    frame = frame @ Rotation.from_rotvec(rng.normal(0.0, 0.15, 3)).as_matrix()
    inertia = frame @ np.diag(principal) @ frame.T
    return Link(name, mass, np.round(com, 5), np.round(0.5 * (inertia + inertia.T), 7))


_NAMES = {2: ["shoulder", "elbow"], 3: ["yaw", "shoulder", "elbow"]}


def joint_names(rng: np.random.Generator, size: int) -> list[str]:
    """Names as robots have them: words for small arms, numbered otherwise."""
    if size in _NAMES and rng.random() < 0.7:
        return _NAMES[size]
    prefix = ["j", "joint_", "axis_"][rng.integers(3)]
    return [f"{prefix}{index + 1}" for index in range(size)]


def random_arm(rng: np.random.Generator, size: int, branched: bool = False) -> Robot:
    """A random arm of `size` joints; a branched one carries two chains on its first joints."""
    names = joint_names(rng, size)
    planar = size == 2 and rng.random() < 0.6
    prismatic = int(rng.integers(size)) if size in (3, 6) and rng.random() < 0.15 else -1
    scale = rng.uniform(0.8, 1.3)
    fork = max(1, size // 3) if branched else size
    links: list[Link] = []
    joints: list[Joint] = []
    reaches: list[Array] = []
    second_start = fork + (size - fork) // 2
    for index in range(size):
        parent = index - 1
        if branched and index == second_start:
            parent = fork - 1
        depth = index if not branched or index < second_start else index - (second_start - fork)
        mass = float(np.round(scale * rng.uniform(2.5, 4.0) * 0.82**depth, 3))
        length = scale * rng.uniform(0.12, 0.35) * (1.0 if size < 4 else 0.75)
        direction = np.array([0.0, 0.0, -1.0]) if planar else rng.normal(size=3)
        reach = length * direction / np.linalg.norm(direction)
        axis = _axis(rng, planar, depth)
        origin = np.array([0.0, 0.0, 0.5]) if parent < 0 else reaches[parent]
        if branched and index in (fork, second_start):
            origin = origin + np.array([0.0, 0.12 if index == fork else -0.12, 0.0])
        rpy = np.zeros(3) if planar or index == 0 else np.round(rng.choice([-1, 0, 1], 3) * 0.5 * np.pi, 12)
        if rng.random() < 0.3 and not planar and index > 0:
            rpy = np.round(rpy + rng.normal(0.0, 0.2, 3), 4)
        rotor = float(np.round(10 ** rng.uniform(-1.5, -0.6) * 0.9**depth, 4))
        kind = "prismatic" if index == prismatic else "revolute"
        joints.append(
            Joint(
                names[index],
                kind,
                parent,
                np.round(origin, 4),
                rpy,
                axis,
                0.0,
                rotor * (10.0 if kind == "prismatic" else 1.0),
            )
        )
        links.append(_random_link(rng, f"link{index + 1}", mass, reach, 0.07 * scale))
        reaches.append(np.round(reach, 4))
    return Robot(f"arm{size}", tuple(links), tuple(joints), np.array([0.0, 0.0, -9.81]))


def _axis(rng: np.random.Generator, planar: bool, depth: int) -> Array:
    if planar:
        return np.array([0.0, 1.0, 0.0])
    if rng.random() < 0.15:
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)
    if depth == 0:
        return np.eye(3)[rng.choice([1, 2])]
    return np.eye(3)[rng.integers(3)]
