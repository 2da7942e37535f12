"""Contacts in the diagnosis: where a mismatch shows, noise through internal states, names, simulations."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.location import locate
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.predict.forecast import forecasts, root_mean_square
from drake_cafim.diagnosis.predict.innovations import innovations
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search.search import search
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.concealed_case import written


@dataclass(frozen=True)
class Known:
    """A case of the press whose truth is known."""

    prepared: Prepared
    truth: dict[str, Any]

    @property
    def model(self) -> Model:
        """The true model."""
        [effect] = self.truth["effects"]
        values = {name: value for name, (value, _) in effect["parameters"].items()}
        numbers = self.truth["nominal_parameters_true"]
        unknown = [numbers[parameter.parameter] for parameter in self.prepared.scene.unknown]
        return Model(np.array(unknown), (effect_named(effect["effect"])(effect["at"], values),))


def known(kind: str, seed: int, folder: Path, files: tuple[str, ...] = ("train_1", "train_2", "train_3")) -> Known:
    case = simulate(kind, "press", seed)
    case.write(folder)
    scene = Scene.load(folder / "scenario.yaml")
    return Known(prepare(scene, [recordings.read(folder / f"{name}.parquet") for name in files]), case.truth)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "seed", "place"),
    [
        ("odd:odd_patchy_friction", 308, ("contact", "tool/wall")),
        ("single:sensor_bias", 311, ("sensor", "wrench.wrist.fz")),
    ],
)
def test_a_wrong_contact_is_told_from_a_wrong_sensor(
    kind: str, seed: int, place: tuple[str, str], tmp_path: Path
) -> None:
    prepared = known(kind, seed, tmp_path, ("train_1",)).prepared
    problem = WeakProblem.of(prepared.scene, prepared.weak, Model(prepared.scene.priors.mean))
    nominal = unbiased_fit(problem, problem.nominal()).model
    first = locate(problem, nominal)[0]
    assert (first.kind, first.name) == place


@pytest.mark.long
@pytest.mark.parametrize("effect", ["contact_presliding", "contact_viscoelastic_relaxation"])
def test_the_truth_leaves_noise_and_simulations_follow_it(effect: str, tmp_path: Path) -> None:
    case = known(f"single:{effect}", 203, tmp_path, ("held_1",))
    [weak] = case.prepared.weak
    problem = WeakProblem.of(case.prepared.scene, [weak], case.model)
    rows = problem.residual(case.model)[: problem.rows]
    assert float(np.mean(rows**2)) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(rows)))
    physics = case.model.physics(case.prepared.scene)
    std = weak.samples.std
    error = root_mean_square(forecasts([weak], physics))
    assert all(error[name] < 1.25 * std[name] for name in error if name.startswith("wrench."))
    least = sum(0.5 * np.log(2.0 * np.pi * std[name] ** 2) + 0.5 for name in std if name[0] in "qvw")
    assert innovations([weak], physics)[0].mean < least + 0.5


@pytest.mark.long
def test_how_high_a_surface_stands_is_found_where_touches_begin_and_end(tmp_path: Path) -> None:
    """A touch that a step of the height makes or ends jumps; over too small a step that looked like a slope."""
    case = known("single:surface_offset", 0x9BC22A302FC0E3C26B3DA783D875D7FC, tmp_path)
    problem = WeakProblem.of(case.prepared.scene, case.prepared.weak, case.model)
    fitted = unbiased_fit(problem, case.model)
    std = float(np.sqrt(fitted.covariance[-1, -1]))
    [truth], [found] = case.model.effects, fitted.model.effects
    assert std < 2e-6
    assert found.values["offset"] == pytest.approx(truth.values["offset"], abs=4.0 * std)


@pytest.mark.long
@pytest.mark.parametrize("effect", ["contact_adhesion", "contact_presliding", "surface_tilt"])
def test_named_and_measured(effect: str, tmp_path: Path) -> None:
    case = known(f"single:{effect}", 203, tmp_path, ("train_1",))
    scene = case.prepared.scene
    best = search(WeakProblem.of(scene, case.prepared.weak, Model(scene.priors.mean)), Settings()).best
    [truth] = case.truth["effects"]
    assert [effect.key for effect in best.model.effects] == [(truth["effect"], truth["at"])]
    [found] = best.model.effects
    first = next(iter(truth["parameters"]))
    assert found.values[first] == pytest.approx(truth["parameters"][first][0], rel=0.05)


@pytest.mark.long
def test_the_gain_of_a_quiet_wrench_is_looked_for(tmp_path: Path) -> None:
    """Friction is felt with an eighth of it as noise; the gain scales what is predicted, and no noise."""
    scene, read = written(simulate("pair", "press", 0xAE53DDB31F5426298249DE33E22B8BD3), tmp_path)
    verdict = diagnose(scene, read[:2])
    assert verdict.kind == "explained", str(verdict)
    assert {accepted.effect.key for accepted in verdict.explanation} == {
        ("actuator_bias", "px"),
        ("sensor_gain_error", "wrench.wrist.fx"),
    }
