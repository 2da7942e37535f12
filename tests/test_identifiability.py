"""Identifiable combinations of parameters, and their description in run.json and the report."""

import numpy as np
import pytest

from drake_cafim.belief import Belief
from drake_cafim.commands.run import table
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.experiment.run_record import describe_combinations
from drake_cafim.information import identifiable_combinations
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.studies.cell import Cell, measure

THETA = np.array([0.4, 100.0])
PRIOR = np.diag([1.0, 1.0 / 50.0**2])
NAMES = ("friction", "stiffness")


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_of_a_product_only_the_product_is_known(scale):
    """y = c μ K: F = c² g gᵀ with g = (K, μ), whatever its size beside the prior's."""
    g = np.array([THETA[1], THETA[0]])
    known, unknown = identifiable_combinations(scale * np.outer(g, g), PRIOR, THETA)
    assert known.identified and not unknown.identified
    np.testing.assert_allclose(known.exponents, 1.0, rtol=1e-9)
    assert known.text(NAMES) == "friction·stiffness"
    covariance = np.linalg.inv(PRIOR + scale * np.outer(g, g))
    product = THETA[0] * THETA[1]
    assert known.std == pytest.approx(np.sqrt(g @ covariance @ g) / product, rel=1e-6)
    assert known.prior_std == pytest.approx(np.sqrt(g @ np.linalg.inv(PRIOR) @ g) / product)
    assert unknown.std == unknown.prior_std
    # the two are independent, before and after
    other = unknown.exponents / THETA
    assert other @ covariance @ (known.exponents / THETA) == pytest.approx(0.0, abs=1e-9)


def test_nothing_and_everything():
    nothing = identifiable_combinations(np.zeros((2, 2)), PRIOR, THETA)
    assert [combination.identified for combination in nothing] == [False, False]
    all_known = identifiable_combinations(np.diag([100.0, 0.01]), PRIOR, THETA)
    assert [combination.identified for combination in all_known] == [True, True]
    assert [combination.text(NAMES) for combination in all_known] == ["friction", "stiffness"]
    np.testing.assert_allclose(all_known[0].std, 1.0 / np.sqrt(101.0) / 0.4)


def test_a_ratio_and_an_estimate_of_zero():
    g = np.array([1.0 / THETA[0], -1.0 / THETA[1]])
    known = identifiable_combinations(np.outer(g, g), PRIOR, THETA)[0]
    assert sorted(known.exponents.round(9)) == [-1.0, 1.0]
    at_zero = identifiable_combinations(np.diag([4.0, 0.0]), PRIOR, np.array([0.0, 100.0]))[0]
    np.testing.assert_allclose(at_zero.exponents, [1.0, 0.0])


def test_the_record_says_it_and_the_summary_too():
    g = np.array([THETA[1], THETA[0]])
    prior = Belief(NAMES, THETA, np.linalg.inv(PRIOR))
    after = prior.update(0.1 * np.outer(g, g), THETA)
    told = describe_combinations(prior, after, 0.1 * np.outer(g, g))
    assert told["rank"] == 1 and told["combinations"][0]["text"] == "friction·stiffness"
    experiment = {
        "estimate": dict(zip(NAMES, after.mean, strict=True)),
        "std": dict(zip(NAMES, after.std, strict=True)),
        "error_percent": dict.fromkeys(NAMES, 0.0),
        "contact_fraction": 0.9,
        "reversals": 3,
        "max_force": 2.0,
        "planning_ms": {"median": 1.0},
    }
    record = {
        "scenario": "s",
        "world": "model",
        "policy": "p",
        "seed": 0,
        "truth": {},
        "experiments": [experiment | told],
    }
    sentence = table(record).splitlines()[-1]
    assert "only this is known: friction·stiffness, to 7.9 %" in sentence
    assert "cannot tell friction, stiffness apart" in sentence
    whole = prior.update(np.diag([1e4, 1e4]), THETA)
    record["experiments"] = [experiment | describe_combinations(prior, whole, np.diag([1e4, 1e4]))]
    assert "only this is known" not in table(record)
    lone = Belief(("a",), np.ones(1), np.eye(1))
    assert describe_combinations(lone, lone, np.eye(1)) == {}


@pytest.mark.parametrize("name, readings", [("rubbing_two", 2), ("rubbing_tangential", 1)])
def test_rank_of_a_run_and_ports_of_its_worlds(name, readings):
    experiment = measure(Cell(name, 1, experiments=1))["experiments"][-1]
    assert experiment["rank"] == readings
    assert (
        0.5 < experiment["behaviour"]["contact_fraction"] <= 1.0
        and 0.2 < experiment["behaviour"]["sliding_fraction"] <= 1.0
    )
    if readings == 1:
        assert experiment["combinations"][0]["text"] == "friction·stiffness"
        known = experiment["combinations"][0]["std_percent"]
        assert experiment["std"][1] > 45.0 > 20.0 > known
        # the estimate is on the curve μ K that the data determine, not at the mean of the curve's posterior beside it
        product = 100.0 * (np.prod(1.0 + 0.01 * np.array(experiment["error"])) - 1.0)
        assert abs(product) < 2.5 * known
    stage = stage_of(load(resolve(name)), name)
    for kind in ("model", "drake"):
        diagram = stage.diagram(kind, 0)
        assert diagram.GetOutputPort("measured_force").size() == readings
    assert len(stage.view.force_directions) == readings


def test_the_rank_is_that_of_the_data_however_wide_the_belief_is():
    """A posterior's own moments, as of a size that was not felt, do not count as something measured."""
    g = np.array([THETA[1], THETA[0]])
    prior = Belief(NAMES, THETA, np.linalg.inv(PRIOR))
    wide = Belief(NAMES, THETA, np.diag([0.3, 2000.0]))
    told = describe_combinations(prior, wide, np.outer(g, g))
    assert told["rank"] == 1 and told["combinations"][0]["text"] == "friction·stiffness"
