"""Parameters of which `make test` runs some, and `make long` the others."""

from collections.abc import Iterable
from typing import Any

import pytest


def long_after(count: int, values: Iterable[Any]) -> list[Any]:
    """`values` for `pytest.mark.parametrize`, those after the first `count` marked as long."""
    long = [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.long)
        for value in list(values)[count:]
    ]
    return [*list(values)[:count], *long]
