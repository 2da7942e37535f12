"""Converts STL meshes to OBJ, since Meshcat's pages cannot show STL."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from drake_cafim.typing import Array

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84


@lru_cache(maxsize=64)
def obj_of(path: Path) -> str:
    """The OBJ text of a binary or ASCII STL file; coincident corners are merged."""
    corners = triangles(path.read_bytes()).reshape(-1, 3)
    points, index = np.unique(corners, axis=0, return_inverse=True)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in points]
    lines += [f"f {a} {b} {c}" for a, b, c in index.reshape(-1, 3) + 1]
    return "\n".join(lines) + "\n"


def triangles(content: bytes) -> Array:
    """The triangles' corners (N, 3, 3) of an STL file's bytes; N = 0 where it is no STL."""
    count = int.from_bytes(content[80:_HEADER], "little")
    if len(content) == _HEADER + count * _TRIANGLE.itemsize:
        return np.asarray(np.frombuffer(content, _TRIANGLE, count, _HEADER)["corners"], dtype=float)
    words = [line.split() for line in content.decode("ascii", "replace").splitlines()]
    corners = [word[1:4] for word in words if len(word) == 4 and word[0] == "vertex"]
    return np.array(corners[: len(corners) // 3 * 3], dtype=float).reshape(-1, 3, 3)
