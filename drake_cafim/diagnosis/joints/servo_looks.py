"""First-order tests of effects of position servos, by differences of the rows."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import Look
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.scenario.physics import Physics


def driving(problem: WeakFormRows) -> tuple[Servo, ...]:
    """The servos that drive a joint in at least one recording."""
    driven = {j for form in problem.forms for j in form.samples.commands}
    tree = problem.scene.tree
    return tuple(servo for servo in problem.scene.physics.servos if tree.joint_index(servo.joint) in driven)


def servo_looks(problem: WeakFormRows, physics: Physics, at: Fit, effect: ServoEffect) -> Iterator[Look]:
    """The looks at `effect` beyond the fit `at`, which has this `physics`."""
    joint = problem.scene.tree.joint_index(effect.at)
    rates, errors = [], []
    for form in problem.forms:
        command = form.samples.commands.get(joint)
        if command is not None:
            rates.append(np.gradient(command.position, form.samples.time))
            errors.append(command.position - form.samples.q[:, joint])
    here = at.residual[: problem.rows]
    for look in effect.looks(np.concatenate(rates), np.concatenate(errors)):
        columns = []
        for step in look:
            ahead = problem.data_rows(physics.with_effects([effect.with_values(step.ahead)]))
            behind = here
            if step.behind is not None:
                behind = problem.data_rows(physics.with_effects([effect.with_values(step.behind)]))
            columns.append((ahead - behind) / step.size)
        yield np.stack(columns, axis=1), partial(effect.from_look, look)
