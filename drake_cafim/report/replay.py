"""The replay of a run as one self-contained HTML page: Meshcat with the motion, forces, plans and beliefs."""

import logging
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, MeshcatVisualizer, Rgba
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.report.panel import Board, animate_panel, changes, draw_panel, draw_text, facing
from drake_cafim.report.replay_data import Camera, Candidates, Forces, Motion, Replay
from drake_cafim.report.shapes import draw_arrow, draw_lines, draw_tube, move_arrow, shifted
from drake_cafim.typing import Array

FORCE = Rgba(0.90, 0.18, 0.12, 1.0)
CANDIDATE = Rgba(0.35, 0.40, 0.48, 1.0)
CHOSEN = Rgba(0.98, 0.55, 0.05, 1.0)
FRAMES_PER_SECOND = 32.0
SHORTEST = 2e-3  # m, of an arrow that is drawn
ROOT = "/replay"


def make_meshcat() -> Meshcat:
    """A Meshcat server that only this machine can reach; its address is `web_url()`."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)  # Drake would log the server's address, which is of no use where a file is written
    try:
        return Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    finally:
        log.setLevel(level)


def write_replay(path: Path, replay: Replay, diagram: Diagram, meshcat: Meshcat) -> None:
    """Writes the page of `render` to `path`, whole or not at all."""
    write_text(path, render(replay, diagram, meshcat))


def render(replay: Replay, diagram: Diagram, meshcat: Meshcat) -> str:
    """The HTML page that shows `replay` without a network or a server.

    `diagram` was built with this `meshcat` (`make_meshcat`), and holds a MultibodyPlant named "plant" and a
    MeshcatVisualizer; its own state and time are not touched. Raises `InputError` if the motion does not fit it.
    """
    set_stage(meshcat, replay.camera)
    meshcat.StartRecording(frames_per_second=FRAMES_PER_SECOND, set_visualizations_while_recording=False)
    _record_motion(replay.motion, diagram)
    if replay.forces is not None:
        _draw_forces(meshcat, replay.forces, replay.stroke)
    if replay.candidates is not None:
        _draw_candidates(meshcat, replay.candidates, replay.stroke)
    _draw_beliefs(meshcat, replay)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return str(meshcat.StaticHtml())


def set_stage(meshcat: Meshcat, camera: Camera) -> None:
    """Set the background, without grid and axes, and the camera."""
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background", "top_color", [0.78, 0.85, 0.93])
    meshcat.SetProperty("/Background", "bottom_color", [0.96, 0.97, 0.98])
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=camera.field_of_view))
    eye: Array = np.array(camera.eye)
    target: Array = np.array(camera.target)
    meshcat.SetCameraPose(eye, target)


def _record_motion(motion: Motion, diagram: Diagram) -> None:
    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    count = plant.num_positions()
    if motion.positions.shape != (len(motion.time), count):
        raise InputError(f"replay: positions of shape {motion.positions.shape}, expected ({len(motion.time)}, {count})")
    visualizer = next(system for system in diagram.GetSystems() if isinstance(system, MeshcatVisualizer))
    context = diagram.CreateDefaultContext()
    visualizer.StartRecording(False)
    for time, q in zip(motion.time, motion.positions, strict=True):
        context.SetTime(time)
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), q)
        visualizer.ForcedPublish(visualizer.GetMyContextFromRoot(context))


def _draw_forces(meshcat: Meshcat, forces: Forces, stroke: float) -> None:
    for index in range(forces.forces.shape[1]):
        path = f"{ROOT}/force{index}"
        draw_arrow(meshcat, path, FORCE, stroke)
        vectors = forces.scale * forces.forces[:, index]
        for time, point, vector in zip(forces.time, forces.points[:, index], vectors, strict=True):
            move_arrow(meshcat, path, float(time), point, vector)
        for moment, visible in changes(forces.time, np.linalg.norm(vectors, axis=-1) > SHORTEST):
            meshcat.SetProperty(path, "visible", visible, moment)


def _draw_candidates(meshcat: Meshcat, candidates: Candidates, stroke: float) -> None:
    """The candidates of each planning step as thin lines, the chosen one as a thick one; one step at a time."""
    count = len(candidates.time)
    for index, (paths, chosen) in enumerate(zip(candidates.paths, candidates.chosen, strict=True)):
        path = f"{ROOT}/plan{index}"
        draw_lines(meshcat, f"{path}/all", paths, CANDIDATE)
        draw_tube(meshcat, f"{path}/chosen", paths[int(chosen)], 0.004 * stroke, CHOSEN)
        for moment, visible in changes(candidates.time, np.arange(count) == index):
            meshcat.SetProperty(path, "visible", visible, moment)


def _draw_beliefs(meshcat: Meshcat, replay: Replay) -> None:
    width, height = replay.panel_width, 0.62 * replay.panel_width
    frames = np.arange(0.0, replay.motion.time[-1] + 1e-9, 1.0 / FRAMES_PER_SECOND)
    X_WB = facing(np.array(replay.panel), np.array(replay.camera.eye), np.array(replay.camera.target))
    for index, belief in enumerate(replay.beliefs):
        shift = shifted(0.0, -1.08 * index * height, 0.0)
        board = Board(X_WB.multiply(shift), width, height)
        draw_panel(meshcat, f"{ROOT}/belief{index}", belief, board)
        animate_panel(meshcat, f"{ROOT}/belief{index}", belief, frames)
    if replay.title:
        meshcat.SetTransform(f"{ROOT}/title", X_WB.multiply(shifted(0.0, 1.06 * height, 0.0)))
        path = f"{ROOT}/title/words"
        draw_text(meshcat, path, replay.title, at=(0.0, 0.0), height=0.1 * height, width=width, bold=True)
    if replay.captions is not None:
        meshcat.SetTransform(f"{ROOT}/captions", X_WB.multiply(shifted(0.0, 1.22 * height, 0.0)))
        current = np.maximum(np.searchsorted(replay.captions.time, frames + 1e-9, side="right") - 1, 0)
        for index, text in enumerate(replay.captions.texts):
            page = f"{ROOT}/captions/page{index}"
            draw_text(meshcat, f"{page}/words", text, at=(0.0, 0.0), height=0.09 * height, width=width)
            for moment, visible in changes(frames, current == index):
                meshcat.SetProperty(page, "visible", visible, moment)
