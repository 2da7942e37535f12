"""What joints under position servos make of the steps of their commands, between the samples."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from drake_cafim.diagnosis.fit.fitting import fit, unbiased_fit
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.servo_effect import CommandDelay
from drake_cafim.effects.step_response import Answers, oscillator
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

KP, KV, PERIOD = 15.0, 1.0, 0.02


@pytest.mark.parametrize(
    ("stiffness", "damping"), [(0.0, 0.0), (0.0, 1e5), (2500.0, 100.0), (1e-3, 1e-9), (1.5e6, 1e5), (400.0, 3.0)]
)
def test_an_oscillator_goes_as_its_matrix_exponential(stiffness: float, damping: float) -> None:
    h = 0.02
    # ẍ = f + s t' − ω² x − λ ẋ with f and s as states that stay, t' = t − h/2 as one that grows
    A = np.array([[0, 1, 0, 0, 0], [-stiffness, -damping, 1, 0, 1], [0] * 5, [0] * 5, [0, 0, 0, 1, 0]], dtype=float)
    whole = expm(A * h)
    by_slope = whole[:2, 3] - 0.5 * h * whole[:2, 4]
    expected = [*whole[0, :2], *whole[1, :2], *whole[:2, 2], *by_slope]
    found = [float(part[0]) for part in oscillator(np.array([stiffness]), np.array([damping]), np.array([h]))]
    scale = [1.0, h, max(1.0, stiffness * h), 1.0, h**2, h, h**3, h**2]
    # series that end with their first term are wrong by ω² h²/12 of it, at most 1e-5/12
    np.testing.assert_allclose(np.array(found) / scale, np.array(expected) / scale, atol=1e-6)


def test_two_joints_answer_to_each_others_steps() -> None:
    M_inverse = np.array([[8.0, -12.0], [-12.0, 60.0]])
    k, d = np.array([40.0, 25.0]), np.array([1.5, 0.4])
    time = 0.01 * np.arange(12)
    steps = {
        0: Effort(np.array([0.0, 0.013, 0.05]), np.array([0.0, 2.0, -1.0])),
        1: Effort(time[[0, 3]], np.array([0.0, 1.0])),
    }
    ones = np.ones((len(time), 1))
    answers = Answers.of(time, M_inverse + 0.0 * time[:, None, None], (ones * k, ones * d), steps).responses

    def rate(t: float, state: Array) -> Array:
        effort = np.array([float(own.at(np.array([t]))[0]) for own in steps.values()]) - k * state[:2] - d * state[2:4]
        return np.concatenate([state[2:4], M_inverse @ effort, effort])

    state, integrals = np.zeros(6), [np.zeros(2)]
    for begin, end in pairwise(time):
        knots = [t for t in (begin, 0.013, 0.05, end) if begin <= t <= end]
        for a, b in pairwise(knots):
            if b - a > 1e-12:
                inside = (a + 1e-9 * (b - a), b - 1e-9 * (b - a))
                state = solve_ivp(rate, inside, state, rtol=1e-10, atol=1e-13).y[:, -1]
        integrals.append(state[4:].copy())
    for j, answer in answers.items():
        np.testing.assert_allclose(answer.integral, np.diff(np.array(integrals)[:, j]), atol=3e-5)
        # what is left of the whole staircase: 2 N m and 1 N m over 0.01 s are 0.02 and 0.01
        assert np.max(np.abs(answer.integral)) > 5e-3


def test_sweeps_that_diverge_leave_what_no_fit_takes() -> None:
    """Masses that a fit tries may be none: the joints' mobility is then not positive definite."""
    time = np.arange(0.0, 4.0, 0.02)
    mobility = np.array([[1e-3, 1e200], [1e200, 1e-3]]) + 0.0 * time[:, None, None]
    ones = np.ones((len(time), 2))
    steps = {j: Effort(time, np.sin(time + j)) for j in range(2)}
    answers = Answers.of(time, mobility, (30.0 * ones, ones), steps).responses
    assert not np.all(np.isfinite(answers[0].after))


