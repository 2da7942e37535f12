"""One recording as the weak form needs it: measured and locally smoothed motion, efforts, wrenches."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.coloured_noise import Lasting, drawn
from drake_cafim.diagnosis.feedback import Feedback
from drake_cafim.diagnosis.slow_channels import Bridges
from drake_cafim.diagnosis.track import Track, track_of
from drake_cafim.diagnosis.velocity import SMOOTHING_REACH, Noise, Velocity, VelocityNoise, resting
from drake_cafim.diagnosis.windows import Windows, lay_windows
from drake_cafim.errors import InputError
from drake_cafim.local_polynomial import local_polynomial
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array, Flags

WINDOW_WIDTH = 0.06
"""s; test functions this wide resolve what happens at reversals and still average the noise."""
END_MARGIN = 0.02
"""s at both ends that no window covers, so that a channel can be read a little earlier or later than it was written."""


@dataclass(frozen=True)
class Samples:
    """Measured channels of one recording, with the linear operators that act on them.

    `q`, `u` (N, n); `v` (N, n) measured, or differentiated from q where `differentiate` is not None; `wrenches` one
    (N, 6) a sensor. `smooth_q` is (N, N).
    """

    recording: Recording
    time: Array
    q: Array
    v: Array
    u: Array
    wrenches: tuple[Array, ...]
    std: dict[str, float]
    """Noise of one sample by column, SI."""
    windows: Windows
    smooth_q: sp.csr_matrix
    smooth_v: tuple[Velocity, ...]
    """Of each joint, as the motion's products have it."""
    kinked_v: tuple[Velocity, ...]
    """Of each joint, as laws of its force have it, which may bend where it rests."""
    differentiate: sp.csr_matrix | None
    memories: Mapping[str, Lasting] = field(default_factory=dict)
    """Of the columns whose noise has one."""
    bridges: Bridges = field(default_factory=dict)
    """Of the columns that are written less often than the others: values and noise at every row from those written."""

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Each joint's position as a contact remembers it."""
        return tuple(self._track(name.removeprefix("q.")) for name in self.std if name.startswith("q."))

    def _track(self, joint: str) -> Track:
        q, v = f"q.{joint}", f"v.{joint}"
        # without a velocity that was measured there is nothing but the position; what was laid between samples that
        # stand farther apart has no noise of its own to compare windows by
        std_v = self.std[v] if self.velocity_measured else 0.0
        widest = q in self.bridges or v in self.bridges
        return track_of(self.time, self.std[q], std_v, self.memories.get(q), self.memories.get(v), widest)

    @cached_property
    def v_std(self) -> Array:
        """(N, n) standard deviation of the velocities that laws have."""
        return np.stack([one.std for one in self.kinked_v], axis=1)

    @property
    def velocity_measured(self) -> bool:
        return self.differentiate is None


def over_wider_windows(samples: Samples, times: float) -> Samples | None:
    """The same samples under windows `times` as wide, that cover no others; None where fewer than three fit."""
    windows = samples.windows
    covered = np.zeros(len(samples.time), dtype=bool)
    for first, stop in zip(windows.first, windows.stop, strict=True):
        covered[first:stop] = True
    wide = lay_windows(samples.time, covered, times * windows.width)
    return replace(samples, windows=wide) if len(wide) >= 3 else None


def noisier(samples: Samples, rng: np.random.Generator, fed_back: bool = False) -> Samples:
    """The samples with the stated noise added once more; `fed_back`, the efforts are what a controller makes of it."""
    names = [name.removeprefix("q.") for name in samples.std if name.startswith("q.")]

    def noise(columns: Sequence[str]) -> Array:
        unit = [drawn(rng, samples.time, samples.memories.get(column)) for column in columns]
        unit = [samples.bridges[c] @ one if c in samples.bridges else one for c, one in zip(columns, unit, strict=True)]
        return np.stack([samples.std[column] * one for column, one in zip(columns, unit, strict=True)], axis=1)

    def again(kind: str, values: Array) -> Array:
        return values + noise([f"{kind}.{name}" for name in names])

    q = again("q", samples.q)
    v = again("v", samples.v) if samples.differentiate is None else samples.differentiate @ q
    sensors = list(dict.fromkeys(name.rsplit(".", 1)[0] for name in samples.std if name.startswith("wrench.")))
    wrenches = tuple(
        wrench + noise([f"{sensor}.{axis}" for axis in WRENCH_COMPONENTS])
        for sensor, wrench in zip(sensors, samples.wrenches, strict=True)
    )
    u = again("u", samples.u)
    if fed_back:
        u = u + Feedback.of(samples.q, samples.v, samples.u).passed_on(q - samples.q, v - samples.v)
    columns = dict(samples.recording.columns)
    for kind, values in (("q", q), ("u", u), *([("v", v)] if samples.velocity_measured else [])):
        columns |= {f"{kind}.{name}": values[:, j] for j, name in enumerate(names)}
    for sensor, wrench in zip(sensors, wrenches, strict=True):
        columns |= {f"{sensor}.{axis}": wrench[:, k] for k, axis in enumerate(WRENCH_COMPONENTS)}
    recording = replace(samples.recording, columns=columns)
    return replace(samples, recording=recording, q=q, v=v, u=u, wrenches=wrenches)


