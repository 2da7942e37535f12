"""Local polynomials on an even clock: weights that are computed once for each place in a window are those of rows."""

import numpy as np
import pytest

from drake_cafim.numerics import local_polynomial as module
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.typing import Array

STEP, REACH = 1e-3, 0.02


@pytest.mark.parametrize("samples", [400, 30, 7])
@pytest.mark.parametrize("rows", [None, np.array([0, 3, 5, 6]), np.zeros(0, dtype=np.int64)])
@pytest.mark.parametrize(("degree", "derivative"), [(3, 1), (2, 0)])
def test_weights_are_those_that_each_row_has_by_itself(
    samples: int, rows: Array | None, degree: int, derivative: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Far from zero, times are rounded, and recordings may be shorter than a window."""
    time = 1000.0 + STEP * np.arange(samples)
    monkeypatch.setattr(module, "CACHED_SAMPLES", 0)
    found = local_polynomial(time, REACH, degree, derivative, 3, rows)  # type: ignore[arg-type]
    monkeypatch.setattr(module, "EVEN", -1.0)
    expected = local_polynomial(time, REACH, degree, derivative, 3, rows)  # type: ignore[arg-type]
    assert found.shape == expected.shape and np.array_equal(found.indices, expected.indices)
    size = np.abs(expected.data).max(initial=0.0)
    np.testing.assert_allclose(found.data, expected.data, atol=1e-6 * size)


def test_an_even_clock_is_computed_once_and_an_uneven_one_row_by_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CACHED_SAMPLES", 0)
    computed: list[int] = []
    weights = module._weights
    monkeypatch.setattr(module, "_weights", lambda basis, wanted: computed.append(len(basis)) or weights(basis, wanted))
    time = STEP * np.arange(300)
    local_polynomial(time, REACH, 2, 0)
    assert sum(computed) == 2 * 20 + 1
    computed.clear()
    local_polynomial(np.where(np.arange(300) == 150, time + 1e-7, time), REACH, 2, 0)
    assert sum(computed) == 300


def test_a_polynomial_is_reproduced() -> None:
    time = STEP * np.arange(200)
    values = 2.0 - 3.0 * time + 50.0 * time**2
    np.testing.assert_allclose(local_polynomial(time, REACH, 2, 0) @ values, values, rtol=1e-9)
    np.testing.assert_allclose(local_polynomial(time, REACH, 3, 1) @ values, -3.0 + 100.0 * time, atol=1e-6)
