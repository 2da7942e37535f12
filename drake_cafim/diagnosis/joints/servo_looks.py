"""First-order tests of effects of position servos, by differences of the rows."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import Look
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.effects.effect import Direction
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

TRACKED = 120
"""Values of a profile's bound whose profiles are compared with the joint's positions."""
SLOWEST = 0.125
"""The least of them, over the least of the effect's own looks: a command may never be as slow as what follows it."""
MOST_TRACKED = 3
"""Most of them, those that the positions follow best, that are tested."""
SCANS = (0.06, 0.015, 0.004, 0.001)
"""Reaches, as shares of the best value so far, in which the rows of a bounded profile are then scanned."""
EACH_SIDE = 4
"""Values of such a scan on each side of the best one."""


def driving(problem: WeakFormRows) -> tuple[Servo, ...]:
    """The servos that drive a joint in at least one recording."""
    driven = {j for form in problem.forms for j in form.samples.commands}
    tree = problem.scene.tree
    return tuple(servo for servo in problem.scene.physics.servos if tree.joint_index(servo.joint) in driven)


def servo_looks(problem: WeakFormRows, physics: Physics, at: Fit, effect: ServoEffect) -> Iterator[Look]:
    """The looks at `effect` beyond the fit `at`, which has this `physics`.

    How a bounded profile moves is no smooth function of its bound, and a command that is followed too slowly misses by
    ever more: only values within one or two percent show what the true one explains. So the values of which the
    positions follow the profile best are tested besides, and around the best of all the rows are scanned.
    """
    joint = problem.scene.tree.joint_index(effect.at)
    driven = [form.samples for form in problem.forms if joint in form.samples.commands]
    here = at.residual[: problem.rows]
    best, share = effect.values, 0.0
    for look in _looks(effect, driven, joint):
        columns = []
        for step in look:
            ahead = problem.data_rows(physics.with_effects([effect.with_values(step.ahead)]))
            behind = here
            if step.behind is not None:
                behind = problem.data_rows(physics.with_effects([effect.with_values(step.behind)]))
            columns.append((ahead - behind) / step.size)
        yield np.stack(columns, axis=1), partial(effect.from_look, look)
        if effect.bounds_profile:
            found = _share(effect, look, columns[0], here)
            best, share = (look[0].ahead, found) if found > share else (best, share)
    for reach in SCANS if share > 0.0 else ():
        about = best
        for times in 1.0 + np.linspace(-reach, reach, 2 * EACH_SIDE):
            values = {name: value * times for name, value in about.items()}
            column, look = problem.data_rows(physics.with_effects([effect.with_values(values)])) - here, _at(values)
            yield column[:, None], partial(effect.from_look, look)
            found = _share(effect, look, column, here)
            best, share = (values, found) if found > share else (best, share)


def _looks(effect: ServoEffect, driven: Sequence[Samples], joint: int) -> Iterator[Sequence[Direction]]:
    """The effect's own looks, and those at values of a bounded profile that the positions follow."""
    commands = [samples.commands[joint] for samples in driven]
    rates = [np.gradient(command.position, samples.time) for command, samples in zip(commands, driven, strict=True)]
    errors = [command.position - samples.q[:, joint] for command, samples in zip(commands, driven, strict=True)]
    own = list(effect.looks(np.concatenate(rates), np.concatenate(errors)))
    yield from own
    if effect.bounds_profile and own:
        for values in _tracked(effect, [look[0].ahead for look in own], driven, joint):
            yield _at(values)


def _at(values: Mapping[str, float]) -> tuple[Direction]:
    """The look at the effect with these values."""
    return (Direction(values, None, 1.0),)


def _tracked(
    effect: ServoEffect, about: Sequence[Mapping[str, float]], driven: Sequence[Samples], joint: int
) -> list[dict[str, float]]:
    """The values, from `SLOWEST` of the least to the largest `about`, of which the positions follow the profile best.

    The joint's position is taken for a combination of the profile's position, velocity and acceleration.
    """
    (name,) = about[0]
    bounds = [values[name] for values in about]
    levels = np.geomspace(SLOWEST * min(bounds), max(bounds), TRACKED)
    missed = np.zeros(TRACKED)
    for k, level in enumerate(levels):
        for samples in driven:
            followed = effect.with_values({name: float(level)}).follow(samples.commands[joint].over(samples.time))
            y = np.interp(samples.time, followed.times, followed.values)
            rate = np.gradient(y, samples.time)
            X = np.stack([np.ones_like(y), y, rate, np.gradient(rate, samples.time)], axis=1)
            q = samples.q[:, joint]
            missed[k] += float(np.sum((q - X @ np.linalg.lstsq(X, q, rcond=None)[0]) ** 2))
    beside = np.pad(missed, 1, constant_values=np.inf)
    lowest = np.flatnonzero((missed <= beside[:-2]) & (missed <= beside[2:]))
    chosen = lowest[np.argsort(missed[lowest])][:MOST_TRACKED]
    return [{name: float(levels[k])} for k in chosen]


def _share(effect: ServoEffect, look: Sequence[Direction], column: Array, residual: Array) -> float:
    """The share of a residual's square that a multiple of `column` takes from it; 0 if that is no value of `look`."""
    square = float(column @ column)
    if square == 0.0:
        return 0.0
    coefficient = -float(column @ residual) / square
    return coefficient**2 * square if effect.from_look(look, np.array([coefficient])) is not None else 0.0
