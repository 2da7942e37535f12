"""A Drake user's own plant, none of ours, with CA-OED and CA-MAP as systems in a Diagram of the user's."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_cafim.design.planner import PlannerConfig
from drake_cafim.design.policies import make_policy
from drake_cafim.design.system import CaOed
from drake_cafim.diagrams.tutorials.own_diagram import PERIOD, TRUTH, make_model, run
from drake_cafim.errors import InputError
from drake_cafim.sensitivity.evaluator import make_evaluator

TRUE_THETA = np.array([TRUTH["stiffness"], TRUTH["mass"]])


def test_three_evaluators_agree_on_the_users_plant():
    model = make_model()
    commands = np.array([[[0.3], [0.3], [0.2], [-0.1], [0.2]]])
    motion = model.motion(np.zeros(2), commands)
    theta = model.parameters.mean
    start = model.start(motion[0, 0], theta)
    answers = {name: make_evaluator(name, model)(motion, theta, start) for name in ("tangent", "finite-difference")}
    scale = np.abs(answers["tangent"].sensitivities).max(axis=(0, 1, 2))
    assert (scale > 0).all()
    np.testing.assert_allclose(
        answers["tangent"].sensitivities / scale, answers["finite-difference"].sensitivities / scale, atol=1e-5
    )


def test_the_robot_is_where_the_motion_has_it_whatever_the_state_says():
    model, theta = make_model(), TRUE_THETA
    state = model.start(np.array([0.02, 0.1]), theta).state
    stale = state.copy()
    stale[[0, 2]] = [-0.03, 0.0]
    force = model.contact(state, np.array([0.02, 0.1]), theta)
    assert force[2] > 0.1
    np.testing.assert_array_equal(model.contact(stale, np.array([0.02, 0.1]), theta), force)
    np.testing.assert_array_equal(
        *(model.step(x, np.array([0.02, 0.1]), np.array([0.03, 0.1]), force, theta) for x in (state, stale))
    )


def test_oed_and_map_in_a_diagram_of_the_users():
    estimator, context, beliefs = run(periods=12, experiments=2)
    before, after = beliefs[0], beliefs[-1]
    assert (after.std < 0.1 * before.std).all()
    assert (np.abs(after.mean - TRUE_THETA) < 3 * after.std).all()
    forces = np.concatenate([data.measurements[:, 2] for data in estimator.data(context)])
    assert (forces > 0.3).any(), "it never touched the cart"


def test_a_copied_context_replays_the_same_plan():
    """All of CA-OED's state is in its Context, its random numbers included."""
    model = make_model()
    config = PlannerConfig(candidates=3, horizon=4, knot_std=0.3)
    builder = DiagramBuilder()
    design = builder.AddSystem(CaOed(model, make_policy("contact-aware", model, config=config), seed=4))
    prior = np.concatenate([model.parameters.mean, np.diag(model.parameters.std**2).ravel()])
    for port, value in (("measured_state", np.array([0.01, 0.2])), ("belief", prior)):
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), design.GetInputPort(port))
    builder.ExportOutput(design.GetOutputPort("plan"), "plan")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.5 * PERIOD)
    copies = [simulator.get_context().Clone() for _ in range(2)]
    plans = []
    for copy in copies:
        again = Simulator(diagram, copy)
        again.AdvanceTo(2.5 * PERIOD)
        plans.append(diagram.GetOutputPort("plan").Eval(copy))
    np.testing.assert_array_equal(*plans)
    assert not np.array_equal(plans[0], diagram.GetOutputPort("plan").Eval(simulator.get_context()))


def test_a_period_that_is_no_whole_number_of_steps_is_refused():
    with pytest.raises(InputError, match="whole number"):
        make_model(period=0.05)
