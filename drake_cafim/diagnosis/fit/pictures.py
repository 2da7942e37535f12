"""The data of a report's pictures: residuals, missing forces and simulations of recordings under models."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.effect import Effect
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ResidualMap:
    """One recording's residual over time × channel, in standard deviations of the noise."""

    recording: str
    time: Array
    """(M,) s, the windows' middles."""
    width: float
    before: Array
    """(M, r) under the model without the effects."""
    after: Array
    """(M, r) with them."""


@dataclass(frozen=True)
class WindowMeans:
    """The motion of one recording averaged over each window: `time` (M,); `q`, `v`, `a`, `u` (M, n)."""

    time: Array
    q: Array
    v: Array
    a: Array
    u: Array


@dataclass(frozen=True)
class Channel:
    """Label of a row of a window, and the unit of the row's mean over a window."""

    label: str
    unit: str


@dataclass(frozen=True)
class Evidence:
    """The evidence for an effect: each recording's missing forces without and with it, and its motion.

    Rows are `channels` (r,); the forces at the joints, in the order of `tree`, begin at row `first_force`.
    """

    effect: Effect
    tree: Tree
    channels: Sequence[Channel]
    first_force: int
    width: float
    """s of a window."""
    means: Sequence[WindowMeans]
    without: Sequence[Array]
    """(M, r) each."""
    with_it: Sequence[Array]
    std: Sequence[Array]
    """(M, r) each: of `without`, by the noise alone."""


@dataclass(frozen=True)
class Remains:
    """The residual of one row in all windows, `values` (M,), and the motion `against` which it is plotted."""

    channel: Channel
    values: Array
    against: Sequence[tuple[str, Array]]
    """A label with its unit, and (M,) values."""


class Pictures(ABC):
    """Computes the data of a report's pictures from a problem's recordings."""

    row_note: ClassVar[str]
    """What the rows of a residual are, as a sentence."""
    simulation_note: ClassVar[str] = ""
    """By what a simulation of a recording is driven, as a clause."""

    @property
    @abstractmethod
    def recordings(self) -> list[Recording]:
        """The recordings of the fit."""

    @property
    @abstractmethod
    def row_labels(self) -> list[str]:
        """The label of each row of a window."""

    @abstractmethod
    def maps(self, before: Model, after: Model) -> list[ResidualMap]:
        """The residual of each recording under two models, with the same whitening."""

    @abstractmethod
    def forecast(self, recording: Recording, physics: Physics) -> Forecast:
        """A recording, fitted to or not, simulated over windows of up to a second."""

    def evidence(self, effect: Effect, without: Physics, with_it: Physics) -> Evidence | None:
        """The evidence for `effect`: `with_it` is physics that has it, `without` the same without this effect.

        None where there are no forces that show it.
        """
        return None

    def remains(self, physics: Physics, place: str) -> Remains | None:
        """The residual under `physics` at a place; None where the place has no row of its own."""
        return None

    def laid_out(self, recording: Recording) -> WeakForm | None:
        """A recording as a weak form, for a replay; None where there are no joints."""
        return None
