"""Where a contact sets in with a jump, as one that damps does, within what noise hides of the moment.

A sample within its noise of the surface may lie on the other side of it: its sensor and its joints then feel the whole
jump, J, or none of it. No slope tells that; of an error of variance σ² in the depth d, its mean square is J² Φ(−|d|/σ).
Between two samples the trapezoid rule takes half an interval's jump, whenever in it the contact sets in: J²/12 more at
the joints.
"""

import numpy as np
import scipy.sparse as sp
from scipy.special import ndtr

from drake_cafim.contact.change import Touch
from drake_cafim.cross import cross
from drake_cafim.diagnosis.coloured_noise import covariance
from drake_cafim.diagnosis.noise_jacobian import place, reading_windows
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import Motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

BARELY = 1e-12
"""m, on either side of the surface."""
RARE = 1e-6
"""Probability of the other side below which a sample is on its own."""


def touching_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) of the rows, of samples that may or may not touch and of jumps between samples."""
    rows = len(weak.samples.windows) * weak.rows_per_window
    total = sp.csr_matrix((rows, rows))
    moving, start = weak.motion(physics), 0
    memory = weak.contact_memory(physics)
    for contact in physics.contacts:
        own, start = memory[:, start : start + contact.memory], start + contact.memory
        touch = contact.touch(moving)
        depth = touch.penetration
        other = ndtr(-np.abs(depth) / np.maximum(_depth_std(weak, contact, moving), 1e-300))
        enters = np.append(np.diff(np.signbit(depth)), False)
        near = np.flatnonzero((other > RARE) | enters)
        if not len(near):
            continue
        felt = _jump(weak, physics, contact, touch, own, near)
        if not np.any(felt):
            continue
        total = total + _scattered(weak, physics, near, felt * np.sqrt(other[near, None]), weak.rows_per_window)
        between = felt * np.sqrt(enters[near, None] / 12.0)
        total = total + _scattered(weak, physics, near, between, weak.dynamic.stop)
    return sp.csr_matrix(total)


def _jump(
    weak: WeakForm, physics: Physics, contact: SphereContact, touch: Touch, memory: Array, near: Indices
) -> Array:
    """What sets in with the contact at the samples `near` (K,): (K, n + 6 s), at joints and on sensors."""
    inside, outside = (contact.force(touch.at_depth(side), memory) for side in (BARELY, -BARELY))
    force, moment = inside[0] - outside[0], inside[1] - outside[1]
    moving = weak.motion(physics)
    wrench = np.zeros((len(force), weak.joints, 6))
    wrench[:, contact.joint] = np.concatenate([cross(touch.position, force) + moment, force], axis=1)
    # a bias is written without a contact, too
    written = weak.written_at_once(physics, moving, wrench) - weak.written_at_once(physics, moving, None)
    return np.asarray(np.concatenate([moving.project(wrench) / physics.effort_gains, written], axis=1)[near])


def _depth_std(weak: WeakForm, contact: SphereContact, moving: Motion) -> Array:
    """(N,) m, of the depth, by the noise of the smoothed positions."""
    s, total = weak.samples, np.zeros(len(weak.samples.time))
    along = moving.force_at(contact.joint, contact.p_JC) @ contact.normal
    for j, name in enumerate(moving.tree.joint_names):
        memory = s.memories.get(f"q.{name}")
        own = s.smooth_q if memory is None else s.smooth_q @ covariance(s.time, memory)
        variance = s.std[f"q.{name}"] ** 2 * np.asarray(own.multiply(s.smooth_q).sum(axis=1)).ravel()
        total += variance * along[:, j] ** 2
    return np.asarray(np.sqrt(total))


def _scattered(weak: WeakForm, physics: Physics, near: Indices, felt: Array, rows: int) -> sp.csr_matrix:
    """The covariance (R, R) of what is `felt` (K, n + 6 s) at the samples `near` (K,), in a window's first `rows`."""
    windows = [weak.samples.windows.value] * weak.joints
    windows += [reading_windows(weak, physics, one, axis) for one in weak.sensors for axis in WRENCH_COMPONENTS]
    by_sample = sum(
        place(weak, sp.csr_matrix(windows[k][:, near] @ sp.diags_array(felt[:, k])), weak.dynamic.start + k)
        for k in range(rows - weak.dynamic.start)
    )
    return sp.csr_matrix(by_sample @ by_sample.T)
