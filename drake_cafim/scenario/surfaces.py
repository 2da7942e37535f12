"""Contacts of a scenario from the model's collision geometry: a sphere or box against a plane."""

import numpy as np
from pydrake.geometry import Box, HalfSpace, SceneGraph, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.dynamics.box_contact import BoxContact
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import motion
from drake_cafim.dynamics.sphere_on_box import SphereOnBox
from drake_cafim.dynamics.tree import FIXED, FREE, Tree
from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import ContactPair
from drake_cafim.typing import Array

ABOVE = np.array([0.0, 0.0, 1e3])
"""m, a point far above: a floating body lands on upper faces."""


def contact_of(
    pair: ContactPair, plant: MultibodyPlant, scene_graph: SceneGraph, tree: Tree, q: Array, source: str
) -> SphereContact:
    """The contact of one body's sphere, or of a floating body's box, with a plane of the other body.

    The plane of a fixed box is the face nearest to the sphere at joint positions `q` (n,), or the upper one if the body
    floats. Raises `InputError` where the pair is not a moving sphere (or floating box) against a fixed box,
    half-space or `ground`.
    """
    names = tuple(pair.bodies)
    for moving, still in (names, names[::-1]):
        sphere = _sphere(moving, plant, scene_graph, tree)
        box = _box(moving, plant, scene_graph, tree)
        if sphere is None and box is None:
            continue
        p_WC = ABOVE
        if sphere is not None and not tree.floating:
            zero = np.zeros((1, len(tree.joints)))
            p_WC = motion(tree, q[None], zero).point(sphere[0], sphere[1])[0][0]
        plane = _plane(pair, still, plant, scene_graph, tree, p_WC)
        if plane is None:
            continue
        if pair.law == "hydroelastic" and sphere is None:
            raise InputError(f"{source}: contact {'/'.join(names)}: the law hydroelastic is of a sphere, found a box")
        radius = sphere[2] if sphere is not None and pair.radius is None else pair.radius
        parameters = ContactParameters(
            stiffness=pair.stiffness,
            damping=pair.damping,
            dissipation=pair.dissipation,
            modulus=pair.modulus,
            radius=radius or 0.0,
            half_extent=pair.half_extent or 0.0,
            resolution=pair.resolution,
            friction=pair.friction,
            slip_velocity=pair.slip_velocity,
            resistance=pair.resistance,
        )
        law = ContactLaw(pair.law)  # type: ignore[arg-type]
        if sphere is not None:
            joint, p_JC, size = sphere
            if pair.faces == "all":
                key = f"{source}: contact {'/'.join(names)}: faces: all"
                X_WG, extents = _fixed_box(still, plant, scene_graph, key)
                R_WG = np.array(X_WG.rotation().matrix())
                centre: Array = np.array(X_WG.translation())
                placed = (joint, p_JC, size, centre, R_WG[:, 2], law, parameters, ())
                return SphereOnBox((moving, still), *placed, extents, R_WG)
            return SphereContact((moving, still), joint, p_JC, size, plane[0], plane[1], law, parameters)
        assert box is not None
        p_JG, R_JG, extents = box
        return BoxContact((moving, still), FREE, p_JG, 0.0, plane[0], plane[1], law, parameters, (), extents, R_JG)
    raise InputError(
        f"{source}: contact {'/'.join(names)}: expected a body with one collision sphere that moves, or a floating one "
        "with one collision box, against a body with one collision box or half-space that does not move, or ground:"
    )


def _box(name: str, plant: MultibodyPlant, scene_graph: SceneGraph, tree: Tree) -> tuple[Array, Array, Array] | None:
    """p_JG, R_JG and extents of the one collision box of a floating body."""
    if not tree.floating or not plant.HasBodyNamed(name) or name == "world" or tree.body(name).joint != FREE:
        return None
    body, inspector = tree.body(name), scene_graph.model_inspector()
    ids = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name))
    shapes = [inspector.GetShape(i) for i in ids]
    if len(shapes) != 1 or not isinstance(shapes[0], Box):
        return None
    X_BG = inspector.GetPoseInFrame(ids[0])
    p_JG = body.p_JB + body.R_JB @ np.array(X_BG.translation())
    return p_JG, body.R_JB @ np.array(X_BG.rotation().matrix()), np.array(shapes[0].size(), dtype=float)


