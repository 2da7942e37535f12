"""Figures of a law over the data: the force that the model lacks without an effect, and the effect's force."""

from collections.abc import Callable
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_cafim.diagnosis.fit.pictures import Evidence
from drake_cafim.dynamics.tree import Joint
from drake_cafim.effects.actuator import ActuatorEffect, Effort
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.report.colours import CORRECTED, MUTED, NOMINAL
from drake_cafim.report.evidence import Picture, draw_law, draw_points, drawn_indices, fit_limits
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.report.time_picture import over_time
from drake_cafim.typing import Array


def law_picture(evidence: Evidence) -> Picture:
    """The law over its variable where it depends on one alone, else over time.

    Raises `FloatingPointError` where a simulation that the data come from has run away, so that nothing can be drawn.
    """
    if not all(any(np.any(np.isfinite(part)) for part in rows) for rows in (evidence.without, evidence.with_it)):
        raise FloatingPointError("no finite number is left of the data")
    with page_style():
        return PICTURES[evidence.effect.shown_over](evidence)


def _over_its_variable(evidence: Evidence) -> Picture:
    """Over velocity or position where the law depends on it alone, else over time."""
    effect = cast(JointForce, evidence.effect)
    q, v, u = (_joint_data(evidence, variable)[1] for variable in "qvu")
    law = effect.force(JointSamples(q, v, u))
    moved = [bool(np.any(slope)) for slope in (law.d_q, law.d_v, law.d_u)]
    if moved == [False, True, False]:
        return _over_velocity(evidence, effect)
    if moved == [True, False, False]:
        return _over_position(evidence)
    return over_time(evidence)


def _over_velocity(evidence: Evidence, effect: JointForce) -> Picture:
    joint, x, y, unit, rate = *_joint_data(evidence, "v"), _joint(evidence).position_unit + "/s"
    if effect.slip is not None:  # it is no function of the velocity
        row = evidence.first_force + evidence.tree.joint_index(effect.at)
        given = y - np.concatenate([values[:, row] for values in evidence.with_it])
        svg = _dots_over(x, y, given, f"velocity of {joint} ({rate})", f"missing force ({unit})")
        return Picture(svg, _each_point(evidence) + "blue is the law's, which builds up after the motion turns round.")
    # a change of sign has a width of its own
    near = float(np.max(np.abs(x))) * np.linspace(-0.05, 0.05, 201)
    grid = np.unique(np.concatenate([_grid(x), near]))
    law = effect.force(JointSamples(np.zeros_like(grid), grid, np.zeros_like(grid))).value
    svg = _law_over(x, y, grid, law, f"velocity of {joint} ({rate})", f"missing force ({unit})")
    return Picture(
        svg, _each_point(evidence) + "the line is the law. A window with a reversal averages over both signs."
    )


def _over_position(evidence: Evidence) -> Picture:
    effect = cast(JointForce, evidence.effect)
    joint, x, y, unit = _joint_data(evidence, "q")
    grid = _grid(x, 400)
    label = f"position of {joint} ({_joint(evidence).position_unit})"
    caption = _each_point(evidence)
    given = effect.force(JointSamples(x, _joint_data(evidence, "v")[1], np.zeros_like(x)))
    if np.any(given.d_v):  # it damps too: its force is no function of the position alone
        svg = _dots_over(x, y, given.value, label, f"missing force ({unit})")
        return Picture(svg, caption + "blue is the law's force in the same window.")
    law = effect.force(JointSamples(grid, np.zeros_like(grid), np.zeros_like(grid))).value
    svg = _law_over(x, y, grid, law, label, f"missing force ({unit})")
    return Picture(svg, caption + "the line is the law.")


