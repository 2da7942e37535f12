"""How much errors of simulations tell: independent errors, fine steps, the scale of efforts, shapes that stick."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from drake_cafim.diagnosis.output_error import scale
from drake_cafim.diagnosis.output_error.errors import FINE_STEP, FINEST_STEP, OutputErrors
from drake_cafim.diagnosis.output_error.likelihood import ErrorLikelihood, independent_errors
from drake_cafim.diagnosis.output_error.problem import NormalEquations, OutputErrorProblem
from drake_cafim.diagnosis.output_error.scale import profile_scale
from drake_cafim.diagnosis.output_error.shapes import STICKING, fit_shapes
from drake_cafim.effects.joint import SLIP_VELOCITY, JointCoulombFriction, JointViscousFriction
from drake_cafim.effects.servo import Servo, drive_servos
from drake_cafim.typing import Array

WINDOWS, SAMPLES = 60, 100


def _windows(courses: Array) -> tuple[Array, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    return courses.ravel(), np.repeat(np.arange(len(courses)), courses.shape[1])


@pytest.mark.parametrize("freedom", [1, 3, 8])
def test_errors_count_as_often_as_they_vary_independently(freedom: int) -> None:
    """Windows of random combinations of orthogonal courses: as many independent errors in each as courses."""
    random = np.random.default_rng(freedom)
    phase = np.pi * np.arange(SAMPLES) / (SAMPLES - 1)
    courses = random.normal(size=(WINDOWS, freedom)) @ np.cos(np.arange(1, freedom + 1)[:, None] * phase)
    found = independent_errors(*_windows(courses))
    assert found == pytest.approx(WINDOWS * freedom, rel=0.25) and found <= WINDOWS * freedom * 1.1


def test_the_variance_of_a_sum_of_squares_is_that_of_so_many_errors() -> None:
    """Over many draws of an autoregressive noise, the mean square scatters by √(2/N) of its mean."""
    random, squares, counted = np.random.default_rng(3), [], []
    for _ in range(300):
        white, noise = random.normal(size=(20, SAMPLES)), np.zeros((20, SAMPLES))
        for k in range(1, SAMPLES):
            noise[:, k] = 0.9 * noise[:, k - 1] + white[:, k]
        squares.append(np.mean(noise**2))
        counted.append(independent_errors(*_windows(noise)))
    expected = 2.0 * np.mean(squares) ** 2 / np.var(squares)
    assert np.mean(counted) == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_errors_of_few_windows_count(count: int) -> None:
    courses = np.random.default_rng(4).normal(size=(count, SAMPLES))
    assert 1.0 <= independent_errors(*_windows(courses)) <= max(1, count) * 64.0
    assert independent_errors(*_windows(0.0 * courses)) == 1.0


def test_the_weight_of_an_error_is_the_slope_of_the_likelihood() -> None:
    errors = np.random.default_rng(8).normal(size=(120, 2))
    likelihood = ErrorLikelihood(np.array([13.0, 5.0]))
    for j, k in ((0, 3), (0, 60), (1, 100)):
        step = 1e-5 * np.eye(120)[k]
        slope = (likelihood.cost(errors[:, j] + step, j) - likelihood.cost(errors[:, j] - step, j)) / 2e-5
        assert 2.0 * likelihood.weight(errors[:, j], j) * errors[k, j] == pytest.approx(slope, rel=1e-5)
    assert np.allclose(likelihood.costs(errors), [likelihood.cost(errors[:, j], j) for j in (0, 1)])


def test_steps_are_as_fine_as_errors_tell() -> None:
    """Errors that a step biases by its square are halved until half the step changes −2 ln p by less than one."""

    class Biased(OutputErrors):
        def __post_init__(self) -> None:
            self.joints, self._basis, self.windows = ("pan",), None, WINDOWS
            self.window = np.repeat(np.arange(WINDOWS), SAMPLES)
            self.noise = 1e-3 * np.random.default_rng(5).normal(size=(WINDOWS * SAMPLES, 1))

        def of(self, physics: object) -> Array:
            return np.asarray(self.noise + self.bias * self.longest_step**2, dtype=float)

    for bias, step in ((0.0, FINE_STEP), (150.0, FINE_STEP / 2.0), (5000.0, FINEST_STEP)):
        errors = Biased((), ("pan",))
        errors.bias = bias
        fine = errors.most_finely(None)  # type: ignore[arg-type]
        assert fine.longest_step == step and errors.longest_step > FINE_STEP
    assert fine.likelihood.independent[0] > 10.0 * WINDOWS


def test_the_scale_of_efforts_is_as_wide_as_simulations_leave_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors that hardly depend on a common factor of two numbers, beside slopes that claim to know it."""
    random = np.random.default_rng(6)
    noise, course, late, common_course = 1e-2 * random.normal(size=(4, 400))
    # what the noise happens to look like would move the least
    known = np.linalg.qr(np.stack([course, late, common_course], axis=1))[0]
    noise -= known @ (known.T @ noise)
    vector, every = np.array([2.0, 3.0, 0.5]), {"a": 0, "b": 1, "c": 2}
    likelihood = ErrorLikelihood(np.array([400.0]))

    def errors_of(vector: Array) -> Array:
        # the third number makes up for what the scale does but for a tenth, and not in proportion
        common = np.log(vector[0] / 2.0)
        made_up = course * (vector[1] / vector[0] - 1.5) + late * (vector[2] - 0.5 + common + common**2)
        return np.asarray(noise + made_up + 0.1 * common_course * common)[:, None]

    problem = SimpleNamespace(
        joints=("pan",),
        numbers=lambda model: [every],
        simulated_within_bounds=lambda model, x: (errors_of(x), x.copy()),
        costs=lambda errors, model, x: likelihood.costs(errors),
        for_each=lambda function, items: [function(item) for item in items],
    )
    steps = 1e-6 * np.eye(3)
    J = np.stack([(errors_of(vector + step) - errors_of(vector))[:, 0] for step in steps], axis=1) / 1e-6
    # rough by the first number
    J[:, 0] += 0.1 * random.normal(size=400)
    nothing, blocks = np.zeros(3), np.zeros(400, dtype=np.int64)
    equations = NormalEquations(J, noise, blocks, likelihood.weight(noise, 0), nothing, nothing)
    found = SimpleNamespace(
        model=SimpleNamespace(vector=vector), equations=(equations,), costs=likelihood.costs(noise[:, None])
    )
    monkeypatch.setattr(scale, "_scaled", lambda problem, model, joint: [0, 1])
    profile = profile_scale(problem, found)  # type: ignore[arg-type]
    # exact slopes would tell this much of 400 errors
    by_curvature = np.sqrt(np.mean(noise**2) / np.mean((0.1 * common_course) ** 2) / 400.0)
    assert equations.std[0] / 2.0 < 0.2 * by_curvature
    assert profile.std[0] == pytest.approx(by_curvature, rel=0.5)
    # both numbers follow the scale, and the third one makes up for it
    assert profile.lowered[0] == 0.0 and np.array_equal(profile.best, vector)
    changes = np.array([*(-size for size in scale.SIZES), *scale.SIZES])
    change = changes[np.argmin(np.abs(np.log(np.abs(changes) / profile.std[0])))]
    expected = np.array([2.0, 3.0, 0.0]) * np.expm1(change) - np.array([0.0, 0.0, change + change**2])
    assert np.allclose(profile.along[0] * change, expected, rtol=0.1, atol=0.03)


