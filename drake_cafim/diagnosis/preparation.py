"""Prepares recordings for a diagnosis: estimates their noise, finds mistakes of the data, sets up their equations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.joints.effort_noise import effort_noise, effort_notes, with_std
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.quality import qualities, surprisal
from drake_cafim.diagnosis.likelihood.efficiency import bounds
from drake_cafim.diagnosis.likelihood.finish import finish
from drake_cafim.diagnosis.noise.coloured import (
    CorrelatedNoise,
    Memory,
    estimate_memories,
    stated_memories,
    step_of,
)
from drake_cafim.diagnosis.noise.differences import correct_for_memory
from drake_cafim.diagnosis.noise.filters import notes_on_filters, without_filtered_velocities
from drake_cafim.diagnosis.noise.quantised import quantised_memories
from drake_cafim.diagnosis.noise.slow_channels import bridge_slow_channels
from drake_cafim.diagnosis.noise.stated import needed_columns, noise_of
from drake_cafim.diagnosis.notes.limits import notes_on_effort_limits, refuted_limits, without_limits
from drake_cafim.diagnosis.notes.overstated import FRICTION, ROTOR, Overstated, without_overstated
from drake_cafim.diagnosis.notes.recording_notes import (
    mistakes_of,
    notes_of,
    notes_on_limits,
    notes_on_undriven_joints,
    notes_on_unknown_joints,
)
from drake_cafim.diagnosis.output_error.errors import OutputErrors, servos_with_unknowns
from drake_cafim.diagnosis.output_error.found import Found, settled
from drake_cafim.diagnosis.output_error.problem import OutputErrorProblem
from drake_cafim.diagnosis.output_error.search import Search
from drake_cafim.diagnosis.output_error.velocities import VelocityEffects, find_velocity_effects
from drake_cafim.diagnosis.predict.forecast import Forecast, forecasts_within
from drake_cafim.diagnosis.rows.samples import moves, samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.search.search import fit_nominal
from drake_cafim.diagnosis.thresholds import EFFORT_NOISE_SETTLED, MISFIT_REDUCED_CHI_SQUARE
from drake_cafim.diagnosis.tosses.preparation import prepare_tosses
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import ChannelNoise, Quality
from drake_cafim.effects.effect import channel_unit
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.usable import check_usable
from drake_cafim.scene.driving import columns_of_servos, idle_joints
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


class PreparedRecordings(Protocol):
    """Recordings to fit and recordings held out, under the noise that was stated or estimated."""

    @property
    def scene(self) -> Scene:
        """The scene that the recordings are of."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on how the recordings were read."""
        ...

    @property
    def mistakes(self) -> tuple[str, ...]:
        """Mistakes of the data, by file and column."""
        ...

    @property
    def noise_remarks(self) -> tuple[str, ...]:
        """Sentences on noise that is not as stated."""
        ...

    @property
    def moves(self) -> bool:
        """Whether anything moves in any of the recordings by more than noise."""
        ...

    @property
    def channel_noise(self) -> Mapping[str, ChannelNoise]:
        """The noise of each column, stated or estimated."""
        ...

    def with_noise_beside(self, model: Model) -> "PreparedRecordings | None":
        """The same recordings with the noise estimated again under `model`; None where it has hardly changed."""
        ...

    def search_by_simulation(
        self, most_effects: int, progress: Callable[[str], None], trace: Trace, jobs: int = 1
    ) -> Found | None:
        """What joints lack that servos with unknown parameters drive, by simulations; None where that is not needed."""
        ...

    def with_servos_settled(self, found: Found) -> "PreparedRecordings":
        """The recordings with the priors of their servos' unknowns at what simulations tell of them."""
        ...

    @property
    def overstated(self) -> Overstated | None:
        """Friction and rotors of which the model file states far too much, unknown in the scene for that."""
        ...

    @property
    def estimated(self) -> Fit | None:
        """The nominal model with these estimated; None where they are used as stated."""
        ...

    def with_overstated_unknown(self, overstated: Overstated) -> "PreparedRecordings":
        """The recordings of the scene in which what the model file states too large is unknown."""
        ...

    def without_overstated(self) -> "PreparedRecordings":
        """The recordings as a search has them: without what the model file states far too large."""
        ...

    def problem(self) -> SearchProblem:
        """The recordings' rows, whitened under the scene's physics as given."""
        ...

    def qualities(self, models: Sequence[tuple[Model, Array]], jobs: int = 1) -> list[list[Quality]]:
        """For each model its figures of fit on the recordings, and on those held out where there are any.

        With each model stands the covariance (n, n) of its unknowns. `jobs` processes do so, -1 for one per core.
        """
        ...

    def simulated(
        self, model: Model, recordings: Sequence[int], within: tuple[float, float], horizon: float
    ) -> list[Forecast]:
        """The recordings with these numbers, simulated by `model` in those windows of `horizon` s that begin `within`.

        `within` is a begin and an end, s, the end not included. A recording without such a window has no forecast.
        """
        ...

    def surprisal(
        self, model: Model, covariance: Array, recordings: Sequence[int], within: tuple[float, float]
    ) -> float:
        """−ln likelihood of innovations, the mean over the samples `within`; NaN where it cannot be computed.

        `covariance` (n, n) is that of the unknowns.
        """
        ...

    def bounds(self, model: Model, jobs: int = 1) -> Array | NotComputable:
        """(n + k,) the least standard deviations that the recordings allow, see `likelihood.efficiency`."""
        ...

    def finished(self, fitted: Fit) -> Fit | NotComputable:
        """The fit of highest likelihood of whole recordings, see `likelihood.finish`."""
        ...


