"""The search's own steps, on problems that answer as they are told to."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis import search
from drake_cafim.diagnosis.model import Model


class _Moving:
    """A problem whose unknown is found at the next of `places`, prior standard deviations, and how it was whitened."""

    def __init__(self, places: list[float]) -> None:
        self.places, self.whitened_at = iter(places), list[float]()
        self.scene = SimpleNamespace(priors=SimpleNamespace(mean=np.zeros(1), std=np.full(1, 2.0)))

    def nominal(self) -> Model:
        return Model(np.zeros(1))

    def rewhitened(self, model: Model) -> "_Moving":
        self.whitened_at.append(float(model.unknown[0]))
        return self


@pytest.mark.parametrize(
    ("places", "whitened_at"),
    [([0.1], []), ([1.0, 1.1], [2.0]), ([1.0, 2.0, 2.1], [2.0, 4.0]), ([1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0])],
)
def test_the_noise_is_reckoned_anew_while_the_unknowns_move(
    monkeypatch: pytest.MonkeyPatch, places: list[float], whitened_at: list[float]
) -> None:
    def found(problem: Any, model: Model) -> Any:
        return SimpleNamespace(model=Model(2.0 * np.array([next(problem.places)])))

    monkeypatch.setattr(search, "unbiased_fit", found)
    monkeypatch.setattr(search, "hypotheses", lambda problem: ())
    monkeypatch.setattr(search, "screen", lambda *looked_at: [])
    monkeypatch.setattr(search, "_detection", lambda *looked_at: 1.0)
    problem: Any = _Moving(places)
    outcome = search.search(problem, search.Settings())
    assert problem.whitened_at == whitened_at
    assert float(outcome.nominal.model.unknown[0]) == 2.0 * places[-1]
