"""The goodness of fit of a fitted model in words: whether the residual is as noise predicts, and if not, where."""

from dataclasses import dataclass

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.thresholds import ADEQUACY_LEVEL
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.numerics.rounding import grouped, rounded

PLACES = 3
"""Largest number of places that the sentence names."""


@dataclass(frozen=True)
class GoodnessOfFit:
    """The residual of a fitted model compared with what the noise predicts.

    - `accepted`: whether the residual is as the noise predicts, at the level `ADEQUACY_LEVEL`.
    - `reduced_chi_square`: χ² per degree of freedom of the `rows`, 1 for noise alone.
    - `p_value`: the probability that noise alone gives as large a residual, in total or in any stretch of time.
    - `locations`: where the model does not fit, strongest first; none where it is accepted.
    """

    accepted: bool
    reduced_chi_square: float
    p_value: float
    rows: int
    locations: tuple[Location, ...] = ()

    def __str__(self) -> str:
        figures = (
            f"reduced χ² {rounded(self.reduced_chi_square)} over {grouped(str(self.rows))} rows, 1 for noise alone; "
            f"p = {rounded(self.p_value, 2)}"
        )
        if self.accepted:
            return f"Goodness of fit: the model fits, the residual is as the noise predicts ({figures})."
        return (
            f"Goodness of fit: WARNING, the model does not fit ({figures}).{self._where()} The values below compensate "
            "for missing physics: do not trust them. `cafim diagnose` looks for what is missing."
        )

    def _where(self) -> str:
        """The strongest places, and when it shows at the first of them, as a sentence."""
        shares: dict[str, float] = {}
        for location in self.locations:
            shares[location.name] = shares.get(location.name, 0.0) + location.share
        if not shares:
            return ""
        strongest = sorted(shares, key=lambda name: -shares[name])[:PLACES]
        first = next(location for location in self.locations if location.name == strongest[0])
        details = [f"from {start:.3g} to {stop:.3g} s of {first.recording}" for start, stop in first.intervals[:1]]
        details += [first.where] if first.where else []
        places = [f"{name} ({shares[name]:.0%})" for name in strongest]
        places[0] += f" {', '.join(details)}" if details else ""
        return f" The misfit is at {'; '.join(places)}."


def goodness_of_fit(problem: SearchProblem, fitted: Fit) -> tuple[GoodnessOfFit, tuple[str, ...]]:
    """The goodness of fit of `fitted`, and a note where the places cannot be computed."""
    left = adequacy(problem, fitted.residual, fitted.strengths)
    accepted = left.p_value > ADEQUACY_LEVEL
    where: tuple[Location, ...] = ()
    notes: tuple[str, ...] = ()
    if not accepted:
        found = compute(lambda: problem.locate(fitted.model))
        if isinstance(found, NotComputable):
            notes = (f"mismatch.locations cannot be computed: {found.reason}",)
        else:
            where = found
    return GoodnessOfFit(accepted, left.reduced_chi_square, left.p_value, problem.rows, where), notes
