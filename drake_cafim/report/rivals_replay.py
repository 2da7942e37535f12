"""The replay of a motion that tells two explanations apart: simulated with each as the truth, with odds over time."""

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat

from drake_cafim.dynamics.tree import FIXED
from drake_cafim.output import write_text
from drake_cafim.report.colours import CORRECTED, NOMINAL
from drake_cafim.report.link_geometry import extent, link_shapes
from drake_cafim.report.recording_motion import frame_times, poses_at
from drake_cafim.report.recording_replay import FRAME_RATE, ROOT, STYLE, camera_for, draw_model, move_model
from drake_cafim.report.replay import make_meshcat, set_stage
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

COLOURS = (CORRECTED, NOMINAL)
PLANNED = "#5d6b7a"
SEEN = 0.25
"""Fraction of the model's size to which departures from the plan are magnified at most; true to scale, few are seen."""
TIMES = tuple(float(m * 10**k) for k in range(5) for m in (1, 2, 5))
FLOOR, CEILING = float(np.log(1.0 / 50.0)), float(np.log(1e4))
"""Limits of ln odds in the figure."""
WIDTH, HEIGHT, LEFT, BOTTOM = 320.0, 120.0, 52.0, 18.0
POINTS = 250


@dataclass(frozen=True)
class RivalRun:
    """A run where explanation `name` is true: positions `q` (T, n), and ln odds (W,) for it after `known` (W,) s."""

    name: str
    q: Array
    known: Array
    log_odds: Array


@dataclass(frozen=True)
class RivalsReplay:
    """The planned positions `q` (T, n) at `time` (T,) s, and for each explanation a run in which it is true."""

    scene: Scene
    time: Array
    q: Array
    runs: tuple[RivalRun, RivalRun]


def write_rivals_replay(path: Path, replay: RivalsReplay, meshcat: Meshcat | None = None) -> None:
    """Write the page to `path`, whole or not at all."""
    write_text(path, render_rivals(replay, meshcat or make_meshcat()))


def render_rivals(replay: RivalsReplay, meshcat: Meshcat) -> str:
    """The page; whatever `meshcat` showed before is deleted."""
    scene, frames = replay.scene, frame_times(replay.time)
    clock = frames - frames[0]
    planned = _at(frames, replay.time, replay.q)
    moving = poses_at(scene.physics, planned)
    size = extent(moving)
    shapes = link_shapes(scene, moving, size)
    carried = [shape for shape in shapes if shape.joint != FIXED]
    departures = [_at(frames, replay.time, run.q) - planned for run in replay.runs]
    times = magnified(scene, planned, departures, size)
    meshcat.Delete(ROOT)
    meshcat.DeleteRecording()
    set_stage(meshcat, camera_for(moving, size))
    draw_model(meshcat, f"{ROOT}/world", [shape for shape in shapes if shape.joint == FIXED], None)
    meshcat.StartRecording(frames_per_second=FRAME_RATE, set_visualizations_while_recording=False)
    draw_model(meshcat, f"{ROOT}/planned", carried, None)
    move_model(meshcat, f"{ROOT}/planned", moving, clock)
    for number, (departure, colour) in enumerate(zip(departures, COLOURS, strict=True)):
        draw_model(meshcat, f"{ROOT}/rival{number}", carried, colour)
        move_model(meshcat, f"{ROOT}/rival{number}", poses_at(scene.physics, planned + times * departure), clock)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    transport = (Path(__file__).parent / "transport.html").read_text(encoding="utf-8")
    head, _, tail = str(meshcat.StaticHtml()).rpartition("</body>")
    return f"{head}{_legend(replay, times)}{transport}{_cursor(replay)}</body>{tail}"


def magnified(scene: Scene, planned: Array, departures: list[Array], size: float) -> float:
    """The factor by which departures (F, n) from the planned positions are magnified: a round number, at least 1."""
    here = poses_at(scene.physics, planned)
    farthest = 0.0
    for departure in departures:
        there = poses_at(scene.physics, planned + departure)
        # a link's end is as far from its joint as the size at most
        turned = 0.5 * size * np.max(np.abs(there.R_WJ - here.R_WJ))
        farthest = max(farthest, float(np.max(np.abs(there.p_WJ - here.p_WJ))), float(turned))
    if farthest == 0.0:
        return 1.0
    return max((factor for factor in TIMES if factor * farthest <= SEEN * size), default=1.0)


def _at(frames: Array, time: Array, q: Array) -> Array:
    return np.stack([np.interp(frames, time, column) for column in q.T], axis=1)


