"""Residuals of inverse dynamics: the efforts that a recorded motion requires, minus those that acted.

Both sides pass through one low-pass filter F without phase lag, as is usual in robot identification (Gautier, Janot,
Vandanjon, IEEE Trans. Control Systems Technology 21(2), 2013),

    r = F[M(q̂) q̂̈ + h(q̂, q̂̇) − joint forces − Jᵀ contact and body forces] − F[u],

with the positions q̂ low-passed at a higher cutoff, which limits the noise of their finite differences and does not
attenuate the pass band of F.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from drake_cafim.diagnosis.predict.rotor_efforts import rotor_efforts
from drake_cafim.diagnosis.rows.filtered_windows import FilteredWindows, apply_filter
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.verdict import EffortResidual
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import Lowpass
from drake_cafim.typing import Array, Indices

ORDER = 4
"""Order of the Butterworth filter, which is applied forwards and backwards."""
CUTOFF, LARGEST_SHARE = 12.0, 0.2
"""Cutoff of F, Hz, and the largest share of the sampling rate that it may be."""
WIDER, NYQUIST_SHARE = 5.0, 0.8
"""Cutoff of the positions' filter over that of F, and the largest share of the Nyquist frequency that it may be."""
BEYOND_MAKERS = 1.25
"""Largest cutoff of F over that of the filter that the maker of a recording applied to its efforts."""
SHORTEST, TRANSIENT = 12.0, 3.0
"""In periods of the cutoff: the shortest stretch without gaps that is used, and the part left out at each of its ends,
where the filter's assumption about the signal beyond the end is amplified by differentiating twice."""


def effort_residuals(
    forms: Sequence[WeakForm], physics: Physics, cutoff: float | None = None
) -> dict[str, EffortResidual]:
    """The residual r of each joint over all recordings; empty where no stretch without gaps is long enough.

    `cutoff` (Hz) of F is `default_cutoff` unless given.
    """
    cutoff = default_cutoff(forms) if cutoff is None else cutoff
    residual, effort = [], []
    for weak in forms:
        acting = weak.mean_effort(physics) + rotor_efforts(weak, physics)
        for stretch in _stretches(weak, cutoff):
            required, acted = _filtered_efforts(weak, physics, acting, stretch, cutoff)
            residual.append(required - acted)
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
    """min(`CUTOFF`, `LARGEST_SHARE` × the lowest sampling rate of the recordings), Hz.

    Where the efforts were filtered by their maker, not more than `BEYOND_MAKERS` × the cutoff of that filter.
    """
    rate = min(1.0 / float(np.median(np.diff(weak.samples.time))) for weak in forms)
    makers = [lowpass.cutoff for weak in forms if (lowpass := _makers_filter(weak)) is not None]
    return min(CUTOFF, LARGEST_SHARE * rate, *(BEYOND_MAKERS * cutoff for cutoff in makers))


def _makers_filter(weak: WeakForm) -> Lowpass | None:
    windows = weak.samples.windows
    return windows.lowpass if isinstance(windows, FilteredWindows) else None


def _stretches(weak: WeakForm, cutoff: float) -> Iterator[Indices]:
    """Sample indices of each stretch without a gap that test functions cover and that is long enough to be filtered."""
    windows, time = weak.samples.windows, weak.samples.time
    covered = np.zeros(len(time), dtype=bool)
    for first, stop in zip(windows.first, windows.stop, strict=True):
        covered[first:stop] = True
    gap = ~covered[1:] | ~covered[:-1] | (np.diff(time) > 2.5 * np.median(np.diff(time)))
    for stretch in np.split(np.arange(len(time)), np.flatnonzero(gap) + 1):
        if time[stretch[-1]] - time[stretch[0]] >= SHORTEST / cutoff:
            yield stretch


def _filtered_efforts(
    weak: WeakForm, physics: Physics, acting: Array, stretch: Indices, cutoff: float
) -> tuple[Array, Array]:
    """Filtered efforts (K, n) that the motion requires, and those that acted, evenly sampled, without the ends.

    `acting` (N, n) are the mean efforts from each sample to the next.
    """
    time = weak.samples.time[stretch]
    count = round((time[-1] - time[0]) / float(np.median(np.diff(time)))) + 1
    even = np.linspace(time[0], time[-1], count)
    rate = (count - 1) / (time[-1] - time[0])

    def low_pass(values: Array, frequency: float) -> Array:
        sections = butter(ORDER, frequency, fs=rate, output="sos")
        return np.asarray(sosfiltfilt(sections, values, axis=0), dtype=float)

    measured = make_interp_spline(time, weak.measurement(physics).q[stretch], k=3)(even)
    q = low_pass(measured, min(WIDER * cutoff, 0.5 * NYQUIST_SHARE * rate))
    v = np.gradient(q, 1.0 / rate, axis=0)
    a = np.gradient(v, 1.0 / rate, axis=0)
    # a mean over an interval is the effort at its middle
    middle = 0.5 * (time[1:] + time[:-1])
    acted = np.stack([np.interp(even, middle, column[stretch[:-1]]) for column in acting.T], axis=1)
    states = weak.contact_memory(physics)[stretch].T
    memory = np.stack([np.interp(even, time, column) for column in states], axis=1) if len(states) else None
    required = _inverse_dynamics(physics, (q, v, a), acted, (even, weak.samples.recording.name), memory)
    lowpass = _makers_filter(weak)
    if lowpass is not None:
        required = apply_filter(lowpass, required, rate)
    inside = (even >= even[0] + TRANSIENT / cutoff) & (even <= even[-1] - TRANSIENT / cutoff)
    return low_pass(required, cutoff)[inside], low_pass(acted, cutoff)[inside]


def _inverse_dynamics(
    physics: Physics, path: tuple[Array, Array, Array], acted: Array, when: tuple[Array, str], memory: Array | None
) -> Array:
    """The efforts (K, n) M v̇ + h − f − Jᵀ F that produce the `path` q, v, v̇, each (K, n).

    The joint laws f may depend on the efforts that `acted` (K, n), the body forces F on `when`: the times (K,) s and
    the recording's name.
    """
    q, v, a = path
    moving = motion(physics.tree, q, v)
    M, bias = equations_of_motion(moving, physics.gravity)
    M = M + np.diag(physics.rotor_inertias)
    load = physics.loads(q) if physics.depends_on_load else np.zeros_like(q)
    joints = [JointSamples(q[:, j], v[:, j], acted[:, j], load=load[:, j], in_order=True) for j in range(q.shape[1])]
    laws, _, _ = physics.applied_at_joints(joints)
    needed = np.einsum("kij,kj->ki", M, a) + bias - laws
    if physics.contacts:
        needed = needed - moving.project(physics.contact_wrenches(moving, memory))
    if physics.body_forces:
        needed = needed - moving.project(physics.body_wrenches(moving, *when))
    return np.asarray(needed, dtype=float)
