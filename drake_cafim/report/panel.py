"""A board in Meshcat with the density of the belief over one parameter, drawn anew after each update."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from drake_cafim.report.lettering import letter
from drake_cafim.report.replay_data import BeliefHistory
from drake_cafim.report.shapes import draw_flat, shifted
from drake_cafim.typing import Array

INK = Rgba(0.10, 0.13, 0.18, 1.0)
CURVE = Rgba(0.13, 0.45, 0.85, 0.9)
PRIOR = Rgba(0.72, 0.80, 0.90, 1.0)
TRUTH = Rgba(0.85, 0.15, 0.15, 1.0)
BOARD = Rgba(1.0, 1.0, 1.0, 1.0)
THIN = 0.006  # of the board's width
BASE = 0.2  # of the board's height, where the axis lies


@dataclass(frozen=True)
class Board:
    """A board of `width` by `height` m; x to the right, y up, z towards the eye, pose X_WB of its lower left."""

    X_WB: RigidTransform
    width: float
    height: float


def facing(corner: Array, eye: Array, target: Array) -> RigidTransform:
    """X_WB of an upright board with its lower left at `corner`, square to a look from `eye` to `target`, (3,) m in W.

    Square to the look, not to the eye: a camera's picture of it is then undistorted wherever it stands.
    """
    z = (eye - target) / np.linalg.norm(eye - target)
    x = np.cross(np.array([0.0, 0.0, 1.0]), z)
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), corner)


def draw_text(
    meshcat: Meshcat,
    path: str,
    text: str,
    *,
    at: tuple[float, float],
    height: float,
    width: float = np.inf,
    bold: bool = False,
    centred: bool = False,
) -> None:
    """`text` on a board at `path`, from `at` m on or about it, `height` m tall but no wider than `width` m."""
    mesh = letter(text, height=height, bold=bold)
    if mesh.faces.shape[1] == 0:
        return
    length = float(mesh.vertices[0].max())
    vertices = mesh.vertices * min(1.0, width / length)
    start = np.array(at) - np.array([0.5 * float(vertices[0].max()) if centred else 0.0, 0.0])
    draw_flat(meshcat, path, vertices + start[:, np.newaxis], mesh.faces, INK, depth=0.003)


def draw_panel(meshcat: Meshcat, path: str, belief: BeliefHistory, board: Board) -> None:
    """Draws one page for each belief of the history at `path`, the first one visible; see `animate_panel`."""
    meshcat.SetTransform(path, board.X_WB)
    back = shifted(0.5 * board.width, 0.5 * board.height, -0.006)
    meshcat.SetObject(f"{path}/board", Box(board.width, board.height, 0.008), BOARD)
    meshcat.SetTransform(f"{path}/board", back)
    low, high = _range(belief)
    _draw_axis(meshcat, path, belief, board, low, high)
    grid = np.linspace(low, high, 161)
    peak = float((1.0 / belief.std).max())
    across, base = _across(grid, low, high, board), BASE * board.height
    for index, (mean, std) in enumerate(zip(belief.mean, belief.std, strict=True)):
        density = np.exp(-0.5 * ((grid - mean) / std) ** 2) / std
        # the square root of the density: without it the wide prior would be flat beside the narrow last belief
        heights = 0.58 * board.height * np.sqrt(density / peak)
        page = f"{path}/page{index}"
        _draw_hill(meshcat, f"{page}/hill", across, base, heights, CURVE, depth=0.002)
        if index == 0:
            _draw_hill(meshcat, f"{path}/prior", across, base, heights, PRIOR, depth=0.001)
        text = f"{belief.name}  {_number(mean)} ± {_number(std)} {belief.unit}".rstrip()
        at = (0.06 * board.width, 0.86 * board.height)
        width = 0.88 * board.width
        draw_text(meshcat, f"{page}/words", text, at=at, height=0.09 * board.height, width=width, bold=True)
        meshcat.SetProperty(page, "visible", index == 0)


def animate_panel(meshcat: Meshcat, path: str, belief: BeliefHistory, frames: Array) -> None:
    """Records for every time of `frames` (s) which page is visible."""
    current = np.maximum(np.searchsorted(belief.time, frames + 1e-9, side="right") - 1, 0)
    for index in range(len(belief.time)):
        for moment, visible in changes(frames, current == index):
            meshcat.SetProperty(f"{path}/page{index}", "visible", visible, moment)


def changes(frames: Array, flags: Array) -> Iterator[tuple[float, bool]]:
    """The first flag and each change of it, with the time it happens: what an animation track needs."""
    for index, flag in enumerate(flags):
        if index == 0 or flag != flags[index - 1]:
            yield float(frames[index]), bool(flag)


def _range(belief: BeliefHistory) -> tuple[float, float]:
    marks = [*(belief.mean - 2.5 * belief.std), *(belief.mean + 2.5 * belief.std)]
    last, spread = belief.mean[-1], belief.std[-1]
    # a vague prior would leave the last belief a needle
    low, high = max(min(marks), last - 25 * spread), min(max(marks), last + 25 * spread)
    known = [belief.truth] if belief.truth is not None else []
    means = [*belief.mean.tolist(), *known]
    return min(low, *means), max(high, *means)


def _across(values: Array, low: float, high: float, board: Board) -> Array:
    return np.asarray(board.width * (0.06 + 0.88 * (values - low) / (high - low)))


def _draw_axis(meshcat: Meshcat, path: str, belief: BeliefHistory, board: Board, low: float, high: float) -> None:
    base = BASE * board.height
    _draw_bar(meshcat, f"{path}/axis", board, 0.5 * board.width, base, 0.9 * board.width, 0.006 * board.height, INK)
    step = _nice_step((high - low) / 4.0)
    for index, value in enumerate(np.round(np.arange(np.ceil(low / step), np.floor(high / step) + 0.5)) * step):
        x = float(_across(np.array(value), low, high, board))
        _draw_bar(
            meshcat,
            f"{path}/tick{index}",
            board,
            x,
            base - 0.02 * board.height,
            THIN * board.width,
            0.04 * board.height,
            INK,
        )
        text = f"{value + 0.0:.6g}"  # no "-0"
        at = (x, 0.07 * board.height)
        draw_text(meshcat, f"{path}/value{index}", text, at=at, height=0.06 * board.height, centred=True)
    if belief.truth is not None:
        x = float(_across(np.array(belief.truth), low, high, board))
        _draw_bar(
            meshcat,
            f"{path}/truth",
            board,
            x,
            base + 0.31 * board.height,
            1.3 * THIN * board.width,
            0.62 * board.height,
            TRUTH,
        )


def _draw_bar(
    meshcat: Meshcat, path: str, board: Board, x: float, y: float, width: float, height: float, color: Rgba
) -> None:
    meshcat.SetObject(path, Box(width, height, 0.004), color)
    meshcat.SetTransform(path, shifted(x, y, 0.004))


def _draw_hill(
    meshcat: Meshcat, path: str, x: Array, base: float, heights: Array, color: Rgba, *, depth: float
) -> None:
    count = len(x)
    vertices = np.concatenate([np.stack([x, np.full(count, base)]), np.stack([x, base + heights])], axis=1)
    first = np.arange(count - 1, dtype=np.int32)
    faces = np.concatenate(
        [np.stack([first, first + 1, first + 1 + count]), np.stack([first, first + 1 + count, first + count])], axis=1
    )
    draw_flat(meshcat, path, vertices, faces, color, depth=depth)


def _nice_step(raw: float) -> float:
    scale = 10.0 ** np.floor(np.log10(raw))
    return float(scale * min((1, 2, 5, 10), key=lambda factor: abs(np.log(factor * scale / raw))))


def _number(value: float) -> str:
    return f"{value:.3g}"
