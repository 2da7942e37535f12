"""Whether a fitted model leaves what noise predicts, and if not, where."""

from dataclasses import dataclass

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.numerics.rounding import grouped, rounded

PLACES = 3
"""How many places a sentence names."""


@dataclass(frozen=True)
class GoodnessOfFit:
    """What a fitted model leaves of the recordings, compared with what their noise predicts.

    - `accepted`: whether the rest is as the noise predicts; where it is, it is refused once in a hundred times.
    - `reduced_chi_square`: its mean square over the noise variance, 1 for noise alone, of so many `rows`.
    - `p_value`: that noise alone leaves as much, in all, at any place or in any stretch of time.
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
            return f"Goodness of fit: the model fits, what it leaves is as the noise predicts ({figures})."
        return (
            f"Goodness of fit: WARNING, the model does not fit ({figures}).{self._where()} The numbers below make up "
            "for what it cannot express: do not trust them. `cafim diagnose` looks for what is missing."
        )

    def _where(self) -> str:
        """The strongest places, and when it shows at the first of them, as a sentence."""
        shares: dict[str, float] = {}
        for one in self.locations:
            shares[one.name] = shares.get(one.name, 0.0) + one.share
        if not shares:
            return ""
        strongest = sorted(shares, key=lambda name: -shares[name])[:PLACES]
        first = next(one for one in self.locations if one.name == strongest[0])
        details = [f"from {start:.3g} to {stop:.3g} s of {first.recording}" for start, stop in first.intervals[:1]]
        details += [first.where] if first.where else []
        places = [f"{name} ({shares[name]:.0%})" for name in strongest]
        places[0] += f" {', '.join(details)}" if details else ""
        return f" What is left is at {'; '.join(places)}."


def goodness_of_fit(problem: SearchProblem, fitted: Fit) -> tuple[GoodnessOfFit, tuple[str, ...]]:
    """That of a fit, and a note where the places cannot be computed."""
    left = adequacy(problem, fitted.residual, fitted.strengths)
    accepted = left.p_value > Settings().false_alarm_rate
    where: tuple[Location, ...] = ()
    notes: tuple[str, ...] = ()
    if not accepted:
        found = compute(lambda: problem.locate(fitted.model))
        if isinstance(found, NotComputable):
            notes = (f"mismatch.locations cannot be computed: {found.reason}",)
        else:
            where = found
    return GoodnessOfFit(accepted, left.reduced_chi_square, left.p_value, problem.rows, where), notes
