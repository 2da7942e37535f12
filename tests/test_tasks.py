"""The planning models' own physics and counts."""

import numpy as np
import pytest

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.errors import InputError
from drake_cafim.numerics.motion_counts import count_make_breaks, count_reversals
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.configure import configure
from drake_cafim.tasks.contouring import Contouring, contouring
from drake_cafim.tasks.hefting import Hefting, hefting
from drake_cafim.tasks.pinching import Pinching, hunt_crossley_pinching, pinching
from drake_cafim.tasks.rubbing import Rubbing, rubbing


def test_the_hand_stays_in_its_workspace_and_brakes_below_g():
    model = Hefting()
    for command in (1.0, -1.0):
        motion = model.motion(np.array([0.2, 0.0]), np.full((1, 60, 1), command))[0]
        assert motion[:, 0].min() > -1e-12 and motion[:, 0].max() < 0.6 + 1e-12
        if command > 0:
            assert motion[:, 2].min() > -9.81
        assert abs(motion[-1, 0] - (0.6 if command > 0 else 0.0)) < 0.02


def test_rigid_force_is_weight_and_inertia():
    model = Hefting()
    motion = np.array([[0.2, 0.0, 0.0], [0.2, 0.0, 3.0], [0.2, 0.0, -12.0]])
    force = model.contact(np.zeros((3, 0)), motion, np.array([0.05]))
    np.testing.assert_allclose(force[:, 0], 0.05 * np.array([9.81, 12.81, 0.0]))


def test_compliant_ball_rests_at_its_equilibrium_and_flies_when_dropped():
    model, theta = CompliantHefting(), np.array([0.05])
    motion = model.motion(np.array([0.2, 0.0]), np.zeros((1, 6, 1)))
    start = model.start(motion[0, 0], theta)
    x = start.state
    for k in range(motion.shape[1] - 1):
        force = model.contact(x, motion[0, k], theta)
        np.testing.assert_allclose(force, 0.05 * 9.81, rtol=1e-9)
        x = model.step(x, motion[0, k], motion[0, k + 1], force, theta)
    falling = model.motion(np.array([0.5, 0.0]), np.array([[[-1.0], [-1.0]]]))[0]
    assert falling[1, 2] < -9.81
    x = model.start(falling[0], theta).state
    flown = False
    for k in range(len(falling) - 1):
        force = model.contact(x, falling[k], theta)
        flown |= force[0] == 0.0
        x = model.step(x, falling[k], falling[k + 1], force, theta)
    assert flown


def test_measured_motion_goes_through_the_measurements():
    states = np.array([[[0.2, 0.0], [0.21, 0.3], [0.24, 0.2]]])
    coarse, fine = Hefting().measured_motion(states)[0], CompliantHefting().measured_motion(states)[0]
    np.testing.assert_allclose(fine[::20], coarse, atol=1e-12)
    np.testing.assert_allclose(coarse[:, 2], [0.0, 6.0, -2.0])


def test_rubbing_and_pinching_are_the_kernel():
    motion = np.array([0.03, 0.7, -0.2, 0.9])
    theta = np.array([0.4])
    parameters = ContactParameters(stiffness=100.0, damping=1.0, friction=0.4, resistance=2.0)
    law = ContactLaw()
    normal = law.normal_force(np.array(0.01), np.array(0.2), parameters)
    force = Rubbing().contact(np.zeros(0), motion, theta)
    np.testing.assert_allclose(force, [1.2, -0.48])
    np.testing.assert_allclose(force[0], normal)
    squeeze = Pinching().contact(np.zeros(0), np.array([0.018, -0.1]), np.array([800.0, 10.0]))
    np.testing.assert_allclose(squeeze, [2.6])
    drakes = hunt_crossley_pinching().contact(np.zeros(0), np.array([0.018, -0.1]), np.array([800.0, 2.5]))
    np.testing.assert_allclose(drakes, [1.6 * 1.25])


def test_box_pushes_back_along_its_normal():
    model, theta = Contouring(), np.array([0.126, 0.05])
    places = {(0.5, -0.03): (0, -1), (0.57, 0.0): (1, 0), (0.43, 0.01): (-1, 0), (0.5, 0.032): (0, 1)}
    for place, direction in places.items():
        force = model.contact(np.zeros(0), np.array([*place, 0.0, 0.0]), theta)
        np.testing.assert_allclose(force / np.linalg.norm(force), direction, atol=1e-12)
    corner = model.contact(np.zeros(0), np.array([0.563 + 0.004, 0.025 + 0.003, 0.0, 0.0]), theta)
    np.testing.assert_allclose(corner, 500.0 * 0.005 * np.array([0.8, 0.6]), rtol=1e-9)
    assert (model.contact(np.zeros(0), np.array([0.6, 0.1, 0.0, 0.0]), theta) == 0).all()


def test_counts():
    assert count_reversals(np.array([1, 1, -1, 1, 1, -1, -1, 1, 1.0])) == 2
    assert count_reversals(np.array([0, 0, 1, 1, 0, -1, -1.0])) == 1
    assert count_reversals(np.zeros(4)) == 0
    assert count_make_breaks(np.array([False, True, True, False, True])) == 3


def test_faces_are_named_by_the_force():
    model = Contouring()
    forces = np.array([[0.0, 0.0], [0.0, -3.0], [2.0, 0.1], [0.0, 0.0]])
    assert model.faces(np.zeros((5, 4)), forces) == ["+x", "-y"]


@pytest.mark.parametrize("make", [hefting, rubbing, pinching, contouring])
def test_tasks_are_the_papers(make):
    task = make()
    assert task.model.parameters.names == tuple(task.truth)
    np.testing.assert_allclose(task.model.parameters.mean, 1.3 * task.theta)
    low = task.with_prior_mean(0.5)
    np.testing.assert_allclose(low.model.parameters.mean, 0.5 * task.theta)
    np.testing.assert_array_equal(low.model.parameters.std, task.model.parameters.std)
    np.testing.assert_array_equal(low.theta, task.theta)
    motion = task.model.motion(task.robot_start, np.zeros((1, 2, len(task.robot_start) // 2)))
    np.testing.assert_allclose(motion[0, -1, : len(task.robot_start)], task.robot_start)


def test_numbers_of_a_model_come_from_a_file():
    model = configure(
        Contouring(),
        {
            "stiffness": 400,
            "workspace_lower": [0.2, -0.2],
            "parameters": [{"name": "length", "mean": 0.1, "std": 0.02}],
        },
        "box.yaml",
    )
    assert model.stiffness == 400.0 and model.workspace_lower == (0.2, -0.2)
    assert model.parameters.names == ("length",)


@pytest.mark.parametrize(
    "values, said",
    [
        ({"stifness": 1.0}, "unknown key 'stifness', expected one of .*stiffness"),
        ({"stiffness": "high"}, "stiffness is 'high', expected a value like 500.0"),
        ({"centre": [1.0]}, "centre"),
        ({"substeps": 1.5}, "substeps"),
        ({"parameters": [{"name": "length"}]}, "expected name, mean"),
    ],
)
def test_wrong_numbers_of_a_model_are_refused(values, said):
    with pytest.raises(InputError, match=f"^box.yaml: .*{said}|^box.yaml: {said}"):
        configure(Contouring(), values, "box.yaml")
