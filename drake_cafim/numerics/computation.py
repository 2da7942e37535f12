"""Figures whose computation may fail: the value, or the reason why there is none."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Figure = TypeVar("Figure")


@dataclass(frozen=True)
class NotComputable:
    """A figure that has no value; `reason` in words, as "singular matrix"."""

    reason: str


def compute(figure: Callable[[], Figure]) -> Figure | NotComputable:
    """The result of `figure()`, or the reason why its arithmetic has no result.

    A singular matrix, eigenvalues that do not converge, an overflow and a division by zero are results here. Any other
    exception is a defect of the code and is passed on.
    """
    try:
        # an overflow within arrays gives an infinite figure, which the caller handles
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return figure()
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        return NotComputable(_in_words(error))


def _in_words(error: Exception) -> str:
    if isinstance(error, ZeroDivisionError):
        return "division by zero"
    if isinstance(error, OverflowError):
        return "a number is beyond what floating point holds"
    words = str(error) or type(error).__name__
    return f"{words[0].lower()}{words[1:]}".removesuffix(".")
