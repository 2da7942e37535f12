"""What a learned law looks like, in words: its size, how often it repeats, how it goes with speed and way."""

import numpy as np

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.learned_force import MEMORY, POSITION, SPEED, LearnedForce, Term
from drake_cafim.numerics.rounding import rounded
from drake_cafim.typing import Array

REPEATING_SHARE = 0.6
"""Share of a function's variance that one sine must hold for it to be said to repeat."""
FEWEST_PERIODS = 1.5
"""Periods within the recorded range below which nothing is said to repeat."""
MOST_PERIODS = 12.0
"""Periods within the recorded range that a law can resolve."""
MEAN_SHARE = 0.1
"""Mean of a force that turns with the direction, over its change with position, below which it is not mentioned."""
FLAT_SHARE = 0.01
"""Change of a force over its mean, below which it is the same throughout."""
STEP_SHARE = 0.5
"""Share of the whole change over all speeds that lies about v = 0, from which on this is said."""
ALIKE = 0.5
"""Correlation of a force with the velocity, up to which it neither opposes the motion nor goes along with it."""


def words_of(law: LearnedForce, tree: Tree) -> str:
    """A phrase on each term of the law, with the sizes in N m or N."""
    joint = tree.joints[tree.joint_index(law.at)]
    phrases = [_phrase(term, joint.effort_unit, joint.prismatic) for term in law.terms]
    return f"at {law.at} a force that {', and '.join(phrases)}"


def _phrase(term: Term, unit: str, prismatic: bool) -> str:
    x, force = np.array(term.x), np.array(term.force)
    size, mean = f"{rounded(float(np.ptp(force)), 2)} {unit}", float(np.mean(force))
    if term.variables == MEMORY:
        distance = f"{rounded(term.x[0], 2)} {'m' if prismatic else 'rad'}"
        return f"lets friction of {rounded(-mean, 2)} {unit} build up over {distance} after the motion turned round"
    # over a narrow range a force may hardly change, and be large all the same
    if np.ptp(force) < FLAT_SHARE * abs(mean):
        return f"is {rounded(mean, 2)} {unit} throughout"
    level = f"is {rounded(mean, 2)} {unit} in the mean and " if abs(mean) > np.ptp(force) else ""
    if term.variables == POSITION:
        return f"{level}changes with position by {size}{_repeats(x, force, prismatic)}"
    if term.variables == SPEED:
        return level + _over_speed(x, force, size)
    if abs(mean) < MEAN_SHARE * float(np.ptp(force)):
        return f"changes with position by {size}, the other way round in the other direction"
    side = "against" if mean < 0.0 else "along"
    return (
        f"depends on the direction, {rounded(abs(mean), 2)} {unit} {side} the motion in the mean and changing with "
        f"position by {size}"
    )


def _over_speed(x: Array, force: Array, size: str) -> str:
    near = np.abs(x) <= 0.1 * np.max(np.abs(x))
    # a motion that never turns round has no speeds near zero
    step = float(np.ptp(force[near])) / max(float(np.ptp(force)), 1e-30) if near.any() else 0.0
    slope = float(np.corrcoef(x, force)[0, 1]) if np.ptp(force) > 0.0 else 0.0
    side = "opposes the motion" if slope < 0.0 else "goes along with the motion"
    side = side if abs(slope) > ALIKE else "depends on the velocity"
    turned = ", mostly where the motion turns round" if step > STEP_SHARE else ""
    return f"{side} and changes over the speeds by {size}{turned}"


def _repeats(x: Array, force: Array, prismatic: bool) -> str:
    """How often the function repeats, where one sine holds most of its variance."""
    span, varied = float(x[-1] - x[0]), force - np.polyval(np.polyfit(x, force, 1), x)
    best, share = 0.0, 0.0
    for periods in np.arange(FEWEST_PERIODS, MOST_PERIODS, 0.1):
        angle = 2.0 * np.pi * periods / span * x
        columns = np.stack([np.cos(angle), np.sin(angle), np.ones_like(x)], axis=1)
        left = varied - columns @ np.linalg.lstsq(columns, varied, rcond=None)[0]
        found = 1.0 - float(left @ left) / max(float(np.sum((varied - varied.mean()) ** 2)), 1e-30)
        if found > share:
            best, share = periods / span, found
    if share < REPEATING_SHARE or np.var(varied) < REPEATING_SHARE * np.var(force):
        return ""
    each = f"every {rounded(1.0 / best, 2)} m" if prismatic else f"{rounded(2.0 * np.pi * best, 2)} times a turn"
    return f" and repeats {each}"