def _over_load(evidence: Evidence) -> Picture:
    effect = cast(JointForce, evidence.effect)
    joint, effort, y, unit = _joint_data(evidence, "u")
    v = _joint_data(evidence, "v")[1]
    moving = np.abs(v) > 0.05 * np.max(np.abs(v))
    x, y = np.abs(effort[moving]), -y[moving] * np.sign(v[moving])
    grid = np.linspace(0.0, float(np.max(x)), 100)
    ones = np.ones_like(grid)
    law = -effect.force(JointSamples(0.0 * ones, 1e3 * ones, grid)).value
    svg = _law_over(x, y, grid, law, f"size of the effort at {joint} ({unit})", f"force against the motion ({unit})")
    return Picture(svg, "Each point is the missing force against the motion, in a window in which the joint moves.")


def _over_acceleration(evidence: Evidence) -> Picture:
    effect = evidence.effect
    joint, x, y, unit = _joint_data(evidence, "a")
    grid = _grid(x)
    label = f"acceleration of {joint} ({_joint(evidence).position_unit}/s²)"
    svg = _law_over(x, y, grid, -effect.values["inertia"] * grid, label, f"missing force ({unit})")
    return Picture(svg, _each_point(evidence) + "the slope of the line is the inertia.")


def _over_effort(evidence: Evidence) -> Picture:
    effect = cast(ActuatorEffect, evidence.effect)
    joint, x, y, unit = _joint_data(evidence, "u")
    grid = _grid(x, 400)
    law = effect.drive(Effort(np.arange(len(grid), dtype=float), grid)).values
    figure, axes = _single()
    axes.plot(grid, grid, color=NOMINAL, linewidth=1.2, linestyle=(0, (4, 3)), label="as the model has it")
    draw_law(axes, grid, law)
    draw_points(axes, x, x + y)
    axes.set_xlabel(f"effort asked of {joint} ({unit})")
    axes.set_ylabel(f"effort that acted ({unit})")
    axes.legend(loc="upper left")
    svg = as_svg(figure, f"Effort that acted against effort asked for at {joint}")
    return Picture(svg, "Each point is the effort that acted in a window, as inverse dynamics of its motion gives it.")


def _law_over(x: Array, y: Array, grid: Array, law: Array, x_label: str, y_label: str) -> str:
    figure, axes = _single()
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    draw_law(axes, grid, law)
    draw_points(axes, x, y)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    fit_limits(axes, np.concatenate([y, law]))
    return as_svg(figure, f"{y_label} against {x_label}")


def _dots_over(x: Array, y: Array, given: Array, x_label: str, y_label: str) -> str:
    figure, axes = _single()
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    chosen = drawn_indices(len(x))
    axes.plot(x[chosen], given[chosen], "o", color=CORRECTED, markersize=4.5, markeredgewidth=0.0, alpha=0.45)
    draw_points(axes, x, y)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    fit_limits(axes, np.concatenate([y, given]))
    return as_svg(figure, f"{y_label} against {x_label}")


def _single() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.2, 3.1), layout="constrained")
    return figure, figure.subplots()


def _joint_data(evidence: Evidence, variable: str) -> tuple[str, Array, Array, str]:
    """The effect's joint, a variable of its motion, what is missing there, and the force's unit; all recordings."""
    tree = evidence.tree
    j = tree.joint_index(evidence.effect.at)
    row = evidence.first_force + j
    x = np.concatenate([getattr(means, variable)[:, j] for means in evidence.means])
    y = np.concatenate([values[:, row] for values in evidence.without])
    return evidence.effect.at, x, y, tree.joints[j].effort_unit


def _joint(evidence: Evidence) -> Joint:
    tree = evidence.tree
    return tree.joints[tree.joint_index(evidence.effect.at)]


def _grid(x: Array, count: int = 200) -> Array:
    return np.linspace(float(np.min(x)), float(np.max(x)), count)


def _each_point(evidence: Evidence) -> str:
    width = 1e3 * evidence.width
    return f"Each point is the force at {evidence.effect.at} that the model lacks, averaged over {width:.0f} ms; "


PICTURES: dict[str, Callable[[Evidence], Picture]] = {
    "time": over_time,
    "variable": _over_its_variable,
    "position": _over_position,
    "load": _over_load,
    "acceleration": _over_acceleration,
    "effort": _over_effort,
}
"""Drawing functions by an effect's `shown_over`."""
