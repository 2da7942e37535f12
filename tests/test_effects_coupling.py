"""Elastic or loose coupling of rotor and link: the twist's motion against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from drake_cafim.effects.coupling import JointBacklash, JointCoupling, JointElasticity, RotorDrive
from drake_cafim.typing import Array

MOBILITY = 25.0


def drive(push: Array, step: float = 0.002) -> RotorDrive:
    return RotorDrive(np.arange(len(push)) * step, push, np.full(len(push), MOBILITY), 0.05)


@pytest.mark.parametrize("damping", [0.0, 0.3, 4.0, 40.0])
def test_elastic_step_response(damping: float) -> None:
    """A step of the push from rest in balance: the free oscillation about the new balance."""
    stiffness = 90.0
    push = np.where(np.arange(300) < 10, 0.0, 7.0)
    rate = JointElasticity("j", {"stiffness": stiffness, "damping": damping}).twist_rate(drive(push))
    t = np.arange(300) * 0.002 - 0.02
    decay, root = 0.5 * damping * MOBILITY, np.sqrt(complex((0.5 * damping * MOBILITY) ** 2 - stiffness * MOBILITY))
    expected = np.where(t > 0, (7.0 * np.exp(-decay * t) * np.sinh(root * t) / root).real, 0.0)
    assert np.allclose(rate, expected, atol=1e-10)


RINGING = {"stiffness": 90.0, "damping": 0.3}


@pytest.mark.parametrize("joint", [JointElasticity("j", RINGING), JointBacklash("j", {"gap": 0.01, **RINGING})])
def test_what_a_start_that_was_not_at_rest_adds(joint: JointCoupling) -> None:
    """A joint that is twisted and turning at the first sample rings out about its balance; so does one with a gap."""
    push, step = np.full(400, 5.0), 0.002
    by_start = joint.twist_rate_by_start(drive(push, step))
    balance, decay = 5.0 / (90.0 * MOBILITY), 0.5 * 0.3 * MOBILITY
    square = 90.0 * MOBILITY
    damped = np.sqrt(square - decay**2)
    t = step * np.arange(400)
    ring, turn = np.exp(-decay * t) * np.sin(damped * t) / damped, np.exp(-decay * t) * np.cos(damped * t)
    assert np.allclose(by_start[:, 0], -square * balance * ring, atol=1e-10)
    assert np.allclose(by_start[:, 1], np.sqrt(square) * balance * (turn - decay * ring), atol=1e-10)


def test_stiff_coupling_moves_with_the_torque() -> None:
    """Far below the resonance ψ = g/(k m): the rate is in proportion to the compliance."""
    t = np.arange(3000) * 0.002
    rates = [
        JointElasticity("j", {"stiffness": k, "damping": 1.4 * np.sqrt(k / MOBILITY)}).twist_rate(drive(np.sin(2 * t)))
        for k in (2e3, 4e3)
    ]
    for stiffness, rate in zip((2e3, 4e3), rates, strict=True):
        # a held push is late by half a step and the twist by the damping's share: both small against the period
        assert np.allclose(rate[500:], 2.0 * np.cos(2 * t[500:]) / (stiffness * MOBILITY), atol=0.03 * 2 / 5e4)


def test_a_gap_under_preload_is_a_spring() -> None:
    push = 20.0 + np.random.default_rng(0).normal(size=500)
    values = {"stiffness": 300.0, "damping": 0.4}
    loaded = JointBacklash("j", {"gap": 0.01, **values}).twist_rate(drive(push))
    assert np.allclose(loaded, JointElasticity("j", values).twist_rate(drive(push)), atol=1e-10)


def test_rotor_flies_freely_inside_the_gap() -> None:
    push = np.where(np.arange(60) < 5, 1e-9, -3.0)
    rate = JointBacklash("j", {"gap": 0.5, "stiffness": 1e3, "damping": 0.1}).twist_rate(drive(push))
    expected = np.where(np.arange(60) < 5, 0.0, -3.0 * 0.002 * (np.arange(60) - 5))
    assert np.allclose(rate, expected, atol=1e-5)


@pytest.mark.long
def test_gap_against_an_adaptive_integrator() -> None:
    gap, k, d = 0.004, 800.0, 2.0
    time = np.arange(1000) * 0.002
    push = 30.0 * np.sin(9.0 * time)

    def torque(twist: float, rate: float) -> float:
        if twist > gap / 2:
            return max(0.0, k * (twist - gap / 2) + d * rate)
        return min(0.0, k * (twist + gap / 2) + d * rate) if twist < -gap / 2 else 0.0

    state, rates = np.array([0.0, 0.0]), [0.0]
    for g in push[:-1]:

        def rate(t: float, x: Array, g: float = g) -> list[float]:
            return [x[1], g - MOBILITY * torque(x[0], x[1])]

        state = solve_ivp(rate, (0.0, 0.002), state, max_step=5e-5, rtol=1e-8, atol=1e-12).y[:, -1]
        rates.append(state[1])
    found = JointBacklash("j", {"gap": gap, "stiffness": k, "damping": d}).twist_rate(drive(push))
    reference = np.array(rates)
    # the start differs: in balance on a flank that nothing presses is anywhere in the gap
    assert np.sqrt(np.mean((found - reference)[200:] ** 2)) < 0.03 * np.sqrt(np.mean(reference**2))


def test_a_misfit_trial_stands_for_nothing() -> None:
    values = {"stiffness": 100.0, "damping": 1.0}
    assert JointElasticity("j").from_trial(values, -1.0) is None
    half_as_soft = JointElasticity("j").from_trial(values, 0.5)
    assert half_as_soft is not None and half_as_soft.values["stiffness"] == pytest.approx(200.0)
    assert JointBacklash("j").from_trial({"gap": 0.001, **values}, 0.1) is None
