"""What fixes the scale of efforts where no effort was recorded: kp as stated, its prior, or known masses.

With commands and positions alone, kp and all other efforts of a joint may be multiplied by one factor. Only a force in
N m that is known beside them fixes it: the weight, or the inertia, of known masses, or kp itself.
"""

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.scenario.physics import Physics

DETERMINED = 0.5
"""Std of kp after the fit, over that of its prior, below which the recordings and not the prior tell kp."""


def effort_scale_notes(problem: Problem, best: Fit) -> tuple[str, ...]:
    """A note for each joint that a servo drives without recorded efforts; none for other recordings."""
    if not isinstance(problem, WeakFormRows):
        return ()
    scene, physics = problem.scene, best.model.physics(problem.scene)
    driven = sorted({j for form in problem.forms for j in form.samples.commands})
    return tuple(_note(problem, best, physics, j) for j in driven if scene.physics.servos)


def _note(problem: WeakFormRows, best: Fit, physics: Physics, joint: int) -> str:
    name = physics.tree.joint_names[joint]
    subject = f"the scale of the efforts at {name}, which were not recorded,"
    for index, unknown in enumerate(problem.scene.unknown):
        if (unknown.parameter, unknown.at) == ("servo_stiffness", name):
            ratio = float(best.std[index] / unknown.prior.std)
            if ratio > DETERMINED:
                return (
                    f"{subject} rests on the prior of servo_stiffness: the recordings leave {ratio:.2g} of its std; "
                    "strengths in N m (N) there are multiples of kp"
                )
            weight, motion = _known_efforts(problem, physics, joint)
            source = "the weight" if weight > motion else "the inertia"
            return f"{subject} is fixed by {source} of the model's masses, which are taken as known"
    return f"{subject} is that of kp as stated; an error of kp multiplies every strength in N m (N) there"


def _known_efforts(problem: WeakFormRows, physics: Physics, joint: int) -> tuple[float, float]:
    """N m (N), root mean squares of the efforts by gravity and by the acceleration of the model's masses."""
    weight, inertial = [], []
    for form in problem.forms:
        moving = form.motion(physics)
        weight.append(physics.loads(moving.q)[:, joint])
        momentum = physics.momentum_and_force(moving)[0][:, joint]
        inertial.append(np.gradient(momentum, form.samples.time))
    found = [float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for parts in (weight, inertial)]
    return found[0], found[1]
