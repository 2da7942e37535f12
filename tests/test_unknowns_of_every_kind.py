"""`unknown:` of each effect's numbers, for a joint with a contact and in a throw: a result, or one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from drake_cafim.diagnosis.diagnose import Estimate, estimate
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.parametrize import long_after
from tests.test_unknown_effects import GROUND, SLIDER, pressed
from tests.tosses import SCENARIO, thrown, thrown_scene

PRESSED = {
    "model": "slider.urdf",
    "weld": [{"body": "base"}],
    "channels": {"q": {"std": 1e-5}, "v": {"std": 1e-3}, "u": {"std": 0.0}},
    "contact": [GROUND | {"damping": 60.0}],
}
JOINT_PLACES = {
    Place.JOINT: "slide", Place.ACTUATOR: "slide", Place.BODY: "ball", Place.WORLD: "world",
    Place.CONTACT: "ball/ground", Place.CHANNEL: "q.slide",
}  # fmt: skip
THROW_PLACES = {Place.BODY: "body", Place.WORLD: "world", Place.CONTACT: "body/ground", Place.CHANNEL: "pose.body.z"}
REFUSED = {
    "sensor_misalignment": "expected a whole wrench sensor",
    "external_disturbance": "expected `interval",
}
"""Effects that are no unknown here, and what the sentence expects."""
ONE_AT_A_TIME = {"inertial_error"}
"""Effects whose numbers are impossible together at their usual sizes: moments of inertia no larger than products."""


def _place(effect: type[Effect], places: dict[Place, str]) -> str | None:
    return "ground" if effect.name.startswith("surface") else places.get(effect.place)


def _estimate(folder: Path, raw: dict[str, Any], effect: type[Effect], at: str, run: Recording) -> Estimate:
    """With the effect at its usual size, and its first number unknown."""
    values = {strength.name: strength.nominal or strength.typical for strength in effect.strengths}
    first = effect.strengths[0]
    if effect.name in ONE_AT_A_TIME:
        values = {strength.name: strength.nominal for strength in effect.strengths} | {first.name: first.typical}
    unknown = {"effect": effect.name, "at": at, "parameter": first.name, "std": abs(first.typical)}
    text = yaml.dump(raw | {"effects": [{"effect": effect.name, "at": at, **values}], "unknown": [unknown]})
    (folder / "scenario.yaml").write_text(text)
    return estimate(Scene.load(folder / "scenario.yaml"), [run])


def _check(folder: Path, raw: dict[str, Any], effect: type[Effect], at: str, run: Recording) -> None:
    if effect.name in REFUSED:
        with pytest.raises(InputError, match=REFUSED[effect.name]):
            _estimate(folder, raw, effect, at, run)
        return
    (found,) = _estimate(folder, raw, effect, at, run).parameters
    assert np.isfinite(found.value) and 0.0 < found.std <= found.prior_std * (1.0 + 1e-6)


@pytest.mark.parametrize("effect", long_after(12, EFFECTS), ids=lambda effect: effect.name)
def test_of_a_joint_or_its_contact(effect: type[Effect], tmp_path: Path) -> None:
    (tmp_path / "slider.urdf").write_text(SLIDER)
    at = _place(effect, JOINT_PLACES)
    assert at is not None
    _check(tmp_path, PRESSED, effect, at, pressed(0.0).window(0.0, 0.8))


@pytest.mark.parametrize(
    "effect",
    long_after(5, [effect for effect in EFFECTS if _place(effect, THROW_PLACES)]),
    ids=lambda effect: effect.name,
)
def test_in_a_throw(effect: type[Effect], tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    (run,) = thrown(scene.physics, 3, count=1)
    at = _place(effect, THROW_PLACES)
    assert at is not None
    _check(tmp_path, yaml.safe_load(SCENARIO), effect, at, run.window(0.0, 0.45))
