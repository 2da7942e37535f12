"""The result of a diagnosis as plain data, from which a report is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from drake_cafim.diagnosis.trace import Record
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.learned_force import LearnedForce
from drake_cafim.numerics.rounding import listed, rounded, short
from drake_cafim.scene.scene import Scene

Kind = Literal["none", "explained", "unexplained"]

TOLD_TOGETHER = 3
"""Least number of places of one kind of effect that the sentence tells together."""


@dataclass(frozen=True)
class Location:
    """A place where recordings and model differ: a joint, body, contact, sensor or the environment, and when."""

    kind: str
    name: str
    share: float
    """Share of the whole excess of χ² over noise; shares sum to at most 1."""
    intervals: tuple[tuple[float, float], ...] = ()
    """s, in the recording's own time."""
    recording: str | None = None
    where: str = ""
    """The condition under which it shows, in words, as "near v.elbow = 0"."""


@dataclass(frozen=True)
class Mismatch:
    """Whether recordings and model differ, the p-value, and where; under `unexplained`, what remains."""

    detected: bool
    p_value: float
    """Corrected for the number of hypotheses that were tested."""
    locations: tuple[Location, ...] = ()
    """A push that is named adds its own, with share 0 where the verdict is `unexplained`."""

    @property
    def standing(self) -> tuple[Location, ...]:
        """The locations with a share above 0: those of what is not explained."""
        return tuple(location for location in self.locations if location.share > 0.0)


@dataclass(frozen=True)
class Value:
    """A value with its standard deviation; `std` is None for a choice, such as a side."""

    value: float
    std: float | None
    unit: str
    efficiency: float | None = None
    """The information that `std` claims over that of the likelihood of the recordings; None where it is not known."""


@dataclass(frozen=True)
class Explanation:
    """An accepted effect, with the probability that it is among what is missing."""

    effect: Effect
    probability: float
    values: Mapping[str, Value]
    sentence: str
    cuts: float | None = None
    """Share of the cuts of the recordings that name it; None where they were not cut."""


@dataclass(frozen=True)
class Rival:
    """An effect that the data cannot distinguish from an accepted one, and why the two look alike.

    Or an unknown `parameter` of the scenario, which would be far from its prior; then `effect` is None.
    """

    effect: str | None
    at: str
    probability: float
    why_alike: str
    parameter: str | None = None

    @property
    def key(self) -> tuple[str, str]:
        """The effect's or the parameter's name, and its place."""
        return self.effect or self.parameter or "", self.at


@dataclass(frozen=True)
class NominalParameter:
    """An unknown parameter of the scenario as fitted together with the accepted effects, and its prior."""

    parameter: str
    at: str
    value: float
    std: float
    unit: str
    prior_mean: float
    prior_std: float
    effect: str | None = None
    """For a parameter of an effect that the scenario states: the effect's name."""
    together: float | None = None
    """Of unknown inertials, which have one prior together: the distance of all ten, at the mass; at the others 0."""
    efficiency: float | None = None
    """As of a `Value`."""

    @property
    def distance(self) -> float:
        """|value − mean|/std by its prior."""
        return abs(self.value - self.prior_mean) / self.prior_std if self.together is None else self.together

    @property
    def key(self) -> tuple[str, str, str | None]:
        """Identifies it among the scenario's unknowns."""
        return self.parameter, self.at, self.effect


@dataclass(frozen=True)
class ChannelNoise:
    """The noise of one sample of a column under which the recordings were read.

    `std` is in `unit`; `correlation_time` is in s, 0 for white noise; `stated` says whether the scenario states the
    std, else it was estimated from the recordings.
    """

    std: float
    unit: str
    correlation_time: float = 0.0
    stated: bool = True


@dataclass(frozen=True)
class EffortResidual:
    """A joint's residual of inverse dynamics, both sides low-passed without phase lag at `cutoff` Hz.

    `rms` is in N m (N); `relative` is rms over the rms of the joint's effort, None where that effort is zero.
    """

    rms: float
    relative: float | None
    cutoff: float


