"""Actuator effects on an effort, each against its closed form."""

import numpy as np
import pytest

from drake_cafim.effects.actuator import (
    ActuatorBias,
    ActuatorDeadZone,
    ActuatorDelay,
    ActuatorGainError,
    ActuatorLag,
    ActuatorSaturation,
    Effort,
)
from drake_cafim.typing import Array


@pytest.fixture
def effort() -> Effort:
    rng = np.random.default_rng(1)
    return Effort(np.arange(200) * 0.002, rng.normal(size=200))


def at(effort: Effort, times: Array) -> Array:
    return effort.values[np.clip(np.searchsorted(effort.times, times, side="right") - 1, 0, None)]


def test_static_laws(effort: Effort) -> None:
    u = effort.values
    assert np.allclose(ActuatorGainError("j", {"gain": 0.9}).drive(effort).values, 0.9 * u)
    assert np.allclose(ActuatorBias("j", {"torque": 0.2}).drive(effort).values, u + 0.2)
    assert np.allclose(ActuatorSaturation("j", {"limit": 0.7}).drive(effort).values, np.clip(u, -0.7, 0.7))
    expected = np.where(np.abs(u) < 0.3, 0.0, u - 0.3 * np.sign(u))
    assert np.allclose(ActuatorDeadZone("j", {"width": 0.3}).drive(effort).values, expected)


def test_delay_acts_late(effort: Effort) -> None:
    late = ActuatorDelay("j", {"delay": 0.0071}).drive(effort)
    times = np.linspace(0.0, 0.39, 1000) + 1.234e-5
    assert np.array_equal(at(late, times), at(effort, times - 0.0071))


def test_delay_and_gain_commute(effort: Effort) -> None:
    delay, gain = ActuatorDelay("j", {"delay": 0.003}), ActuatorGainError("j", {"gain": 1.3})
    assert np.allclose(delay.drive(gain.drive(effort)).values, gain.drive(delay.drive(effort)).values)


@pytest.mark.parametrize("tau", [2e-4, 0.005, 0.05])
def test_lag_has_the_exponential_as_mean(effort: Effort, tau: float) -> None:
    slow = ActuatorLag("j", {"time_constant": tau}).drive(effort)
    parts = len(slow.values) // len(effort.values)
    each = 500
    step = 0.002 / parts / each
    y = effort.values[0]
    for k, mean in enumerate(slow.values[: 20 * parts]):
        u = effort.values[k // parts]
        held = u + (y - u) * np.exp(-step * (np.arange(each) + 0.5) / tau)
        assert mean == pytest.approx(float(np.mean(held)), abs=1e-6)
        y = u + (y - u) * np.exp(-step * each / tau)


def test_lag_starts_settled_and_ends_at_the_effort() -> None:
    held = Effort(np.arange(100) * 0.002, np.where(np.arange(100) < 50, 1.0, 3.0))
    slow = ActuatorLag("j", {"time_constant": 0.004}).drive(held)
    assert np.allclose(at(slow, np.array([0.0, 0.05, 0.0999])), 1.0)
    assert at(slow, np.array([0.19]))[0] == pytest.approx(3.0, abs=1e-8)


@pytest.mark.parametrize(
    ("effect", "values", "coefficient"),
    [
        (ActuatorDelay, {"delay": 0.004}, 0.004),
        (ActuatorLag, {"time_constant": 0.004}, 0.004),
        (ActuatorDeadZone, {"width": 0.1}, 0.1),
    ],
)
def test_a_look_leads_back_to_the_strength(
    effort: Effort, effect: type[ActuatorDelay], values: dict[str, float], coefficient: float
) -> None:
    looks = list(effect("j").looks(effort.values))
    nearest = min(looks, key=lambda look: abs(look[0].size - coefficient))
    found = effect("j").from_look(nearest, np.array([coefficient]))
    assert found is not None and found.values == pytest.approx(values)


def test_saturation_starts_only_where_all_of_the_excess_is_missing(effort: Effort) -> None:
    effect = ActuatorSaturation("j")
    look = next(iter(effect.looks(effort.values)))
    assert effect.from_look(look, np.array([1.0])) is not None
    assert effect.from_look(look, np.array([0.05])) is None
    assert effect.from_look(look, np.array([-1.0])) is None
