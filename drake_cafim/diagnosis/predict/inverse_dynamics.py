"""Residuals of inverse dynamics: the efforts that a recorded motion asks for, against those that acted.

Both sides pass through one low-pass filter F without phase lag, as is usual in robot identification (Gautier, Janot,
Vandanjon, IEEE Trans. Control Systems Technology 21(2), 2013),

    r = F[M(q̂) q̂̈ + h(q̂, q̂̇) − joint forces − Jᵀ contact and body forces] − F[u],

with the positions q̂ filtered at a higher cutoff, which only keeps their differences finite and leaves F's band alone.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from drake_cafim.diagnosis.predict.rotor_efforts import rotor_efforts
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.verdict import EffortResidual
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.effects.effect import JointSamples
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

ORDER = 4
"""Of the Butterworth filter, applied forwards and backwards."""
CUTOFF, LARGEST_SHARE = 12.0, 0.2
"""Hz, and the share of the sampling rate that it is lowered to where a recording is sampled more slowly."""
WIDER, NYQUIST_SHARE = 5.0, 0.8
"""Times the cutoff that positions are filtered at, and the share of half the sampling rate that this stays below."""
SHORTEST, TRANSIENT = 12.0, 3.0
"""Periods of the cutoff that a stretch without gaps must last, and those of them that the filter needs to settle: they
are left out at either end, where two differentiations make much of what was assumed beyond it."""


def effort_residuals(
    forms: Sequence[WeakForm], physics: Physics, cutoff: float | None = None
) -> dict[str, EffortResidual]:
    """By joint, over all `forms`; empty where no stretch without gaps is long enough.

    `cutoff` (Hz) is `default_cutoff` unless given.
    """
    cutoff = default_cutoff(forms) if cutoff is None else cutoff
    residual, effort = [], []
    for weak in forms:
        acting = weak.mean_effort(physics) + rotor_efforts(weak, physics)
        for stretch in _stretches(weak, cutoff):
            asked, acted = _both_sides(weak, physics, acting, stretch, cutoff)
            residual.append(asked - acted)
            effort.append(acted)
    if not residual:
        return {}
    left = np.sqrt(np.mean(np.concatenate(residual) ** 2, axis=0))
    whole = np.sqrt(np.mean(np.concatenate(effort) ** 2, axis=0))
    return {
        name: EffortResidual(float(left[j]), float(left[j] / whole[j]) if whole[j] > 0.0 else None, cutoff)
        for j, name in enumerate(physics.tree.joint_names)
    }


def default_cutoff(forms: Sequence[WeakForm]) -> float:
    """Hz: `CUTOFF`, or less where the slowest of the recordings is sampled too slowly for it."""
    rate = min(1.0 / float(np.median(np.diff(weak.samples.time))) for weak in forms)
    return min(CUTOFF, LARGEST_SHARE * rate)


def _stretches(weak: WeakForm, cutoff: float) -> Iterator[Indices]:
    """Sample indices of each stretch that windows cover without a gap, if it is long enough to be filtered."""
    windows, time = weak.samples.windows, weak.samples.time
    covered = np.zeros(len(time), dtype=bool)
    for first, stop in zip(windows.first, windows.stop, strict=True):
        covered[first:stop] = True
    gap = ~covered[1:] | ~covered[:-1] | (np.diff(time) > 2.5 * np.median(np.diff(time)))
    for stretch in np.split(np.arange(len(time)), np.flatnonzero(gap) + 1):
        if time[stretch[-1]] - time[stretch[0]] >= SHORTEST / cutoff:
            yield stretch


def _both_sides(
    weak: WeakForm, physics: Physics, acting: Array, stretch: Indices, cutoff: float
) -> tuple[Array, Array]:
    """Filtered efforts (K, n) that the motion asks for and that acted, on an even clock, without the filter's ends.

    `acting` (N, n) are means from each sample to the next.
    """
    time = weak.samples.time[stretch]
    count = round((time[-1] - time[0]) / float(np.median(np.diff(time)))) + 1
    even = np.linspace(time[0], time[-1], count)
    rate = (count - 1) / (time[-1] - time[0])

    def filtered(values: Array, frequency: float) -> Array:
        sections = butter(ORDER, frequency, fs=rate, output="sos")
        return np.asarray(sosfiltfilt(sections, values, axis=0), dtype=float)

    measured = make_interp_spline(time, weak.measurement(physics).q[stretch], k=3)(even)
    q = filtered(measured, min(WIDER * cutoff, 0.5 * NYQUIST_SHARE * rate))
    v = np.gradient(q, 1.0 / rate, axis=0)
    a = np.gradient(v, 1.0 / rate, axis=0)
    middle = 0.5 * (time[1:] + time[:-1])
    acted = np.stack([np.interp(even, middle, column[stretch[:-1]]) for column in acting.T], axis=1)
    remembered = weak.contact_memory(physics)[stretch].T
    memory = np.stack([np.interp(even, time, column) for column in remembered], axis=1) if len(remembered) else None
    asked = _inverse_dynamics(physics, (q, v, a), acted, (even, weak.samples.recording.name), memory)
    inside = (even >= even[0] + TRANSIENT / cutoff) & (even <= even[-1] - TRANSIENT / cutoff)
    return filtered(asked, cutoff)[inside], filtered(acted, cutoff)[inside]


def _inverse_dynamics(
    physics: Physics, moved: tuple[Array, Array, Array], acted: Array, when: tuple[Array, str], memory: Array | None
) -> Array:
    """Efforts (K, n) under which the joints move as `moved` (q, v, v̇), each (K, n).

    `acted` is what laws of the load depend on, `when` the times (K,) s and the recording, which a push depends on.
    """
    q, v, a = moved
    moving = motion(physics.tree, q, v)
    M, bias = equations_of_motion(moving, physics.gravity)
    M = M + np.diag(physics.rotor_inertias)
    laws, _, _ = physics.applied_at_joints([JointSamples(q[:, j], v[:, j], acted[:, j]) for j in range(q.shape[1])])
    needed = np.einsum("kij,kj->ki", M, a) + bias - laws
    if physics.contacts:
        needed = needed - moving.project(physics.contact_wrenches(moving, memory))
    if physics.body_forces:
        needed = needed - moving.project(physics.body_wrenches(moving, *when))
    return np.asarray(needed, dtype=float)