@pytest.mark.long
@pytest.mark.parametrize("late", [0.0, 0.013])
@pytest.mark.parametrize("inertia", [1e-5, 1e-3, 5e-3, 0.1])
def test_servos_of_light_joints_are_known_at_coarse_steps(tmp_path: Path, inertia: float, late: float) -> None:
    """From joints that settle within a hundredth of a sampling step to those that take five, kp and kv are right.

    Of rows that took what a servo bends as linear in time, the mean square was up to 2e6 times the noise's variance
    (6.9e10 with a late command), and kp ended at zero.
    """
    scene = _turntable(tmp_path, inertia)
    problem = prepare(scene, [_driven(inertia, late)]).problem()
    model = problem.nominal().with_effects([CommandDelay("pan", {"delay": late})] if late else [])
    problem = problem.rewhitened(model)
    rows = problem.rows_of(model).reshape(-1, 2)
    assert np.all(np.mean(rows**2, axis=0) < 1.4)
    fitted = unbiased_fit(problem, model).model
    np.testing.assert_allclose(fitted.unknown, [KP, KV], rtol=0.02)
    if late:
        assert abs(fitted.effects[0].values["delay"] - late) < 0.01 * PERIOD


@pytest.mark.parametrize("inertia", [0.02, 0.1])
def test_a_fit_far_from_the_prior_ends_at_a_minimum(tmp_path: Path, inertia: float) -> None:
    """With the slopes at the prior it ended where χ² still fell by 8 per standard deviation."""
    scene = _turntable(tmp_path, inertia, (40.0, 0.4))
    problem = prepare(scene, [_driven(inertia, 0.0)]).problem()
    found = fit(problem, problem.nominal())

    def chi_square(i: int, change: float) -> float:
        beside = found.model.vector.copy()
        beside[i] += change
        return float(np.sum(problem.residual(found.model.at(beside)) ** 2))

    for i, std in enumerate(found.std):
        slope = (chi_square(i, 0.1 * std) - chi_square(i, -0.1 * std)) / 0.2
        assert abs(slope) < 0.3


def _turntable(folder: Path, inertia: float, guessed: tuple[float, float] = (KP, KV)) -> Scene:
    """One upright axis under a servo, whose stiffness and damping are known to half of those that are guessed."""
    kp, kv = guessed
    (folder / "pan.urdf").write_text(
        '<robot name="pan"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/><mass value="0.5"/>'
        f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="pan" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>'
        "</robot>"
    )
    (folder / "pan.yaml").write_text(
        "model: pan.urdf\nweld: [{body: base}]\nchannels: {q: {std: 1.0e-4}, v: {std: 1.0e-3}}\n"
        f"servo: {{kp: {kp}, kv: {kv}}}\n"
        f"unknown: [{{parameter: servo_stiffness, joint: pan, std: {kp / 2}}},"
        f" {{parameter: servo_damping, joint: pan, std: {kv / 2}}}]\n"
    )
    return Scene.load(folder / "pan.yaml")


def _driven(inertia: float, late: float, seed: int = 1, samples: int = 500) -> Recording:
    """A recording of the axis, exact but for the noise of its samples."""
    random, parts = np.random.default_rng(seed), 200
    time = PERIOD * np.arange(samples)
    rates, phases = 2.0 * np.pi * random.uniform(0.2, 1.2, 4), random.uniform(0.0, 6.0, 4)
    command = 0.25 * np.sum(np.sin(rates * time[:, None] + phases), axis=1)
    A = np.array([[0.0, 1.0], [-KP / inertia, -KV / inertia]])
    step, behind = expm(A * PERIOD / parts), round(late / PERIOD * parts)
    state, read = np.array([command[0], 0.0]), []
    for k in range(samples):
        read.append(state)
        for i in range(parts):
            goal = np.array([command[max(0, (k * parts + i - behind) // parts)], 0.0])
            state = goal + step @ (state - goal)
    q, v = np.array(read).T
    return Recording(
        "pan",
        time,
        {
            "q.pan": q + 1e-4 * random.normal(size=samples),
            "v.pan": v + 1e-3 * random.normal(size=samples),
            "cmd.pan": command,
        },
    )
