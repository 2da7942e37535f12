"""The shapes by which a replay draws a model: its visuals, or joints, links and centres of mass where it has none."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Box, Cylinder, HalfSpace, InMemoryMesh, Mesh, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from drake_cafim.dynamics.motion import Motion
from drake_cafim.dynamics.sphere_on_box import SphereOnBox
from drake_cafim.dynamics.tree import FIXED, Tree
from drake_cafim.report.stl import obj_of
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MOST_MESH = 12_000_000
"""Bytes of mesh files; a page holds them once for each of up to three robots."""
LINK = Rgba(0.72, 0.75, 0.79, 1.0)
JOINT = Rgba(0.42, 0.48, 0.56, 1.0)
MASS = Rgba(0.22, 0.26, 0.33, 1.0)
TOUCHING = Rgba(0.55, 0.60, 0.66, 1.0)
GROUND = Rgba(0.86, 0.88, 0.90, 1.0)


@dataclass(frozen=True)
class LinkShape:
    """A shape at X_JG in frame J of `joint`; of a joint that is `FIXED` J is the world."""

    joint: int
    shape: Shape
    X_JG: RigidTransform
    color: Rgba


def link_shapes(scene: Scene, moving: Motion, size: float) -> list[LinkShape]:
    """The shapes of the scene's bodies; drawn joints and links are scaled by the `size` m of the whole.

    A model without visuals is drawn by its joints, bars between them, centres of mass, collision geometry, and rails
    that are as long as the motion `moving` of prismatic joints.
    """
    visuals = [] if too_large(scene) else list(_geometries(scene, visual=True))
    if any(shape.joint != FIXED for shape in visuals):
        drawn = visuals
    else:
        touching = list(_geometries(scene, visual=False))
        tips = [
            bar
            for collision in touching
            for bar in _bar(collision.joint, np.array(collision.X_JG.translation()), 0.014 * size)
        ]
        drawn = [*visuals, *_sticks(scene.tree, size), *_rails(moving, size), *tips, *touching]
    standing = any(shape.joint == FIXED for shape in drawn)
    return drawn if standing else [*drawn, *_grounds(scene, size)]


def extent(moving: Motion) -> float:
    """How large the model and its motion are together, m."""
    return max(0.05, float(np.linalg.norm(np.ptp(cloud(moving), axis=0))))


def cloud(moving: Motion) -> Array:
    """(N, 3) m: where joints and centres of mass are over the whole motion, world."""
    tree = moving.tree
    centers = [moving.point(b.joint, _center(tree, i))[0] for i, b in enumerate(tree.bodies) if b.joint != FIXED]
    return np.concatenate([moving.p_WJ.reshape(-1, 3), *centers])


def _center(tree: Tree, index: int) -> Array:
    """A body's centre of mass in frame J, (3,) m."""
    body = tree.bodies[index]
    return np.asarray(body.p_JB + body.R_JB @ body.p_BBcm, dtype=float)


def _geometries(scene: Scene, *, visual: bool) -> Iterator[LinkShape]:
    """The model's own shapes in one role."""
    inspector = scene.scene_graph.model_inspector()
    plant = scene.plant
    for body in scene.tree.bodies:
        drake_body = plant.GetBodyByName(body.name)
        ids = (
            plant.GetVisualGeometriesForBody(drake_body) if visual else plant.GetCollisionGeometriesForBody(drake_body)
        )
        X_JB = RigidTransform(RotationMatrix(body.R_JB), body.p_JB)
        for i in ids:
            shape = inspector.GetShape(i)
            if isinstance(shape, HalfSpace):
                continue
            if isinstance(shape, Mesh) and shape.extension() == ".stl":
                shape = _as_obj(shape)
            color = TOUCHING
            properties = inspector.GetIllustrationProperties(i) if visual else None
            if properties is not None and properties.HasProperty("phong", "diffuse"):
                color = cast(Rgba, properties.GetProperty("phong", "diffuse"))
            yield LinkShape(body.joint, shape, X_JB.multiply(inspector.GetPoseInFrame(i)), color)


