"""Intervals of strengths cover as much as the likelihood allows, and no more."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.realised_noise import RealisedNoise
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.thresholds import WINDOWS_PER_BLOCK
from drake_cafim.effects.actuator import ActuatorDelay
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.transmission import TorqueRipple
from tests.concealed.make import simulate
from tests.concealed_case import written

STD = 0.5


class OneWindow:
    """A recording of a single row, of which blocks of time tell nothing."""

    rows = 1
    realised_noise = None
    runs = (SimpleNamespace(shape=(1, 1)),)
    scene = SimpleNamespace(unknown=())


@dataclass
class Curve(OneWindow):
    """Rows in an unknown x and a coefficient c, that are zero at c = 1 and x = 0; both raise the second one."""

    flat: bool

    def residual(self, model: Model) -> Any:
        x, c = model.vector
        along = np.log(c) if self.flat else c - 1.0
        return np.array([along / STD + x, x])

    def penalty(self, model: Model, own_noise: bool = True) -> float:
        return 0.0

    def prior_std(self, model: Model) -> Any:
        return np.ones(1)

    def fit(self) -> Fit:
        model = Model(np.zeros(1), (JointViscousFriction("a", {"coefficient": 1.0}),))
        jacobian = np.array([[1.0, 1.0 / STD], [1.0, 0.0]])
        return Fit(model, self.residual(model), jacobian, np.linalg.inv(jacobian.T @ jacobian), 2)


@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_a_number_is_known_no_better_than_the_likelihood_falls(scale: float) -> None:
    """χ² at its least over x is (ln c / STD)² / 2: it has risen by 1.96² scale where ln c is 1.96 √(2 scale) STD."""
    problem: Any = Curve(flat=True)
    fit = problem.fit()
    reach = np.exp(1.96 * np.sqrt(2.0 * scale) * STD) - 1.0
    found = standard_deviations(problem, fit, scale)
    assert found[1] == pytest.approx(reach / 1.96, rel=0.1)
    assert found[1] > 1.2 * fit.std[1] * np.sqrt(scale)
    assert found[0] == pytest.approx(fit.std[0] * np.sqrt(scale))


def test_where_chi_square_is_a_parabola_slopes_tell_all() -> None:
    problem: Any = Curve(flat=False)
    fit = problem.fit()
    np.testing.assert_allclose(standard_deviations(problem, fit, 1.0), fit.std, rtol=1e-6)


def test_noise_that_is_three_times_as_large_as_its_covariance_says_widens_an_interval() -> None:
    """C Jᵀ of the data's row (1, 2) is (0, 1/2), C the covariance of x and c."""
    problem: Any = Curve(flat=False)
    problem.realised_noise = RealisedNoise(3.0 * np.random.default_rng(1).standard_normal((1, 4000)))
    found = standard_deviations(problem, problem.fit(), 1.0)
    np.testing.assert_allclose(found, [1.0, 1.5], rtol=0.05)


@dataclass
class Plateau(OneWindow):
    """A row in a delay, up to 0.2 s, whose χ² never rises by more than 1.5² from where it is fitted, or not at all."""

    delay: float
    seen: bool = True

    def residual(self, model: Model) -> Any:
        off = float(model.vector[0]) - self.delay
        return self.seen * 1.5 * np.tanh(np.array([off / 0.02]) / 1.5)

    def penalty(self, model: Model, own_noise: bool = True) -> float:
        return 0.0

    def fit(self) -> Fit:
        model = Model(np.zeros(0), (ActuatorDelay("a", {"delay": self.delay}),))
        slope = 50.0 if self.seen else 1e-7
        return Fit(model, self.residual(model), np.array([[slope]]), np.array([[slope**-2]]), 1)


@pytest.mark.parametrize("delay", [0.0, 0.06, 0.2])
@pytest.mark.parametrize("seen", [True, False])
def test_what_is_hardly_seen_is_known_no_better_than_its_bounds(delay: float, seen: bool) -> None:
    problem: Any = Plateau(delay, seen)
    assert standard_deviations(problem, problem.fit(), 1.0) == pytest.approx([max(delay, 0.2 - delay) / 1.96])


@dataclass
class Wandering:
    """A coefficient's mean rows, whose noise stays the same for a block of time: 40 numbers, however many rows."""

    lasting: bool
    rows = 40 * 4 * WINDOWS_PER_BLOCK
    realised_noise = None
    runs = (SimpleNamespace(shape=(rows, 1)),)
    scene = SimpleNamespace(unknown=())

    def residual(self, model: Model) -> Any:
        length = 4 * WINDOWS_PER_BLOCK if self.lasting else 1
        noise = np.repeat(np.random.default_rng(0).normal(size=self.rows // length), length)
        return noise - noise.mean() - (model.vector[0] - 1.0)

    def penalty(self, model: Model, own_noise: bool = True) -> float:
        return 0.0

    def fit(self) -> Fit:
        model = Model(np.zeros(0), (JointViscousFriction("a", {"coefficient": 1.0}),))
        return Fit(
            model, self.residual(model), -np.ones((self.rows, 1)), np.array([[1.0 / self.rows]]), self.rows, True
        )


@pytest.mark.parametrize("lasting", [True, False])
def test_noise_that_lasts_longer_than_was_stated_widens_an_interval(lasting: bool) -> None:
    problem: Any = Wandering(lasting)
    fit = problem.fit()
    expected = np.sqrt(1.0 / 40.0) if lasting else fit.std[0]
    np.testing.assert_allclose(standard_deviations(problem, fit, 1.0), expected, rtol=0.25)


def test_what_is_not_shown_to_be_there_looks_like_anything(tmp_path: Path) -> None:
    """The best ripple of noise is one of many: its amplitude is no more than what it is, its phase any."""
    scene, recordings = written(simulate("null", "arm2", 3), tmp_path)
    problem = prepare(scene, recordings).problem()
    nominal = unbiased_fit(problem, problem.nominal())
    at = scene.tree.joint_names[0]
    [best] = screen(problem, nominal, [TorqueRipple(at)])
    fit = unbiased_fit(problem, nominal.model.with_effects([best.effect]))
    std = dict(zip(("amplitude", "cycles", "phase"), standard_deviations(problem, fit, 1.0)[-3:], strict=True))
    [found] = fit.model.effects
    assert std["amplitude"] >= abs(found.values["amplitude"])
    assert min(std["cycles"], std["phase"]) > 1e3
