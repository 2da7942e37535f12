"""Held-out recordings are compared and used for nothing else, for jointed robots and for thrown bodies."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.forecast import Forecast, counted_together, root_mean_square
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.test_report_html import PENDULUM, recorded
from tests.tosses import SCENARIO, thrown, thrown_scene


def _scene(kind: str, folder: Path, stated: bool) -> Scene:
    if kind == "throw":
        std = "channels: {pose.body: {std: {position: 2.0e-4, rotation: 2.0e-3}}}\n"
        assert std in SCENARIO
        return thrown_scene(folder, scenario=SCENARIO if stated else SCENARIO.replace(std, ""))
    (folder / "pendulum.urdf").write_text(PENDULUM)
    channels = {"q": 1e-4, "v": 1e-3, "u": 0.0} if stated else {"u": 0.0}
    return Scene.from_model(folder / "pendulum.urdf", channels=channels, weld=["base"])


def _recordings(kind: str, scene: Scene) -> tuple[Recording, Recording]:
    """Two that differ in more than their noise."""
    if kind == "throw":
        first, second = thrown(scene.physics, 3, count=2)
        return first, second
    grease: list[list[Effect]] = [[JointViscousFriction("hinge", {"coefficient": value})] for value in (0.2, 0.4)]
    return recorded(scene, grease[0], "a", 1), recorded(scene, grease[1], "b", 2)


def _louder(recording: Recording) -> Recording:
    """The recording with ten times the noise."""
    rng, names = np.random.default_rng(7), [name for name in recording.columns if name[0] != "u"]
    louder = {name: recording.columns[name] + 0.01 * rng.normal(size=len(recording.time)) for name in names}
    return Recording("louder", recording.time, dict(recording.columns) | louder)


@pytest.mark.parametrize("kind", ["pendulum", "throw"])
def test_each_group_has_the_figures_of_its_own_recordings(kind: str, tmp_path: Path) -> None:
    scene = _scene(kind, tmp_path, stated=True)
    train, held = _recordings(kind, scene)
    model, doubt = Model(scene.priors.mean), np.diag(scene.priors.std**2)
    [both] = prepare(scene, [train], [held]).qualities([(model, doubt)])
    alone = [prepare(scene, [recording]).qualities([(model, doubt)])[0][0] for recording in (train, held)]
    for found, own in zip(both, alone, strict=True):
        assert found.nll == pytest.approx(own.nll, rel=1e-9)
        assert found.rmse == pytest.approx(own.rmse, rel=1e-9)
    assert both[0].nll != pytest.approx(both[1].nll, rel=1e-6)


@pytest.mark.parametrize("kind", ["pendulum", "throw"])
def test_nothing_is_read_or_fitted_of_what_is_held_out(kind: str, tmp_path: Path) -> None:
    """Not even the noise, where it is not stated: the same rows to the last bit, whatever is held out."""
    scene = _scene(kind, tmp_path, stated=False)
    train, held = _recordings(kind, scene)
    model = Model(scene.priors.mean)
    alone, beside = prepare(scene, [train]), prepare(scene, [train], [_louder(held)])
    np.testing.assert_array_equal(beside.problem().residual(model), alone.problem().residual(model))
    assert beside.mistakes == alone.mistakes and beside.noise_remarks == alone.noise_remarks


def test_models_are_compared_over_the_samples_before_any_of_them_diverges() -> None:
    """An error that grows with time would be the larger the longer a model holds."""
    errors, window = np.array([0.0, 1.0, 2.0, 3.0, 0.0, 1.0]), np.array([0, 0, 0, 0, 1, 1])

    def simulated(growth: float, first_lost: int) -> Forecast:
        lost = (np.arange(6) >= first_lost) & (window == 0)
        measured = {"q.elbow": np.zeros(6)}
        return Forecast("run", np.arange(6.0), window, {"q.elbow": growth * errors}, measured, lost)

    poor, good = simulated(2.0, 2), simulated(1.0, 4)
    together = [root_mean_square(own)["q.elbow"] for own in counted_together([[poor], [good], [good]])]
    assert together == pytest.approx([2.0 * np.sqrt(0.5), np.sqrt(0.5), np.sqrt(0.5)])
    whole = replace(good, lost=None)
    assert counted_together([[whole], [whole]])[1][0] is whole
    assert counted_together([]) == []
