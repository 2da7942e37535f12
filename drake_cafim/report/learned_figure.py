"""The figure of a learned law: each of its terms over the range that was recorded."""

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.bristle import bristle_after
from drake_cafim.effects.learned_force import MEMORY, POSITION, SIDED, SPEED, LearnedForce, Term
from drake_cafim.report.colours import CORRECTED
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.typing import Array

WIDTH, HEIGHT = 9.4, 2.3
"""Size of the figure in inches; the terms share its width."""
SLIPS_SHOWN = 5.0
"""Displacements s that are drawn of friction that builds up over s."""


def _curve(term: Term) -> tuple[Array, Array]:
    """The places and the forces to draw; of a memory, what is left of z − 1 after a turn from sliding back."""
    if term.variables != MEMORY:
        return np.array(term.x), np.array(term.force)
    way = np.linspace(0.0, SLIPS_SHOWN * term.x[0], 101)
    return way, term.force[0] * (bristle_after(-np.ones_like(way), way, term.x[0]) - 1.0)


def learned_figure(law: LearnedForce, tree: Tree) -> str:
    """SVG: a panel for each term, its force over position or velocity."""
    joint = tree.joints[tree.joint_index(law.at)]
    labels = {
        POSITION: f"position ({joint.position_unit})",
        SPEED: f"velocity ({joint.position_unit}/s)",
        SIDED: f"position ({joint.position_unit}), moving in the positive direction",
        MEMORY: f"way since it turned to the positive direction ({joint.position_unit})",
    }
    with page_style():
        figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
        panels = figure.subplots(1, len(law.terms), squeeze=False, sharey=True)[0]
        for axes, term in zip(panels, law.terms, strict=True):
            axes.plot(*_curve(term), color=CORRECTED)
            axes.set_xlabel(labels[term.variables])
        # a force that hardly changes is shown as one: with zero in the picture
        panels[0].set_ylim(min(panels[0].get_ylim()[0], 0.0), max(panels[0].get_ylim()[1], 0.0))
        panels[0].set_ylabel(f"force ({joint.effort_unit})")
        return as_svg(figure, f"the learned force at {law.at}")
