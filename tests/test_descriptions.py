"""Models with traits of published ones: meshes, packages, no masses, inconsistent inertias, MJCF's defaults."""

import logging
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Mesh
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.description.packages import package_folders
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.link_geometry import link_shapes
from drake_cafim.report.stl import obj_of, triangles
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scene.scene import Scene

LINK = """
  <link name="{name}">
    <inertial><origin xyz="0.1 0 0.02"/><mass value="{mass}"/>
      <inertia ixx="{ixx}" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://somebody_description/meshes/{name}.dae"/></geometry>
      <material name="red"/></visual>
    <collision><geometry><mesh filename="package://somebody_description/meshes/{name}.stl"/></geometry></collision>
  </link>"""
JOINT = """
  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-3.1415926535" upper="3.1415926535" effort="{effort}" velocity="2"/>
    {more}</joint>"""


def arm(more: str = "", mass: float = 1.0, ixx: float = 0.02, kind: str = "revolute", effort: float = 10.0) -> str:
    """Two links on a massless base."""
    links = "".join(LINK.format(name=f"link{k}", mass=mass, ixx=ixx) for k in (1, 2))
    joints = JOINT.format(name="shoulder", kind="revolute", parent="base", child="link1", effort=effort, more="")
    joints += JOINT.format(name="elbow", kind=kind, parent="link1", child="link2", effort=effort, more=more)
    return f'<?xml version="1.0"?>\n<robot name="arm">\n  <link name="base"/>{links}{joints}\n</robot>\n'


def scene_of(folder: Path, text: str, name: str = "arm.urdf", **more: object) -> Scene:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    base = "base" if name.endswith("urdf") else None
    lines = [f"model: {name}", *([f"weld: [{{body: {base}}}]"] if base else [])]
    lines += [f"{key}: {value}" for key, value in more.items()]
    (folder / "scenario.yaml").write_text("\n".join(lines), encoding="utf-8")
    return Scene.load(folder / "scenario.yaml")


def test_meshes_of_an_unknown_package_are_not_needed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    scene = scene_of(tmp_path, arm())
    assert scene.tree.joint_names == ("shoulder", "elbow")
    said = " ".join(scene.stated.notes)
    assert "collision meshes are not read" in said and "link1, link2" in said
    for way in ("packages: {somebody_description", "--package somebody_description=DIR", "ROS_PACKAGE_PATH"):
        assert way in said
    assert "AMENT_PREFIX_PATH" in said and "package.xml" in said


def test_a_drawing_is_taken_from_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = tmp_path / "there" / "share" / "somebody_description" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "link1.dae").write_text("<COLLADA/>", encoding="utf-8")
    package = meshes.parent

    def shown(scene: Scene) -> int:
        body = scene.plant.GetBodyByName("link1")
        return len(scene.plant.GetVisualGeometriesForBody(body))

    assert shown(scene_of(tmp_path / "a", arm())) == 0
    assert shown(
        scene_of(tmp_path / "b", arm(), packages="{somebody_description: ../there/share/somebody_description}")
    )
    given = package_folders((f"somebody_description={package}",))
    assert shown(Scene.load(tmp_path / "a" / "scenario.yaml", packages=given))
    with monkeypatch.context() as patch:
        patch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "there"))
        assert shown(Scene.load(tmp_path / "a" / "scenario.yaml"))
    with monkeypatch.context() as patch:
        patch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}:{package.parent}")
        assert shown(Scene.load(tmp_path / "a" / "scenario.yaml"))
    (package / "package.xml").write_text("<package><name>somebody_description</name></package>", encoding="utf-8")
    assert shown(scene_of(package / "urdf", arm()))


def test_a_corrected_scenario_keeps_its_packages(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    scene_of(tmp_path / "a", arm())
    scene = Scene.load(tmp_path / "a" / "scenario.yaml", packages={"somebody_description": str(tmp_path / "meshes")})
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "again.yaml").write_text(as_yaml(scene.scenario, scene.folder, tmp_path / "out"), "utf-8")
    assert "../meshes" in (tmp_path / "out" / "again.yaml").read_text(encoding="utf-8")
    assert Scene.load(tmp_path / "out" / "again.yaml").tree.joint_names == ("shoulder", "elbow")


