"""A plate that turns about a vertical axis: one joint without gravity, whose exact motions are easily written down."""

from pathlib import Path

import pandas as pd

from drake_cafim import recordings
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.scene.scene import Scene

ROTOR = """
  <transmission name="drive">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="axis"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="motor"><drake:rotor_inertia value="{rotor}"/><drake:gear_ratio value="1"/></actuator>
  </transmission>
"""


def write_turntable(
    folder: Path,
    table: pd.DataFrame,
    std: tuple[float, float],
    inertia: float,
    *,
    rotor: float = 0.0,
    damping: float = 0.0,
    friction: float = 0.0,
) -> None:
    """Writes scenario.yaml and run.parquet, the `table`, with `std` of q (rad) and v (rad/s) and exact efforts.

    The plate has the `inertia`, kg m², its joint a `rotor` inertia, `damping` N m s/rad and dry `friction` N m.
    """
    (folder / "turntable.urdf").write_text(f"""
<robot name="turntable" xmlns:drake="http://drake.mit.edu">
  <link name="base"/>
  <link name="plate">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="axis" type="continuous">
    <parent link="base"/><child link="plate"/><axis xyz="0 0 1"/><dynamics damping="{damping}" friction="{friction}"/>
  </joint>
  {ROTOR.format(rotor=rotor) if rotor else ""}
</robot>
""")
    (folder / "scenario.yaml").write_text(
        "model: turntable.urdf\nweld: [{body: base}]\n"
        f"channels: {{q: {{std: {std[0]}}}, v: {{std: {std[1]}}}, u: {{std: 0.0}}}}\n"
    )
    table.to_parquet(folder / "run.parquet")


def problem_of(folder: Path) -> WeakProblem:
    """The equations of what `write_turntable` has written there."""
    scene = Scene.load(folder / "scenario.yaml")
    problem = prepare(scene, [recordings.read(folder / "run.parquet")]).problem()
    assert isinstance(problem, WeakProblem)
    return problem
