"""The vectorised rigid-body quantities against Drake's own."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pytest import MonkeyPatch

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.dynamics.contact import SphereContact, WrenchSensor
from drake_cafim.dynamics.motion import bias_force, mass_matrix, momentum_balance, motion
from drake_cafim.dynamics.tree import Tree, tree_of
from drake_cafim.errors import InputError

BRANCHED = """<robot name="branched">
  <link name="base"/>
  {links}
  <joint name="turn" type="revolute"><parent link="base"/><child link="a"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/>
    <axis xyz="0.2 0.3 0.9"/><limit lower="-2" upper="2" effort="30" velocity="4"/></joint>
  <joint name="mount" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0 0.1 0.2" rpy="0.1 0.4 0"/></joint>
  <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0" rpy="0 0.7 0"/>
    <axis xyz="0 1 0.5"/></joint>
  <joint name="left" type="continuous"><parent link="b"/><child link="d"/>
    <origin xyz="0 0 0.4" rpy="1 0 0"/><axis xyz="1 0 0"/></joint>
  <joint name="tip" type="continuous"><parent link="c"/><child link="e"/>
    <origin xyz="0.1 0.1 0.1"/><axis xyz="0 0 1"/></joint>
</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="{x} 0.02 -0.03" rpy="0.2 0 0.1"/><mass value="{m}"/>
  <inertia ixx="0.03" iyy="0.02" izz="0.04" ixy="0.002" ixz="-0.001" iyz="0.003"/></inertial></link>"""


@pytest.fixture
def branched() -> MultibodyPlant:
    links = "".join(LINK.format(name=name, x=0.05 * k, m=1.0 + k) for k, name in enumerate("abcde"))
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(BRANCHED.format(links=links), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def test_mass_matrix_bias_and_momentum_are_drakes(branched: MultibodyPlant) -> None:
    tree = tree_of(branched)
    rng = np.random.default_rng(3)
    q, v = rng.normal(size=(20, 4)), rng.normal(size=(20, 4))
    gravity = np.array([1.0, -2.0, -9.0])
    branched.mutable_gravity_field().set_gravity_vector(gravity)
    moving = motion(tree, q, v)
    M = mass_matrix(moving)
    bias = bias_force(moving, gravity)
    balance = momentum_balance(moving, gravity)
    context = branched.CreateDefaultContext()
    for k in range(len(q)):
        branched.SetPositions(context, q[k])
        branched.SetVelocities(context, v[k])
        M_drake = branched.CalcMassMatrix(context)
        bias_drake = branched.CalcBiasTerm(context) - branched.CalcGravityGeneralizedForces(context)
        np.testing.assert_allclose(M[k], M_drake, rtol=0, atol=1e-12)
        np.testing.assert_allclose(bias[k], bias_drake, rtol=0, atol=1e-12)
        np.testing.assert_allclose(balance.momentum[k], M_drake @ v[k], rtol=0, atol=1e-12)


def test_a_touching_sphere_and_a_wrench_sensor_are_drakes(branched: MultibodyPlant) -> None:
    tree, rng = tree_of(branched), np.random.default_rng(4)
    q, v, normal = rng.normal(size=(5, 4)), rng.normal(size=(5, 4)), np.array([0.6, 0.0, 0.8])
    joint, p_JC, point, radius = tree.joint_index("tip"), np.array([0.1, -0.2, 0.3]), np.array([0.2, 0.1, -0.4]), 0.05
    moving = motion(tree, q, v)
    law, numbers = ContactLaw(), ContactParameters(stiffness=100.0)
    touch = SphereContact(("e", "plane"), joint, p_JC, radius, point, normal, law, numbers).touch(moving)
    X_JS = RigidTransform(RollPitchYaw(0.1, 0.5, -0.7), [0.02, 0.03, -0.01])
    sensor = WrenchSensor("wrist", joint, X_JS.rotation().matrix(), X_JS.translation())
    wrench = rng.normal(size=(5, 6))
    reading, on_links = sensor.reading(moving, wrench), np.zeros((5, 4, 6))
    on_links[:, joint] = wrench
    generalized = moving.project(on_links)
    context, frame, world = branched.CreateDefaultContext(), branched.GetFrameByName("e"), branched.world_frame()
    for k in range(len(q)):
        branched.SetPositions(context, q[k])
        branched.SetVelocities(context, v[k])
        X_WE = frame.CalcPoseInWorld(context)
        V_WE = frame.CalcSpatialVelocityInWorld(context)
        p_WC = X_WE @ p_JC - radius * normal
        v_WC = V_WE.Shift(p_WC - X_WE.translation()).translational()
        np.testing.assert_allclose(touch.penetration[k], -normal @ (p_WC - point), atol=1e-12)
        np.testing.assert_allclose(touch.rate[k], -normal @ v_WC, atol=1e-12)
        np.testing.assert_allclose(touch.slip[k], v_WC - normal * (normal @ v_WC), atol=1e-12)
        np.testing.assert_allclose(touch.position[k], p_WC, atol=1e-12)
        np.testing.assert_allclose(touch.spinning[k], np.cross(V_WE.rotational(), -radius * normal), atol=1e-12)
        X_WS = X_WE @ X_JS
        F_Wo = SpatialForce(wrench[k, :3], wrench[k, 3:])
        F_So = F_Wo.Shift(X_WS.translation()).Rotate(X_WS.rotation().inverse())
        np.testing.assert_allclose(reading[k], [*F_So.translational(), *F_So.rotational()], atol=1e-12)
        J = branched.CalcJacobianSpatialVelocity(context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world)
        about_frame = F_Wo.Shift(X_WE.translation()).get_coeffs()
        np.testing.assert_allclose(generalized[k], J.T @ about_frame, atol=1e-12)


def test_kinetic_energy_gradient_matches_differences(branched: MultibodyPlant) -> None:
    tree = tree_of(branched)
    rng = np.random.default_rng(4)
    q, v = rng.normal(size=(5, 4)), rng.normal(size=(5, 4))

    def kinetic(position: np.ndarray) -> np.ndarray:
        moving = motion(tree, position, v)
        return 0.5 * np.einsum("nj,njk,nk->n", v, mass_matrix(moving), v)

    moving = motion(tree, q, v)
    force = momentum_balance(moving, np.zeros(3)).force
    for j in range(4):
        step = np.zeros(4)
        step[j] = 1e-6
        difference = (kinetic(q + step) - kinetic(q - step)) / 2e-6
        np.testing.assert_allclose(force[:, j], difference, rtol=0, atol=1e-7)


def test_tree_keeps_limits_and_names_what_it_lacks(branched: MultibodyPlant) -> None:
    tree: Tree = tree_of(branched)
    assert tree.joint_names == tuple(
        sorted(tree.joint_names, key=lambda name: branched.GetJointByName(name).velocity_start())
    )
    turn = tree.joints[tree.joint_index("turn")]
    assert turn.position_limits == (-2.0, 2.0) and turn.velocity_limit == 4.0
    with pytest.raises(InputError, match="no joint named 'elbow'; it has: turn"):
        tree.joint_index("elbow")


def test_one_body_may_float_and_two_are_refused_with_a_sentence() -> None:
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.AddModelsFromString(f"<robot name='r'>{LINK.format(name='a', x=0.1, m=1)}</robot>", "urdf")
    plant.Finalize()
    tree = tree_of(plant)
    mass, center, _ = tree.lumps
    assert tree.floating and tree.joints == () and mass[0] == 1.0 and center[0, 0] == pytest.approx(0.1)
    plant = MultibodyPlant(0.0)
    for name in "ab":
        Parser(plant).AddModelsFromString(f"<robot name='{name}'>{LINK.format(name=name, x=0, m=1)}</robot>", "urdf")
    plant.Finalize()
    with pytest.raises(InputError, match="bodies a, b move and nothing holds them all"):
        tree_of(plant)


def test_inertial_regressor_gives_the_same_rows_as_the_momentum(branched: MultibodyPlant) -> None:
    from drake_cafim.diagnosis.rows.inertial_regressor import LinkRegressors
    from drake_cafim.diagnosis.rows.test_functions import lay_windows

    tree = tree_of(branched)
    time = 0.004 * np.arange(100)
    q = np.stack([np.sin((2 + k) * time) for k in range(4)], axis=1)
    v = np.stack([(2 + k) * np.cos((2 + k) * time) for k in range(4)], axis=1)
    gravity = np.array([1.0, -2.0, -9.0])
    windows = lay_windows(time, np.ones(100, dtype=bool), 0.08)
    moving = motion(tree, q, v)
    balance = momentum_balance(moving, gravity)
    expected = -(windows.rate @ balance.momentum) - windows.value @ balance.force
    links = LinkRegressors(windows)
    rows = links.regressor(moving, v, (q, v), windows.value).rows(tree.inertial_parameters, gravity)
    np.testing.assert_allclose(rows, expected, rtol=0, atol=1e-12)
    # links that other numbers do not move are as they were, and the others are reckoned anew
    for joint in range(4):
        other = q.copy()
        other[:, joint] += 0.1 * time
        moving = motion(tree, other, v)
        balance = momentum_balance(moving, gravity)
        expected = -(windows.rate @ balance.momentum) - windows.value @ balance.force
        rows = links.regressor(moving, v, (other, v), windows.value).rows(tree.inertial_parameters, gravity)
        np.testing.assert_allclose(rows, expected, rtol=0, atol=1e-12)


def test_rows_are_the_same_with_and_without_their_regressor(branched: MultibodyPlant) -> None:
    """Rows do not change by a bit once it is there; measured velocities need not be smooth."""
    from drake_cafim.diagnosis.rows.inertial_regressor import LinkRegressors
    from drake_cafim.diagnosis.rows.inertial_rows import CACHED, InertialRows
    from drake_cafim.diagnosis.rows.test_functions import lay_windows

    tree = tree_of(branched)
    time = 0.004 * np.arange(100)
    q = np.stack([np.sin((2 + k) * time) for k in range(4)], axis=1)
    v = np.stack([(2 + k) * np.cos((2 + k) * time) for k in range(4)], axis=1)
    measured = v + np.random.default_rng(1).normal(size=v.shape)
    windows = lay_windows(time, np.ones(100, dtype=bool), 0.08)
    links, places = LinkRegressors(windows), (q[1:], v[1:])
    smooth, value = motion(tree, q, v), windows.value[:, 1:]
    rows, direct = (InertialRows(links, smooth, measured, places, value, by_regressor=by) for by in (True, False))
    before = []
    for k in [*range(CACHED + 2), *range(CACHED + 2)]:
        gravity = np.array([1.0 + k, -2.0, -9.0])
        force = momentum_balance(motion(tree, q[1:], v[1:]), gravity).force
        momentum = momentum_balance(motion(tree, q, measured), gravity).momentum
        expected = -(windows.rate @ momentum) - windows.value[:, 1:] @ force
        np.testing.assert_allclose(rows.of(tree, gravity), expected, rtol=0, atol=1e-11)
        np.testing.assert_allclose(direct.of(tree, gravity), expected, rtol=0, atol=1e-11)
        assert direct.regressor.inertia.shape[1] == 4
        before.append((rows.of(tree, gravity), direct.of(tree, gravity)))
    assert np.array_equal(before[: CACHED + 2], before[CACHED + 2 :])


def test_momenta_and_forces_are_those_of_the_motion_with_followers_too() -> None:
    from drake_cafim.dynamics.motion import inertial_force, momentum

    plant = MultibodyPlant(0.0)
    links = "".join(LINK.format(name=name, x=0.1 + 0.05 * k, m=1.0 + k) for k, name in enumerate("abc"))
    joints = """<link name="base"/>
      <joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
        <limit lower="-2" upper="2" effort="1" velocity="4"/></joint>
      <joint name="two" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
        <limit lower="-2" upper="2" effort="1" velocity="4"/></joint>
      <joint name="three" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0"/>
        <axis xyz="1 0 0"/><mimic joint="two" multiplier="-0.4" offset="0.1"/>
        <limit lower="-2" upper="2" effort="1" velocity="4"/></joint>"""
    Parser(plant).AddModelsFromString(f"<robot name='follows'>{joints}{links}</robot>", "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    tree = tree_of(plant)
    rng = np.random.default_rng(2)
    q, v, gravity = rng.normal(size=(5, len(tree.joints))), rng.normal(size=(5, len(tree.joints))), rng.normal(size=3)
    balance = momentum_balance(motion(tree, q, v), gravity)
    np.testing.assert_allclose(momentum(tree, q, v), balance.momentum, rtol=0, atol=1e-12)
    np.testing.assert_allclose(inertial_force(tree, q, v, gravity), balance.force, rtol=0, atol=1e-12)


def test_the_regressor_by_parts_is_that_of_all_windows(branched: MultibodyPlant, monkeypatch: MonkeyPatch) -> None:
    from drake_cafim.diagnosis.rows import inertial_regressor
    from drake_cafim.diagnosis.rows.test_functions import lay_windows

    tree = tree_of(branched)
    time = 0.004 * np.arange(200)
    q = np.stack([np.sin((2 + k) * time) for k in range(4)], axis=1)
    v = np.stack([(2 + k) * np.cos((2 + k) * time) for k in range(4)], axis=1)
    usable = np.ones(200, dtype=bool)
    usable[90:100] = False
    windows = lay_windows(time, usable, 0.08)
    found = []
    for at_once in (10_000, 3):
        monkeypatch.setattr(inertial_regressor, "WINDOWS_AT_ONCE", at_once)
        links = inertial_regressor.LinkRegressors(windows)
        found.append(links.regressor(motion(tree, q, v), v, (q, v), windows.value))
    np.testing.assert_allclose(found[1].inertia, found[0].inertia, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(found[1].weight, found[0].weight, rtol=1e-13, atol=1e-15)


def test_a_locked_joint_is_a_weld_at_its_position(branched: MultibodyPlant) -> None:
    tree = tree_of(branched, {"slide": 0.3})
    assert "slide" not in tree.joint_names and len(tree.joints) == 3
    rng = np.random.default_rng(5)
    q, v = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    moving = motion(tree, q, v)
    M = mass_matrix(moving)
    context = branched.CreateDefaultContext()
    index = [branched.GetJointByName(name).velocity_start() for name in tree.joint_names]
    slide = branched.GetJointByName("slide").position_start()
    for k in range(4):
        full = np.zeros(4)
        full[index], full[slide] = q[k], 0.3
        branched.SetPositions(context, full)
        np.testing.assert_allclose(M[k], branched.CalcMassMatrix(context)[np.ix_(index, index)], atol=1e-12)
    with pytest.raises(InputError, match="lock names the joint 'elbow'"):
        tree_of(branched, {"elbow": 0.0})
