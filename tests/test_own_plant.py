"""A Drake user's own plant, none of ours, with CA-OED and CA-MAP as systems in a Diagram of the user's."""

from itertools import pairwise

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from drake_cafim.contact import ContactParameters
from drake_cafim.contact.system import PARAMETER_NAMES, SphereContact
from drake_cafim.design.planner import PlannerConfig
from drake_cafim.design.policies import make_policy
from drake_cafim.design.system import CaOed
from drake_cafim.errors import InputError
from drake_cafim.estimation.shooting import ShootingConfig
from drake_cafim.estimation.system import CaMap
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.diagram_model import DiagramModel
from drake_cafim.sensitivity.evaluator import make_evaluator

PERIOD, STEP = 0.04, 0.02
TRUE_STIFFNESS, TRUE_MASS = 60.0, 0.8


def build_cart(finger_driven=False):
    """A finger that pushes a sprung cart along x: plant, contact and the spring's return force, all Drake's."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=STEP)
    plant.SetUseSampledOutputPorts(False)
    bodies = {}
    for name, mass in (("finger", 0.1), ("cart", TRUE_MASS)):
        body = plant.AddRigidBody(name, SpatialInertia(mass, np.zeros(3), UnitInertia.SolidSphere(0.02)))
        plant.AddJoint(PrismaticJoint(name, plant.world_frame(), body.body_frame(), [0.0, 0.0, 1.0], damping=2.0))
        bodies[name] = body
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    plant.Finalize()
    contact = builder.AddNamedSystem(
        "contact",
        SphereContact(
            "kelvin_voigt",
            ContactParameters(stiffness=TRUE_STIFFNESS, damping=1.0),
            sphere_body=bodies["cart"].index(),
            plane_body=bodies["finger"].index(),
            radius=0.02,
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), contact.GetInputPort("body_poses"))
    velocities = plant.get_body_spatial_velocities_output_port()
    builder.Connect(velocities, contact.GetInputPort("body_spatial_velocities"))
    builder.Connect(contact.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
    plant.SetDefaultPositions([0.0, 0.03])
    builder.ExportOutput(contact.GetOutputPort("contact_force"), "force")
    return builder.Build()


def set_theta(diagram, context, theta):
    """θ = (stiffness, mass): one is our contact law's number, the other a parameter of Drake's own plant."""
    contact, plant = diagram.GetSubsystemByName("contact"), diagram.GetSubsystemByName("plant")
    parameter = contact.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(0)
    values = parameter.CopyToVector()
    values[PARAMETER_NAMES.index("stiffness")] = theta[0]
    parameter.SetFromVector(values)
    plant.GetBodyByName("cart").SetMass(plant.GetMyMutableContextFromRoot(context), theta[1])


def make_model(**changes):
    settings = {
        "diagram": build_cart(),
        "set_parameters": set_theta,
        "parameters": Parameters(
            (
                Parameter("stiffness", 78.0, std=30.0, lower=5.0, upper=400.0, unit="N/m"),
                Parameter("mass", 1.0, std=0.4, lower=0.1, upper=4.0, unit="kg"),
            )
        ),
        "noise_std": np.full(3, 0.05),
        "robot": (0, 2),
        "measurement_port": "force",
        "period": PERIOD,
        "workspace_lower": (-0.05,),
        "workspace_upper": (0.2,),
        "speed_limit": 0.4,
    }
    return DiagramModel(**settings | changes)


class UsersCart(LeafSystem):
    """The user's world: the plant above at the truth, its finger moved by `command`; and a noisy force sensor."""

    def __init__(self):
        super().__init__()
        self.model = make_model()
        self.truth = np.array([TRUE_STIFFNESS, TRUE_MASS])
        self.DeclareVectorInputPort("command", 1)
        size = self.model.state_size
        self.state = self.DeclareDiscreteState(self.model.start(np.zeros(2), self.truth).state)
        self.force = self.DeclareDiscreteState(3)
        self.DeclareVectorOutputPort("measured_state", 2, self.robot, {self.discrete_state_ticket(self.state)})
        self.DeclareStateOutputPort("measured_force", self.force)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.5 * PERIOD, self.move)
        assert size == 4

    def robot(self, context, output):
        state = context.get_discrete_state(self.state).get_value()
        output.SetFromVector(state[[0, 2]])

    def move(self, context, update):
        x = np.array(context.get_discrete_state(self.state).get_value())
        command = self.get_input_port(0).Eval(context)
        motion = self.model.motion(x[[0, 2]], command[np.newaxis, np.newaxis])[0]
        for before, after in pairwise(motion):
            x = self.model.step(x, before, after, np.zeros(3), self.truth)
        force = self.model.contact(x, motion[-1], self.truth)
        noise = 0.05 * np.random.default_rng(round(1e3 * context.get_time())).standard_normal(3)
        update.set_value(self.state, x)
        update.set_value(self.force, force + noise)


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
    model, theta = make_model(), np.array([TRUE_STIFFNESS, TRUE_MASS])
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
    model, periods, experiments = make_model(), 12, 2
    config = PlannerConfig(candidates=3, horizon=5, knot_std=0.3)
    builder = DiagramBuilder()
    cart = builder.AddNamedSystem("cart", UsersCart())
    design = builder.AddNamedSystem("design", CaOed(model, make_policy("contact-aware", model, config=config)))
    estimator = builder.AddNamedSystem(
        "estimator",
        CaMap(
            model,
            periods=periods,
            experiments=experiments,
            config=ShootingConfig(grid_points=3, starts=1, gauss_newton_steps=4),
        ),
    )
    for source, sink in (
        (cart.GetOutputPort("measured_state"), design.GetInputPort("measured_state")),
        (cart.GetOutputPort("measured_state"), estimator.GetInputPort("measured_state")),
        (cart.GetOutputPort("measured_force"), estimator.GetInputPort("measured_force")),
        (estimator.GetOutputPort("belief"), design.GetInputPort("belief")),
        (design.GetOutputPort("command"), cart.GetInputPort("command")),
    ):
        builder.Connect(source, sink)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    own = estimator.GetMyContextFromRoot(context)
    before = estimator.belief(own)
    start = diagram.CreateDefaultContext()
    for number in range(experiments):
        cart.GetMyMutableContextFromRoot(context).SetStateAndParametersFrom(cart.GetMyContextFromRoot(start))
        context.SetTime(0.0)
        design.begin_experiment(design.GetMyMutableContextFromRoot(context), number)
        estimator.begin_experiment(estimator.GetMyMutableContextFromRoot(context), number)
        simulator.Initialize()
        simulator.AdvanceTo((periods + 0.25) * PERIOD)
    after = estimator.belief(own)
    assert (after.std < 0.5 * before.std).all()
    assert (np.abs(after.mean - [TRUE_STIFFNESS, TRUE_MASS]) < 3 * after.std).all()
    forces = np.concatenate([data.measurements[:, 2] for data in estimator.data(own)])
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