@dataclass(frozen=True)
class Quality:
    """A model's figures of fit on some recordings.

    `nll` is the negative log likelihood per sample of one-step innovations, with the uncertainty of the fitted unknowns
    included; `rmse` and `rmse_short` are the root mean square errors of simulations over 1 s and 0.1 s by column;
    `effort` is the residual of inverse dynamics by joint; `diverges` the seconds after which simulations over 1 s leave
    a joint's range: then the errors of all models that are compared are of the samples before that.

    A figure that cannot be computed is NaN or empty; `missing` says which and why, as "nll cannot be computed: ...".
    """

    nll: float
    rmse: Mapping[str, float]
    rmse_short: Mapping[str, float] = field(default_factory=dict)
    effort: Mapping[str, EffortResidual] = field(default_factory=dict)
    diverges: Mapping[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """The quality of three models on the same recordings: as given, with unknowns fitted, and corrected.

    `named` is that of the corrected one without its learned laws, None where it has none.
    """

    nominal_as_given: Quality
    nominal: Quality
    corrected: Quality
    named: Quality | None = None

    def missing(self, group: str) -> tuple[str, ...]:
        """Notes on each figure that cannot be computed, and why; `group` is "train" or "held_out"."""
        models = {"nominal_as_given": self.nominal_as_given, "nominal": self.nominal, "corrected": self.corrected}
        models |= {} if self.named is None else {"named": self.named}
        return tuple(f"fit.{group}.{name}.{why}" for name, model in models.items() for why in model.missing)


@dataclass(frozen=True)
class LeftOut:
    """A named effect that is not in the corrected scene, and why; the evidence that names it stands."""

    effect: str
    at: str
    why: str

    @property
    def key(self) -> tuple[str, str]:
        """The effect's name and its place."""
        return self.effect, self.at


@dataclass(frozen=True)
class Learned:
    """A law without a name, and in words what it looks like."""

    law: LearnedForce
    words: str


@dataclass(frozen=True)
class Correction:
    """What of the findings the corrected scene contains: that which predicts left-out training parts better."""

    as_given: bool = False
    """Whether it is the scene as given, with none of them."""
    left_out: tuple[LeftOut, ...] = ()
    unknowns_held: str = ""
    """Why its unknowns keep the values given; empty where they have the fitted ones, or where there are none."""


@dataclass(frozen=True)
class Verdict:
    """The result of a diagnosis; `str(verdict)` is its summary sentence.

    - `kind`: "none", the recordings are as model and noise predict; "explained", the residual under the accepted
      effects is as the noise predicts; "unexplained", something remains that is not named.
    - `mismatch`: whether anything differs (`detected`, `p_value`), and its `locations`, strongest first: `kind`,
      `name`, `share` of the excess over noise, `intervals` in s of `recording`, and `where` in words. A push that is
      named adds a location: its body, over its interval.
    - `explanation`: the accepted effects, by probability: `effect.name`, `effect.at`, `probability`, `sentence`, and
      `values`, by parameter its `value`, `std` and `unit` (SI).
    - `rivals`: effects that the data cannot distinguish from these: `effect`, `at`, `probability`, `why_alike`; or an
      unknown `parameter` that would be far from its prior.
    - `parameters`: the scenario's unknowns as fitted: `parameter`, `at`, `value`, `std`, `unit`, and their priors.
    - `train` and `held_out` (None where nothing was held out): three models compared, `nominal_as_given`, `nominal`
      with the unknowns fitted and `corrected` with the effects too. Each has `nll`, of one-step innovations a sample,
      and `rmse`, of simulations over 1 s, by column and in its unit.
    - `corrected`: the scene with those of the accepted effects and fitted unknowns that predict training recordings
      that were left out better; `correction` says what is not in it, and why.
    - `learned`: laws without a name that it contains besides, each with `words` on what it looks like.
    - `data_mistakes`: mistakes of the recordings themselves; `noise_remarks`: where the noise is not as stated;
      `overstated`: what the model file states far too large, and at which joints; `notes`: what was read and left out,
      which figure cannot be computed (NaN here, null in a report) and why.
    - `noise`: by column the std of one sample, stated or estimated, in SI units.
    - `reduced_chi_square`: χ² per whitened row before and after the explanation; noise alone gives 1.
    - `trace`: the decisions that led to this verdict, in order, as `drake_cafim.diagnosis.trace.Record`; `cafim why`
      prints them.
    - `far`: those of `parameters` more than three standard deviations from their priors, each a mismatch at its place;
      `adequate`: whether they and `overstated` are all that is wrong, and what is left is as the noise predicts.
    - `next_experiment`: the motion that would best tell the rivals apart, None until one has been designed.
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
    overstated: Mapping[str, Sequence[str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    reduced_chi_square: tuple[float, float] = (0.0, 0.0)
    trace: tuple[Record, ...] = ()
    next_experiment: Mapping[str, object] | None = field(default=None)
    far: tuple[NominalParameter, ...] = ()
    adequate: bool = False
    noise: Mapping[str, ChannelNoise] = field(default_factory=dict)
    correction: Correction = field(default_factory=Correction)
    learned: tuple[Learned, ...] = ()

    @property
    def changed(self) -> bool:
        """Whether there are effects or learned laws to show beside the nominal model."""
        return bool(self.explanation or self.learned)

    @property
    def unknown_values(self) -> dict[tuple[str, str, str | None], float]:
        """The values of `parameters` by parameter, place and effect."""
        return {parameter.key: parameter.value for parameter in self.parameters}

    def __str__(self) -> str:
        return sentence(self)


def sentence(verdict: Verdict) -> str:
    """The verdict in words, followed by what the corrected scene lacks of it, and by the remarks on noise."""
    remarks = [f"{remark[0].upper()}{remark[1:]}." for remark in verdict.noise_remarks]
    return " ".join(filter(None, [_finding(verdict), *_overstated(verdict), *_correction(verdict), *remarks]))


def _overstated(verdict: Verdict) -> list[str]:
    """A sentence on friction and rotor inertia of which the model file states far too much, if it does."""
    words = "The model file states far more {} at {} than the recordings show; {}."
    friction, rotor = "all that it states is left out, and looked for anew", "it is estimated, if there is any"
    told = {} if verdict.data_mistakes else verdict.overstated
    return [words.format(kind, listed(at), friction if kind == "friction" else rotor) for kind, at in told.items()]


def _correction(verdict: Verdict) -> list[str]:
    """A sentence on what was found and is not in the corrected scene; none where all is."""
    correction = verdict.correction
    learned = [f"Learned without a name: {_learned(verdict.learned)}."] if verdict.learned else []
    if correction.as_given and (verdict.explanation or verdict.parameters):
        return ["The corrected scene is the one given: nothing predicts left-out parts better by error and likelihood."]
    left_out = dict[str, list[str]]()
    for left in correction.left_out:
        left_out.setdefault(left.effect.replace("_", " "), []).append(left.at)
    named = " and ".join(f"{effect} at {listed(at)}" for effect, at in left_out.items())
    parts = ", ".join(filter(None, [named, "the unknown parameters as fitted" * bool(correction.unknowns_held)]))
    missing = f"Not in the corrected scene, since left-out recordings are not predicted better: {parts}."
    return [missing, *learned] if parts else learned


def _learned(laws: Sequence[Learned]) -> str:
    few = len(laws) < TOLD_TOGETHER
    return "; ".join(law.words for law in laws) if few else f"a force each at {listed([law.law.at for law in laws])}"


def mistakes_sentence(mistakes: Sequence[str]) -> str:
    """The sentence on `mistakes` of the data, which replaces every other finding."""
    return f"The recordings themselves look wrong: {'; '.join(mistakes)}."


def _finding(verdict: Verdict) -> str:
    """What is missing in the model, or which mistake of the data makes that question void."""
    if verdict.data_mistakes:
        return mistakes_sentence(verdict.data_mistakes)
    if verdict.kind == "none":
        return (
            "Nothing is missing: the recordings are as the model and its noise predict "
            f"(p = {rounded(verdict.mismatch.p_value, 2)})."
        )
    named = _spoken(verdict.explanation)
    if verdict.kind == "explained":
        return f"The model lacks {named}. With that, what remains is noise."
    far = " ".join(map(far_sentence, verdict.far))
    if verdict.adequate:
        return f"The model lacks {named}. {far}".rstrip() if named else far
    rest = ", ".join(dict.fromkeys(location.name for location in verdict.mismatch.standing[:3]))
    remains = (
        f"Something more is there, at {rest}, that is not named."
        if rest
        else "Something more is there that is not named."
    )
    before, after = verdict.reduced_chi_square
    if named:
        # what remains unnamed at one joint may be more under the noise of the named physics than without it
        taken = f" That takes the misfit from {rounded(before)} to {rounded(after)} times the noise variance."
        return f"The model lacks {named}.{taken if after < before else ''} {remains} {far}".rstrip()
    differ = f"The recordings differ from the model by {rounded(before)} times the noise variance, and"
    if verdict.rivals:
        laws = ", ".join(f"{(r.effect or r.parameter or '').replace('_', ' ')} at {r.at}" for r in verdict.rivals[:3])
        return f"{differ} they do not tell which of several laws explains it, as {laws}. {far}".rstrip()
    return f"{differ} no known effect explains it. {remains} {far}".rstrip()


def _spoken(explanation: Sequence[Explanation]) -> str:
    """The effects, their places and their parameters, "joint spring at a, b and c (stiffness 0.2 to 0.3 N m/rad)".

    Effects of one kind follow each other, in the order in which the first of each comes.
    """
    kinds: dict[str, list[Explanation]] = {}
    for found in explanation:
        kinds.setdefault(found.effect.name, []).append(found)
    return "; ".join(
        _together(of_kind) if len(of_kind) >= TOLD_TOGETHER else "; ".join(found.sentence for found in of_kind)
        for of_kind in kinds.values()
    )


def _together(of_kind: Sequence[Explanation]) -> str:
    """Effects of one kind, with the range of each parameter."""
    first = of_kind[0]
    ranges = []
    for name, value in first.values.items():
        if value.std is None:
            continue
        numbers = [found.values[name].value for found in of_kind]
        low, high = short(min(numbers)), short(max(numbers))
        size = low if low == high else f"{low} to {high}"
        ranges.append(f"{name.replace('_', ' ')} {size} {value.unit}".removesuffix(" 1"))
    at = listed([found.effect.at for found in of_kind])
    return f"{first.effect.name.replace('_', ' ')} at {at} ({', '.join(ranges)})"


def far_sentence(found: NominalParameter) -> str:
    """A parameter that is far from its prior, as a sentence."""
    if found.together is not None:
        return (
            f"The inertials of {found.at} (mass {found.value:.4g} {found.unit}) are {found.together:.2g} standard "
            f"deviations from the model's (mass {found.prior_mean:.4g} {found.unit}): the model or its stated std is "
            "wrong, or physics is missing there that looks like it."
        )
    unit = "" if found.unit == "1" else f" {found.unit}"
    return (
        f"{found.parameter.replace('_', ' ').capitalize()} of {found.at} is {found.value:.4g}{unit}, "
        f"{found.distance:.2g} standard deviations from the {found.prior_mean:.4g}{unit} of its prior: "
        "the prior is wrong, or physics is missing there that looks like it."
    )