def test_a_model_in_an_unknown_package_names_the_four_ways(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text("model: package://nobody_knows/arm.urdf\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"packages: \{nobody_knows.*--package.*ROS_PACKAGE_PATH.*package.xml"):
        Scene.load(tmp_path / "scenario.yaml")
    with pytest.raises(InputError, match="expected NAME=DIR"):
        package_folders(("nobody_knows",))


def test_the_parser_says_nothing_on_the_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = arm(more='<dynamics damping="0.1" friction="0.3"/><safety_controller k_velocity="1"/>')
    scene = scene_of(tmp_path, text.replace('<link name="link2"', '<link name="link2" type="odd"'))
    assert capfd.readouterr().err == ""
    assert any("'type'" in note for note in scene.stated.notes)
    assert logging.getLogger("drake").propagate


def test_an_inertia_that_no_body_can_have_is_mended_and_noted(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, arm(ixx=0.2))
    (note,) = [note for note in scene.stated.notes if "'link2'" in note]
    assert "line 12" in note and "arm.urdf" in note
    low, middle, high = np.linalg.eigvalsh(scene.tree.body("link2").I_BBcm_B)
    assert low + middle == pytest.approx(high)


def test_shapes_without_an_extent_are_left_out(tmp_path: Path) -> None:
    empty = '<collision><geometry><box size="0 0 0"/></geometry></collision></link>'
    scene = scene_of(tmp_path, arm().replace("</link>", empty, 1))
    assert any(note.startswith("shapes without an extent are left out (link1)") for note in scene.stated.notes)


def test_an_include_written_under_windows_is_found(tmp_path: Path) -> None:
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "defaults.xml").write_text(DEFAULTS, encoding="utf-8")
    text = MJCF.replace("common/defaults.xml", "common\\defaults.xml")
    assert scene_of(tmp_path, text, "arm.xml").tree.joints[0].damping == 0.1


def test_only_the_groups_that_the_file_names_have_mass(tmp_path: Path) -> None:
    """`inertiagrouprange`: masses as MuJoCo has them, and no mesh of another group is missed."""
    mujoco = pytest.importorskip("mujoco")
    text = """<mujoco><compiler inertiagrouprange="3 4"/><asset><mesh name="drawn" file="drawn.stl"/></asset><worldbody>
      <body name="fore"><joint name="elbow" axis="0 1 0"/><geom type="mesh" mesh="drawn" group="1"/>
      <geom size="0.1" group="2"/><geom size="0.05" pos="0 0 0.2" group="3"/></body></worldbody></mujoco>"""
    scene = scene_of(tmp_path, text, "arm.xml")
    plain = text.replace('<geom type="mesh" mesh="drawn" group="1"/>', "").replace(
        '<mesh name="drawn" file="drawn.stl"/>', ""
    )
    model = mujoco.MjModel.from_xml_string(plain)
    assert scene.tree.body("fore").mass == pytest.approx(model.body("fore").mass[0])


def test_a_negative_mass_names_the_body_and_the_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"arm.urdf, line 5: body 'link1' has the mass -1"):
        scene_of(tmp_path, arm(mass=-1.0))


def test_a_joint_that_moves_nothing_names_the_body_and_the_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"arm.urdf, line 21: joint 'elbow' moves 'link2'.*without mass"):
        before, (inertial, after) = (
            arm().rsplit("<inertial>", 1)[0],
            arm().rsplit("<inertial>", 1)[1].split("</inertial>"),
        )
        assert "mass" in inertial
        scene_of(tmp_path, f"{before}\n{after}")


def test_an_inertia_without_a_mass_is_kept(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, arm().replace('<mass value="1.0"/>', '<mass value="0"/>'))
    assert scene.tree.body("link2").I_BBcm_B[1, 1] == pytest.approx(0.02)
    assert any("'link2' has an inertia but no mass" in note for note in scene.stated.notes)


