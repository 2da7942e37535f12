"""Estimated noise of efforts whose std is not stated."""

from pathlib import Path

import pytest

from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.scene.scene import Scene
from tests import two_links

UNSTATED = "channels: {q: {std: 2.0e-4}, v: {std: 2.0e-3}}"
NOISE = (2e-4, 2e-3, 0.1)


def _scene(folder: Path) -> Scene:
    return two_links.scene(folder, UNSTATED, "")


def _prepared(folder: Path, noise: float, friction: float = 0.0, seed: int = 1) -> Prepared:
    runs = [
        two_links.recording(f"run_{k}", k, noise=(2e-4, 2e-3, noise), friction=(friction, 0.4 * friction))
        for k in (seed, seed + 1)
    ]
    prepared = prepare(_scene(folder), runs)
    assert isinstance(prepared, Prepared)
    return prepared


@pytest.mark.parametrize(("noise", "friction"), [(0.05, 0.0), (0.5, 0.0), (0.5, 1.0)])
def test_noise_is_estimated_whether_physics_is_missing_or_not(noise: float, friction: float, tmp_path: Path) -> None:
    std = _prepared(tmp_path, noise, friction).weak[0].samples.std
    assert [std["u.shoulder"], std["u.elbow"]] == pytest.approx([noise, noise], rel=0.3)


def test_exact_efforts_stay_all_but_exact(tmp_path: Path) -> None:
    """A friction of a few thousandths of the efforts leaves more than what is taken for noise."""
    std = _prepared(tmp_path, 0.0).weak[0].samples.std
    assert std["u.shoulder"] < 0.03 and std["u.elbow"] < 0.03


def _found(folder: Path, friction: tuple[float, float]) -> Verdict:
    runs = [two_links.recording(f"run_{k}", k, noise=NOISE, friction=friction) for k in (3, 4)]
    return diagnose(_scene(folder), runs)


def test_noise_alone_is_nothing_missing(tmp_path: Path) -> None:
    verdict = _found(tmp_path, (0.0, 0.0))
    assert verdict.kind == "none" and not verdict.noise_remarks
    [shoulder, elbow] = [note for note in verdict.notes if note.startswith("Noise of u.")]
    assert shoulder.startswith("Noise of u.shoulder: estimated 0.") and shoulder.endswith(" N m")
    assert elbow.startswith("Noise of u.elbow: estimated 0.")


def test_a_friction_under_the_noise_is_named(tmp_path: Path) -> None:
    """Of the size of the noise of one sample."""
    verdict = _found(tmp_path, (0.0, 0.1))
    assert verdict.kind == "explained" and not verdict.noise_remarks
    [found] = verdict.explanation
    assert (found.effect.name, found.effect.at) == ("joint_coulomb_friction", "elbow")
    torque = found.values["torque"]
    assert torque.value == pytest.approx(0.1, abs=4.0 * torque.std)


def test_physics_that_passed_for_noise_is_given_back(tmp_path: Path) -> None:
    """Friction of twenty times the noise: under the model as given about twice the noise is seen."""
    prepared = _prepared(tmp_path, 0.05, 1.0)
    effects = [JointCoulombFriction("shoulder", {"torque": 1.0, "slip_velocity": 0.005})]
    effects += [JointCoulombFriction("elbow", {"torque": 0.4, "slip_velocity": 0.005})]
    finer = prepared.with_noise_beside(Model(prepared.scene.priors.mean, tuple(effects)))
    assert finer is not None and finer.with_noise_beside(Model(prepared.scene.priors.mean, tuple(effects))) is None
    std = finer.weak[0].samples.std
    assert std["u.shoulder"] < 0.8 * prepared.effort_noise["u.shoulder"]
    # at the elbow most of a row's noise is the sensors', so its effort's is less well known
    assert std["u.shoulder"] == pytest.approx(0.05, rel=0.2) and std["u.elbow"] == pytest.approx(0.05, rel=0.5)
    assert sum(note.startswith("Noise of u.") for note in finer.notes) == 2


def test_an_estimate_says_what_noise_it_reckoned_with(tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path, UNSTATED)
    found = estimate(scene, [two_links.recording("run", 5, noise=NOISE)])
    assert "note: Noise of u.elbow: estimated 0." in str(found)
    [mass] = found.parameters
    assert mass.value == pytest.approx(1.0, abs=4.0 * mass.std) and mass.std < 0.01
