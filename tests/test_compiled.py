"""Compiled functions where the compiler has no writable cache folder."""

from typing import Any

import numba
import pytest

from drake_cafim.numerics.compiled import compiled


def test_a_function_that_cannot_be_kept_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    njit, asked = numba.njit, list[bool]()

    def without_a_place(*arguments: Any, **options: Any) -> Any:
        asked.append(bool(options.get("cache")))
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return njit(*arguments, **options)

    monkeypatch.setattr(numba, "njit", without_a_place)
    doubled = compiled(lambda x: 2.0 * x)
    assert doubled(3.0) == 6.0
    assert asked[:2] == [True, False]
