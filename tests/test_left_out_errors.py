"""Errors of simulations of left-out parts, some of which cannot be simulated."""

from collections.abc import Mapping

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.left_out.parts import Part
from drake_cafim.diagnosis.left_out.simulations import Errors, both_horizons, mean_differences
from drake_cafim.diagnosis.predict.forecast import Forecast

PARTS = (Part((0,)), Part((1,)))


class Predictions:
    """By the numbers of the recordings in a part, the misses of each column; None where a part cannot be simulated."""

    jobs = 1

    def __init__(self, *misses: Mapping[str, float] | None) -> None:
        self.misses = misses

    def simulate(self, model: Model, part: Part, horizon: float) -> list[Forecast]:
        misses = self.misses[part.recordings[0]]
        if misses is None:
            raise np.linalg.LinAlgError("singular")
        predicted = {column: np.full(4, miss) for column, miss in misses.items()}
        measured = {column: np.zeros(4) for column in misses}
        return [Forecast("run", np.arange(4.0), np.zeros(4, dtype=np.int64), predicted, measured)]

    def surprisal(self, model: Model, part: Part) -> float:
        return 0.0


def _errors(*misses: Mapping[str, float] | None) -> Errors:
    return both_horizons(Predictions(*misses), [Model(np.zeros(0))] * len(PARTS), PARTS)


def test_a_model_that_cannot_be_simulated_at_all_is_compared_with_one_that_can() -> None:
    neither, both = _errors(None, None), _errors({"q.a": 1.0, "v.a": 1.0}, {"q.a": 1.0, "v.a": 1.0})
    assert np.all(neither.diverges)
    assert np.all(np.isnan(neither.worse_than(both)))
    assert np.all(np.isnan(both.worse_than(neither)))


def test_what_one_part_lacks_is_left_out_there_alone() -> None:
    worse = _errors({"q.a": 2.0, "v.a": 8.0}, None).worse_than(_errors({"q.a": 1.0, "v.a": 2.0}, {"q.a": 1.0}))
    assert worse[0] == pytest.approx(0.5 * np.log(2.0 * 4.0))
    assert np.isnan(worse[1])


def test_only_columns_that_both_have_are_compared() -> None:
    assert mean_differences([{"q.a": 1.0, "v.a": 9.0}], [{"q.a": 0.5}]) == pytest.approx([0.5])


def test_an_exact_simulation_says_nothing_of_a_ratio() -> None:
    assert np.isnan(_errors({"q.a": 0.0}, {"q.a": 1.0}).worse_than(_errors({"q.a": 1.0}, {"q.a": 1.0}))[0])
