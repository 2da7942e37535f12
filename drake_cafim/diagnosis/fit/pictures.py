"""What a report draws of recordings and models, as numbers: residuals, missing forces, simulations."""

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
    """What one row of a window is about, in words, and the unit of its mean over a window."""

    label: str
    unit: str


@dataclass(frozen=True)
class Evidence:
    """What an effect is judged by: each recording's missing forces without and with it, and its motion.

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
    """What a model leaves in one row of all windows, `values` (M,), beside the motion `against` which it is shown."""

    channel: Channel
    values: Array
    against: Sequence[tuple[str, Array]]
    """A label with its unit, and (M,) values."""


class Pictures(ABC):
    """What a report draws of a problem's recordings."""

    row_note: ClassVar[str]
    """What the rows of a residual are, as a sentence."""
    simulation_note: ClassVar[str] = ""
    """What drives a simulation of a recording, as a clause."""

    @property
    @abstractmethod
    def recordings(self) -> list[Recording]:
        """The recordings that were fitted to."""

    @property
    @abstractmethod
    def row_labels(self) -> list[str]:
        """What each row of a window is about, in words."""

    @abstractmethod
    def maps(self, before: Model, after: Model) -> list[ResidualMap]:
        """The residual of all recordings under two models, whitened alike."""

    @abstractmethod
    def forecast(self, recording: Recording, physics: Physics) -> Forecast:
        """A recording, fitted to or not, simulated over windows of up to a second."""

    def evidence(self, effect: Effect, without: Physics, with_it: Physics) -> Evidence | None:
        """What speaks for `effect`: `with_it` is the corrected physics, `without` the same but for this effect.

        None where there are no forces to show it by.
        """
        return None

    def remains(self, physics: Physics, place: str) -> Remains | None:
        """What `physics` leaves unexplained at a place; None where the place has no row of its own."""
        return None

    def laid_out(self, recording: Recording) -> WeakForm | None:
        """A recording as a replay shows it; None where there are no joints to draw one from."""
        return None
