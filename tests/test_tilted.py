"""The frame of a contact as nuisance: offset and tilt learned beside what is sought."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drake_cafim.errors import InputError
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import solve
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing
from drake_cafim.tasks.tilted import turned

LEGS = {
    "rubbing": [(0.06, 0.6), (0.02, 0.6), (0.02, 0.9)],
    "contouring": [(0.47, -0.05), (0.46, -0.028), (0.54, -0.028), (0.57, -0.05), (0.567, -0.015), (0.567, 0.015)],
}
TASKS = {"rubbing": rubbing, "contouring": contouring}


def felt(task, seed):
    """Data along the legs, forces of the task's model at its true parameters, with noise."""
    model, places = task.model, np.array(LEGS[task.name])
    ways = [np.linspace(*ends, 25, endpoint=False) for ends in pairwise(places)]
    positions = np.concatenate(ways)
    states = np.column_stack([positions, np.gradient(positions, model.period, axis=0)])
    clean = model.contact(np.zeros(0), states[1:], task.theta)
    noise = np.random.default_rng(seed).standard_normal(clean.shape)
    return Data(states, clean + model.noise_std * noise)


@pytest.mark.parametrize("name", TASKS)
def test_offset_and_tilt_are_learned_beside_what_is_sought(name):
    """What is touched stands 2 mm and 1.5 degrees beside its place: known to be so, the estimate holds the truth."""
    task = TASKS[name]()
    task = replace(task, model=replace(task.model, force_std=0.1 * task.model.force_std))
    off, angle = 0.002, np.deg2rad(-1.5)
    data = [felt(task.with_frame(off, angle), seed) for seed in range(4)]
    quiet = {}
    for which, planned in (("known", task), ("learned", task.with_unknown_place(0.003, np.deg2rad(1.0)))):
        found = solve(make_problem(planned.model, TangentEvaluator(planned.model), data)).belief
        sought = planned.model.parameters.sought
        quiet[which] = np.abs(found.mean[sought] - task.theta) / found.std[sought]
    assert quiet["known"].max() > 4.0, "the frame does not matter: no test"
    assert quiet["learned"].max() < 2.5
    assert planned.model.parameters.names[-1] == "tilt"
    assert abs(found.mean[-1] - angle) < 3.0 * found.std[-1] < 0.5 * abs(angle)


def test_the_force_turns_with_the_frame():
    """A wall turned by a right angle: what was pressing is sliding, and the force points along it."""
    task = rubbing().with_frame(0.0, np.pi / 2)
    model, pivot = task.model, task.model.pivot
    motion = np.array([0.02, 0.0, -0.1, 0.3])  # in the wall's frame, from the pivot
    upright = rubbing().model.contact(np.zeros(0), np.concatenate([pivot + motion[:2], motion[2:]]), np.array([0.4]))
    moved = np.concatenate([pivot + turned(motion[:2], np.pi / 2), turned(motion[2:], np.pi / 2)])
    force = model.contact(np.zeros(0), moved, np.array([0.4, 0.0, np.pi / 2]))
    assert upright[0] > 1.0 and upright[1] < -0.1
    np.testing.assert_allclose(force, [-upright[1], upright[0]], atol=1e-12)


def test_between_jaws_a_tilt_is_refused():
    with pytest.raises(InputError, match="--tilt-std: in pinching a tilt changes"):
        pinching().with_unknown_place(0.003, 0.01)
    assert pinching().with_unknown_place(0.003).model.parameters.names[-1] == "offset"
