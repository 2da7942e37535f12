"""Links whose ten inertial parameters are all wrong, each by a like share, and still those of a body that can be.

A link is a cloud of mass m about its centre c, whose spread along its principal axes P are the radii g (3,) of the
second moments a unit of mass. In the units of these radii every cloud of a positive mass and a positive definite
spread is a body. The ten numbers `by` are the relative change of the mass, the shift of the centre along the axes
(in radii) and the relative change of the spread, (xx, yy, zz, xy, xz, yz).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .robots import Array, Link, Robot

NUMBERS = 10
LEAST, MOST = 0.1, 0.3
"""By how much each of the numbers is wrong, up or down. A spread stays positive: 1 - 0.3 is more than 2 times 0.3."""
STD = 0.2
"""What the scenario states of all of them: between the two, as the root mean square of what is drawn is 0.21."""
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def changed(link: Link, by: Array) -> Link:
    """The link with its ten numbers changed `by` (10,)."""
    second = 0.5 * np.trace(link.inertia) * np.eye(3) - link.inertia
    squares, axes = np.linalg.eigh(second / link.mass)
    radii = axes * np.sqrt(squares)
    spread = np.eye(3)
    for change, (i, j) in zip(by[4:], _PLACES, strict=True):
        spread[i, j] += change
        spread[j, i] = spread[i, j]
    mass = link.mass * (1.0 + by[0])
    second = mass * radii @ spread @ radii.T
    return replace(
        link, mass=float(mass), com=link.com + radii @ by[1:4], inertia=np.trace(second) * np.eye(3) - second
    )


def wrong(rng: np.random.Generator, robot: Robot) -> tuple[Robot, list[dict[str, object]], dict[str, float]]:
    """The true robot, the scenario's `unknown`, and the true masses."""
    true, values = robot, {}
    for index, link in enumerate(robot.links):
        size, sign = rng.uniform(LEAST, MOST, NUMBERS), rng.choice([-1.0, 1.0], NUMBERS)
        true = true.replace_link(index, changed(link, sign * size))
        values[f"mass.{link.name}"] = true.links[index].mass
    return true, [{"parameter": "inertials", "body": "all", "std": STD}], values
