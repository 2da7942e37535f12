"""The samples of one recording for the weak form: measured and smoothed motion, efforts, wrenches, and their noise."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.noise.coloured import CorrelatedNoise, drawn
from drake_cafim.diagnosis.noise.slow_channels import Bridges
from drake_cafim.diagnosis.rows.filtered_windows import FilteredWindows, reach_of
from drake_cafim.diagnosis.rows.law_points import LawPoints
from drake_cafim.diagnosis.rows.position_smoothing import Track, track_of
from drake_cafim.diagnosis.rows.test_functions import Windows, lay_windows
from drake_cafim.diagnosis.rows.velocity_smoothing import Noise, Velocity, VelocityNoise, near_rest, resting
from drake_cafim.diagnosis.thresholds import (
    END_MARGIN,
    MOTION_NOISE_STDS,
    VELOCITY_SMOOTHING_REACH,
    WINDOW_WIDTH,
)
from drake_cafim.errors import InputError
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.schema import Lowpass
from drake_cafim.scene.driving import RAMPED, Command, commands_of, driven_by_servo, with_idle_efforts
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class EstimatedMotion:
    """Estimated positions `q` and velocities `v` (N, n), and their standard deviations `q_std`, `v_std`, SI units.

    Joint laws are integrated over `points`. `beyond` (N, n) is what the velocity has beyond the derivative of the
    positions between samples, where velocities are not measured.
    """

    q: Array
    v: Array
    q_std: Array
    v_std: Array
    beyond: Array | None
    points: LawPoints
    missed_q: Array
    missed_v: Array
    """(N, n): what the motion has beyond that which sensor effects, undone, make of the recorded channels."""
    unmodelled_force: Array
    """(n,) largest density of white forces at the joints that no model knows, (N m)² s or N² s, within its accuracy."""
    bend: Array
    """(N − 1, n): what the model's acceleration, its efforts' left out, changes over each sample interval."""


@dataclass(frozen=True)
class Samples:
    """The measured channels of one recording, with the linear operators that smooth and integrate them.

    `q`, `u` are (N, n); `v` (N, n) is measured, or is `differentiate @ q` where `differentiate` (N, N) is not None;
    `wrenches` has (N, 6) for each sensor: force, moment. `smooth_q` is (N, N).
    """

    recording: Recording
    time: Array
    q: Array
    v: Array
    u: Array
    wrenches: tuple[Array, ...]
    std: dict[str, float]
    """Standard deviation of one sample by column, SI units."""
    windows: Windows
    smooth_q: sp.csr_matrix
    smooth_v: tuple[Velocity, ...]
    """Each joint's smoother of v for the nonlinear factors of the equations of motion."""
    kinked_v: tuple[Velocity, ...]
    """Each joint's smoother of v for force laws, which may have a kink at rest."""
    differentiate: sp.csr_matrix | None
    ramped: tuple[bool, ...]
    """For each joint True where its effort is linear from sample to sample, False where it is held."""
    memories: Mapping[str, CorrelatedNoise] = field(default_factory=dict)
    """Correlation models by column; a column that is not in it has white noise."""
    bridges: Bridges = field(default_factory=dict)
    """Interpolation matrices (N, N) of the columns that are sampled more slowly than the others."""
    commands: Mapping[int, Command] = field(default_factory=dict)
    """The commands of the joints that a servo drives, by the joint's index; `u` is then what acts beside the servo."""
    estimated: EstimatedMotion | None = None
    """How well q and v are known where they are estimated by `adjust`, rather than measured."""

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Each joint's smoothed position for contact states that depend on the past."""
        return tuple(self._track(name.removeprefix("q.")) for name in self.std if name.startswith("q."))

    def _track(self, joint: str) -> Track:
        q, v = f"q.{joint}", f"v.{joint}"
        # without measured velocities the position alone is smoothed; interpolated channels have no independent noise
        # between their samples by which windows could be compared
        std_v = self.std[v] if self.velocity_measured else 0.0
        widest = q in self.bridges or v in self.bridges
        return track_of(self.time, self.std[q], std_v, self.memories.get(q), self.memories.get(v), widest)

    @cached_property
    def v_std(self) -> Array:
        """(N, n) standard deviation of the velocities at which force laws are evaluated."""
        if self.estimated is not None:
            return self.estimated.v_std
        return np.stack([smoother.std for smoother in self.kinked_v], axis=1)

    @property
    def law_value(self) -> sp.csr_matrix:
        """(M, P) matrix of ∫ w f dt from the values f (P,) of a joint law at the points of its integration."""
        return self.windows.value if self.estimated is None else self.estimated.points.value

    @property
    def velocity_measured(self) -> bool:
        """Whether v was recorded, rather than differentiated from q."""
        return self.differentiate is None


def over_wider_windows(samples: Samples, times: float) -> Samples | None:
    """The samples with windows `times` as wide, over the samples covered before; None where fewer than three fit."""
    windows = samples.windows
    covered = np.zeros(len(samples.time), dtype=bool)
    for first, stop in zip(windows.first, windows.stop, strict=True):
        covered[first:stop] = True
    wide = lay_windows(samples.time, covered, times * windows.width)
    if isinstance(windows, FilteredWindows):
        wide = FilteredWindows.of(wide, windows.lowpass)
    return replace(samples, windows=wide) if len(wide) >= 3 else None


