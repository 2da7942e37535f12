"""What remains after the explanation, against all that it might depend on."""

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.diagnosis.location import places_of
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.report.colours import ALARM, INK, MUTED
from drake_cafim.report.evidence import thinned
from drake_cafim.report.missing import missing, row_labels, row_units, window_means
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

BINS = 24


def remains_figure(problem: WeakProblem, physics: Physics, place: str) -> str | None:
    """The force or reading that `physics` leaves unexplained at a place; None where the place has no row of its own."""
    names = [name for _, name in places_of(problem)]
    if place not in names:
        return None
    row = names.index(place)
    joint = _joint_of(problem, row)
    forms = [run.weak for run in problem.runs]
    means = [window_means(form, physics) for form in forms]
    y = np.concatenate([missing(form, physics)[:, row] for form in forms])
    name, unit = problem.scene.tree.joint_names[joint], problem.scene.tree.joints[joint].position_unit
    effort = problem.scene.tree.joints[joint].effort_unit
    panels = [
        (f"position of {name} ({unit})", np.concatenate([one.q[:, joint] for one in means])),
        (f"velocity ({unit}/s)", np.concatenate([one.v[:, joint] for one in means])),
        (f"effort ({effort})", np.concatenate([one.u[:, joint] for one in means])),
        ("time (s)", np.concatenate([one.time - one.time[0] for one in means])),
    ]
    with page_style():
        figure = Figure(figsize=(9.4, 2.5), layout="constrained")
        chosen = thinned(len(y))
        low, high = np.quantile(y, [0.005, 0.995])
        margin = 0.15 * max(float(high - low), 1e-12)
        for axes, (label, x) in zip(figure.subplots(1, 4, sharey=True), panels, strict=True):
            axes.axhline(0.0, color=MUTED, linewidth=0.8)
            axes.plot(x[chosen], y[chosen], "o", color=INK, markersize=2.0, markeredgewidth=0.0, alpha=0.25)
            axes.plot(*_trend(x, y), color=ALARM, linewidth=2.0)
            axes.set_xlabel(label)
            axes.set_ylim(float(low) - margin, float(high) + margin)
        figure.axes[0].set_ylabel(f"{row_labels(problem)[row]} ({row_units(problem)[row]})")
        return as_svg(figure, f"What remains at {place} against position, velocity, effort and time")


def _joint_of(problem: WeakProblem, row: int) -> int:
    """The joint whose motion a row is shown against: its own, or the one that carries the sensor."""
    weak = problem.runs[0].weak
    if row < weak.kinematic_rows:
        return row
    if row < weak.dynamic.stop:
        return int(row - weak.dynamic.start)
    sensor = (row - weak.dynamic.stop) // 6
    carrier = weak.sensors[sensor].joint if sensor < len(weak.sensors) else weak.joints - 1
    return max(int(carrier), 0)


def _trend(x: Array, y: Array) -> tuple[Array, Array]:
    """Medians of y in bins that hold equally many points."""
    order = np.argsort(x, kind="stable")
    parts = [part for part in np.array_split(order, min(BINS, max(1, len(x) // 8))) if len(part)]
    return np.array([np.median(x[part]) for part in parts]), np.array([np.median(y[part]) for part in parts])