def retaken(samples: Samples, scene: Scene, recording: Recording) -> Samples:
    """The samples of another recording at the same times and with the same noise."""
    names, slope = scene.tree.joint_names, samples.differentiate
    q = _filled(recording.matrix("q", names))
    v = _filled(recording.matrix("v", names)) if slope is None else np.asarray(slope @ q, dtype=float)
    noise = _velocity_noise(names, samples.std, samples.memories, slope is None)
    return replace(
        samples,
        recording=recording,
        q=q,
        v=v,
        kinked_v=tuple(resting(samples.time, q[:, j], v[:, j], one) for j, one in enumerate(noise)),
        u=_filled(recording.matrix("u", names)),
        wrenches=tuple(_filled(recording.wrench(sensor.name)) for sensor in scene.wrench_sensors),
    )


def samples_of(
    scene: Scene,
    recording: Recording,
    std: dict[str, float],
    width: float = WINDOW_WIDTH,
    memories: Mapping[str, Lasting] | None = None,
    bridges: Bridges | None = None,
) -> Samples:
    """The samples of `recording` for `scene`, `std` and `memories` giving the noise by column.

    `bridges` tell how slow channels were laid between their own samples.

    Raises `InputError` when a needed column is missing or the recording is shorter than three windows.
    """
    names = scene.tree.joint_names
    q = recording.matrix("q", names)
    u = recording.matrix("u", names)
    time = recording.time
    measured = all(f"v.{name}" in recording.columns for name in names)
    width = max(width, 12.0 * float(np.median(np.diff(time))))
    v = recording.matrix("v", names) if measured else np.zeros_like(q)
    wrenches = tuple(recording.wrench(sensor.name) for sensor in scene.wrench_sensors)
    usable = np.all(np.isfinite(np.concatenate([q, v, u, *wrenches], axis=1)), axis=1)
    q, v, u = _filled(q), _filled(v), _filled(u)
    wrenches = tuple(_filled(wrench) for wrench in wrenches)
    smooth_q = local_polynomial(time, SMOOTHING_REACH, 2, 0, at_least=2)
    differentiate = None
    if not measured:
        differentiate = local_polynomial(time, 0.0, 6, 1, at_least=3)
        v = differentiate @ q
    memories = dict(memories or {})
    noise = _velocity_noise(names, std, memories, measured)
    usable &= (time >= time[0] + END_MARGIN) & (time <= time[-1] - END_MARGIN)
    windows = lay_windows(time, _away_from(~usable, smooth_q), width)
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
        windows,
        smooth_q,
        tuple(Velocity.over(SMOOTHING_REACH, time, one) for one in noise),
        tuple(resting(time, q[:, j], v[:, j], one) for j, one in enumerate(noise)),
        differentiate,
        memories,
        dict(bridges or {}),
    )


def _refuse_other_stamps(recording: Recording, scene: Scene) -> None:
    """Raises `InputError` where two columns hardly share a row, as those of topics with stamps of their own."""
    needed = [f"{kind}.{name}" for kind in "qvu" for name in scene.tree.joint_names]
    needed += [f"wrench.{sensor.name}.{axis}" for sensor in scene.wrench_sensors for axis in WRENCH_COMPONENTS]
    there = {column: np.isfinite(recording[column]) for column in needed if column in recording.columns}
    rows = len(recording.time)
    pairs = list(itertools.combinations(there, 2))
    both = [int(np.sum(there[one] & there[other])) for one, other in pairs]
    fewest = int(np.argmin(both))
    if both[fewest] < 0.5 * rows:
        one, other = pairs[fewest]
        raise InputError(
            f"{recording.name}: {one} and {other} stand together in {both[fewest]} of {rows} rows, as topics with "
            "stamps or rates of their own do; say `join:` for one of them in `topics:`, or resample by "
            "`cafim import --period`"
        )


def _velocity_noise(
    names: Sequence[str], std: Mapping[str, float], memories: Mapping[str, Lasting], measured: bool
) -> list[VelocityNoise]:
    """Of each joint."""

    def noise(column: str) -> Noise:
        return Noise(std[column], memories.get(column))

    return [VelocityNoise(noise(f"q.{name}"), noise(f"v.{name}") if measured else None) for name in names]


def _filled(values: Array) -> Array:
    """Missing samples hold the last one's value; windows never cover them."""
    if np.all(np.isfinite(values)):
        return values
    index = np.where(np.isfinite(values), np.arange(len(values))[:, None], 0)
    held = np.take_along_axis(values, np.maximum.accumulate(index, axis=0), axis=0)
    return np.asarray(np.nan_to_num(held), dtype=float)


def _away_from(missing: Flags, smooth: sp.csr_matrix) -> Flags:
    """Samples whose smoothing takes no missing one."""
    touched = abs(smooth) @ missing.astype(float)
    return np.asarray(touched == 0.0)
