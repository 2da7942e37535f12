"""The replay of a recording beside simulations of it, in Meshcat, as one HTML page that needs no network."""

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from pydrake.geometry import Cylinder, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.motion import Motion
from drake_cafim.dynamics.tree import FIXED
from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.report.colours import CORRECTED, NOMINAL, RESIDUAL
from drake_cafim.report.link_geometry import LinkShape, cloud, extent, link_shapes, too_large
from drake_cafim.report.panel import changes
from drake_cafim.report.recording_motion import (
    Arrow,
    contact_arrows,
    frame_times,
    lacking_arrows,
    poses_at,
    recorded_frames,
    simulated_frames,
)
from drake_cafim.report.replay import make_meshcat, set_stage
from drake_cafim.report.replay_data import Camera
from drake_cafim.report.shapes import draw_arrow, move_arrow
from drake_cafim.report.wording import short
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

ROOT = "/replay"
GHOST = 0.5
"""Opacity of a simulation."""
CONTACT = Rgba(0.76, 0.16, 0.11, 1.0)
FRAME_RATE = 32.0


@dataclass(frozen=True)
class RecordingReplay:
    """The contents of a replay: a recording, its nominal model, the corrected model or None, and shares by place."""

    scene: Scene
    weak: WeakForm
    nominal: Physics
    corrected: Physics | None = None
    shares: dict[str, float] = field(default_factory=dict)
    """Share of the misfit by the name of a joint, body, contact or channel."""
    sentence: str = ""


def write_recording_replay(path: Path, replay: RecordingReplay, meshcat: Meshcat | None = None) -> None:
    """Write the page to `path`, whole or not at all."""
    write_text(path, render(replay, meshcat or make_meshcat()))


def render(replay: RecordingReplay, meshcat: Meshcat) -> str:
    """The page that shows `replay`; whatever `meshcat` showed before is deleted.

    Raises `InputError` for a recording that is too short to be simulated.
    """
    weak = replay.weak
    if weak.samples.recording.duration <= 0.0:
        raise InputError(f"{weak.samples.recording.name}: it lasts no time, expected at least two samples")
    frames = frame_times(weak.samples.time)
    moving = poses_at(replay.scene.physics, recorded_frames(weak, frames))
    size = extent(moving)
    shapes = link_shapes(replay.scene, moving, size)
    meshcat.Delete(ROOT)
    meshcat.DeleteRecording()
    set_stage(meshcat, camera_for(moving, size))
    draw_model(meshcat, f"{ROOT}/world", [s for s in shapes if s.joint == FIXED], None)
    meshcat.StartRecording(frames_per_second=FRAME_RATE, set_visualizations_while_recording=False)
    carried = [shape for shape in shapes if shape.joint != FIXED]
    models = [("recording", moving, None), ("nominal", _simulated(replay, replay.nominal, frames), NOMINAL)]
    if replay.corrected is not None:
        models.append(("corrected", _simulated(replay, replay.corrected, frames), CORRECTED))
    clock = frames - frames[0]
    for name, motion, color in models:
        draw_model(meshcat, f"{ROOT}/{name}", carried, color)
        move_model(meshcat, f"{ROOT}/{name}", motion, clock)
    arrows = [(CONTACT, "contact", contact_arrows(weak, replay.corrected or replay.nominal, moving, frames, size))]
    arrows.append(
        (rgba(NOMINAL), "lacking", lacking_arrows(weak, replay.nominal, moving, frames, size, beside=replay.nominal))
    )
    if replay.corrected is not None:
        remaining = lacking_arrows(weak, replay.corrected, moving, frames, size, beside=replay.nominal)
        arrows.append((rgba(CORRECTED), "remaining", remaining))
    for color_, kind, group in arrows:
        _draw_arrows(meshcat, f"{ROOT}/{kind}", group, color_, clock, size)
    _draw_places(meshcat, replay, moving, clock, size)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    legend = _legend(replay, {kind for _, kind, group in arrows if group})
    transport = (Path(__file__).parent / "transport.html").read_text(encoding="utf-8")
    head, _, tail = str(meshcat.StaticHtml()).rpartition("</body>")
    return f"{head}{legend}{transport}</body>{tail}"


def _simulated(replay: RecordingReplay, physics: Physics, frames: Array) -> Motion:
    return poses_at(physics, simulated_frames(replay.weak, physics, frames))


def draw_model(meshcat: Meshcat, path: str, shapes: Sequence[LinkShape], color: str | None) -> None:
    """The shapes under one path a joint; in one transparent `color` where it is given."""
    for index, drawn in enumerate(shapes):
        place = f"{path}/joint{drawn.joint}/shape{index}"
        meshcat.SetObject(place, drawn.shape, drawn.color if color is None else rgba(color, GHOST))
        meshcat.SetTransform(place, drawn.X_JG)
        if color is not None:  # slightly smaller, so that it is inside the recording's shapes where the two coincide
            slimmer = [0.8, 0.8, 0.995] if isinstance(drawn.shape, Cylinder) else [0.92, 0.92, 0.92]
            meshcat.SetProperty(place, "scale", slimmer)


def move_model(meshcat: Meshcat, path: str, motion: Motion, clock: Array) -> None:
    """Record the poses of all joints at the times `clock` (F,) s."""
    for j in range(motion.q.shape[1]):
        for frame, time in enumerate(clock):
            pose = RigidTransform(_rotation(motion.R_WJ[frame, j]), motion.p_WJ[frame, j])
            meshcat.SetTransform(f"{path}/joint{j}", pose, float(time))


def _rotation(R: Array) -> RotationMatrix:
    return RotationMatrix.ProjectToRotationMatrix(R)


