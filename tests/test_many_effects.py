"""Many effects at once, beside forces that nobody knows: all are named, each at its joint, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.places import joint_of, place_of
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.recordings.recording import Recording
from tests.concealed.make import simulate
from tests.concealed_case import written

pytestmark = pytest.mark.long

SEED = 12
VISCOUS, COULOMB, WIDTH = 0.8, 0.6, 0.01
"""N m at each joint's root mean square velocity, N m, rad/s: of the friction at every joint."""


def _with_friction(recording: Recording, coefficients: dict[str, float], unknown: float) -> Recording:
    """A recording whose efforts also overcame friction at every joint, and a torque (N m) at the first that beats."""
    columns, joints = dict(recording.columns), tuple(coefficients)
    for joint in joints:
        v = recording[f"v.{joint}"]
        columns[f"u.{joint}"] = columns[f"u.{joint}"] + coefficients[joint] * v + COULOMB * np.tanh(v / WIDTH)
    t = recording.time
    columns[f"u.{joints[0]}"] = columns[f"u.{joints[0]}"] + unknown * np.sin(9.0 * t + 2.0 * np.sin(1.3 * t))
    return replace(recording, columns=columns)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Verdict, dict[str, float]]:
    scene, read = written(simulate("null", "arm3", SEED), tmp_path_factory.mktemp("arm"))
    speeds = {
        joint: np.sqrt(np.mean(np.concatenate([recording[f"v.{joint}"] for recording in read]) ** 2))
        for joint in scene.tree.joint_names
    }
    coefficients = {joint: float(VISCOUS / speed) for joint, speed in speeds.items()}
    return diagnose(scene, [_with_friction(recording, coefficients, 0.15) for recording in read]), coefficients


def test_friction_is_named_at_every_joint(diagnosed: tuple[Verdict, dict[str, float]]) -> None:
    verdict, coefficients = diagnosed
    assert verdict.kind == "unexplained", str(verdict)
    named = {found.effect.key: found for found in verdict.explanation}
    assert len(named) == 2 * len(coefficients), str(verdict)
    for joint, coefficient in coefficients.items():
        viscous = named["joint_viscous_friction", joint].values["coefficient"]
        assert viscous.std is not None
        assert abs(viscous.value - coefficient) < 4.0 * viscous.std + 0.02 * coefficient
        # beside a force that nobody knows, both directions may have a torque of their own
        laws = ("joint_coulomb_friction", "joint_asymmetric_coulomb_friction")
        (coulomb,) = (named[law, joint] for law in laws if (law, joint) in named)
        for torque in coulomb.values.values():
            if torque.unit == "N m":
                assert torque.std is not None
                assert abs(torque.value - COULOMB) < 4.0 * torque.std + 0.02 * COULOMB


def test_nothing_named_is_undetermined(diagnosed: tuple[Verdict, dict[str, float]]) -> None:
    """Each std is below a third of the bounds or of the largest strength in its unit; one is 3 std from none."""
    verdict, _ = diagnosed
    rivals = max((rival.probability for rival in verdict.rivals), default=0.0)
    for found in verdict.explanation:
        assert found.probability >= 0.5 and found.probability >= rivals
        sure = []
        for strength in found.effect.strengths:
            value = found.values[strength.name]
            assert value.std is not None
            width = strength.upper - strength.lower
            alike = [other for other in found.effect.strengths if other.unit == strength.unit]
            sizes = [max(abs(found.values[other.name].value), other.typical) for other in alike]
            assert value.std < (width if np.isfinite(width) else max(sizes)) / 3.0
            sure.append(abs(value.value - strength.nominal) >= 3.0 * value.std)
        assert any(sure)


def test_places_at_which_effects_are_weighed() -> None:
    def at(name: str, place: str) -> tuple[str, str]:
        effect = effect_named(name)(place)
        return place_of(effect), joint_of(effect)

    assert at("joint_coulomb_friction", "elbow") == ("elbow", "elbow")
    assert at("sensor_delay", "v.elbow") == ("v.elbow", "elbow")
    assert at("payload", "link3")[0] == at("gravity_misalignment", "world")[0] == ""
