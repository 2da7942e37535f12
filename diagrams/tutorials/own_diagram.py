"""Your own plant in your own Diagram, with the CA-OED and CA-MAP systems: what is this cart, and what is it made of?

A finger that is told how fast to move can push a cart on a rail, and a sensor feels the contact force. Neither the
cart's mass nor the stiffness of the contact is known. No derivative is written by hand: a `DiagramModel` takes
them through the Diagram by AutoDiffXd.

    python -m drake_cafim.diagrams.tutorials.own_diagram
"""

from typing import Any

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import PdControllerGains, PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, MatrixGain, RandomSource

from drake_cafim.belief import Belief
from drake_cafim.contact import ContactParameters
from drake_cafim.contact.system import PARAMETER_NAMES, SphereContact
from drake_cafim.design.planner import PlannerConfig
from drake_cafim.design.policies import make_policy
from drake_cafim.design.system import CaOed
from drake_cafim.estimation.shooting import ShootingConfig
from drake_cafim.estimation.system import CaMap
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.diagram_model import DiagramModel

STEP, PERIOD = 0.02, 0.04  # s, of the plant; s, of the controller
NOISE = 0.05  # N, standard deviation of one reading of the force
ORIGIN: Any = np.zeros(3)
ALONG: Any = np.array([0.0, 0.0, 1.0])  # the rail
APART: Any = np.array([0.0, 0.03])  # m: where finger and cart begin
TO_STATE: Any = np.array([[0.0], [1.0]])  # a commanded velocity as a desired state
OF_FINGER: Any = np.eye(4)[[0, 2]]  # the finger's position and velocity out of the plant's state
TRUTH = {"stiffness": 60.0, "mass": 0.8}  # N/m, kg
PRIOR = Parameters(
    (
        Parameter("stiffness", 78.0, std=30.0, lower=5.0, upper=400.0, unit="N/m"),
        Parameter("mass", 1.0, std=0.4, lower=0.1, upper=4.0, unit="kg"),
    )
)


def add_cart(builder: DiagramBuilder) -> tuple[MultibodyPlant, Any]:
    """Plant and contact. Nothing in here knows of any estimation: put your own in its place.

    The contact is our LeafSystem because Drake's own contact properties have no derivatives.
    """
    plant: MultibodyPlant
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=STEP)
    plant.SetUseSampledOutputPorts(False)
    bodies = {}
    for name, mass in (("finger", 0.1), ("cart", TRUTH["mass"])):
        bodies[name] = plant.AddRigidBody(name, SpatialInertia(mass, ORIGIN, UnitInertia.SolidSphere(0.02)))
        plant.AddJoint(PrismaticJoint(name, plant.world_frame(), bodies[name].body_frame(), ALONG, damping=2.0))
    plant.mutable_gravity_field().set_gravity_vector(ORIGIN)  # the rail carries it
    contact = builder.AddNamedSystem(
        "contact",
        SphereContact(
            "kelvin_voigt",
            ContactParameters(stiffness=TRUTH["stiffness"], damping=1.0),
            sphere_body=bodies["cart"].index(),
            plane_body=bodies["finger"].index(),
            radius=0.02,
        ),
    )
    return plant, contact


def connect(builder: DiagramBuilder, plant: MultibodyPlant, contact: Any) -> None:
    """Finalize the plant and let the contact act on it."""
    plant.Finalize()
    plant.SetDefaultPositions(APART)
    builder.Connect(plant.get_body_poses_output_port(), contact.GetInputPort("body_poses"))
    velocities = plant.get_body_spatial_velocities_output_port()
    builder.Connect(velocities, contact.GetInputPort("body_spatial_velocities"))
    builder.Connect(contact.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())


def make_model(**changes: Any) -> DiagramModel:
    """What planning and estimation need to know: a Diagram, where θ goes in it, what is measured, how well."""
    builder = DiagramBuilder()
    plant, contact = add_cart(builder)
    connect(builder, plant, contact)
    builder.ExportOutput(contact.GetOutputPort("contact_force"), "force")
    settings: dict[str, Any] = {
        "diagram": builder.Build(),
        "set_parameters": set_theta,
        "parameters": PRIOR,
        "noise_std": np.full(3, NOISE),
        "robot": (0, 2),  # where the finger's position and velocity stand in the Diagram's state
        "measurement_port": "force",
        "period": PERIOD,
        "workspace_lower": (-0.05,),
        "workspace_upper": (0.2,),
        "speed_limit": 0.4,
    }
    return DiagramModel(**settings | changes)