def _draw_arrows(meshcat: Meshcat, path: str, arrows: Sequence[Arrow], color: Rgba, clock: Array, size: float) -> None:
    for index, arrow in enumerate(arrows):
        place = f"{path}/arrow{index}"
        draw_arrow(meshcat, place, color, 0.8 * size)
        for time, point, vector in zip(clock, arrow.points, arrow.vectors, strict=True):
            move_arrow(meshcat, place, float(time), point, vector)
        for moment, visible in changes(clock, np.linalg.norm(arrow.vectors, axis=1) > 0.015 * size):
            meshcat.SetProperty(place, "visible", visible, moment)


def _draw_places(meshcat: Meshcat, replay: RecordingReplay, moving: Motion, clock: Array, size: float) -> None:
    """Draw a transparent sphere at each place of the misfit, larger and darker with its share."""
    colours = LinearSegmentedColormap.from_list("share", RESIDUAL[1:])
    for index, (name, share) in enumerate(replay.shares.items()):
        found = _place(replay, name)
        if found is None:
            continue
        joint, p_JP = found
        red, green, blue, _ = colours(share)
        path = f"{ROOT}/places/place{index}"
        meshcat.SetObject(path, Sphere(size * (0.035 + 0.025 * share)), Rgba(red, green, blue, 0.42))
        points, _ = moving.point(joint, p_JP)
        for time, point in zip(clock, points, strict=True):
            meshcat.SetTransform(path, RigidTransform(point), float(time))


def _place(replay: RecordingReplay, name: str) -> tuple[int, Array] | None:
    """The joint that moves a place, and its point in the joint's frame, (3,) m; None where it has no position."""
    tree = replay.scene.tree
    parts = name.split("/")[0]
    joint = parts.removeprefix("q.").removeprefix("v.").removeprefix("u.")
    if joint in tree.joint_names:
        return tree.joint_index(joint), np.zeros(3)
    for sensor in replay.weak.sensors:
        if name.startswith(f"wrench.{sensor.name}"):
            return sensor.joint, np.asarray(sensor.p_JS, dtype=float)
    for body in tree.bodies:
        if body.name == parts:
            return body.joint, np.asarray(body.p_JB + body.R_JB @ body.p_BBcm, dtype=float)
    return None


def camera_for(moving: Motion, size: float) -> Camera:
    """Looks across the plane in which most of the motion is, from somewhat above."""
    points = cloud(moving)
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    spread = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    normal = spread[2] if spread[2][1] <= 0.0 else -spread[2]  # from the side on which x points to the right
    if abs(normal[2]) > 0.7:
        normal = np.array([0.25, -0.8, 0.6])
    eye = normal / np.linalg.norm(normal) + np.array([0.0, 0.0, 0.3])
    # the legend covers the left of the picture
    center = center - 0.22 * size * np.cross([0.0, 0.0, 1.0], eye) / np.linalg.norm(eye[:2])
    away = center + 1.75 * size * eye / np.linalg.norm(eye)
    return Camera(eye=_triple(away), target=_triple(center))


def _triple(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def rgba(color: str, opacity: float = 1.0) -> Rgba:
    """The colour that #rrggbb names."""
    red, green, blue = (int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return Rgba(red, green, blue, opacity)


def _legend(replay: RecordingReplay, kinds: set[str]) -> str:
    """The legend as HTML: the verdict's sentence, the meaning of the colours, and the shares of the misfit."""
    rows = [("#5d6b7a", f"the recording, {short(replay.weak.samples.recording.name)}")]
    without = "the model without the effects" if replay.corrected else "the model"
    rows.append((NOMINAL, f"{without}, simulated from the measured state anew every second"))
    if replay.corrected:
        rows.append((CORRECTED, "the model with the effects, likewise; hidden where it coincides with the recording"))
    if too_large(replay.scene):
        rows.append(("#5d6b7a", "bars along the links: the model's meshes are too large for a page"))
    if "contact" in kinds:
        rows.append(("#c2291d", "arrow: contact force"))
    if "lacking" in kinds:
        rows.append((NOMINAL, "arrow: force that the model lacks; a torque is drawn as a force on its link"))
    if "remaining" in kinds:
        rows.append((CORRECTED, "arrow: force that is still lacking with the effects"))
    colours = LinearSegmentedColormap.from_list("share", RESIDUAL[1:])
    for name, share in replay.shares.items():
        red, green, blue, _ = (int(255 * c) for c in colours(share))
        rows.append((f"rgb({red},{green},{blue})", f"{name}: {100 * share:.0f} % of the misfit"))
    items = "".join(f'<li><i style="background:{color}"></i>{html.escape(text)}</li>' for color, text in rows)
    words = re.sub(r" \([^()]*\)", "", replay.sentence)  # the numbers stand in the report
    sentence = f"<p>{html.escape(words)}</p>" if words else ""
    return f'{STYLE}<div id="legend">{sentence}<ul>{items}</ul></div>'


STYLE = """<style>#legend{position:fixed;left:14px;top:12px;max-width:23rem;background:rgba(255,255,255,.86);
border-radius:6px;padding:.6rem .9rem;font:13px/1.4 system-ui,"DejaVu Sans",sans-serif;color:#1a212e;z-index:10;
pointer-events:none}#legend p{margin:0 0 .45rem;font-weight:600}#legend ul{list-style:none;margin:0;padding:0}
#legend li{margin:.12rem 0;padding-left:1.2rem;text-indent:-1.2rem}
#legend i{display:inline-block;width:.7rem;height:.7rem;border-radius:2px;margin-right:.5rem}</style>"""
