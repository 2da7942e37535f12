"""Every effect under a controller that closes loops over the measured channels, in discrete and continuous plants."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.parametrize import long_after
from tests.recoveries.cases import CASES, Case
from tests.recoveries.rig import CONTINUOUS, rig

STEP = 5e-4
"""s"""
SERVO_STEP = 2.5e-4
"""s: damping over inertia of the rig's position servos is 100 1/s and more, five times the rate of its controllers."""
FROM_THE_START = {
    "joint_hard_stop": {"position": -0.5},
    "unmodeled_contact": {"offset": 0.5},
    "actuator_saturation": {"limit": 5.0},
    "actuator_speed_limit": {"no_load_speed": 2.0, "stall_torque": 1.0},
    "external_disturbance": {"interval": [0.01, 0.09]},
}
"""Values with which the effect is felt in the first tenth of a second."""


def measured(scene: Scene, case: Case, config: MultibodyPlantConfig) -> dict[str, Array]:
    """All channels but the efforts over the first tenth of a second."""
    closed = rig(scene, case.desired(1), config=config, rate=case.rate)
    closed.simulator.AdvanceTo(0.1)
    return {name: x[:49] for name, x in closed.recording().columns.items() if not name.startswith("u.")}


@pytest.mark.parametrize("case", long_after(8, CASES), ids=lambda case: case.name)
def test_a_discrete_plant_does_what_a_continuous_one_does(case: Case, tmp_path: Path) -> None:
    """To first order in the step: what the effect changes differs by a twentieth of its largest value at most."""
    case = replace(case, values={**case.values, **FROM_THE_START.get(case.name, {})})
    discrete = MultibodyPlantConfig(time_step=SERVO_STEP if "servo" in case.more else STEP)
    changes = []
    for config in (CONTINUOUS, discrete):
        with_it, without = (measured(case.scene(tmp_path, effect), case, config) for effect in (True, False))
        changes.append({name: x - without[name] for name, x in with_it.items()})
    kinds = {name.split(".")[0] for name in changes[0]}
    sizes = {kind: max(np.max(np.abs(x)) for name, x in changes[0].items() if name.startswith(kind)) for kind in kinds}
    assert max(sizes.values()) > 0.0
    for name, change in changes[0].items():
        np.testing.assert_allclose(changes[1][name], change, rtol=0.0, atol=0.05 * sizes[name.split(".")[0]])
