"""Text as flat triangle meshes, since Meshcat cannot draw text."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from drake_cafim.typing import Array


@dataclass(frozen=True)
class FlatMesh:
    """Triangles in a plane: vertices (2, n) m, faces (3, m) indices."""

    vertices: Array
    faces: "np.ndarray[tuple[int, ...], np.dtype[np.int32]]"


def letter(text: str, *, height: float, bold: bool = False, bands: int = 28) -> FlatMesh:
    """The mesh of `text`, capitals about `height` m tall, from the origin along x, on the line y = 0.

    The outlines are cut into `bands` horizontal strips, and each strip into quadrilaterals by the even-odd rule:
    it needs no triangulation library and draws the holes of letters right.
    """
    if not text.strip():  # matplotlib fails on it
        return FlatMesh(np.zeros((2, 0)), np.zeros((3, 0), dtype=np.int32))
    path = TextPath((0.0, 0.0), text, size=1.0, prop=FontProperties(weight="bold" if bold else "normal"))
    polygons = [np.asarray(polygon, dtype=float) for polygon in path.to_polygons(closed_only=True)]
    outlines = [polygon[:-1] for polygon in polygons if len(polygon) > 3]
    edges = np.concatenate([np.stack([line, np.roll(line, -1, axis=0)], axis=1) for line in outlines])
    levels = np.linspace(edges[..., 1].min(), edges[..., 1].max(), bands + 1)
    quads = [quad for low, high in pairwise(levels) for quad in _strip(edges, low, high)]
    corners = np.array(quads).reshape(-1, 2) * (height / 0.73)  # capitals are 0.73 of the font's size
    first = 4 * np.arange(len(quads), dtype=np.int32)
    faces = np.concatenate([np.stack([first, first + 1, first + 2]), np.stack([first, first + 2, first + 3])], axis=1)
    return FlatMesh(corners.T, faces)


def _strip(edges: Array, low: float, high: float) -> list[list[list[float]]]:
    """Quadrilaterals (4 corners) that the outlines enclose between two levels."""
    middle = 0.5 * (low + high)
    start, end = edges[:, 0], edges[:, 1]
    crossing = (start[:, 1] <= middle) != (end[:, 1] <= middle)
    start, end = start[crossing], end[crossing]
    slope = (end[:, 0] - start[:, 0]) / (end[:, 1] - start[:, 1])
    at = start[:, 0] + (middle - start[:, 1]) * slope
    order = np.argsort(at)
    lean = 0.5 * (high - low) * slope[order]
    left = np.stack([at[order] - lean, at[order] + lean], axis=1)
    pairs = zip(left[0::2], left[1::2], strict=True)
    return [[[a[0], low], [b[0], low], [b[1], high], [a[1], high]] for a, b in pairs]
