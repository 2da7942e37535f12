"""The verdict as plain data: what a report says, and nothing of how it was found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from drake_cafim.diagnosis.trace import Record
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.rounding import rounded
from drake_cafim.scene.scene import Scene

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
    """A number with its standard deviation; None of a choice, such as a side."""

    value: float
    std: float | None
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
    effect: str | None = None
    """Of a parameter of an effect that the scenario states: the effect's name."""

    @property
    def key(self) -> tuple[str, str, str | None]:
        """What tells it from the scenario's other unknowns."""
        return self.parameter, self.at, self.effect


@dataclass(frozen=True)
class EffortResidual:
    """A joint's residual of inverse dynamics, both sides low-passed without phase lag at `cutoff` Hz.

    `rms` N m (N), and `relative` over the rms of its effort, None where that is zero throughout.
    """

    rms: float
    relative: float | None
    cutoff: float


@dataclass(frozen=True)
class Quality:
    """How a model does on some recordings.

    `nll` is the negative log likelihood per sample of one-step innovations, what is not known of the unknowns reckoned
    in; `rmse` and `rmse_short` the root mean square of simulations over 1 s and 0.1 s by column; `effort` the residual
    of inverse dynamics by joint; `diverges` the seconds after which simulations over 1 s leave a joint's range.

    What cannot be computed is NaN, or empty; `missing` says which of them and why, as "nll cannot be computed: ...".
    """

    nll: float
    rmse: Mapping[str, float]
    rmse_short: Mapping[str, float] = field(default_factory=dict)
    effort: Mapping[str, EffortResidual] = field(default_factory=dict)
    diverges: Mapping[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """A set of recordings under three models: as given, unknowns fitted, and effects added."""

    nominal_as_given: Quality
    nominal: Quality
    corrected: Quality

    def missing(self, group: str) -> tuple[str, ...]:
        """What of it cannot be computed, and why, for a report's notes; `group` is "train" or "held_out"."""
        models = {"nominal_as_given": self.nominal_as_given, "nominal": self.nominal, "corrected": self.corrected}
        return tuple(f"fit.{group}.{name}.{why}" for name, one in models.items() for why in one.missing)


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
      noise is not as stated; `notes`: what was read, what was left out, and which figure cannot be computed (it is
      NaN here, null in a report) and why.
    - `reduced_chi_square`: χ² per whitened row before and after the explanation; noise alone gives 1.
    - `trace`: the decisions that led here, in order, see `drake_cafim.diagnosis.trace`; `cafim why` reads them.
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
    trace: tuple[Record, ...] = ()
    next_experiment: Mapping[str, object] | None = field(default=None)

    def __str__(self) -> str:
        return sentence(self)


def sentence(verdict: Verdict) -> str:
    """The verdict in words."""
    remarks = [f"{remark[0].upper()}{remark[1:]}." for remark in verdict.noise_remarks]
    return " ".join([_finding(verdict), *remarks])


def mistaken(mistakes: Sequence[str]) -> str:
    """The sentence that stands before all others where the data themselves have `mistakes`."""
    return f"The recordings themselves look wrong: {'; '.join(mistakes)}."


def _finding(verdict: Verdict) -> str:
    if verdict.data_mistakes:
        return mistaken(verdict.data_mistakes)
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
