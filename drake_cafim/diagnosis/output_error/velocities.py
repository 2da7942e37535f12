"""What the sensors of velocities do beside a search by simulations: measured velocities against measured positions.

A servo may report its velocity late or filtered. For each test function w of `Windows` and each joint, without that

    ∫ ẇ q dt + ∫ w v dt = 0

but for noise, whatever drives the joint (the kinematic rows of `weak_form`). These are the errors here, of which
effects on the velocities are found as effects at joints are of errors of simulations.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.output_error import decisions
from drake_cafim.diagnosis.output_error.comparison import Comparison
from drake_cafim.diagnosis.output_error.errors import BLOCKS
from drake_cafim.diagnosis.output_error.growth import Growth
from drake_cafim.diagnosis.output_error.likelihood import TINY, ErrorLikelihood
from drake_cafim.diagnosis.output_error.moves import Moves
from drake_cafim.diagnosis.output_error.problem import ErrorProblem, number_name
from drake_cafim.diagnosis.rows.kinematic_rows import KinematicRows, lags_of
from drake_cafim.diagnosis.rows.measurement import corrected_measurement
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import NAMED_EXCESS_SHARE, NOISE_STD_TOLERANCE
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Indices

MOST_ROUNDS = 3
"""Most effects of one sensor."""
LENGTH = 1.0
"""s of rows that are compared with others to count how many are independent."""


@dataclass(frozen=True)
class VelocityEffects:
    """Effects of sensors of velocities, stds of their strengths, their probability, and what explains the same."""

    effects: tuple[Effect, ...] = ()
    std: Mapping[Key, Array] = field(default_factory=dict)
    probability: Mapping[Key, float] = field(default_factory=dict)
    rivals: Mapping[Key, float] = field(default_factory=dict)


@dataclass
class VelocityErrors:
    """Kinematic rows (S, c) of the recordings `forms`, which measure velocities; `joints` (c) are their channels v.

    The other fields are as those of `OutputErrors`.
    """

    forms: tuple[WeakForm, ...]
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        blocks, windows, first = [], [], 0
        for k, form in enumerate(self.forms):
            at = form.samples.windows.centers - form.samples.time[0]
            lasting = form.samples.time[-1] - form.samples.time[0]
            blocks.append(BLOCKS * k + np.minimum((BLOCKS * at / lasting).astype(np.int64), BLOCKS - 1))
            windows.append(first + (at / LENGTH).astype(np.int64))
            first += int(lasting / LENGTH) + 1
        self.block: Indices = np.concatenate(blocks)
        self.window: Indices = np.concatenate(windows)
        self.likelihood = ErrorLikelihood(np.full(len(self.joints), float(len(self.window))))
        self._rows = [KinematicRows(form.samples) for form in self.forms]

    def of(self, physics: Physics) -> Array:
        """The rows (S, c) under the sensor effects of `physics`."""
        names = physics.tree.joint_names
        columns = [names.index(joint.removeprefix("v.")) for joint in self.joints]
        lags = lags_of(physics.sensors)
        others = replace(physics, sensors=tuple(effect for effect in physics.sensors if effect not in lags))
        found = []
        for form, rows in zip(self.forms, self._rows, strict=True):
            measured = corrected_measurement(form.samples, form.sensors, others)
            q, v, louder = rows.compared(lags, names, measured.q, measured.v)
            windows = form.samples.windows
            found.append(((windows.rate @ q + windows.velocity @ v) * louder)[:, columns])
        return np.concatenate(found)

    def over_noise(self, found: Array) -> Array:
        """(c,) mean of rows² (S, c) over their variance by the noise of q and v."""
        variances = []
        for joint in self.joints:
            own = joint.removeprefix("v.")
            variances.append(np.concatenate([rows.variance(own) for rows in self._rows]))
        ratio = np.mean(found**2 / np.maximum(np.stack(variances, axis=1), TINY), axis=0)
        return np.asarray(ratio, dtype=float)

    def finely(self) -> "VelocityErrors":
        """The same errors, counted apart."""
        return copy(self)

    def count(self, found: Array) -> None:
        """The likelihood is that of errors as independent as `found` (S, c) from now on."""
        self.likelihood = ErrorLikelihood.of(found, self.window)


def find_velocity_effects(
    scene: Scene, forms: Sequence[WeakForm], joints: Sequence[str], trace: Trace, progress: Callable[[str], None]
) -> VelocityEffects:
    """What the sensors of the velocities of `joints` do; nothing where a recording measures none of them."""
    channels = tuple(f"v.{joint}" for joint in joints if all(f"v.{joint}" in form.samples.std for form in forms))
    if not channels or not all(form.samples.velocity_measured for form in forms):
        return VelocityEffects()
    progress("comparing measured velocities with positions")
    problem = ErrorProblem(scene, VelocityErrors(tuple(forms), channels))
    moves = Moves(problem, tuple(tuple(_hypotheses(scene, channel)) for channel in channels), _excludes)
    growth, comparison = Growth(moves, trace), Comparison(moves, trace)
    best = problem.counted(problem.fit(Model(scene.priors.mean), steps=0))
    for _ in range(MOST_ROUNDS):
        grown = growth.grow(best)
        if grown is None:
            break
        # kinks of the motion between samples leave more than noise, too, of which any effect takes a small part
        removed = dict(zip(channels, _shares_removed(problem.errors, best.errors, grown.errors), strict=True))
        known, kept = best.model.keys, list[Effect]()
        for effect in grown.model.effects:
            if effect.key in known:
                kept.append(effect)
                continue
            trace.add(decisions.record_share_of_excess(effect.key, removed[effect.at], NAMED_EXCESS_SHARE))
            if removed[effect.at] >= NAMED_EXCESS_SHARE:
                kept.append(effect)
        if len(kept) == len(known):
            break
        best = problem.counted(problem.fit(replace(grown.model, effects=tuple(kept))))
    best = problem.fit(comparison.of(growth.prune(best)).model)
    std: dict[Key, Array] = {}
    for names, system in zip(best.names, best.equations, strict=True):
        own = dict(zip(names, system.std.tolist(), strict=True))
        for effect in best.model.effects:
            numbers = [number_name(effect, strength.name) for strength in effect.strengths]
            if set(numbers) <= set(own):
                std[effect.key] = np.array([own[name] for name in numbers])
    present = best.model.keys
    return VelocityEffects(
        best.model.effects,
        std,
        comparison.probability,
        {key: share for key, share in comparison.rivals.items() if key not in present},
    )


def _shares_removed(errors: VelocityErrors, before: Array, after: Array) -> list[float]:
    """By channel, the share of what rows (S, c) have beyond noise that is gone after a change.

    Noise is no more than what is left `after`; its σ may be understated by `NOISE_STD_TOLERANCE`.
    """
    was, left = errors.over_noise(before), errors.over_noise(after)
    beyond = was - np.minimum(left, (1.0 + NOISE_STD_TOLERANCE) ** 2)
    shares = np.where(beyond > 0.0, (was - left) / np.where(beyond > 0.0, beyond, 1.0), 0.0)
    return [float(share) for share in shares]


@dataclass(frozen=True)
class _Late(ByKind[bool]):
    """Whether an effect makes a sensor late."""

    def other(self, effect: Effect) -> bool:
        return False

    def sensor(self, effect: SensorEffect) -> bool:
        return effect.late


def _excludes(law: Effect, present: Effect) -> bool:
    """Whether a law cannot act beside one that is present; a sensor is late in one way."""
    late = _Late()
    return law.excludes(present) or (law.at == present.at and late(law) and late(present))


def _hypotheses(scene: Scene, channel: str) -> list[Effect]:
    """The effects of the vocabulary on a channel that the scene does not state."""
    where = Surroundings(scene.tree, scene.physics.contacts, (channel,))
    stated = {effect.key for effect in (*scene.of_model, *scene.known)}
    effects = [kind(at) for kind in scene.vocabulary for at in kind.attachments(where) if at == channel]
    return [effect for effect in effects if effect.key not in stated]