def _legend(replay: RivalsReplay, times: float) -> str:
    first, second = (html.escape(run.name) for run in replay.runs)
    rows = [(PLANNED, "the planned motion")]
    rows += [(colour, f"if {run.name} is true") for run, colour in zip(replay.runs, COLOURS, strict=True)]
    if times > 1.0:
        rows.append(("none", f"departures from the plan are magnified {times:.0f} times"))
    items = "".join(f'<li><i style="background:{color}"></i>{html.escape(text)}</li>' for color, text in rows)
    values = "".join(
        f'<li><i style="background:{colour}"></i>for {html.escape(run.name)}, if it is true: <b></b></li>'
        for run, colour in zip(replay.runs, COLOURS, strict=True)
    )
    apart, departures = _departure_picture(replay)
    return (
        f'{STYLE}<div id="legend"><p>The motion that tells {first} from {second}, simulated with each of them '
        f"as the truth.</p><ul>{items}</ul><p>{html.escape(apart)}</p>{departures}<p>Odds for the true explanation</p>"
        f'{_odds_picture(replay)}<ul id="odds">{values}</ul></div>'
    )


def _odds_picture(replay: RivalsReplay) -> str:
    """ln odds over time, up to the ceiling."""
    marks = [
        (float(np.log(odds)), text) for odds, text in ((0.05, "1:20"), (1.0, "1:1"), (20.0, "20:1"), (1e3, "1000:1"))
    ]
    return _picture(replay, [_from_start(run) for run in replay.runs], (FLOOR, CEILING), marks)


def _departure_picture(replay: RivalsReplay) -> tuple[str, str]:
    """The title and the figure of the departures from the plan over time, of the joint whose two runs differ most."""
    joints, (first, second) = replay.scene.tree.joints, replay.runs
    j = int(np.argmax(np.max(np.abs(first.q - second.q), axis=0)))
    clock = replay.time - replay.time[0]
    every = slice(None, None, max(len(clock) // POINTS, 1))
    courses = [(clock[every], 1e3 * (run.q - replay.q)[every, j]) for run in replay.runs]
    most = max(float(np.max(np.abs(course))) for _, course in courses) or 1.0
    marks = [(sign * most, f"{sign * most:.2g}") for sign in (-1.0, 1.0)] + [(0.0, "0")]
    unit = "mm" if joints[j].prismatic else "mrad"
    return f"{joints[j].name} off the plan ({unit})", _picture(replay, courses, (-1.1 * most, 1.1 * most), marks)


def _picture(
    replay: RivalsReplay,
    courses: Sequence[tuple[Array, Array]],
    bounds: tuple[float, float],
    marks: Sequence[tuple[float, str]],
) -> str:
    """SVG: courses over time in the rivals' colours, clipped to `bounds`, a line for each mark and one for the time."""
    duration, tall = float(replay.time[-1] - replay.time[0]), HEIGHT - BOTTOM

    def up(values: Array) -> Array:
        return np.asarray(tall * (1.0 - (np.clip(values, *bounds) - bounds[0]) / (bounds[1] - bounds[0])))

    parts = []
    for value, text in marks:
        y = float(up(np.array(value)))
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH}" stroke="#c3cad2"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    for share, anchor in ((0.0, "start"), (0.5, "middle"), (1.0, "end")):
        at = LEFT + share * (WIDTH - LEFT)
        parts.append(f'<text x="{at}" y="{HEIGHT - 4}" text-anchor="{anchor}">{share * duration:.1f} s</text>')
    for (time, values), colour in zip(courses, COLOURS, strict=True):
        across = LEFT + (WIDTH - LEFT) * time / duration
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across.tolist(), up(values).tolist(), strict=True))
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
    parts.append(f'<path class="now" d="M{LEFT} 0V{tall}" stroke="#1a212e"/>')
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" style="width:100%;font-size:11px">{"".join(parts)}</svg>'


def _from_start(run: RivalRun) -> tuple[Array, Array]:
    """Time and ln odds of the run, from ln odds 0 at time 0: the explanations are equally probable a priori."""
    return np.concatenate([[0.0], run.known]), np.concatenate([[0.0], run.log_odds])


def _cursor(replay: RivalsReplay) -> str:
    """The script that shows the odds at the animation's time."""
    courses = [[series.round(4).tolist() for series in _from_start(run)] for run in replay.runs]
    duration = float(replay.time[-1] - replay.time[0])
    return f"""<script>
(function () {{
  const courses = {json.dumps(courses)}, values = document.querySelectorAll("#odds b");
  const strokes = document.querySelectorAll(".now");
  const words = x => x < 0 ? "1:" + number(-x) : number(x) + ":1";
  const number = x => x < Math.log(1e6) ? Number(Math.exp(x).toPrecision(2)) : "10^" + Math.round(x / Math.LN10);
  function show() {{
    if (viewer.animator && viewer.animator.duration > 0) {{
      const time = viewer.animator.time;
      const shift = `translate(${{{WIDTH - LEFT} * Math.min(time / {duration}, 1)}} 0)`;
      strokes.forEach(one => one.setAttribute("transform", shift));
      courses.forEach(([known, odds], k) => {{
        values[k].textContent = words(odds[known.findLastIndex(one => one <= time + 1e-9)]);
      }});
    }}
  }}
  setInterval(show, 40);
}})();
</script>"""
