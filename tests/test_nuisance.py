"""What may be off about a contact or its sensor as nuisance: offset and tilt, bias and drift, learned with the rest."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drake_cafim.errors import InputError
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import solve
from drake_cafim.experiment.closed_loop import Options, run
from drake_cafim.experiment.kinematic_world import kinematic_world
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.hefting import Hefting, hefting
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


@pytest.mark.parametrize("model, drift", [(Hefting, 0.0), (CompliantHefting, -0.05)])
def test_a_sensors_bias_and_drift_are_learned_beside_the_mass(model, drift):
    """Off by a third of the ball's weight, and drifting: the mass is missed if that is not known to be possible."""
    task = hefting(model()).with_prior_mean(1.3)
    task = replace(task, model=replace(task.model, force_std=0.05))
    off, drift_std = task.with_sensor(0.15, drift, drift_std=abs(drift)), 2.0 * abs(drift)
    away = {}
    for which, planned in (("tared", task), ("learned", task.with_unknown_sensor(0.2, drift_std))):
        belief = run(planned, Options(seed=3, experiments=2), kinematic_world(off, seed=3)).belief
        sought = planned.model.parameters.sought
        away[which] = float((np.abs(belief.mean[sought] - 0.05) / belief.std[sought])[0])
    assert away["tared"] > 5.0 and away["learned"] < 2.5
    assert belief.names == off.model.parameters.names
    errors = np.abs(belief.mean - off.theta)[1:]
    assert (errors < 3.0 * belief.std[1:]).all() and (belief.std[1:] < [0.1, 0.03][: len(errors)]).all()


def test_a_tared_sensor_has_no_bias():
    with pytest.raises(InputError, match="--bias-std, --drift-std: pinching takes its force sensor as tared"):
        pinching().with_unknown_sensor(0.1, 0.0)
