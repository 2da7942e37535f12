"""The contact law against finite differences, its own limits, and Drake; the systems against the law."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, InitializeAutoDiff
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.contact import NORMAL_LAWS, ContactLaw, ContactParameters
from drake_cafim.contact.system import PARAMETER_NAMES, ContactLawSystem, SphereContact
from drake_cafim.diagnosis.tosses.compiled_contact import forces, law_of
from drake_cafim.dynamics import contact as on_tree
from drake_cafim.dynamics.touching import sphere_wrenches
from drake_cafim.errors import InputError

FORMS = {"slip_velocity": 0.05, "resistance": 2.0}
NUMBERS = {
    "stiffness": 300.0,
    "damping": 4.0,
    "dissipation": 0.7,
    "friction": 0.4,
    "modulus": 3e4,
    "radius": 0.02,
    "resolution": 0.006,
}
"""Of all laws."""


def _samples(size, seed=0):
    random = np.random.default_rng(seed)
    penetration = random.uniform(-0.004, 0.02, 400)
    rate = random.uniform(-0.5, 0.5, 400)
    velocity = random.normal(0.0, 0.6, (400, size))
    return penetration, rate, velocity


def _forces(law, sample, numbers):
    penetration, rate, velocity = sample
    parameters = ContactParameters(**numbers)
    normal = law.normal_force(penetration, rate, parameters)
    return normal, law.tangential_force(normal, velocity, parameters)


def _central(law, sample, numbers, name, column=None):
    """Central differences, and where both one-sided slopes agree (no kink in between)."""
    step = 1e-7 if name not in NUMBERS else 1e-6 * NUMBERS[name]
    values = []
    for sign in (-1, 0, 1):
        moved, changed = [array.copy() for array in sample], dict(numbers)
        if name in changed:
            changed[name] += sign * step
        elif name == "tangential_velocity":
            moved[2][:, column] += sign * step
        else:
            moved[("penetration", "rate").index(name)] += sign * step
        values.append(_forces(law, moved, changed))
    central = [(after - before) / (2 * step) for before, _, after in zip(*values, strict=True)]
    left = [(middle - before) / step for before, middle, _ in zip(*values, strict=True)]
    scale = 1.0 + max(np.abs(central[0]).max(), np.abs(central[1]).max())
    kink = np.abs(central[0] - left[0]) > 1e-3 * scale
    kink |= (np.abs(central[1] - left[1]) > 1e-3 * scale).any(axis=-1)
    return central, ~kink, scale


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("normal", NORMAL_LAWS)
@pytest.mark.parametrize("size", [1, 2, 3])
def test_derivatives_match_central_differences(normal, form, size):
    law, sample, numbers = ContactLaw(normal), _samples(size), NUMBERS | {form: FORMS[form]}
    exact = law.derivatives(*sample, ContactParameters(**numbers))
    forces = _forces(law, sample, numbers)
    np.testing.assert_array_equal(exact.normal_force, forces[0])
    np.testing.assert_allclose(exact.tangential_force, forces[1], rtol=1e-13)
    for name in ("penetration", "rate", *(name for name in numbers if name not in ("radius", "resolution"))):
        (of_normal, of_tangential), smooth, scale = _central(law, sample, numbers, name)
        assert smooth.mean() > 0.97
        if name in exact.normal:
            np.testing.assert_allclose(exact.normal[name][smooth], of_normal[smooth], atol=1e-6 * scale)
        np.testing.assert_allclose(exact.tangential[name][smooth], of_tangential[smooth], atol=1e-6 * scale)
    for column in range(size):
        (_, of_tangential), smooth, scale = _central(law, sample, numbers, "tangential_velocity", column)
        slope = exact.tangential["tangential_velocity"][..., column]
        np.testing.assert_allclose(slope[smooth], of_tangential[smooth], atol=2e-6 * scale)


def test_laws_as_written():
    penetration, rate = np.array([0.01, 0.01, -0.01, 0.01]), np.array([0.1, -0.1, 3.0, -2.0])
    parameters = ContactParameters(stiffness=100.0, damping=2.0, dissipation=1.5, modulus=3e3 / np.pi, radius=0.02)
    force = {name: ContactLaw(name).normal_force(penetration, rate, parameters) for name in NORMAL_LAWS}
    np.testing.assert_allclose(force["paper"], [0.8, 0.8, 0.0, 0.0])
    np.testing.assert_allclose(force["kelvin_voigt"], [1.2, 0.8, 0.0, 0.0])
    np.testing.assert_allclose(force["hunt_crossley"], [1.15, 0.85, 0.0, 0.0])
    np.testing.assert_allclose(force["hydroelastic"], [0.23, 0.17, 0.0, 0.0])  # 3000 (1e-4 − 2e-6/0.06) (1 + 1.5 ḋ)


def test_friction_is_invisible_where_the_resistance_is_smaller():
    law = ContactLaw()
    parameters = ContactParameters(stiffness=100.0, friction=0.4, resistance=2.0)
    slope = law.derivatives(
        np.array([0.04, 0.04]), np.zeros(2), np.array([[0.9, 0.0], [0.7, 0.0]]), parameters
    ).tangential["friction"]
    np.testing.assert_array_equal(slope, [[-4.0, 0.0], [0.0, 0.0]])  # 0.4 · 4 N against 1.8 N and 1.4 N


def test_rest_neither_divides_by_zero_nor_pushes():
    for form, width in FORMS.items():
        parameters = ContactParameters(stiffness=100.0, friction=0.4, **{form: width})
        exact = ContactLaw().derivatives(np.array([0.01]), np.zeros(1), np.zeros((1, 2)), parameters)
        np.testing.assert_array_equal(exact.tangential_force, 0.0)
        expected = -0.4 / width if form == "slip_velocity" else -width
        np.testing.assert_allclose(exact.tangential["tangential_velocity"][0], expected * np.eye(2))


def test_unknown_law_and_two_widths_are_refused():
    with pytest.raises(InputError, match="kelvin_voigt"):
        ContactLaw("coulomb")
    with pytest.raises(InputError, match="one of them"):
        ContactParameters(stiffness=1.0, slip_velocity=0.1, resistance=1.0)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("normal", NORMAL_LAWS)
def test_system_gives_the_kernel_and_its_derivatives_through_autodiff(normal, form):
    parameters = ContactParameters(**NUMBERS, **{form: FORMS[form]})
    kinematics = np.array([0.012, 0.2, 0.3, -0.1])
    builder = DiagramBuilder()
    leaf = builder.AddSystem(ContactLawSystem(normal, parameters))
    leaf.set_name("contact")
    builder.ExportInput(leaf.GetInputPort("contact_kinematics"), "contact_kinematics")
    builder.ExportOutput(leaf.GetOutputPort("contact_force"), "contact_force")
    diagram = builder.Build().ToAutoDiffXd()
    leaf = diagram.GetSubsystemByName("contact")
    context = diagram.CreateDefaultContext()
    values = leaf.GetMyContextFromRoot(context).get_numeric_parameter(0).CopyToVector()
    seeded = InitializeAutoDiff(np.concatenate([kinematics, [value.value() for value in values]])).ravel()
    diagram.GetInputPort("contact_kinematics").FixValue(context, seeded[:4])
    leaf.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(0).SetFromVector(seeded[4:])
    force = diagram.GetOutputPort("contact_force").Eval(context)
    gradient = np.array([value.derivatives() for value in force])
    exact = ContactLaw(normal).derivatives(kinematics[0], kinematics[1], kinematics[2:], parameters)
    np.testing.assert_allclose(force[0].value(), exact.normal_force)
    np.testing.assert_allclose([f.value() for f in force[1:]], exact.tangential_force)
    for column, name in enumerate(("penetration", "rate")):
        np.testing.assert_allclose(gradient[0, column], exact.normal[name], atol=1e-12)
        np.testing.assert_allclose(gradient[1:, column], exact.tangential[name], atol=1e-12)
    np.testing.assert_allclose(gradient[1:, 2:4], exact.tangential["tangential_velocity"], atol=1e-11)
    for column, name in enumerate(PARAMETER_NAMES, start=4):
        name = form if name == "width" else name
        np.testing.assert_allclose(gradient[0, column], exact.normal.get(name, 0.0), atol=1e-12)
        np.testing.assert_allclose(gradient[1:, column], exact.tangential[name], atol=1e-11)


def _ball_on_ground(normal, parameters):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=1e-4)
    inertia = SpatialInertia(0.2, np.zeros(3), UnitInertia.SolidSphere(0.03))
    ball = plant.AddRigidBody("ball", inertia)
    plant.SetUseSampledOutputPorts(False)  # the update then depends on the present state alone
    plant.Finalize()
    plant.SetDefaultFloatingBaseBodyPose(ball, RigidTransform([0.0, 0.0, 0.04]))
    contact = builder.AddSystem(
        SphereContact(
            normal,
            parameters,
            sphere_body=ball.index(),
            plane_body=plant.world_body().index(),
            radius=0.03,
        )
    )
    builder.Connect(plant.get_body_poses_output_port(), contact.GetInputPort("body_poses"))
    contact.set_name("contact")
    velocities = plant.get_body_spatial_velocities_output_port()
    builder.Connect(velocities, contact.GetInputPort("body_spatial_velocities"))
    builder.Connect(contact.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
    return builder.Build(), plant, contact, ball


def test_ball_dropped_on_a_plane_comes_to_rest_at_its_weight():
    parameters = ContactParameters(stiffness=500.0, damping=5.0, friction=0.3, slip_velocity=0.01)
    diagram, plant, contact, ball = _ball_on_ground("kelvin_voigt", parameters)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetVelocities(plant_context, [0.0, 0.0, 0.0, 0.4, 0.0, 0.0])
    simulator.AdvanceTo(1.5)
    force = contact.GetOutputPort("contact_force").Eval(contact.GetMyContextFromRoot(context))
    np.testing.assert_allclose(force[2], 0.2 * 9.81, rtol=1e-3)
    pose = ball.EvalPoseInWorld(plant_context).translation()
    np.testing.assert_allclose(pose[2], 0.03 - 0.2 * 9.81 / 500.0, atol=1e-5)
    # sliding turns into rolling without slip: v = ω r
    V_WB = ball.EvalSpatialVelocityInWorld(plant_context)
    assert 0.1 < V_WB.translational()[0] < 0.4
    np.testing.assert_allclose(V_WB.rotational()[1] * 0.03, V_WB.translational()[0], rtol=1e-3)


def test_plant_in_autodiff_gives_the_derivative_of_its_motion_with_respect_to_stiffness():
    parameters = ContactParameters(stiffness=500.0, damping=5.0, friction=0.3, slip_velocity=0.05)
    diagram, _, _, _ = _ball_on_ground("kelvin_voigt", parameters)

    def height(stiffness, system):
        simulator_context = system.CreateDefaultContext()
        # a plant's default pose does not survive scalar conversion
        simulator_context.SetTimeStateAndParametersFrom(diagram.CreateDefaultContext())
        leaf = system.GetSubsystemByName("contact")
        parameter = leaf.GetMyMutableContextFromRoot(simulator_context).get_mutable_numeric_parameter(0)
        values = parameter.CopyToVector()
        values[0] = stiffness
        parameter.SetFromVector(values)
        for _ in range(600):
            update = system.EvalUniquePeriodicDiscreteUpdate(simulator_context)
            simulator_context.SetDiscreteState(update.value(0))
        return simulator_context.get_discrete_state_vector().GetAtIndex(6)

    reference = height(AutoDiffXd(500.0, [1.0]), diagram.ToAutoDiffXd())
    step = 0.05
    difference = (height(500.0 + step, diagram) - height(500.0 - step, diagram)) / (2 * step)
    assert abs(difference) > 1e-7
    np.testing.assert_allclose(reference.derivatives()[0], difference, rtol=1e-5)


@pytest.mark.parametrize("law", NORMAL_LAWS)
def test_arms_and_throws_are_pressed_by_the_same_law(law):
    """Compiled loops over a tree's links and over a thrown body's points, and NumPy: the same bits."""
    parameters = ContactParameters(stiffness=300.0, damping=4.0, dissipation=0.7, modulus=3e4, radius=0.02)
    up, origin = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    contact = on_tree.SphereContact(("ball", "ground"), 0, origin, 0.0, origin, up, ContactLaw(law), parameters)
    penetration, rate, _ = _samples(3)
    expected = contact.law.normal_force(penetration, rate, parameters)
    count = len(penetration)
    place, velocity = np.zeros((count, 1, 3)), np.zeros((count, 1, 6))
    place[:, 0, 2], velocity[:, 0, 5] = -penetration, -rate
    geometry, numbers = contact.numbers
    linked = sphere_wrenches(
        np.tile(np.eye(3), (count, 1, 1, 1)), place, velocity, np.array([0]), geometry[None], numbers[None]
    )
    np.testing.assert_array_equal(linked[:, 0, 5], expected)
    # of a thrown body only the points that touch are asked for
    on = penetration > 0.0
    nothing = np.zeros((int(on.sum()), 3))
    thrown = forces(
        penetration[on], rate[on], nothing, nothing, origin, np.zeros((len(nothing), 0)), up, law_of(contact)
    )
    np.testing.assert_array_equal(thrown[0][:, 2], expected[on])
    assert np.any(expected == 0.0) and np.any(expected > 0.0)
