"""The condition under which a mismatch shows, in words: at reversals, with the load, on one side, for a moment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from drake_cafim.diagnosis.thresholds import (
    CONDITION_EXCESS_SHARE,
    CONDITION_TIME_SHARE,
    MOMENT_EXCESS_SHARE,
    MOMENT_TIME_SHARE,
    REVERSAL_SPEED_SHARE,
    RISING_RANK_CORRELATION,
)
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Seen:
    """One place's standardised misfit and its joint's motion by window of all recordings, (M,) each.

    `start` and `stop` are in s of the recording `name`; q in rad or m, v per s, u in N m or N; these and `joint` are
    None where the place belongs to no joint.
    """

    misfit: Array
    start: Array
    stop: Array
    name: Sequence[str]
    joint: str | None = None
    q: Array | None = None
    v: Array | None = None
    u: Array | None = None


def condition(seen: Seen) -> str:
    """The condition in words; empty where the misfit shows all the time."""
    excess = np.clip(seen.misfit**2 - 1.0, 0.0, None)
    total = float(excess.sum())
    if total <= 0.0 or len(excess) < 10:
        return ""
    return _moment(seen, excess / total) or _at_joint(seen, excess / total)


def _moment(seen: Seen, share: Array) -> str:
    """The condition of a misfit that shows only in a short interval of one recording; else empty."""
    strongest = int(np.argmax(share))
    own = np.array([name == seen.name[strongest] for name in seen.name])
    near = own & (share > MOMENT_EXCESS_SHARE * share[strongest])
    first, last = int(np.flatnonzero(near)[0]), int(np.flatnonzero(near)[-1])
    if (
        last - first + 1 > MOMENT_TIME_SHARE * len(share)
        or float(share[first : last + 1].sum()) < CONDITION_EXCESS_SHARE
    ):
        return ""
    return f"only in {seen.start[first]:.3g}–{seen.stop[last]:.3g} s of {seen.name[strongest]}"


def _at_joint(seen: Seen, share: Array) -> str:
    if seen.joint is None or seen.q is None or seen.v is None or seen.u is None:
        return ""
    turning = np.abs(seen.v) < REVERSAL_SPEED_SHARE * float(np.abs(seen.v).max())
    # windows overlap, so that the neighbours of a window with a reversal contain it too
    turning = turning | np.roll(turning, 1) | np.roll(turning, -1)
    if np.mean(turning) < CONDITION_TIME_SHARE and float(share[turning].sum()) > CONDITION_EXCESS_SHARE:
        return f"at reversals of v.{seen.joint}"
    sided = _one_side(seen.q, share, f"q.{seen.joint}")
    if sided:
        return sided
    sizes = {f"|u.{seen.joint}|": np.abs(seen.u), f"|v.{seen.joint}|": np.abs(seen.v)}
    # a constant has no rank correlation
    sizes = {name: size for name, size in sizes.items() if np.ptp(size) > 0.0}
    if not sizes or not np.ptp(np.abs(seen.misfit)) > 0.0:
        return ""
    with np.errstate(invalid="ignore"):
        rises = {name: float(np.nan_to_num(spearmanr(np.abs(seen.misfit), size)[0])) for name, size in sizes.items()}
    name = max(rises, key=lambda key: rises[key])
    return f"grows with {name}" if rises[name] > RISING_RANK_CORRELATION else ""


def _one_side(value: Array, share: Array, name: str) -> str:
    """The condition of a misfit that shows only at one end of the range of `value` (M,); else empty."""
    order = np.argsort(value)
    for ascending, word in ((order, "below"), (order[::-1], "above")):
        held = np.cumsum(share[ascending])
        count = int(np.searchsorted(held, 0.95)) + 1
        if count < CONDITION_TIME_SHARE * len(value):
            return f"only {word} {name} = {value[ascending[count - 1]]:.2g}"
    return ""


def seen_at(runs: Sequence[Run], physics: Physics, rows: Sequence[Array], joint: int | None) -> Seen:
    """The input of `condition`, from each recording's standardised `rows` (M,) of one place."""
    windows = [run.weak.samples.windows for run in runs]
    names = [run.weak.samples.recording.name for run in runs for _ in range(len(run.weak.samples.windows))]
    start = np.concatenate([window.starts for window in windows])
    stop = start + np.concatenate([np.full(len(window), window.width) for window in windows])
    if joint is None:
        return Seen(np.concatenate(rows), start, stop, names)
    means = []
    for run, window in zip(runs, windows, strict=True):
        measured = run.weak.measurement(physics)
        motion = np.stack([measured.q_hat[:, joint], measured.v_hat[:, joint], measured.u[:, joint]], axis=1)
        means.append(window.value @ motion / np.asarray(window.value.sum(axis=1)).reshape(-1, 1))
    q, v, u = np.concatenate(means).T
    return Seen(np.concatenate(rows), start, stop, names, physics.tree.joint_names[joint], q, v, u)
