"""The interface of search, verdict and report to recordings of a scene, of jointed robots and of throws alike."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from drake_cafim.diagnosis.fit.columns import Columns
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Pictures
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.typing import Array

Build = Callable[[Array], Effect | None]
"""The effect that coefficients (c,) stand for; None where there is none."""
Look = tuple[Array | Columns, Build]
"""Whitened columns (R, c) along which an effect moves the rows, to first order, and what their coefficients mean."""


@dataclass(frozen=True)
class Looks:
    """First-order tests (looks) of an effect, and how many more were `tried` to choose them."""

    found: Iterator[Look]
    tried: int = 0


class SearchProblem(Problem):
    """A problem with hypotheses: possible effects, how each changes the rows, and where a residual is."""

    @abstractmethod
    def hypotheses(self) -> tuple[Effect, ...]:
        """Every effect of the vocabulary at every place where these recordings could show it."""

    @abstractmethod
    def looks(self, at: Fit, effect: Effect) -> Looks:
        """The looks at `effect` beyond the fitted model `at`."""

    @abstractmethod
    def locate(self, lacking: Model) -> tuple[Location, ...]:
        """Where and when the recordings differ from the model `lacking`: shares of the excess χ², strongest first."""

    @abstractmethod
    def apart(self, rows: Array) -> Array:
        """Whitened rows (R,) as they are without whitening, each over its own standard deviation.

        Whitening makes rows independent by subtracting from each what those before it tell of its noise. Where one is
        far from noise, as at a joint at which something is missing, that spreads to all.
        """

    @property
    def noise_share(self) -> Array:
        """(R,) the part of each row's variance that the noise of the channels makes; unknown forces make the rest."""
        return np.ones(self.rows)

    @property
    def equations(self) -> slice:
        """The kinds of rows, of those of a window, that say how the model moves, and not how two readings agree."""
        return slice(None)

    @property
    @abstractmethod
    def pictures(self) -> Pictures:
        """The data of a report's pictures."""

    def forget(self) -> None:
        """Frees what is cached, which is computed again when it is asked for: of a search that has ended."""

    def effect_columns(self, model: Model, position: int) -> Array:
        """(R + n, k) derivatives by the strengths of one of the model's effects."""
        raise TypeError(f"{type(self).__name__} has no derivatives by single effects")

    def law_samples(self, model: Model) -> list[list[JointSamples]]:
        """By recording and joint, the motion at which laws of joints act; no recording where there are no joints."""
        return []

    def joint_columns(self, joint: int, columns: Sequence[Array]) -> Array:
        """Whitened rows (R, k) of forces (P, k) at a joint at the points of `law_samples`, by recording."""
        raise TypeError(f"{type(self).__name__} has no joints")

    def likeliest_force(self, model: Model, near: Self | None = None) -> Array | None:
        """(n,) density of white forces at the joints that maximises the likelihood of the residual under `model`.

        It is searched from the density of the forces that are noise in `near`, if that is given. None where the
        rows are no equations of motion.
        """
        return None

    def with_unknown_force(self, force: Array, model: Model | None = None) -> Self:
        """The same recordings, with forces of that density as noise, whitened under `model` or as now."""
        raise TypeError(f"{type(self).__name__} has no forces at joints")

    @property
    def forced_joints(self) -> tuple[str, ...]:
        """The joints at which unknown forces are a large part of the noise."""
        return ()

    @property
    def exact_joints(self) -> tuple[str, ...]:
        """The joints at which no unknown force shows, though one as large beside their efforts as elsewhere would."""
        return ()

    @property
    def force_remarks(self) -> tuple[str, ...]:
        """A sentence for each joint at which unknown forces are a large part of the noise."""
        return ()

    def with_reading(self, model: Model) -> tuple[Array, Array] | None:
        """(n,) excess χ² of each joint's equation with the predicted contact force, and with a sensor's reading of it.

        None where no sensor reads it, or where there is more than one contact or sensor.
        """
        return None

    def over_wider_windows(self, times: float) -> "tuple[Self, float] | None":
        """The same recordings under windows `times` as wide, and the widest in s; None where too few fit in any.

        A recording that is too short for them has the widest that it has room for, halving `times`.
        """
        return None
