"""The verdict as plain data: what a report says, and nothing of how it was found."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drake_cafim.effects.effect import Effect
from drake_cafim.rounding import rounded
from drake_cafim.scenario.scene import Scene

Kind = Literal["none", "explained", "unexplained"]


@dataclass(frozen=True)
class Location:
    """Where recordings and model differ: a joint, body, contact, sensor or the environment, and when."""

    kind: str
    name: str
    share: float
    """Of all the excess over noise; shares sum to at most 1."""
    intervals: tuple[tuple[float, float], ...] = ()
    """s, in the recording's own time."""
    recording: str | None = None
    where: str = ""
    """The condition in words, as "near v.elbow = 0"."""


@dataclass(frozen=True)
class Mismatch:
    """Whether anything differs, how sure that is, and where; under `unexplained`, what remains unexplained."""

    detected: bool
    p_value: float
    """Accounts for the number of hypotheses that were looked at."""
    locations: tuple[Location, ...] = ()
    """A push that is named has its own, without a share where `unexplained` is spoken of."""

    @property
    def standing(self) -> tuple[Location, ...]:
        """The locations that have a share."""
        return tuple(one for one in self.locations if one.share > 0.0)


@dataclass(frozen=True)
class Value:
    """A number with its standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Explanation:
    """An effect that the data support."""

    effect: Effect
    probability: float
    values: Mapping[str, Value]
    sentence: str


@dataclass(frozen=True)
class Rival:
    """An effect that the data cannot tell from an accepted one."""

    effect: str
    at: str
    probability: float
    why_alike: str


@dataclass(frozen=True)
class NominalParameter:
    """An unknown of the scenario as it was fitted, beside the accepted effects."""

    parameter: str
    at: str
    value: float
    std: float
    unit: str
    prior_mean: float
    prior_std: float


@dataclass(frozen=True)
class Quality:
    """Negative log likelihood per sample of one-step innovations, what is not known of the unknowns reckoned in; and
    root mean square of 1 s forecasts by column."""

    nll: float
    rmse: Mapping[str, float]


@dataclass(frozen=True)
class Comparison:
    """A set of recordings under three models: as given, unknowns fitted, and effects added."""

    nominal_as_given: Quality
    nominal: Quality
    corrected: Quality


@dataclass(frozen=True)
class Verdict:
    """What a diagnosis found. `str(verdict)` is the sentence.

    - `kind`: "none", the recordings are as model and noise predict; "explained", what the accepted effects leave is
      as the noise predicts; "unexplained", something remains that is not in the vocabulary.
    - `mismatch`: whether anything differs (`detected`, `p_value`), and its `locations`, strongest first: `kind`,
      `name`, `share` of the excess over noise, `intervals` in s of `recording`, and `where` in words. A push that is
      named has its body's, over its own interval.
    - `explanation`: the accepted effects, surest first: `effect.name`, `effect.at`, `probability`, `sentence`, and
      `values`, by parameter its `value`, `std` and `unit` (SI).
    - `rivals`: what the data cannot tell from these: `effect`, `at`, `probability`, `why_alike`.
    - `parameters`: the scenario's unknowns as fitted: `parameter`, `at`, `value`, `std`, `unit`, and their priors.
    - `train` and `held_out` (None where nothing was held out): three models compared, `nominal_as_given`, `nominal`
      with the unknowns fitted and `corrected` with the effects too. Each has `nll`, of one-step innovations a sample,
      and `rmse`, of simulations over 1 s, by column and in its unit.
    - `corrected`: the scene with its unknowns as fitted and the accepted effects in it; where none is accepted though
      something is missing, and the unknowns as given predict the recordings better, with those.
    - `data_mistakes`: what is wrong with the recordings themselves, before any physics; `noise_remarks`: where the
      noise is not as stated; `notes`: what was read and what was left out.
    - `reduced_chi_square`: χ² per whitened row before and after the explanation; noise alone gives 1.
    - `next_experiment`: the motion that tells the rivals apart, None until one was designed.
    """

    kind: Kind
    mismatch: Mismatch
    explanation: tuple[Explanation, ...]
    rivals: tuple[Rival, ...]
    parameters: tuple[NominalParameter, ...]
    train: Comparison
    held_out: Comparison | None
    corrected: Scene
    data_mistakes: tuple[str, ...] = ()
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    reduced_chi_square: tuple[float, float] = (0.0, 0.0)
    next_experiment: Mapping[str, object] | None = field(default=None)

    def __str__(self) -> str:
        return sentence(self)


def sentence(verdict: Verdict) -> str:
    """The verdict in words."""
    remarks = [f"{remark[0].upper()}{remark[1:]}." for remark in verdict.noise_remarks]
    return " ".join([_finding(verdict), *remarks])


def _finding(verdict: Verdict) -> str:
    if verdict.data_mistakes:
        return f"The recordings themselves look wrong: {'; '.join(verdict.data_mistakes)}."
    if verdict.kind == "none":
        return (
            "Nothing is missing: the recordings are as the model and its noise predict "
            f"(p = {rounded(verdict.mismatch.p_value, 2)})."
        )
    named = "; ".join(explanation.sentence for explanation in verdict.explanation)
    if verdict.kind == "explained":
        return f"The model lacks {named}. With that, what remains is noise."
    rest = ", ".join(dict.fromkeys(location.name for location in verdict.mismatch.standing[:3]))
    remains = (
        f"Something more is there, at {rest}, that is not in the vocabulary."
        if rest
        else "Something more is there that is not in the vocabulary."
    )
    before, after = verdict.reduced_chi_square
    if named:
        return (
            f"The model lacks {named}. That takes the misfit from {rounded(before)} to {rounded(after)} times the "
            f"noise variance. {remains}"
        )
    return (
        f"The recordings differ from the model by {rounded(before)} times the noise variance, and no known effect "
        f"explains it. {remains}"
    )