def test_several_servos_follow_the_law_of_each() -> None:
    random = np.random.default_rng(7)
    servos = {
        2: Servo("c", 3.0, 0.2),
        0: Servo("a", 8.0, 0.1, limit=1.5, sag=0.3),
        1: Servo("b", 5.0, 0.0, limit=0.4, dead_band=0.05),
        3: Servo("d", 6.0, 0.1, stall_torque=1.2, no_load_speed=0.8),
    }
    command, q, v, effort, offset = random.normal(size=(5, 50, 5))
    gain, supply, scale = random.uniform(0.5, 1.5, size=(3, 50, 5))
    on, duration = (random.uniform(size=(50, 5)) > 0.3).astype(float), random.uniform(1e-3, 2e-3, 50)
    numbers = np.array([own.numbers for own in servos.values()])
    inputs = (on, command, gain, supply, scale, offset)
    total, slope = drive_servos(np.array([*servos]), numbers, *inputs, q, v, effort, duration)
    for j, servo in servos.items():
        own = servo.effort(command[:, j], scale[:, j] * q[:, j] + offset[:, j], v[:, j], gain[:, j], supply[:, j])
        assert np.allclose(total[:, j], effort[:, j] + on[:, j] * own.value, rtol=1e-13)
        assert np.allclose(slope[:, j], on[:, j] * (own.d_v + 0.5 * duration * scale[:, j] * own.d_q), rtol=1e-13)
    assert np.array_equal(total[:, 4], effort[:, 4]) and not np.any(slope[:, 4])


def test_a_friction_that_sticks_is_tried_beside_the_grid_of_its_law() -> None:
    """The shape with the least cost is taken; laws without such a width keep theirs."""
    tried = []

    def fit(model: SimpleNamespace, slopes: object = None, steps: int = 0) -> SimpleNamespace:
        widths = [effect.values.get(SLIP_VELOCITY.name) for effect in model.effects]
        tried.append(widths)
        return SimpleNamespace(model=model, costs=np.array([widths[0]]), slopes_without=lambda effects: ())

    @dataclass(frozen=True)
    class Fitted:
        effects: tuple[object, ...]

    model = Fitted((JointCoulombFriction("pan", {"torque": 0.1, "slip_velocity": 0.005}), JointViscousFriction("pan")))
    problem = SimpleNamespace(
        joints=("pan",), fit=fit, for_each=lambda function, items: [function(item) for item in items]
    )
    best = fit_shapes(problem, fit(model))  # type: ignore[arg-type, arg-type]
    assert best.model.effects[0].values[SLIP_VELOCITY.name] == STICKING < SLIP_VELOCITY.grid[0]
    assert len(tried) == 1 + len(SLIP_VELOCITY.grid) - 1 + 1 + 1
    assert replace(best.model).effects[1] == model.effects[1]


def test_processes_change_nothing() -> None:
    problem = OutputErrorProblem(None, None, jobs=2)  # type: ignore[arg-type]

    def square(x: int) -> tuple[int, int]:
        return x**2, problem.jobs

    # a copy makes no copies of its own
    assert problem.for_each(square, [1, 2, 3]) == [(1, 1), (4, 1), (9, 1)] and problem.jobs == 2
    assert problem.for_each(square, [4]) == [(16, 2)] and problem.for_each(square, []) == []