def add_effort_noise(samples: Samples, rng: np.random.Generator) -> Samples:
    """The samples with another realisation of the noise of measured efforts added."""
    names = [name.removeprefix("q.") for name in samples.std if name.startswith("q.")]
    columns = [f"u.{name}" for name in names]
    noise = [samples.std[column] * drawn(rng, samples.time, samples.memories.get(column)) for column in columns]
    u = samples.u + np.stack(noise, axis=1)
    written = {column: u[:, j] for j, column in enumerate(columns) if j not in samples.commands}
    recording = replace(samples.recording, columns={**samples.recording.columns, **written})
    return replace(samples, recording=recording, u=u)


def with_recording(samples: Samples, scene: Scene, recording: Recording, laws: bool = True) -> Samples:
    """The samples of another `recording` that has the same times and the same noise; operators are shared.

    So are the smoothers of joints that move in both alike; and of all joints where no force `laws` are evaluated.
    """
    names, slope = scene.tree.joint_names, samples.differentiate
    q = _filled(recording.matrix("q", names))
    v = _filled(recording.matrix("v", names)) if slope is None else np.asarray(slope @ q, dtype=float)
    noise = _velocity_noise(names, samples.std, samples.memories, slope is None)
    return replace(
        samples,
        recording=recording,
        q=q,
        v=v,
        kinked_v=tuple(
            samples.kinked_v[j]
            if not laws or (np.array_equal(q[:, j], samples.q[:, j]) and np.array_equal(v[:, j], samples.v[:, j]))
            else resting(samples.time, q[:, j], v[:, j], of_joint)
            for j, of_joint in enumerate(noise)
        ),
        u=_filled(with_idle_efforts(scene, recording).matrix("u", names)),
        wrenches=tuple(_filled(recording.wrench(sensor.name)) for sensor in scene.wrench_sensors),
        commands=_filled_commands(commands_of(scene, recording, [names[j] for j in samples.commands])),
    )


def samples_of(
    scene: Scene,
    recording: Recording,
    std: dict[str, float],
    width: float = WINDOW_WIDTH,
    memories: Mapping[str, CorrelatedNoise] | None = None,
    bridges: Bridges | None = None,
) -> Samples:
    """The samples of `recording` for `scene`, with the noise's `std` and correlation `memories` by column.

    `width` s is that of the windows (at least 12 median sampling times); `bridges` are the interpolation matrices of
    slow channels, by column.

    Raises `InputError` when a needed column is missing, or fewer than three windows fit between the recording's gaps.
    """
    names = scene.tree.joint_names
    driven = driven_by_servo(scene, recording)
    q = recording.matrix("q", names)
    u = with_idle_efforts(scene, recording).matrix("u", names)
    time = recording.time
    # velocities that not every recording has have no noise here: then the positions tell them in all of these
    measured = all(f"v.{name}" in recording.columns and f"v.{name}" in std for name in names)
    lowpass, period = effort_filter(scene), float(np.median(np.diff(time)))
    if lowpass and not lowpass.cutoff < 0.5 / period:
        raise InputError(
            f"{scene.name}: the cutoff {lowpass.cutoff:g} Hz of u is not below half the rate of {recording.name}, "
            f"{0.5 / period:.4g} Hz, expected a lowpass with the cutoff of the filter that was applied"
        )
    if lowpass and lowpass.cutoff * recording.duration < 1.0:
        raise InputError(
            f"{scene.name}: the cutoff {lowpass.cutoff:g} Hz of u has a longer period than {recording.name} lasts, "
            f"{recording.duration:.4g} s, expected a lowpass with the cutoff of the filter that was applied"
        )
    # a window narrower than the filter's response says nothing more, and its rows are hardly independent
    width = max(width, 12.0 * period, 1.0 / lowpass.cutoff if lowpass else 0.0)
    v = recording.matrix("v", names) if measured else np.zeros_like(q)
    wrenches = tuple(recording.wrench(sensor.name) for sensor in scene.wrench_sensors)
    usable = np.all(np.isfinite(np.concatenate([q, v, u, *wrenches], axis=1)), axis=1)
    commands = commands_of(scene, recording, driven)
    for command in commands.values():
        usable &= np.isfinite(command.position) & np.isfinite(command.gain) & np.isfinite(command.supply)
    q, v, u = _filled(q), _filled(v), _filled(u)
    wrenches = tuple(_filled(wrench) for wrench in wrenches)
    smooth_q = local_polynomial(time, VELOCITY_SMOOTHING_REACH, 2, 0, at_least=2)
    differentiate = None
    if not measured:
        differentiate = local_polynomial(time, 0.0, 6, 1, at_least=3)
        v = differentiate @ q
    memories = dict(memories or {})
    noise = _velocity_noise(names, std, memories, measured)
    usable &= (time >= time[0] + END_MARGIN) & (time <= time[-1] - END_MARGIN)
    usable = _away_from(~usable, smooth_q)
    if lowpass:
        usable = _beyond_response(usable, reach_of(lowpass, 1.0 / period))
    windows = lay_windows(time, usable, width)
    if len(windows) < 3:
        _refuse_other_stamps(recording, scene)
        raise InputError(
            f"{recording.name}: only {len(windows)} windows of {width:.3g} s fit between its gaps, expected at least 3"
        )
    return Samples(
        recording,
        time,
        q,
        v,
        u,
        wrenches,
        std,
        FilteredWindows.of(windows, lowpass) if lowpass else windows,
        smooth_q,
        tuple(Velocity.over(VELOCITY_SMOOTHING_REACH, time, of_joint) for of_joint in noise),
        near_rest(time, q, v, noise),
        differentiate,
        tuple((channel := scene.channel(f"u.{name}")) is not None and channel.hold == RAMPED for name in names),
        memories,
        dict(bridges or {}),
        _filled_commands(commands),
    )