def too_large(scene: Scene) -> bool:
    """Whether the model's visual meshes exceed `MOST_MESH` bytes: browsers fail to open a page that holds them."""
    inspector, plant = scene.scene_graph.model_inspector(), scene.plant
    bodies = [plant.GetBodyByName(body.name) for body in scene.tree.bodies]
    shapes = [inspector.GetShape(i) for body in bodies for i in plant.GetVisualGeometriesForBody(body)]
    files = [Path(shape.source().path()) for shape in shapes if isinstance(shape, Mesh) and shape.source().is_path()]
    return sum(file.stat().st_size for file in files if file.is_file()) > MOST_MESH


def _as_obj(mesh: Mesh) -> Mesh:
    path = Path(mesh.source().path())
    content = MemoryFile(obj_of(path), ".obj", path.stem)
    scale: Array = np.array(mesh.scale3(), dtype=float)
    return Mesh(InMemoryMesh(mesh_file=content), scale)


def _sticks(tree: Tree, size: float) -> Iterator[LinkShape]:
    """A mark at each joint, a bar to whatever it carries, and a mark at each centre of mass."""
    thick = 0.018 * size
    heaviest = max(body.mass for body in tree.bodies)
    for j, joint in enumerate(tree.moving):
        if joint.prismatic:
            yield LinkShape(j, Box(3.6 * thick, 3.6 * thick, 2.4 * thick), RigidTransform(), JOINT)
        else:
            along = _upright(joint.axis)
            yield LinkShape(j, Cylinder(1.5 * thick, 3.6 * thick), _pose(along), JOINT)
        yield from _bar(joint.parent, joint.p_PF, thick)
    for index, body in enumerate(tree.bodies):
        if body.joint == FIXED or body.mass < 1e-3 * heaviest:
            continue
        center = _center(tree, index)
        yield from _bar(body.joint, center, 0.8 * thick)
        radius = 1.7 * thick * float(np.cbrt(body.mass / heaviest))
        yield LinkShape(body.joint, Sphere(radius), RigidTransform(center), MASS)


def _rails(moving: Motion, size: float) -> Iterator[LinkShape]:
    """A rail under each slide, as long as the motion."""
    for j, joint in enumerate(moving.tree.joints):
        if joint.prismatic:
            low, high = float(np.min(moving.q[:, j])), float(np.max(moving.q[:, j]))
            along = _upright(joint.R_PF @ joint.axis)
            middle = joint.p_PF + joint.R_PF @ joint.axis * 0.5 * (low + high)
            shape = Cylinder(0.007 * size, high - low + 0.1 * size)
            yield LinkShape(joint.parent, shape, _pose(along, middle), LINK)


def _bar(joint: int, end: Array, radius: float) -> Iterator[LinkShape]:
    """A bar from the joint's origin to `end` (3,) m in J; from the world's origin it would be no link."""
    length = float(np.linalg.norm(end))
    if joint == FIXED or length < 2.0 * radius:
        return
    along = _upright(end / length)
    yield LinkShape(joint, Cylinder(radius, length), _pose(along, 0.5 * end), LINK)


def _grounds(scene: Scene, size: float) -> Iterator[LinkShape]:
    """A plate under each contact plane, and each box that is touched all round."""
    for contact in scene.physics.contacts:
        if isinstance(contact, SphereOnBox):
            yield LinkShape(FIXED, Box(*contact.size), _pose(RotationMatrix(contact.R_WG), contact.point), GROUND)
            continue
        turned = _upright(contact.normal)
        thickness = 0.01 * size
        place = _pose(turned, contact.point - 0.5 * thickness * contact.normal)
        yield LinkShape(FIXED, Box(1.5 * size, 1.5 * size, thickness), place, GROUND)


def _upright(axis: Array) -> RotationMatrix:
    """The rotation that takes z to a unit `axis` (3,)."""
    unit: Array = np.asarray(axis, dtype=float)
    return RotationMatrix.MakeFromOneVector(unit, 2)


def _pose(R: RotationMatrix, p: Array | None = None) -> RigidTransform:
    position: Array = np.zeros(3) if p is None else p
    return RigidTransform(R, position)