def _sphere(name: str, plant: MultibodyPlant, scene_graph: SceneGraph, tree: Tree) -> tuple[int, Array, float] | None:
    """Joint index, centre p_JC (3,) m and radius m of the one collision sphere of a moving body."""
    if name == "world" or not plant.HasBodyNamed(name):
        return None
    body = tree.body(name)
    inspector = scene_graph.model_inspector()
    shapes = [
        (inspector.GetShape(i), inspector.GetPoseInFrame(i))
        for i in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name))
    ]
    spheres = [(shape, X_BG) for shape, X_BG in shapes if isinstance(shape, Sphere)]
    if body.joint == FIXED or len(spheres) != 1:
        return None
    shape, X_BG = spheres[0]
    return body.joint, body.p_JB + body.R_JB @ np.array(X_BG.translation()), float(shape.radius())


def _plane(
    pair: ContactPair, name: str, plant: MultibodyPlant, scene_graph: SceneGraph, tree: Tree, p_WC: Array
) -> tuple[Array, Array] | None:
    """Point (3,) m and outward normal (3,), in the world, of a fixed body's plane or its box face nearest to `p_WC`."""
    if pair.ground is not None:
        normal = np.array(pair.ground.normal, dtype=float)
        return np.array(pair.ground.point, dtype=float), normal / np.linalg.norm(normal)
    if not plant.HasBodyNamed(name) or (name != "world" and tree.body(name).joint != FIXED):
        return None
    inspector = scene_graph.model_inspector()
    ids = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name))
    X_WB = plant.EvalBodyPoseInWorld(plant.CreateDefaultContext(), plant.GetBodyByName(name))
    for i in ids:
        shape, X_WG = inspector.GetShape(i), X_WB.multiply(inspector.GetPoseInFrame(i))
        if isinstance(shape, HalfSpace):
            return np.array(X_WG.translation()), np.array(X_WG.rotation().matrix()[:, 2])
        if isinstance(shape, Box):
            return _nearest_face(X_WG, np.array(shape.size()), p_WC)
    return None


def _fixed_box(name: str, plant: MultibodyPlant, scene_graph: SceneGraph, key: str) -> tuple[RigidTransform, Array]:
    """X_WG and extents (3,) m of the one collision box of a fixed body; `InputError` that begins with `key` else."""
    inspector = scene_graph.model_inspector()
    ids = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name)) if plant.HasBodyNamed(name) else []
    shapes = [(inspector.GetShape(i), inspector.GetPoseInFrame(i)) for i in ids]
    boxes = [(shape, X_BG) for shape, X_BG in shapes if isinstance(shape, Box)]
    if len(boxes) != 1:
        raise InputError(f"{key}: {name} has {len(boxes)} collision boxes, expected one that does not move")
    X_WB = plant.EvalBodyPoseInWorld(plant.CreateDefaultContext(), plant.GetBodyByName(name))
    [(box, X_BG)] = boxes
    return X_WB.multiply(X_BG), np.array(box.size(), dtype=float)


def _nearest_face(X_WG: RigidTransform, size: Array, p_WC: Array) -> tuple[Array, Array]:
    """Point and outward normal, in the world, of the box face that p_WC (3,) is farthest outside of."""
    p_GC = X_WG.inverse().multiply(p_WC)
    outside = np.abs(p_GC) - 0.5 * size
    axis = int(np.argmax(outside))
    normal = np.zeros(3)
    normal[axis] = 1.0 if p_GC[axis] >= 0 else -1.0
    normal_W = X_WG.rotation().matrix() @ normal
    point: Array = np.array(X_WG.multiply(0.5 * size * normal), dtype=float)
    return point, normal_W
