"""The face of a toss problem to the search, the verdict and the report."""

from dataclasses import dataclass
from functools import cached_property

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Pictures
from drake_cafim.diagnosis.fit.search_problem import Looks, SearchProblem
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows
from drake_cafim.diagnosis.tosses.linearised_effects import hypotheses, looks
from drake_cafim.diagnosis.tosses.location import locate_tosses
from drake_cafim.diagnosis.tosses.pictures import TossPictures
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


@dataclass(frozen=True)
class TossProblem(ArcRows, SearchProblem):
    """Tosses of one body, as arcs."""

    def hypotheses(self) -> tuple[Effect, ...]:
        return hypotheses(self)

    def looks(self, at: Fit, effect: Effect) -> Looks:
        return looks(self, at, effect)

    def locate(self, lacking: Model) -> tuple[Location, ...]:
        return locate_tosses(self, lacking)

    def apart(self, rows: Array) -> Array:
        # innovations are independent as they are
        return rows

    @cached_property
    def pictures(self) -> Pictures:
        return TossPictures(self)
