"""The rows' noise by dry friction near rest, where its force is not a function of the velocity.

A joint at rest is held by whatever force it takes, up to the friction's size T. The law T tanh(v/w) puts a creep with
v of the order of w in its place, and w is not known where a model file states the friction alone. The force then
differs from the law by up to T (1 − |tanh(v/w)|); that is counted as noise, once as what is alike for as long as the
joint rests, and once as what turns within a window, since the force follows what pushes the joint: a controller that
makes up for the friction turns it from −T to T within a few samples. A friction whose width is stated, or was fitted,
is a function of the velocity, and there is no such noise.
"""

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import REST_LASTING, RESTING_EFFORT_STD
from drake_cafim.effects.joint import DRY_FRICTION, SLIP_VELOCITY, JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags

SLIDING = 20.0
"""Velocity in widths w at which a joint slides for certain."""
FAINT = 1e-3
"""Share of the friction below which its doubt counts as none."""


def friction_at_rest_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) the rows' covariance by dry friction without a known width, near rest."""
    windows, r = weak.samples.windows, weak.rows_per_window
    total = sp.csr_matrix((r * len(windows), r * len(windows)))
    joints = weak.joint_samples(physics)
    for effect in physics.joint_forces:
        if effect.group != DRY_FRICTION or SLIP_VELOCITY.name in effect.values:
            continue
        joint = physics.tree.joint_index(effect.at)
        size, share = _doubt(effect, joints[joint])
        if not np.any(share):
            continue
        scaled = windows.value @ sp.diags_array(share / physics.effort_gains[joint])
        shared = sp.coo_matrix(scaled @ _held(weak, size, joints[joint].u, np.greater(share, 0.0)) @ scaled.T)
        rows, columns = (r * index + weak.dynamic.start + joint for index in (shared.row, shared.col))
        total = total + sp.csr_matrix((shared.data, (rows, columns)), shape=total.shape)
    return sp.csr_matrix(total)


def _doubt(effect: JointForce, joint: JointSamples) -> tuple[Array, Array]:
    """(N,) the size of the friction, N m or N, and (N,) 1 − |tanh(v/w)|; zero away from rest."""
    width = SLIP_VELOCITY.nominal
    sliding = np.full_like(joint.v, SLIDING * width)
    forward, backward = (effect.force(JointSamples(joint.q, v, joint.u, load=joint.load)) for v in (sliding, -sliding))
    share = np.maximum(1.0 - np.abs(joint.sign(width).value), 0.0)
    return 0.5 * np.abs(forward.value - backward.value), np.where(share > FAINT, share, 0.0)


def _held(weak: WeakForm, size: Array, effort: Array, at_rest: Flags) -> sp.csr_matrix:
    """(N, N) covariance of the force that holds a joint `at_rest` (N,), (N m)² or N².

    Of what lasts and of what turns within a window, both of the friction's `size` (N,), and of an unknown multiple of
    the joint's `effort` (N,), which the friction takes away: without that, a law by which efforts do not act would
    explain all that is left at such a joint by a single number.
    """
    time, width = weak.samples.time, weak.samples.windows.width
    long, brief = lasting(time, at_rest, REST_LASTING), lasting(time, at_rest, width)
    by_size, by_effort = sp.diags_array(size), sp.diags_array(RESTING_EFFORT_STD * np.clip(effort, -size, size))
    return sp.csr_matrix(by_size @ (long + brief) @ by_size + by_effort @ long @ by_effort)


def lasting(time: Array, where: Flags, reach: float) -> sp.csr_matrix:
    """(N, N) correlation 1 − |Δt|/`reach` among the instants `where` (N,) is set; zero of all others and beyond that.

    `time` (N,) increases, s, as is `reach`.
    """
    at = np.flatnonzero(where)
    ends = np.searchsorted(time[at], time[at] + reach)
    counts = ends - np.arange(len(at))
    first = np.repeat(np.arange(len(at)), counts)
    second = first + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    near = 1.0 - (time[at[second]] - time[at[first]]) / reach
    upper = sp.csr_matrix((near, (at[first], at[second])), shape=(len(time), len(time)))
    return sp.csr_matrix(upper + upper.T - sp.diags_array(upper.diagonal()))
