"""Dry friction in a discrete plant: no slip below its level, slip above it, and the speed at which it creeps."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import Joint, JointActuator, PrismaticJoint, RevoluteJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_cafim.corrected.brakes import GAIN
from drake_cafim.typing import Array
from tests.recoveries.models import scene_of

INERTIA, ROTOR = 0.03, 0.02
ONE = f"""<robot name="one" xmlns:drake="http://drake.mit.edu"><link name="base"/><link name="l"><inertial>
<mass value="1"/><inertia ixx="0.03" iyy="0.03" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/></joint>
<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="j"/><actuator name="j">
<drake:rotor_inertia value="{ROTOR}"/><drake:gear_ratio value="1"/></actuator></transmission></robot>"""
FRICTIONS = [
    ("joint_coulomb_friction", {"torque": 1.0}),
    ("joint_asymmetric_coulomb_friction", {"torque_positive": 1.0, "torque_negative": 0.6}),
    ("joint_stribeck_friction", {"coulomb": 0.7, "static": 1.0, "velocity": 0.05}),
    ("joint_load_dependent_friction", {"torque": 0.5, "coefficient": 0.5}),
]


def pushed(
    folder: Path,
    name: str,
    values: dict[str, float],
    effort: float,
    speed: float,
    config: MultibodyPlantConfig,
    model: str = ONE,
) -> Array:
    """Velocity (N,) rad/s of a joint under a steady effort at steps of 1 ms over 0.5 s."""
    scene = scene_of(folder, model, {"effect": name, "at": "j", **values})
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, config)
    source = builder.AddSystem(ConstantVectorSource([effort]))
    builder.Connect(source.get_output_port(), corrected.effort)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = corrected.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    corrected.plant.SetVelocities(context, [speed])
    found = []
    for k in range(500):
        simulator.AdvanceTo(1e-3 * (k + 1))
        found.append(float(corrected.plant.GetVelocities(context)[0]))
    return np.array(found)


@pytest.mark.parametrize("solver", ["sap", "lagged", "similar"])
@pytest.mark.parametrize(("name", "values"), FRICTIONS)
def test_holds_still_below_its_level(name: str, values: dict[str, float], solver: str, tmp_path: Path) -> None:
    effort = 0.9
    v = pushed(tmp_path, name, values, effort, 0.0, MultibodyPlantConfig(discrete_contact_approximation=solver))
    # 9e-5 rad/s under nine tenths of the friction, 0.3° in a minute
    assert np.max(np.abs(v)) <= 1.01 * effort / GAIN


@pytest.mark.parametrize(("name", "values"), FRICTIONS)
def test_slides_above_its_level(name: str, values: dict[str, float], tmp_path: Path) -> None:
    v = pushed(tmp_path, name, values, 1.5, 0.0, MultibodyPlantConfig())
    level = {"joint_stribeck_friction": 0.7, "joint_load_dependent_friction": 0.5 + 0.5 * 1.5}.get(name, 1.0)
    assert v[-1] - v[-101] == pytest.approx(0.1 * (1.5 - level) / (INERTIA + ROTOR), rel=1e-3)


def test_comes_to_rest_and_stays(tmp_path: Path) -> None:
    v = pushed(tmp_path, "joint_coulomb_friction", {"torque": 1.0}, 0.0, 2.0, MultibodyPlantConfig())
    stop = round(2.0 * (INERTIA + ROTOR) / 1.0 / 1e-3)
    assert np.all(v[: stop - 1] > 0.0)
    assert np.max(np.abs(v[stop + 1 :])) < 1e-8


def test_a_friction_beside_that_of_the_model_is_simulated(tmp_path: Path) -> None:
    """Two dry frictions of one joint, as where the model file states one and a diagnosis finds another."""
    model = ONE.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><dynamics friction="0.6"/>')
    name, values, config = "joint_coulomb_friction", {"torque": 0.5}, MultibodyPlantConfig()
    assert np.max(np.abs(pushed(tmp_path, name, values, 1.0, 0.0, config, model))) <= 1.01 / GAIN
    v = pushed(tmp_path, name, values, 1.4, 0.0, config, model)
    assert v[-1] - v[-101] == pytest.approx(0.1 * (1.4 - 1.1) / (INERTIA + ROTOR), rel=1e-3)


def test_drake_has_no_dry_friction_of_joints_of_its_own_yet() -> None:
    """When this fails, `drake_cafim.corrected.brakes` has what it stands in for: use it there."""
    known = (MultibodyPlant, Joint, RevoluteJoint, PrismaticJoint, JointActuator, MultibodyPlantConfig)
    names = {name.lower() for kind in known for name in dir(kind)}
    assert not [name for name in names if "friction" in name or "coulomb" in name]
