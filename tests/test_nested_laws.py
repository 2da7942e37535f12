"""Which of two nested laws is named, by what each leaves under its own noise and whether its size is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import nested_laws
from drake_cafim.diagnosis.search.decisions import record_descent
from drake_cafim.effects.friction import JointStribeckFriction
from drake_cafim.effects.joint import JointCoulombFriction, JointForce
from drake_cafim.report.reasons import turning

COULOMB = JointCoulombFriction("j1", {"torque": 1.0})
STRIBECK = JointStribeckFriction("j1", {"coulomb": 1.0, "static": 40.0, "velocity": 0.001})


def _whitened(effect: JointForce, chi_square: float, log_determinant: float, noise: bool) -> Any:
    """A problem under the noise of a law, and its fit; `noise` tells whether it leaves only noise."""
    rows, k = np.full(1000, np.sqrt(chi_square / 1000)), len(effect.strengths)
    model = Model(np.zeros(0), (effect,))
    found = Fit(model, rows, np.zeros((1000, k)), np.eye(k), 1000, unbiased=True)
    return SimpleNamespace(log_determinant=log_determinant, leaves_noise=noise, hypotheses=lambda: (COULOMB,)), found


def _simplified(
    monkeypatch: pytest.MonkeyPatch, larger: Any, simpler: Any, unknown: str | None = None
) -> tuple[Fit, list[nested_laws.Descent]]:
    monkeypatch.setattr(nested_laws, "_under_own_noise", lambda *of: larger)
    monkeypatch.setattr(nested_laws, "_with_law", lambda *of: simpler)
    monkeypatch.setattr(nested_laws, "leaves_noise", lambda problem, *of: problem.leaves_noise)
    monkeypatch.setattr(nested_laws, "reason_against", lambda *of: unknown)
    problem, found, descents = nested_laws.simplify(*larger, 1e-4, 0.01)
    # the problem is whitened with the noise of what is named
    assert problem is (simpler if descents else larger)[0]
    return found, descents


@pytest.mark.parametrize(("chi_square", "log_determinant"), [(1010.0, 0.0), (1000.0, 5.0), (1100.0, -95.0)])
def test_a_law_that_explains_hardly_more_gives_way(
    monkeypatch: pytest.MonkeyPatch, chi_square: float, log_determinant: float
) -> None:
    """Two strengths more lower −2 ln likelihood by 18.4 in one of ten thousand cases, by noise alone."""
    simpler = _whitened(COULOMB, chi_square, log_determinant, True)
    found, [descent] = _simplified(monkeypatch, _whitened(STRIBECK, 1000.0, 0.0, True), simpler)
    assert found is simpler[1] and descent.law == COULOMB
    record = record_descent(Model(np.zeros(0), (STRIBECK,)), descent)
    assert record.statistic == pytest.approx(chi_square + log_determinant - 1000.0, abs=1.0)
    assert (
        record.threshold == pytest.approx(18.42, abs=0.01) and "joint coulomb friction at j1 is named" in record.words
    )
    assert turning(record).startswith("decrease of −2 ln likelihood would have to be above 18.42")


@pytest.mark.parametrize(("chi_square", "log_determinant"), [(1030.0, 0.0), (1000.0, 30.0)])
def test_a_law_that_explains_more_stands(
    monkeypatch: pytest.MonkeyPatch, chi_square: float, log_determinant: float
) -> None:
    larger, simpler = _whitened(STRIBECK, 1000.0, 0.0, True), _whitened(COULOMB, chi_square, log_determinant, True)
    found, descents = _simplified(monkeypatch, larger, simpler)
    assert found is larger[1] and not descents


def test_a_law_that_alone_leaves_noise_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    larger, simpler = _whitened(STRIBECK, 1000.0, 0.0, True), _whitened(COULOMB, 1005.0, 0.0, False)
    assert not _simplified(monkeypatch, larger, simpler, "its static ends at a bound")[1]


@pytest.mark.parametrize("noise", [True, False])
def test_a_law_of_unknown_size_gives_way_to_one_that_leaves_noise(monkeypatch: pytest.MonkeyPatch, noise: bool) -> None:
    """However much more it explains; but not to one that leaves more than noise."""
    larger, simpler = _whitened(STRIBECK, 1000.0, 0.0, noise), _whitened(COULOMB, 1050.0, 0.0, noise)
    found, descents = _simplified(monkeypatch, larger, simpler, "its static may be anything")
    assert (found is simpler[1]) == noise == bool(descents)
    if descents:
        record = record_descent(Model(np.zeros(0), (STRIBECK,)), descents[0])
        assert "its static may be anything: nothing is known of its size" in record.words
        assert turning(record) == ""
