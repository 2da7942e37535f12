"""What the search, the verdict and the report ask of recordings of a scene, whatever kind of motion they hold."""

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Pictures
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

Look = tuple[Array, Callable[[Array], Effect | None]]
"""Whitened columns (R, c) along which an effect moves the rows, to first order, and the effect that coefficients (c,)
of them stand for."""


@dataclass(frozen=True)
class Looks:
    """Linear looks at an effect, and how many more were `tried` to find where to look."""

    found: Iterator[Look]
    tried: int = 0


class SearchProblem(Problem):
    """The one face of joints and throws: what effects there can be, how each moves the rows, and what is left where."""

    @abstractmethod
    def hypotheses(self) -> tuple[Effect, ...]:
        """Every effect of the vocabulary at every place where these recordings could show it."""

    @abstractmethod
    def looks(self, at: Fit, effect: Effect) -> Looks:
        """How `effect` would move the rows beyond the fitted model `at`."""

    @abstractmethod
    def locate(self, lacking: Model) -> tuple[Location, ...]:
        """Where and when the recordings differ from `lacking`, by the share of the excess χ², strongest first."""

    @property
    @abstractmethod
    def pictures(self) -> Pictures:
        """What a report draws."""

    def gain_without_echo(self, at: Fit, effect: Effect, gain: float, basis: Array) -> float:
        """What is left of the `gain` in χ² of a look at `effect` once it is not told by noise that it shares.

        `basis` (R, n) is orthonormal and spans the nuisance.
        """
        return gain

    def shape_columns(self, model: Model, position: int) -> Array | None:
        """(R + n, k) columns of the effect at `position`, where another shape's χ² follows from them; else None."""
        return None

    def likeliest_force(self, model: Model) -> Array | None:
        """(n,) density of white forces at the joints under which what `model` leaves is likeliest.

        None where the rows are not of forces.
        """
        return None

    def with_unknown_force(self, force: Array, model: Model | None = None) -> Self:
        """The same recordings, whitened with such forces as noise, under `model` or else the same as now."""
        raise TypeError(f"{type(self).__name__} knows no forces at joints")

    @property
    def force_remarks(self) -> tuple[str, ...]:
        """The joints at which unknown forces make up a good part of the noise, in words."""
        return ()

    def over_wider_windows(self, times: float) -> "tuple[Self, float] | None":
        """The same recordings under windows `times` as wide, and the widest in s; None where too few fit in any.

        A recording that is too short for them has the widest that it has room for, halving `times`.
        """
        return None
