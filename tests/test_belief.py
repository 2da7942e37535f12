"""The Gaussian belief: update, intervals, entropy, and its conversion to a vector."""

import numpy as np
import pytest

from drake_cafim.belief import Belief
from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameter, Parameters


def _belief():
    return Belief(("a", "b"), np.array([1.0, 2.0]), np.array([[0.5, 0.1], [0.1, 0.3]]))


def test_prior_holds_the_free_parameters():
    items = (Parameter("a", 1.0, std=2.0), Parameter("b", 5.0, frozen=True), Parameter("c", 3.0, std=0.5))
    belief = Belief.prior(Parameters(items))
    assert belief.names == ("a", "c")
    np.testing.assert_array_equal(belief.std, [2.0, 0.5])


def test_update_adds_information_once():
    fisher = np.array([[4.0, 1.0], [1.0, 3.0]])
    after = _belief().update(fisher, np.array([1.1, 1.9]))
    np.testing.assert_allclose(after.information, _belief().information + fisher)
    twice = _belief().update(2 * fisher, after.mean)
    np.testing.assert_allclose(twice.covariance, after.update(fisher, after.mean).covariance)


def test_no_prior_is_no_information():
    belief = Belief(("a", "b"), np.zeros(2), np.diag([np.inf, 0.25]))
    np.testing.assert_array_equal(belief.information, [[0.0, 0.0], [0.0, 4.0]])


def test_interval_holds_its_level():
    random = np.random.default_rng(0)
    belief = _belief()
    draws = random.multivariate_normal(belief.mean, belief.covariance, 20000)
    for level in (0.5, 0.95):
        low, high = belief.interval(level).T
        np.testing.assert_allclose(((draws > low) & (draws < high)).mean(axis=0), level, atol=0.012)


def test_entropy_of_independent_parameters_adds_up():
    single = [Belief((name,), np.zeros(1), np.array([[v]])).entropy() for name, v in (("a", 0.2), ("b", 3.0))]
    both = Belief(("a", "b"), np.zeros(2), np.diag([0.2, 3.0])).entropy()
    assert both == pytest.approx(sum(single))
    assert single[1] == pytest.approx(0.5 * np.log(2 * np.pi * np.e * 3.0))


def test_vector_and_back():
    again = Belief.from_vector(("a", "b"), _belief().vector())
    np.testing.assert_array_equal(again.mean, _belief().mean)
    np.testing.assert_array_equal(again.covariance, _belief().covariance)


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match=r"expected \(2,\) and \(2, 2\)"):
        Belief(("a", "b"), np.zeros(3), np.eye(2))