@dataclass(frozen=True)
class Layout:
    """How recordings of joints become weak forms: the noise's `std` and its memories `known` by column."""

    scene: Scene
    std: Mapping[str, float]
    known: Mapping[str, CorrelatedNoise]

    def of(self, recording: Recording) -> WeakForm:
        """The weak form of a recording without velocities that its maker filtered, or of which some are missing."""
        missing = [name for name in self.std if name.startswith("v.") and name not in recording.columns]
        std = {name: value for name, value in self.std.items() if not (missing and name.startswith("v."))}
        memories = quantised_memories(recording, std) | dict(self.known)
        recording, bridges = bridge_slow_channels(recording)
        samples = samples_of(self.scene, recording, std, memories=memories, bridges=bridges)
        return WeakForm(samples, self.scene.wrench_sensors)


@dataclass(frozen=True)
class Prepared:
    """Recordings of joints as weak forms, with notes on them."""

    scene: Scene
    weak: list[WeakForm]
    held_out: list[WeakForm]
    notes: tuple[str, ...]
    mistakes: tuple[str, ...]
    noise_remarks: tuple[str, ...]
    effort_noise: Mapping[str, float]
    """Estimated std by column of the efforts without a stated one, N m or N."""
    layout: Layout
    settled: Scene | None = None
    """The scene with the priors that a search has, where they are others: of servos' unknowns what simulations tell of
    them, of what is `overstated` that there is none."""
    overstated: Overstated | None = None
    """What the model file states far too large, and what is unknown in `scene` for that."""
    estimated: Fit | None = None
    """The nominal model with that estimated, in place of which a search has none."""

    def laid_out(self, recording: Recording) -> WeakForm:
        """Another recording of the same robot, under the same noise. Raises `InputError` where it lacks something."""
        check_usable(recording, needed_columns(self.scene))
        (own,), _ = without_filtered_velocities(self.scene, [recording])
        form = self.layout.of(own)
        return with_std(form, self.effort_noise) if self.effort_noise else form

    def with_noise_beside(self, model: Model) -> "Prepared | None":
        """The same recordings with the noise of efforts estimated again; None where it has hardly changed.

        Physics that was missing at the first estimate, and that `model` contains, may have counted as noise in part.
        """
        joints = [self.scene.tree.joint_index(column.removeprefix("u.")) for column in self.effort_noise]
        exact = [with_std(form, dict.fromkeys(self.effort_noise, 0.0)) for form in self.weak]
        noise = effort_noise(self.scene, exact, model, joints)
        if all(noise[column] >= EFFORT_NOISE_SETTLED * std for column, std in self.effort_noise.items()):
            return None
        before = effort_notes(self.scene, self.effort_noise)
        return replace(
            self,
            weak=[with_std(form, noise) for form in self.weak],
            held_out=[with_std(form, noise) for form in self.held_out],
            notes=(*(note for note in self.notes if note not in before), *effort_notes(self.scene, noise)),
            effort_noise=noise,
        )

    @property
    def channel_noise(self) -> dict[str, ChannelNoise]:
        samples, found = self.weak[0].samples, {}
        for column, std in samples.std.items():
            memory = samples.memories.get(column)
            time = memory.time if isinstance(memory, Memory) else 0.0
            unit, stated = channel_unit(column, self.scene.tree), self.scene.std(column) is not None
            found[column] = ChannelNoise(float(std), unit, time, stated)
        return found

    @property
    def moves(self) -> bool:
        """Whether any joint moves in any of the recordings by more than noise."""
        return any(moves(form.samples) for form in self.weak)

    @property
    def searched(self) -> Scene:
        """The scene whose priors a search uses."""
        return self.settled or self.scene

    def search_by_simulation(
        self, most_effects: int, progress: Callable[[str], None], trace: Trace, jobs: int = 1
    ) -> Found | None:
        """What joints lack that servos with unknown parameters drive, by simulations from their commands.

        None where no servo has unknowns, where the equations of motion are satisfied to noise, and where fewer than two
        windows are of recordings in which servos drive all these joints. Recordings in which they drive none of them
        are simulated from their efforts: what resists a free motion is told apart from the servo there.
        """
        joints = servos_with_unknowns(self.scene, self.weak)
        if not joints:
            return None
        progress("fitting the unknowns of servos to the equations of motion")
        problem, nominal = fit_nominal(self.problem(), Trace())
        problem.forget()
        if nominal.reduced_chi_square < MISFIT_REDUCED_CHI_SQUARE:
            return None
        indices = {self.scene.tree.joint_index(name) for name in joints}
        driven = tuple(form for form in self.weak if indices <= set(form.samples.commands))
        if OutputErrors(driven, joints).windows < 2:
            return None
        driven += tuple(form for form in self.weak if not indices & set(form.samples.commands))
        errors = OutputErrors(driven, joints)
        by_simulation, velocities = OutputErrorProblem(self.scene, errors, jobs=jobs), VelocityEffects()
        if most_effects:
            velocities = find_velocity_effects(self.scene, driven, joints, trace, progress)
        return Search(by_simulation, trace, progress, velocities).run(most_effects)

    def with_overstated_unknown(self, overstated: Overstated) -> "Prepared":
        """The recordings of the scene in which what the model file states too large is unknown.

        That is all its friction, if that of any joint is overstated, and the overstated rotors. The noise of efforts,
        of which they may have been a part, is estimated again.
        """
        scene = self.scene.with_stated_unknown(FRICTION in overstated.joints, overstated.joints.get(ROTOR, ()))
        prepared = replace(self, scene=scene, layout=replace(self.layout, scene=scene), overstated=overstated)
        problem = prepared.problem()
        fitted = fit(problem, problem.nominal(), tolerance=CONVERGED)
        prepared = prepared.with_noise_beside(fitted.model) or prepared
        problem = prepared.problem()
        estimated = fit(problem, fitted.model, tolerance=CONVERGED)
        estimated = replace(estimated, jacobian=estimated.jacobian[:0])
        return replace(prepared, estimated=estimated)

    def without_overstated(self) -> "Prepared":
        """The recordings as a search has them, which then finds what is there in any shape where too much is stated."""
        found = self.overstated
        return self if found is None else replace(self, settled=without_overstated(self.scene, found))

    def with_servos_settled(self, found: Found) -> "Prepared":
        """The recordings with the priors of their servos' unknowns at what simulations tell of them."""
        return replace(self, settled=settled(self.scene, found))

    def bounds(self, model: Model, jobs: int = 1) -> Array | NotComputable:
        """(n + k,) the least standard deviations that the recordings allow."""
        return bounds(self.searched, self.weak, model, jobs=jobs)

    def finished(self, fitted: Fit) -> Fit | NotComputable:
        """The fit of highest likelihood of whole recordings."""
        return finish(self.searched, self.weak, fitted)

    def problem(self) -> WeakProblem:
        """The recordings' equations, whitened under the model as given."""
        return WeakProblem.of(self.searched, self.weak, Model(self.searched.priors.mean))

    def simulated(
        self, model: Model, recordings: Sequence[int], within: tuple[float, float], horizon: float
    ) -> list[Forecast]:
        """The recordings with these numbers, simulated in those windows of `horizon` s that begin `within`."""
        return forecasts_within([self.weak[k] for k in recordings], model.physics(self.scene), horizon, within)

    def surprisal(
        self, model: Model, covariance: Array, recordings: Sequence[int], within: tuple[float, float]
    ) -> float:
        """−ln likelihood of innovations, the mean over the samples `within`; NaN where it cannot be computed."""
        return surprisal([self.weak[k] for k in recordings], self.scene, model, covariance, within)

    def qualities(self, models: Sequence[tuple[Model, Array]], jobs: int = 1) -> list[list[Quality]]:
        """For each model its figures of fit on the recordings, and on those held out where there are any.

        With each model stands the covariance (n, n) of its unknowns. `jobs` processes do so, -1 for one per core.
        """
        groups = [self.weak, self.held_out] if self.held_out else [self.weak]
        return qualities(groups, self.scene, models, jobs)