def test_macros_are_to_be_expanded_first(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 3: found <xacro:include>.*`xacro arm.urdf` writes"):
        scene_of(tmp_path, arm().replace("<link", '<xacro:include filename="a.xacro"/><link', 1))


def test_materials_defined_twice_or_never_do_no_harm(tmp_path: Path) -> None:
    twice = (
        '<material name="red"><color rgba="1 0 0 1"/></material><material name="red"><color rgba="0 1 0 1"/></material>'
    )
    assert scene_of(tmp_path, arm().replace("<link ", f"{twice}<link ", 1)).tree.joints


def recording_of(*joints: str) -> Recording:
    time = np.arange(0.0, 1.0, 0.01)
    columns = {f"{kind}.{joint}": np.sin(time) for joint in joints for kind in ("q", "v", "u")}
    return Recording(name="run.csv", time=time, columns=columns)


def test_a_missing_column_says_that_a_joint_can_be_held(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no column q.elbow.*`lock: \[elbow\]`.*`lock: unrecorded`"):
        prepare(scene_of(tmp_path, arm()), [recording_of("shoulder")])


def test_unrecorded_joints_are_held(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, arm(), lock="unrecorded")
    prepared = prepare(scene, [recording_of("shoulder", "stranger")])
    assert prepared.scene.tree.joint_names == ("shoulder",)
    assert prepared.scene.scenario.lock == {"elbow": 0.0}
    assert any("no such joint: q.stranger, v.stranger, u.stranger" in note for note in prepared.notes)
    assert "elbow: 0.0" in as_yaml(prepared.scene.scenario, prepared.scene.folder, tmp_path)
    with pytest.raises(InputError, match="lock names the joint 'wrist'"):
        scene_of(tmp_path, arm(), lock="[wrist]")
    with pytest.raises(InputError, match="lock is 'some', expected a list"):
        scene_of(tmp_path, arm(), lock="some")


def test_a_list_of_held_joints_stands_at_the_files_value(tmp_path: Path) -> None:
    scene = mjcf_scene(tmp_path, lock="[elbow]")
    assert scene.scenario.lock == {"elbow": 0.3}
    moved = mjcf_scene(tmp_path / "moved", lock="{elbow: 0.5}")
    assert not np.allclose(scene.tree.body("fore").R_JB, moved.tree.body("fore").R_JB)


def test_what_follows_a_held_joint_is_held_where_it_follows(tmp_path: Path) -> None:
    text = arm(more='<mimic joint="shoulder" multiplier="2" offset="0.1"/>')
    wrist = JOINT.format(name="wrist", kind="revolute", parent="link2", child="link3", effort=1.0, more="")
    text = text.replace("</robot>", f"{LINK.format(name='link3', mass=1.0, ixx=0.02)}{wrist}</robot>")
    assert scene_of(tmp_path, text, lock="{shoulder: 0.2}").scenario.lock == {"shoulder": 0.2, "elbow": 0.5}
    with pytest.raises(InputError, match=r"line 21: joint 'elbow' follows 'shoulder' and carries.*lock: \[shoulder\]"):
        scene_of(tmp_path, text)


def test_what_a_urdf_says_of_friction_and_efforts_is_nominal(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, arm(more='<dynamics friction="0.7" damping="0.2"/>'))
    (friction,) = scene.physics.joint_forces
    assert (friction.name, friction.at, friction.values["torque"]) == ("joint_coulomb_friction", "elbow", 0.7)
    assert scene.tree.joints[1].damping == 0.2
    assert scene.tree.joints[1].effort_limit == 10.0


def test_commands_beyond_the_limit_act_as_far_as_that(tmp_path: Path) -> None:
    recording = recording_of("shoulder", "elbow")
    commanded = scene_of(tmp_path, arm(effort=0.5), channels="{u: {std: 0.0}}").for_recordings([recording])
    assert [
        (effect.name, effect.at, effect.values["limit"])
        for effect in commanded.with_surfaces_at(np.zeros(2)).physics.actuators
    ] == [
        ("actuator_saturation", "shoulder", 0.5),
        ("actuator_saturation", "elbow", 0.5),
    ]
    measured = scene_of(tmp_path, arm(effort=0.5), channels="{u: {std: 0.1}}").for_recordings([recording])
    assert not measured.physics.actuators
    assert "ignored (shoulder, elbow)" in measured.stated.notes[-1]
    assert not scene_of(tmp_path, arm(effort=0.0)).for_recordings([recording]).physics.actuators


def test_a_simulated_joint_gets_no_more_than_its_limit_and_its_friction(tmp_path: Path) -> None:
    """One joint, no gravity: I ω̇ = limit − friction."""
    text = arm(more='<dynamics friction="0.2"/>', effort=1.0)
    scene = scene_of(tmp_path, text, gravity="[0, 0, 0]", lock="[shoulder]")
    builder = DiagramBuilder()
    plant = scene.add_to(builder)
    builder.ExportInput(plant.effort, "effort")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    diagram.get_input_port(0).FixValue(simulator.get_mutable_context(), np.array([7.0]))
    simulator.AdvanceTo(0.1)
    (speed,) = plant.plant.GetVelocities(plant.plant.GetMyContextFromRoot(simulator.get_context()))
    inertia = 0.02 + 1.0 * (0.1**2 + 0.02**2)
    assert speed == pytest.approx(0.1 * (1.0 - 0.2) / inertia, rel=0.01)


CORNERS = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, 0, 1]]], dtype=float)


def write_stl(path: Path, binary: bool) -> None:
    if binary:
        facets = [np.r_[np.zeros(3), triangle.ravel()].astype("<f4").tobytes() + b"\0\0" for triangle in CORNERS]
        path.write_bytes(b" " * 80 + len(facets).to_bytes(4, "little") + b"".join(facets))
        return
    facets = ["facet normal 0 0 0\nouter loop\n", "endloop\nendfacet\n"]
    rows = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle) for triangle in CORNERS]
    path.write_text(f"solid a\n{''.join(facets[0] + row + facets[1] for row in rows)}endsolid\n", encoding="ascii")


