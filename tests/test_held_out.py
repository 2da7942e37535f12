"""Likelihoods and simulations of the physics that made a recording: the residual is its noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.forecast import forecasts, root_mean_square
from drake_cafim.diagnosis.predict.innovations import innovations
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.parametrize import long_after


def _held_out(kind: str, rig: str, seed: int, folder: Path) -> tuple[Scene, WeakForm, Model]:
    """A recording, and the model that made it."""
    case = simulate(kind, rig, seed)
    case.write(folder)
    prepared = prepare(Scene.load(folder / "scenario.yaml"), [recordings.read(folder / "held_1.parquet")])
    scene, [weak] = prepared.scene, prepared.weak
    numbers = case.truth["nominal_parameters_true"]
    unknown = [
        numbers.get(f"{parameter.parameter}.{parameter.at}", numbers.get(parameter.parameter))
        for parameter in scene.unknown
    ]
    effects = [
        effect_named(stated["effect"])(stated["at"], {name: value for name, (value, _) in stated["parameters"].items()})
        for stated in case.truth["effects"]
    ]
    return scene, weak, Model(np.array(unknown), tuple(effects))


def _least(weak: WeakForm) -> float:
    """What noise alone leaves of a sample, however well the state is known."""
    return sum(0.5 * np.log(2.0 * np.pi * std**2) + 0.5 for name, std in weak.samples.std.items() if name[0] != "u")


# a joint so soft that it rings from the start, a gap, and a lag that passes much of each step on within a sample
@pytest.mark.parametrize(
    ("kind", "seed"),
    long_after(2, [("joint_elasticity", 0), ("joint_elasticity", 3), ("actuator_lag", 3), ("joint_backlash", 5)]),
)
def test_true_physics_leaves_noise(kind: str, seed: int, tmp_path: Path) -> None:
    scene, weak, true = _held_out(f"single:{kind}", "arm2", seed, tmp_path)
    nominal = Model(true.unknown)
    with_it, without = (innovations([weak], model.physics(scene))[0].mean for model in (true, nominal))
    assert with_it < _least(weak) + 0.3
    assert without > with_it + 4.0
    errors = [root_mean_square(forecasts([weak], model.physics(scene))) for model in (true, nominal)]
    worst = max(errors[1], key=lambda name: errors[1][name] / weak.samples.std[name])
    assert errors[0][worst] < errors[1][worst]


def test_a_mass_that_is_hardly_known_does_not_count_against_a_model(tmp_path: Path) -> None:
    scene, weak, true = _held_out("null", "arm2", 1, tmp_path)
    wrong = replace(true, unknown=1.02 * true.unknown)
    physics, doubt = wrong.physics(scene), replace(true, unknown=1.04 * true.unknown).physics(scene)
    sure, unsure = innovations([weak], physics)[0].mean, innovations([weak], physics, [doubt])[0].mean
    assert unsure < _least(weak) + 0.5
    assert sure > unsure + 1.0


def test_wrenches_count(tmp_path: Path) -> None:
    scene, weak, true = _held_out("single:sensor_bias", "press", 311, tmp_path)
    with_it, without = (innovations([weak], model.physics(scene))[0].mean for model in (true, Model(true.unknown)))
    assert with_it < _least(weak) + 0.5
    assert without > with_it + 1.0
