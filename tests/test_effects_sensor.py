"""Sensor effects: the distorted signal against its closed form, the inverse, and the derivatives by the strengths."""

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drake_cafim.effects.sensor import SensorBias, SensorDrift, SensorEffect, SensorGainError, SensorMisalignment
from drake_cafim.effects.timing import ClockSkew, SensorDelay, SensorLag, TimingEffect, interpolation
from drake_cafim.typing import Array

TIME = np.sort(np.arange(1500) * 0.002 + np.random.default_rng(2).uniform(0, 5e-4, 1500))
INSIDE = slice(50, -50)
ONE = [
    (SensorBias("q.a"), {"bias": 0.3}),
    (SensorGainError("q.a"), {"gain": 1.1}),
    (SensorDrift("q.a"), {"rate": 0.02}),
    (SensorDelay("q.a"), {"delay": 0.0053}),
    (SensorLag("q.a"), {"time_constant": 0.0047}),
    (ClockSkew("q.a"), {"skew": -0.004}),
]


def signal(t: Array) -> Array:
    return np.stack([np.sin(3 * t) + 0.4 * np.cos(11 * t), 0.7 * np.cos(5 * t)], axis=1)


def closed_form(effect: SensorEffect, t: Array) -> Array:
    p = effect.values
    match effect.name:
        case "sensor_bias":
            return signal(t) + p["bias"]
        case "sensor_gain_error":
            return p["gain"] * signal(t)
        case "sensor_drift":
            return signal(t) + p["rate"] * t[:, None]
        case "sensor_delay":
            return signal(t - p["delay"])
        case "clock_skew":
            return signal(t * (1 + p["skew"]))
    raise AssertionError(effect.name)


@pytest.mark.parametrize(("effect", "values"), [pair for pair in ONE if pair[0].name != "sensor_lag"])
def test_written(effect: SensorEffect, values: Mapping[str, float]) -> None:
    effect = effect.with_values(values)
    assert np.allclose(effect.measured(TIME, signal(TIME))[INSIDE], closed_form(effect, TIME)[INSIDE], atol=1e-9)


def test_lag_of_a_sine_is_smaller_and_late() -> None:
    tau, omega = 0.004, 20.0
    written = SensorLag("q.a", {"time_constant": tau}).measured(TIME, np.sin(omega * TIME)[:, None])[:, 0]
    expected = np.sin(omega * TIME - np.arctan(omega * tau)) / np.hypot(1, omega * tau)
    # straight between samples is a sine but for (ω h)²/12
    assert np.allclose(written[100:], expected[100:], atol=3e-4)


@pytest.mark.parametrize(("effect", "values"), ONE)
def test_truth_comes_back(effect: SensorEffect, values: Mapping[str, float]) -> None:
    effect = effect.with_values(values)
    truth = effect.true(TIME, effect.measured(TIME, signal(TIME)))
    atol = 2e-4 if effect.name == "sensor_lag" else 1e-9
    assert np.allclose(truth[INSIDE], signal(TIME)[INSIDE], atol=atol)


@pytest.mark.parametrize(("effect", "values"), ONE)
def test_columns_are_slopes(effect: SensorEffect, values: Mapping[str, float]) -> None:
    [strength] = effect.strengths
    step = 1e-3 * strength.typical
    low = strength.nominal if strength.lower == strength.nominal else strength.nominal - step
    high = strength.nominal + step
    # a delay and a lag have one side only
    by_difference = (
        effect.with_values([high]).measured(TIME, signal(TIME)) - effect.with_values([low]).measured(TIME, signal(TIME))
    ) / (high - low)
    column = effect.columns(TIME, signal(TIME))[..., 0]
    tolerance = 0.02 * np.abs(column).max()
    assert np.allclose(column[INSIDE], by_difference[INSIDE], atol=tolerance)


def test_misalignment_turns_force_and_torque() -> None:
    wrench = np.random.default_rng(1).normal(size=(7, 6))
    effect = SensorMisalignment("wrench.wrist", {"roll": 0.2, "pitch": -0.3, "yaw": 0.5})
    R = (Rotation.from_euler("x", 0.2) * Rotation.from_euler("y", -0.3) * Rotation.from_euler("z", 0.5)).as_matrix()
    written = effect.measured(TIME[:7], wrench)
    assert np.allclose(written[:, :3], np.stack([R.T @ f for f in wrench[:, :3]]))
    assert np.allclose(written[:, 3:], np.stack([R.T @ f for f in wrench[:, 3:]]))
    assert np.allclose(effect.true(TIME[:7], written), wrench)
    columns = effect.columns(TIME[:7], wrench)
    for k in range(3):
        small = np.zeros(3)
        small[k] = 1e-6
        ahead = effect.with_values(small).measured(TIME[:7], wrench)
        behind = effect.with_values(-small).measured(TIME[:7], wrench)
        assert np.allclose(columns[..., k], (ahead - behind) / 2e-6, atol=1e-8)


def test_interpolation_and_its_slope_on_an_uneven_grid() -> None:
    at = np.linspace(0.05, 2.9, 777)
    assert np.allclose(interpolation(TIME, at) @ signal(TIME), signal(at), atol=1e-10)
    slope = 3 * np.cos(3 * at) - 4.4 * np.sin(11 * at)
    assert np.allclose((interpolation(TIME, at, derivative=1) @ signal(TIME))[:, 0], slope, atol=1e-6)


def test_interpolation_moves_noise_and_does_not_smooth_it() -> None:
    """Under a smooth weight the noise keeps its size: a delay cannot explain noise away."""
    time = np.arange(3000) * 0.002
    noise = np.random.default_rng(0).normal(size=(3000, 200))
    moved = interpolation(time, time + 0.0011) @ noise
    weight = np.sin(np.pi * np.arange(30) / 30) ** 4
    sizes = [np.std([weight @ signal[k : k + 30] for k in range(100, 2900, 60)]) for signal in (noise, moved)]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.02)


def test_sites() -> None:
    columns = [*(f"{kind}.{joint}" for kind in "qvu" for joint in "ab"), *(f"wrench.w.{a}" for a in ("fx", "tz"))]
    assert list(SensorBias.sites(columns)) == ["q.a", "q.b", "v.a", "v.b", "wrench.w.fx", "wrench.w.tz"]
    assert list(SensorDelay.sites(columns)) == ["q.a", "q.b", "v.a", "v.b", "wrench.w"]
    assert list(SensorMisalignment.sites(columns)) == ["wrench.w"]
    assert SensorDelay("wrench.w").channels(columns) == ("wrench.w.fx", "wrench.w.tz")
    assert SensorBias("q.a").channels([*columns, "q.ab"]) == ("q.a",)


@pytest.mark.parametrize(
    "effect",
    [
        SensorLag("q.elbow", {"time_constant": 0.01}),
        SensorDelay("q.elbow", {"delay": 0.007}),
        ClockSkew("q.elbow", {"skew": 0.01}),
    ],
    ids=lambda effect: effect.name,
)
def test_writing_is_the_matrix_of_measured(effect: TimingEffect) -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(0.001, 0.003, 400))
    true = np.sin(20.0 * time)[:, None]
    np.testing.assert_allclose(effect.filter_matrix(time) @ true, effect.measured(time, true), atol=5e-4)


def test_no_position_is_off_by_more_than_half_a_turn() -> None:
    assert SensorBias("q.a", {"bias": -3.1}).plausible()
    assert not SensorBias("q.a", {"bias": -7.1}).plausible()
    assert SensorBias("wrench.tip", {"bias": -7.1}).plausible()
