"""Records of the decisions of a search by errors of simulations, or of velocities against positions."""

from collections.abc import Sequence

from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.output_error.candidates import Candidate
from drake_cafim.diagnosis.trace import NOMINAL, Record, name_of, spoken
from drake_cafim.numerics.rounding import short

SEARCH = "simulations"
"""The name of this search in the trace."""
CRITERION = "N ln of the mean of N independent squared errors, plus a cost for each parameter"


def record_screening(joint: str, found: Sequence[Candidate], fitted: bool) -> list[Record]:
    """By how much effects lower the errors of a joint to first order, and whether they are `fitted`."""
    then = "so it is fitted" if fitted else "it is not fitted, since one that was fitted before is admitted"
    return [
        Record(
            "screen",
            name_of(candidate.effect.key),
            candidate.excess,
            0.0,
            fitted,
            f"to first order, lowers {CRITERION}, at {joint} by {short(candidate.excess)}; {then}",
            "decrease of the criterion",
        )
        for candidate in found
    ]


def record_trial(key: Key, replaced: Sequence[Key], lowered: float, worse: float, error: float, passed: bool) -> Record:
    """Whether an effect is admitted, in the place of others or beside them."""
    instead = f" in the place of {' and '.join(spoken(name_of(other)) for other in replaced)}" if replaced else ""
    words = (
        f"{spoken(name_of(key))}{instead} lowers {CRITERION}, by {short(lowered)}; errors of recordings, or "
        f"of quarters of few, that are left out change by {short(worse)} ± {short(error)} in ln of their mean square, "
        f"which may not rise: "
        f"{'admitted' if passed else 'not admitted'}"
    )
    return Record("admit", name_of(key), lowered, 0.0, passed, words, "decrease of the criterion")


def record_share_of_excess(key: Key, share: float, asked: float) -> Record:
    """Whether an effect of a sensor removes enough of what its channel has beyond noise."""
    words = (
        f"{spoken(name_of(key))} removes a share of {short(share)} of what the differences between velocities and "
        f"positions have beyond noise; at least {short(asked)} is required"
    )
    return Record("prune", name_of(key), share, asked, share >= asked, words, "share of the excess")


def record_prune(key: Key, risen: float, worse: float, error: float, stays: bool) -> Record:
    """Whether an effect stays."""
    words = (
        f"without {spoken(name_of(key))}, {CRITERION}, is higher by {short(risen)}, and errors of recordings, "
        f"or of quarters of few, that are left out change by {short(worse)} ± {short(error)} in ln of their mean "
        f"square: "
        f"{'it stays' if stays else 'it is taken out'}"
    )
    return Record("prune", name_of(key), risen, 0.0, stays, words, "rise of the criterion")


def record_alike(key: Key, other: Key, lead: float) -> Record:
    """A law compared with one that acts alike, in its place."""
    words = (
        f"with {spoken(name_of(other))} in the place of {spoken(name_of(key))}, {CRITERION}, is "
        f"{'higher' if lead >= 0.0 else 'lower'} by {short(abs(lead))}"
    )
    return Record("choose", name_of(other), -lead, 0.0, lead < 0.0, words, "decrease of the criterion", name_of(key))


def record_errors(joint: str, error: float, alone: float, p_value: float, level: float) -> Record:
    """Whether the errors of simulations at a joint are those of noise."""
    passed = p_value > level
    words = (
        f"simulations over a second miss the positions of {joint} by {short(error)} (root mean square), with the "
        f"unknowns alone by {short(alone)}; the probability that noise of the encoder alone makes such errors is "
        f"{short(p_value, 2)}: {'what remains is noise' if passed else 'more than noise remains'}"
    )
    return Record("adequacy", NOMINAL, p_value, level, passed, words, "p-value")


def record_servos(error: float, alone: float) -> Record:
    """The unknowns of position servos are settled by simulations, which no effect that was tried makes better."""
    words = (
        f"the unknowns of servos are fitted to simulations over a second, which miss positions by {short(error)} "
        f"(geometric mean of the joints), beside a late command and friction; without these by {short(alone)}. Where "
        "physics is missing, the equations of a servo may be satisfied best at a wrong scale"
    )
    return Record("servos", NOMINAL, error, alone, True, words, "error of simulations, rad or m")