@pytest.mark.parametrize("binary", [True, False])
def test_an_stl_becomes_an_obj(tmp_path: Path, binary: bool) -> None:
    write_stl(tmp_path / "a.stl", binary)
    np.testing.assert_array_equal(triangles((tmp_path / "a.stl").read_bytes()), CORNERS)
    lines = obj_of(tmp_path / "a.stl").splitlines()
    assert [line.split()[0] for line in lines] == ["v"] * 4 + ["f"] * 2  # four corners, two of them shared


def test_the_replay_shows_the_models_own_meshes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "meshes").mkdir()
    for name in ("link1.stl", "link2.stl", "nowhere.stl"):
        write_stl(tmp_path / "meshes" / name, binary=True)
    urdf = scene_of(tmp_path, arm().replace(".dae", ".stl"), packages="{somebody_description: .}")
    mjcf = MJCF.replace("<worldbody>", '<asset><mesh file="meshes/nowhere.stl" scale="2 2 2"/></asset><worldbody>')
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "defaults.xml").write_text(DEFAULTS, encoding="utf-8")
    for scene, count, scale in ((urdf, 2, 1.0), (scene_of(tmp_path, mjcf, "arm.xml"), 1, 2.0)):
        still = motion(scene.tree, np.zeros((2, 2)), np.zeros((2, 2)))
        meshes = [shape.shape for shape in link_shapes(scene, still, 1.0) if isinstance(shape.shape, Mesh)]
        assert [mesh.extension() for mesh in meshes] == [".obj"] * count
        assert all(mesh.scale3()[0] == scale for mesh in meshes)
        with monkeypatch.context() as patch:
            patch.setattr("drake_cafim.report.link_geometry.MOST_MESH", 10)
            assert not any(isinstance(shape.shape, Mesh) for shape in link_shapes(scene, still, 1.0))


MJCF = """<mujoco>
  <compiler angle="radian"/>
  <include file="common/defaults.xml"/>
  <worldbody>
    <body childclass="arm">
      <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.005"/>
      <joint name="shoulder" axis="0 1 0"/>
      <geom type="mesh" mesh="nowhere"/>
      <body name="fore" pos="0 0 0.3">
        <inertial pos="0 0 0.1" mass="0.5" fullinertia="0.01 0.01 0.005 0.001 0 0"/>
        <joint name="elbow" axis="0 1 0" ref="0.3" class="stiff"/>
        <body name="bare"><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/><geom size="0.01"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
DEFAULTS = """<mujocoinclude><default><default class="arm"><joint damping="0.1" armature="0.02" frictionloss="0.3"/>
  <default class="stiff"><joint stiffness="2" springref="0.1" frictionloss="0"/></default></default></default>
</mujocoinclude>"""


def mjcf_scene(folder: Path, **more: object) -> Scene:
    (folder / "common").mkdir(parents=True)
    (folder / "common" / "defaults.xml").write_text(DEFAULTS, encoding="utf-8")
    return scene_of(folder, MJCF, "arm.xml", **more)


def test_an_mjcf_without_a_name_with_includes_and_classes_loads(tmp_path: Path) -> None:
    scene = mjcf_scene(tmp_path)
    shoulder, elbow = scene.tree.joints
    assert (shoulder.damping, shoulder.rotor_inertia, elbow.damping) == (0.1, 0.02, 0.1)


def test_an_mjcf_moves_as_mujoco_has_it(tmp_path: Path) -> None:
    """Inverse dynamics with everything that the file states, `ref` included."""
    mujoco = pytest.importorskip("mujoco")
    scene = mjcf_scene(tmp_path)
    model = mujoco.MjModel.from_xml_string(
        MJCF.replace('<geom type="mesh" mesh="nowhere"/>', ""), {"common/defaults.xml": DEFAULTS.encode()}
    )
    model.dof_frictionloss[:] = 0.0  # a constraint in MuJoCo, a smoothed sign here
    data = mujoco.MjData(model)
    random = np.random.default_rng(1)
    for _ in range(5):
        data.qpos, data.qvel, data.qacc = random.normal(size=(3, 2))
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(
            inverse_dynamics(scene, data.qpos, data.qvel, data.qacc), data.qfrc_inverse, rtol=1e-9
        )


def inverse_dynamics(scene: Scene, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """N m that give the accelerations `a` against all that acts but dry friction."""
    from drake_cafim.effects.joint_samples import JointSamples

    physics = scene.physics
    M, bias = equations_of_motion(motion(scene.tree, q[None], v[None]), physics.gravity)
    smooth = [effect for effect in physics.joint_forces if effect.name != "joint_coulomb_friction"]
    samples = [JointSamples(q[j : j + 1], v[j : j + 1], np.zeros(1)) for j in range(len(q))]
    from dataclasses import replace

    applied = replace(physics, joint_forces=tuple(smooth)).applied_at_joints(samples)[0]
    return (M[0] + np.diag(physics.rotor_inertias)) @ a + bias[0] - applied[0]