def effort_filter(scene: Scene) -> Lowpass | None:
    """The filter that the maker of the recordings applied to all efforts; None where there is none.

    Raises `InputError` where the efforts of the joints were filtered in different ways.
    """
    filters = {name: scene.channel(f"u.{name}") for name in scene.tree.joint_names}
    found = {name: channel.lowpass if channel is not None else None for name, channel in filters.items()}
    if len(set(found.values())) > 1:
        item, *others = found
        other = next(name for name in others if found[name] != found[item])
        raise InputError(
            f"{scene.name}: the efforts of {item} and {other} are filtered differently (channels: u: lowpass), "
            "expected one filter of all joints, as the equations of the joints are filtered together"
        )
    return next(iter(found.values()), None)


def moves(samples: Samples) -> bool:
    """Whether a joint's position, or its measured velocity, scatters by more than its noise does."""
    kinds = ("q.", "v.") if samples.velocity_measured else ("q.",)
    columns = [name for name in samples.std if name.startswith(kinds)]
    spread = {name: float(np.nanstd(samples.recording[name])) for name in columns}
    return any(spread[name] > MOTION_NOISE_STDS * samples.std[name] for name in columns)


def _refuse_other_stamps(recording: Recording, scene: Scene) -> None:
    """Raises `InputError` where two columns have values in less than half of the rows together.

    Columns of topics with time stamps of their own are like that.
    """
    needed = [f"{kind}.{name}" for kind in "qvu" for name in scene.tree.joint_names]
    needed += [f"wrench.{sensor.name}.{axis}" for sensor in scene.wrench_sensors for axis in WRENCH_COMPONENTS]
    written = {column: np.isfinite(recording[column]) for column in needed if column in recording.columns}
    rows = len(recording.time)
    pairs = list(itertools.combinations(written, 2))
    both = [int(np.sum(written[first] & written[second])) for first, second in pairs]
    fewest = int(np.argmin(both))
    if both[fewest] < 0.5 * rows:
        first, second = pairs[fewest]
        raise InputError(
            f"{recording.name}: {first} and {second} have values together in only {both[fewest]} of {rows} rows, as "
            "topics with different time stamps or rates do; give `join:` for one of them in `topics:`, or resample "
            "with `cafim import --period`"
        )


def _velocity_noise(
    names: Sequence[str], std: Mapping[str, float], memories: Mapping[str, CorrelatedNoise], measured: bool
) -> list[VelocityNoise]:
    """The noise of each joint's positions and velocities."""

    def noise(column: str) -> Noise:
        return Noise(std[column], memories.get(column))

    return [VelocityNoise(noise(f"q.{name}"), noise(f"v.{name}") if measured else None) for name in names]


def _filled(values: Array) -> Array:
    """`values` (N, k) with missing samples replaced by the last one before; windows never cover them."""
    if np.all(np.isfinite(values)):
        return values
    index = np.where(np.isfinite(values), np.arange(len(values))[:, None], 0)
    held = np.take_along_axis(values, np.maximum.accumulate(index, axis=0), axis=0)
    return np.asarray(np.nan_to_num(held), dtype=float)


def _beyond_response(usable: Flags, reach: int) -> Flags:
    """(N,) True for `usable` samples with none that is not, and no end of the recording, within `reach` samples."""
    missing = np.concatenate([np.ones(reach), ~usable, np.ones(reach)])
    near = np.convolve(missing, np.ones(2 * reach + 1), mode="valid")
    return np.asarray(near == 0.0)


def _filled_commands(commands: Mapping[int, Command]) -> dict[int, Command]:
    """The commands with missing samples replaced by the last one before."""

    def whole(values: Array) -> Array:
        return _filled(values[:, None])[:, 0]

    return {
        j: replace(own, position=whole(own.position), gain=whole(own.gain), supply=whole(own.supply))
        for j, own in commands.items()
    }


def _away_from(missing: Flags, smooth: sp.csr_matrix) -> Flags:
    """(N,) True for the samples whose smoother uses no `missing` sample."""
    touched = abs(smooth) @ missing.astype(float)
    return np.asarray(touched == 0.0)