def prepare(scene: Scene, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()) -> PreparedRecordings:
    """The recordings as weak forms, or as poses of a thrown body, with the noise stated or else estimated.

    Raises `InputError` for recordings that lack what the scene needs.
    """
    scene = scene.for_recordings([*recordings, *held_out])
    if scene.tree.floating:
        return prepare_tosses(scene, recordings, held_out, (*scene.stated.notes, *notes_of(recordings)))
    for recording in (*recordings, *held_out):
        check_usable(recording, needed_columns(scene))
    scene = _orient_surfaces(scene, recordings)
    filters = notes_on_filters(scene, recordings)
    (recordings, filtered), (held_out, _) = (
        without_filtered_velocities(scene, group) for group in (recordings, held_out)
    )
    std, notes = noise_of(scene, recordings)
    notes = (*filters, *filtered, *notes)
    stated = stated_memories(scene, list(std))
    estimated = {column for column in std if scene.std(column) is None}
    from_spectra, remarks = estimate_memories(recordings, std, stated, estimated)
    known = stated | from_spectra
    std = correct_for_memory(std, known, estimated, step_of(recordings))

    layout = Layout(scene, std, known)
    even = [bridge_slow_channels(recording)[0] for recording in recordings]
    forms = [layout.of(recording) for recording in recordings]
    refuted = compute(lambda: refuted_limits(scene, recordings, forms))
    unlimited = () if isinstance(refuted, NotComputable) else refuted
    if unlimited:
        scene = _orient_surfaces(without_limits(scene, unlimited), recordings)
        layout = replace(layout, scene=scene)
    idle = {name for recording in recordings for name in idle_joints(scene, recording)}
    names = scene.tree.joint_names
    measured = [j for j, name in enumerate(names) if f"u.{name}" in estimated and name not in idle]
    noise: dict[str, float] = {}
    if measured:
        # the noise of efforts is estimated from the residual of the equations, set up first with exact efforts
        noise = effort_noise(scene, forms, Model(scene.priors.mean), measured)
        std, notes = std | noise, (*notes, *effort_notes(scene, noise))
        layout = replace(layout, std=std)
        forms = [layout.of(recording) for recording in recordings]
    return Prepared(
        scene,
        forms,
        [layout.of(recording) for recording in held_out],
        (
            *scene.stated.notes,
            *notes,
            *notes_of(even, columns_of_servos(scene)),
            *notes_on_unknown_joints(scene, recordings),
            *notes_on_undriven_joints(scene, recordings),
            *notes_on_effort_limits(scene, recordings, unlimited),
            *notes_on_limits(scene, recordings, std),
            *(f"held out: {mistake}" for mistake in mistakes_of(scene, held_out, std)),
        ),
        mistakes_of(scene, recordings, std),
        remarks,
        noise,
        layout,
    )


def _orient_surfaces(scene: Scene, recordings: Sequence[Recording]) -> Scene:
    """The scene with each contact plane on the side on which the first recording starts."""
    q = recordings[0].matrix("q", scene.tree.joint_names)
    return scene.with_surfaces_at(q[np.flatnonzero(np.all(np.isfinite(q), axis=1))[0]])
