"""The rows' noise where a contact force sets in with a jump (as damping makes it) at an instant that noise hides.

A sample whose distance to the surface is within its noise may lie on the other side of it, so that the predicted force
is wrong by the whole jump J or not at all. No Jacobian describes that: with an error of variance σ² in the depth d, the
mean square error is J² Φ(−|d|/σ). Between two samples the trapezoid rule assumes half an interval's jump, whenever in
the interval the contact sets in: a variance of J²/12 more in the joints' rows.
"""

import numpy as np
import scipy.sparse as sp
from scipy.special import ndtr

from drake_cafim.contact.change import Touch
from drake_cafim.diagnosis.noise.coloured import covariance
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.noise_jacobian import place, reading_windows
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import Motion
from drake_cafim.numerics.cross import cross
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

JUST_INSIDE = 1e-12
"""Depth on either side of the surface at which the jump is evaluated, m."""
RARE_SIDE = 1e-6
"""Probability of being on the other side of the surface below which a sample is ignored."""


def impact_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) the rows' covariance by samples that may or may not touch, and by jumps between samples."""
    rows = len(weak.samples.windows) * weak.rows_per_window
    total = sp.csr_matrix((rows, rows))
    moving, start = weak.motion(physics), 0
    memory = weak.contact_memory(physics)
    for contact in physics.contacts:
        states, start = memory[:, start : start + contact.memory], start + contact.memory
        touch = contact.touch(moving)
        depth = touch.penetration
        wrong_side = ndtr(-np.abs(depth) / np.maximum(_depth_std(weak, contact, moving, touch), 1e-300))
        enters = np.append(np.diff(np.signbit(depth)), False)
        near = np.flatnonzero((wrong_side > RARE_SIDE) | enters)
        if not len(near):
            continue
        jump = _jump(weak, physics, contact, touch, states, near)
        if not np.any(jump):
            continue
        unsure = jump * np.sqrt(wrong_side[near, None])
        total = total + _covariance_of(weak, physics, near, unsure, weak.rows_per_window)
        between = jump * np.sqrt(enters[near, None] / 12.0)
        # a sensor reads at the samples: only the joints' rows integrate over what lies between
        total = total + _covariance_of(weak, physics, near, between, weak.dynamic.stop)
    return sp.csr_matrix(total)


def _jump(
    weak: WeakForm, physics: Physics, contact: SphereContact, touch: Touch, memory: Array, near: Indices
) -> Array:
    """(K, n + 6 s) jumps of generalised forces and sensor readings when `contact` sets in, at the samples `near`."""
    inside, outside = (contact.force(touch.at_depth(side), memory) for side in (JUST_INSIDE, -JUST_INSIDE))
    force, moment = inside[0] - outside[0], inside[1] - outside[1]
    moving = weak.motion(physics)
    wrench = moving.no_wrenches
    wrench[:, contact.joint] = np.concatenate([cross(touch.position, force) + moment, force], axis=1)
    # the difference, since a bias is written without a contact, too
    written = weak.contacts.undelayed_readings(physics, moving, wrench)
    written = written - weak.contacts.undelayed_readings(physics, moving, None)
    return np.asarray(np.concatenate([moving.project(wrench) / physics.effort_gains, written], axis=1)[near])


def _depth_std(weak: WeakForm, contact: SphereContact, moving: Motion, touch: Touch) -> Array:
    """(N,) standard deviation of the depth by the noise of the smoothed positions, m."""
    s, total = weak.samples, np.zeros(len(weak.samples.time))
    along = np.einsum("nja,na->nj", moving.force_at(contact.joint, contact.p_JC), _each(contact.outward(touch), s.time))
    if s.estimated is not None:
        return np.asarray(np.sqrt(np.sum((s.estimated.q_std * along) ** 2, axis=1)))
    for j, name in enumerate(moving.tree.joint_names):
        memory = s.memories.get(f"q.{name}")
        correlated = s.smooth_q if memory is None else s.smooth_q @ covariance(s.time, memory)
        variance = s.std[f"q.{name}"] ** 2 * np.asarray(correlated.multiply(s.smooth_q).sum(axis=1)).ravel()
        total += variance * along[:, j] ** 2
    return np.asarray(np.sqrt(total))


def _each(normal: Array, time: Array) -> Array:
    """A constant `normal` (1, 3), or one for each sample, as (N, 3)."""
    return np.broadcast_to(normal, (len(time), 3))


def _covariance_of(weak: WeakForm, physics: Physics, near: Indices, error: Array, rows: int) -> sp.csr_matrix:
    """(R, R) covariance by independent errors of standard deviation `error`, see `rows_by_sample`."""
    by_sample = rows_by_sample(weak, physics, near, error, rows)
    return sp.csr_matrix(by_sample @ by_sample.T)


def rows_by_sample(weak: WeakForm, physics: Physics, near: Indices, error: Array, rows: int) -> sp.csr_matrix:
    """(R, K) changes of the rows by forces and readings `error` (K, n + 6 s) at each of the samples `near` (K,).

    Only the first `rows` rows of each window are affected.
    """
    windows = [weak.samples.windows.value] * weak.joints
    windows += [reading_windows(weak, physics, sensor, axis) for sensor in weak.sensors for axis in WRENCH_COMPONENTS]
    by_sample = sum(
        place(weak, sp.csr_matrix(windows[k][:, near] @ sp.diags_array(error[:, k])), weak.dynamic.start + k)
        for k in range(rows - weak.dynamic.start)
    )
    return sp.csr_matrix(by_sample)
