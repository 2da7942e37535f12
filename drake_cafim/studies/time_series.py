"""The figure of one contact-aware experiment over time: position, velocity and contact force."""

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.studies.cell import TASKS
from drake_cafim.studies.curves import COLOURS

AXES = {"hefting": ("z",), "rubbing": ("x", "y"), "pinching": ("x",), "contouring": ("x", "y")}
FORCES = {"hefting": ("normal",), "rubbing": ("normal", "tangential"), "pinching": ("normal",)}


def time_series(name: str, seed: int = 0) -> str:
    """SVG of position (m), velocity (m/s) and force (N) of the first experiment in the kinematic world."""
    task = TASKS[name]().with_prior_mean(1.3)
    (experiment,) = run(task, Options(seed=seed, experiments=1)).experiments
    size = experiment.commands.shape[1]
    states = experiment.robot_states
    rows = (
        ("position, m", experiment.time, states[:, :size], AXES[name]),
        ("velocity, m/s", experiment.time[1:], states[1:, size:], AXES[name]),
        ("force, N", experiment.time[1:], experiment.true_force, FORCES.get(name, AXES[name])),
    )
    with page_style():
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        for axes, (label, time, values, names) in zip(
            np.atleast_1d(figure.subplots(3, sharex=True)), rows, strict=True
        ):
            for column, colour, called in zip(values.T, COLOURS, names, strict=False):
                axes.step(time, column, where="pre", color=colour, linewidth=1.0, label=called)
            axes.set_ylabel(label)
            axes.legend(fontsize=7, loc="upper right")
        axes.set_xlabel("time, s")
        figure.suptitle(name)
        return as_svg(figure, f"Position, velocity and force over time, {name}")