def set_theta(diagram: Any, context: Any, theta: Any) -> None:
    """θ = (stiffness, mass): one is the contact law's number, the other a parameter of Drake's own plant."""
    contact, plant = diagram.GetSubsystemByName("contact"), diagram.GetSubsystemByName("plant")
    parameter = contact.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(0)
    values = parameter.CopyToVector()
    values[PARAMETER_NAMES.index("stiffness")] = theta[0]
    parameter.SetFromVector(values)
    plant.GetBodyByName("cart").SetMass(plant.GetMyMutableContextFromRoot(context), theta[1])


def build_world(model: DiagramModel, *, periods: int, experiments: int) -> tuple[Diagram, CaOed, CaMap]:
    """The Diagram of the real cart, its finger a velocity servo, with the controller that plans and the estimator."""
    builder = DiagramBuilder()
    plant, contact = add_cart(builder)
    motor = plant.AddJointActuator("motor", plant.GetJointByName("finger"))
    motor.set_controller_gains(PdControllerGains(p=1e-6, d=1e3))  # velocity alone
    connect(builder, plant, contact)
    policy = make_policy("contact-aware", model, config=PlannerConfig(candidates=3, horizon=5, knot_std=0.3))
    design: Any = builder.AddNamedSystem("design", CaOed(model, policy))
    fitting = ShootingConfig(grid_points=3, starts=1, gauss_newton_steps=4)
    estimator: Any = builder.AddNamedSystem(
        "estimator", CaMap(model, periods=periods, experiments=experiments, config=fitting)
    )
    desired = builder.AddSystem(MatrixGain(TO_STATE))
    finger = builder.AddSystem(MatrixGain(OF_FINGER))
    noise = builder.AddSystem(RandomSource(RandomDistribution.kGaussian, 3, PERIOD))
    loudness: Any = NOISE * np.eye(3)
    scaled = builder.AddSystem(MatrixGain(loudness))
    force = builder.AddSystem(Adder(2, 3))
    for source, sink in (
        (plant.get_state_output_port(), finger.get_input_port()),
        (finger.get_output_port(), design.GetInputPort("measured_state")),
        (finger.get_output_port(), estimator.GetInputPort("measured_state")),
        (contact.GetOutputPort("contact_force"), force.get_input_port(0)),
        (noise.get_output_port(), scaled.get_input_port()),
        (scaled.get_output_port(), force.get_input_port(1)),
        (force.get_output_port(), estimator.GetInputPort("measured_force")),
        (estimator.GetOutputPort("belief"), design.GetInputPort("belief")),
        (design.GetOutputPort("command"), desired.get_input_port()),
        (desired.get_output_port(), plant.get_desired_state_input_port(motor.model_instance())),
    ):
        builder.Connect(source, sink)
    return builder.Build(), design, estimator


def run(periods: int = 12, experiments: int = 2) -> tuple[CaMap, Context, list[Belief]]:
    """Carry out the experiments; the estimator with its context, and the belief before and after each of them."""
    diagram, design, estimator = build_world(make_model(), periods=periods, experiments=experiments)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant: Any = diagram.GetSubsystemByName("plant")
    own = estimator.GetMyMutableContextFromRoot(context)
    beliefs = [estimator.belief(own)]
    for number in range(experiments):
        place = plant.GetMyMutableContextFromRoot(context)
        plant.SetPositionsAndVelocities(place, np.concatenate([APART, [0.0, 0.0]]))  # the cart is put back
        context.SetTime(0.0)
        design.begin_experiment(design.GetMyMutableContextFromRoot(context), number)
        estimator.begin_experiment(own, number)
        simulator.Initialize()
        simulator.AdvanceTo((periods + 0.25) * PERIOD)
        beliefs.append(estimator.belief(own))
    return estimator, own, beliefs


def in_words(belief: Belief) -> str:
    """The belief's means and standard deviations as text."""
    numbers = zip(PRIOR, belief.mean, belief.std, strict=True)
    return ", ".join(f"{parameter.name} {mean:.2f} ± {std:.2f} {parameter.unit}" for parameter, mean, std in numbers)


if __name__ == "__main__":
    for number, belief in enumerate(run()[2]):
        print(f"after {number} experiments: {in_words(belief)}")
    print(f"the truth: stiffness {TRUTH['stiffness']} N/m, mass {TRUTH['mass']} kg")
