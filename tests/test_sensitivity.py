"""Three evaluators, one answer; and the answer against a Drake plant."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.contact import ContactParameters
from drake_cafim.contact.system import SphereContact
from drake_cafim.errors import InputError
from drake_cafim.information import fisher_information
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.evaluator import FISHER, make_evaluator
from drake_cafim.sensitivity.model import Start
from drake_cafim.sensitivity.tangent import _differentiate_stateful
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.contouring import Contouring
from drake_cafim.tasks.hefting import Hefting
from drake_cafim.tasks.pinching import Pinching
from drake_cafim.tasks.rubbing import Rubbing

BOTH = Parameters((Parameter("friction", 0.5, std=1.0), Parameter("stiffness", 120.0, std=50.0)))
SENSOR = Parameters(
    (Parameter("bias", 0.1, std=0.2), *Hefting().parameters, Parameter("drift", 0.05, std=0.05)),
)
MODELS = {
    "hefting": (Hefting(), [0.2, 0.0]),
    "compliant hefting": (CompliantHefting(), [0.2, 0.0]),
    "hunt-crossley hefting": (CompliantHefting(law="hunt_crossley", damping=0.0, dissipation=3.0), [0.2, 0.0]),
    "hefting, sensor off": (Hefting(parameters=SENSOR), [0.2, 0.0]),
    "compliant hefting, sensor off": (CompliantHefting(parameters=SENSOR), [0.2, 0.0]),
    "rubbing": (Rubbing(), [0.05, 0.8, 0.0, 0.0]),
    "rubbing, two unknown": (Rubbing(parameters=BOTH), [0.05, 0.8, 0.0, 0.0]),
    "rubbing, tangential force alone": (Rubbing(measures_normal=False), [0.05, 0.8, 0.0, 0.0]),
    "pinching": (Pinching(), [0.024, 0.0]),
    "contouring": (Contouring(), [0.43, -0.04, 0.0, 0.0]),
    "contouring in Drake's field": (
        Contouring(
            law="hydroelastic",
            resolution=0.004,
            parameters=Parameters(
                (
                    *Contouring().parameters,
                    Parameter("modulus", 5e4, std=1e4),
                    Parameter("dissipation", 0.5, std=0.5),
                    Parameter("offset_x", 1e-3, std=3e-3),
                    Parameter("offset_y", -1e-3, std=3e-3),
                    Parameter("tilt", 0.05, std=0.02),
                )
            ),
        ),
        [0.43, -0.04, 0.0, 0.0],
    ),
    "rubbing in Drake's field": (
        Rubbing(
            law="hydroelastic",
            resolution=0.02,
            slip_velocity=0.005,
            parameters=Parameters(
                (
                    *Rubbing().parameters,
                    Parameter("modulus", 2300.0, std=700.0),
                    Parameter("dissipation", 0.5, std=0.5),
                    Parameter("offset", 1e-3, std=3e-3),
                    Parameter("tilt", -0.05, std=0.02),
                )
            ),
        ),
        [0.05, 0.8, 0.0, 0.0],
    ),
    "rubbing a turned wall": (
        Rubbing(parameters=Parameters((*BOTH, Parameter("offset", 1e-3, std=3e-3), Parameter("tilt", 0.05, std=0.02)))),
        [0.05, 0.8, 0.0, 0.0],
    ),
    "contouring a turned box": (
        Contouring(
            law="hunt_crossley",
            dissipation=0.5,
            parameters=Parameters(
                (
                    *Contouring().parameters,
                    Parameter("offset_x", 1e-3, std=3e-3),
                    Parameter("offset_y", -1e-3, std=3e-3),
                    Parameter("tilt", 0.05, std=0.02),
                )
            ),
        ),
        [0.43, -0.04, 0.0, 0.0],
    ),
    "pinching in Drake's field": (
        Pinching(
            law="hydroelastic",
            resolution=0.006,
            parameters=Parameters(
                (
                    Parameter("modulus", 5e4, std=1e4),
                    Parameter("dissipation", 2.5, std=2.5),
                    Parameter("offset", 1e-3, std=3e-3),
                )
            ),
        ),
        [0.024, 0.0],
    ),
}


def rollouts(name, evaluator, seed=3, batch=6, length=12):
    model, start = MODELS[name]
    random = np.random.default_rng(seed)
    lower, upper = model.velocity_bounds
    commands = 0.5 * random.uniform(lower, upper, (batch, length, len(lower)))
    if "compliant" in name or "crossley" in name:
        commands *= 0.4  # the ball stays on the palm: leaving it is a kink of the force
    motion = model.motion(np.array(start), commands)
    theta = 0.9 * model.parameters.mean
    return make_evaluator(evaluator, model)(motion, theta, model.start(motion[0, 0], theta))


@pytest.mark.parametrize(
    ("law", "smoothing"),
    [("paper", 0.0), ("kelvin_voigt", 0.0), ("hunt_crossley", 0.0), ("paper", 0.1), ("kelvin_voigt", 0.1)],
)
def test_the_compiled_ball_is_the_one_that_is_carried_step_by_step(law, smoothing):
    """Thrown and caught again, from starts of its own for each candidate."""
    model = CompliantHefting(law=law, dissipation=3.0, smoothing=smoothing)
    random = np.random.default_rng(5)
    motion = model.motion(np.array([0.2, 0.0]), random.uniform(-1.0, 1.0, (6, 12, 1)))
    states = np.array([0.2, 0.0]) + 1e-3 * random.standard_normal((6, 2))
    start, theta = Start(states, 0.01 * random.standard_normal((6, 2, 1))), np.array([0.06])
    compiled, stepped = model.rollout(motion, theta, start), _differentiate_stateful(model, motion, theta, start)
    assert (compiled.forces == 0).any() == (smoothing == 0) and (compiled.forces > 0.6).any()
    for name, value in vars(stepped).items():
        np.testing.assert_allclose(getattr(compiled, name), value, rtol=1e-9, atol=1e-9, err_msg=name)


def test_corners_of_the_box_have_bounded_and_right_derivatives():
    """Within the corner radius, just outside it, and on the faces beside it."""
    model, theta = Contouring(), np.array([0.126, 0.05])
    random = np.random.default_rng(1)
    offset = random.uniform(-0.004, 0.006, (400, 2))
    place = np.array([0.563, 0.025]) + offset
    motion = np.concatenate([place, np.zeros_like(place)], axis=-1)[:, np.newaxis]
    motion = np.concatenate([motion, motion], axis=1)
    start = model.start(motion[0, 0], theta)
    tangent, reference = (make_evaluator(name, model)(motion, theta, start) for name in ("tangent", "autodiff"))
    np.testing.assert_allclose(tangent.forces, reference.forces, atol=1e-12)
    np.testing.assert_allclose(tangent.sensitivities, reference.sensitivities, atol=1e-6 * 250)
    assert np.abs(reference.sensitivities).max() < 0.5 * 500 * (1 + 0.01 / 0.002)


@pytest.mark.parametrize("name", MODELS)
def test_three_evaluators_agree(name):
    reference, tangent, difference = (rollouts(name, e) for e in ("autodiff", "tangent", "finite-difference"))
    scale = np.abs(reference.sensitivities).max()
    assert scale > 0, "the rollouts touch nothing"
    for other, tolerance in ((tangent, 1e-6), (difference, 1e-5)):
        np.testing.assert_allclose(other.forces, reference.forces, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.states, reference.states, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.sensitivities, reference.sensitivities, atol=tolerance * scale)
        np.testing.assert_allclose(
            other.state_sensitivities, reference.state_sensitivities, rtol=tolerance, atol=tolerance * scale
        )
    std = MODELS[name][0].noise_std
    fisher = [fisher_information(r.sensitivities, std) for r in (reference, tangent, difference)]
    np.testing.assert_allclose(fisher[1], fisher[0], rtol=1e-6, atol=1e-6 * np.abs(fisher[0]).max())
    np.testing.assert_allclose(fisher[2], fisher[0], rtol=1e-5, atol=1e-5 * np.abs(fisher[0]).max())


def test_evaluators_start_from_a_given_state_and_sensitivity():
    model, theta = CompliantHefting(), np.array([0.06])
    motion = model.motion(np.array([0.2, 0.1]), np.full((1, 4, 1), 0.2))
    start = Start(np.array([0.198, 0.05]), np.array([[-0.03], [0.2]]))
    answers = [make_evaluator(name, model)(motion, theta, start) for name in FISHER]
    for answer in answers[1:]:
        np.testing.assert_allclose(answer.sensitivities, answers[0].sensitivities, rtol=1e-5)


def test_an_unknown_evaluator_is_refused_with_the_valid_names():
    with pytest.raises(InputError, match="finite-difference"):
        make_evaluator("exact", Hefting())


def _heft_in_drake(model, motion, theta):
    """The ball of `CompliantHefting` as a Drake plant on a prismatic joint, its palm moved as the motion says."""
    step = model.period / model.substeps
    radius = 0.03
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=step)
    plant.SetUseSampledOutputPorts(False)
    bodies = []
    for name, mass in (("palm", 1.0), ("ball", 0.05)):
        body = plant.AddRigidBody(name, SpatialInertia(mass, np.zeros(3), UnitInertia.SolidSphere(radius)))
        plant.AddJoint(PrismaticJoint(name, plant.world_frame(), body.body_frame(), [0.0, 0.0, 1.0]))
        bodies.append(body)
    plant.Finalize()
    contact = builder.AddNamedSystem(
        "contact",
        SphereContact(
            "kelvin_voigt",
            ContactParameters(stiffness=model.stiffness, damping=model.damping),
            sphere_body=bodies[1].index(),
            plane_body=bodies[0].index(),
            radius=radius,
            X_AP=RigidTransform([0.0, 0.0, -radius]),
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), contact.GetInputPort("body_poses"))
    velocities = plant.get_body_spatial_velocities_output_port()
    builder.Connect(velocities, contact.GetInputPort("body_spatial_velocities"))
    builder.Connect(contact.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
    diagram = builder.Build().ToAutoDiffXd()
    plant = diagram.GetSubsystemByName("plant")
    contact = diagram.GetSubsystemByName("contact")
    context = diagram.CreateDefaultContext()
    mass = AutoDiffXd(theta[0], [1.0])
    plant.GetBodyByName("ball").SetMass(plant.GetMyMutableContextFromRoot(context), mass)
    start = model.start(motion[0], theta)
    ball = [AutoDiffXd(v, [s]) for v, s in zip(start.state, start.sensitivity[:, 0], strict=True)]
    output, slopes, forces = contact.GetOutputPort("contact_force"), [], []
    for index, r in enumerate(motion):
        # the palm is where the plan says, whatever pushes it
        context.SetDiscreteState(np.array([AutoDiffXd(r[0]), ball[0], AutoDiffXd(r[1]), ball[1]]))
        if index and index % model.substeps == 0:
            force = output.Eval(contact.GetMyContextFromRoot(context))[2]
            forces.append(force.value())
            slopes.append(ExtractGradient(np.array([[force]]))[0, 0])
        update = diagram.EvalUniquePeriodicDiscreteUpdate(context).value(0)
        ball = [update[1], update[3]]
    return np.array(forces), np.array(slopes)


def test_compliant_hefting_is_what_a_drake_plant_does():
    model, theta = CompliantHefting(), np.array([0.06])
    commands = 0.25 * np.sin(np.arange(10))[np.newaxis, :, np.newaxis]
    motion = model.motion(np.array([0.2, 0.0]), commands)
    ours = make_evaluator("tangent", model)(motion, theta, model.start(motion[0, 0], theta))
    forces, slopes = _heft_in_drake(model, motion[0], theta)
    np.testing.assert_allclose(ours.forces[0, :, 0], forces, rtol=1e-3)
    drake, fisher = (slopes**2).sum() / 0.25, fisher_information(ours.sensitivities, model.noise_std)[0, 0, 0]
    np.testing.assert_allclose(fisher, drake, rtol=1e-3)
    assert np.ptp(forces) > 0.2  # N: it really was shaken
