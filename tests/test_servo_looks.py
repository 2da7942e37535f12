"""Bounds of the profile that a servo follows are found where only values within a percent show what they explain."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.output_error.starts import _of_law
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint_samples import JointSamples
from tests.concealed.make import make
from tests.concealed_case import written


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "seed", "parameter"),
    [
        ("command_rate_limit", 906, "rate"),
        ("command_acceleration_limit", 931, "acceleration"),
        ("command_rate_limit", 0x3F6C07E6CE6B46C9A6F5F622C63E0C34, "rate"),  # slower than the command ever is
    ],
)
def test_the_bound_is_the_true_one(effect: str, seed: int, parameter: str, tmp_path: Path) -> None:
    case = make(f"single:{effect}", f"served{2 + seed % 2}", seed)
    scene, train = written(case, tmp_path)
    problem = prepare(scene, train).problem()
    (true,) = case.truth["effects"]  # type: ignore[attr-defined]
    nominal = fit(problem, problem.nominal())
    own = [tried for tried in problem.hypotheses() if tried.key == (effect, true["at"])]
    (found,) = screen(problem, nominal, own)
    assert found.effect.values[parameter] == pytest.approx(true["parameters"][parameter][0], rel=2e-3)
    assert found.gain > 0.99 * nominal.chi_square


@pytest.mark.long
def test_a_motors_envelope_is_fitted_from_its_first_order_start(tmp_path: Path) -> None:
    """Efforts that jump between few levels have no quantile near the stall torque."""
    case = make("single:actuator_speed_limit", "served2", 0x58CC2F18066F6F4AF440F7165A2BB646)
    scene, train = written(case, tmp_path)
    problem = prepare(scene, train).problem()
    (true,) = case.truth["effects"]  # type: ignore[attr-defined]
    nominal = fit(problem, problem.nominal())
    own = [tried for tried in problem.hypotheses() if tried.key == ("actuator_speed_limit", true["at"])]
    (started,) = screen(problem, nominal, own)
    found = fit(problem, nominal.model.with_effects([started.effect]))
    assert found.chi_square < problem.rows
    assert found.model.effects[0].values["stall_torque"] == pytest.approx(
        true["parameters"]["stall_torque"][0], rel=0.05
    )


def test_by_simulation_an_envelope_begins_whole() -> None:
    """A share of it is no law: what its start gives is simulated as it is, and not divided by a size."""
    time = 0.01 * np.arange(400)
    joint = JointSamples(
        np.sin(3.0 * time), 3.0 * np.cos(3.0 * time), 4.0 * np.sign(np.sin(7.0 * time)), load=0.0 * time
    )
    begun = list(_of_law(effect_named("actuator_speed_limit")("j"), joint, 4.0, 0.005))
    assert begun
    for start in begun:
        assert start.sizes == (1.0,) and start.parts[0].values["stall_torque"] < 4.0 / (1.0 - 1.0 / 1.05)
        assert start.law(np.array([3.0])).values == start.parts[0].values
