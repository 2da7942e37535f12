"""Draws meshes, polylines, tubes and arrows in Meshcat."""

from typing import Any

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from drake_cafim.typing import Array


def shifted(x: float, y: float, z: float) -> RigidTransform:
    """The translation by (x, y, z) m."""
    offset: Array = np.array([x, y, z])
    return RigidTransform(offset)


def draw_mesh(meshcat: Meshcat, path: str, vertices: Array, faces: Any, color: Rgba) -> None:
    """Triangles: vertices (3, n) m, faces (3, m) indices."""
    corners: Any = np.asfortranarray(vertices)
    triangles: Any = np.asfortranarray(faces, dtype=np.int32)
    meshcat.SetTriangleMesh(path, corners, triangles, color)


def draw_flat(meshcat: Meshcat, path: str, vertices: Array, faces: Any, color: Rgba, *, depth: float) -> None:
    """Triangles in the plane z = `depth` m: vertices (2, n) m, faces (3, m) indices."""
    lifted = np.concatenate([vertices, np.full((1, vertices.shape[1]), depth)])
    draw_mesh(meshcat, path, lifted, faces, color)


def draw_lines(meshcat: Meshcat, path: str, polylines: Array, color: Rgba) -> None:
    """Thin polylines (c, h, 3) m."""
    start: Any = np.asfortranarray(polylines[:, :-1].reshape(-1, 3).T)
    end: Any = np.asfortranarray(polylines[:, 1:].reshape(-1, 3).T)
    meshcat.SetLineSegments(path, start, end, 1.5, color)


def draw_tube(meshcat: Meshcat, path: str, points: Array, radius: float, color: Rgba) -> None:
    """A polyline (h, 3) m with thickness, as a four-sided tube: browsers draw lines one pixel wide."""
    ahead = _unit(np.gradient(points, axis=0))
    side = _unit(np.cross(ahead, np.array([0.31, 0.95, 0.04])))
    other = np.cross(ahead, side)
    rings = np.stack([points + radius * offset for offset in (side, other, -side, -other)], axis=1)
    faces = []
    for index in range(len(points) - 1):
        for corner in range(4):
            a, b = 4 * index + corner, 4 * index + (corner + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    draw_mesh(meshcat, path, rings.reshape(-1, 3).T, np.array(faces).T, color)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def draw_arrow(meshcat: Meshcat, path: str, color: Rgba, stroke: float = 1.0) -> None:
    """An arrow along z of the path's frame, 16 mm thick times `stroke`; `move_arrow` gives it its length."""
    meshcat.SetObject(f"{path}/shaft/bar", Cylinder(0.008 * stroke, 1.0), color)
    meshcat.SetTransform(f"{path}/shaft/bar", shifted(0.0, 0.0, 0.5))
    # Meshcat's cones stand on their tips
    turned = RigidTransform(RotationMatrix.MakeXRotation(np.pi), shifted(0.0, 0.0, 0.045 * stroke).translation())
    meshcat.SetObject(f"{path}/head/cone", MeshcatCone(0.045 * stroke, 0.02 * stroke, 0.02 * stroke), color)
    meshcat.SetTransform(f"{path}/head/cone", turned)


def move_arrow(meshcat: Meshcat, path: str, time: float, point: Array, vector: Array) -> None:
    """Records that the arrow at `path` starts at `point` (3,) m at `time` s and is as long as `vector` (3,) m."""
    length = float(np.linalg.norm(vector))
    axis: Array = np.array([0.0, 0.0, 1.0]) if length < 1e-9 else np.asarray(vector / length)
    meshcat.SetTransform(path, RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), point), time)
    # a scale of zero has no inverse
    meshcat.SetProperty(f"{path}/shaft", "scale", [1.0, 1.0, max(length, 1e-4)], time)
    meshcat.SetTransform(f"{path}/head", shifted(0.0, 0.0, length), time)
