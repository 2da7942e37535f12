"""The rows' noise by dry friction near rest, where its force is not a function of the velocity.

A joint at rest is held by whatever force it takes, up to the friction's size T. The law T tanh(v/w) puts a creep with
v of the order of w in its place, and w is not known where a model file states the friction alone. The force then
differs from the law by up to T (1 − |tanh(v/w)|); that is counted as noise, once as what is alike for as long as the
joint rests, and once as what turns within a window, since the force follows what pushes the joint: a controller that
makes up for the friction turns it from −T to T within a few samples. A friction whose width is stated, or was fitted,
is a function of the velocity: there is no such noise unless the velocity's error hides the width. The force that holds
a joint which truly sticks depends on no velocity, and a law that rises towards rest would seem to explain it.
"""

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import REST_LASTING, RESTING_EFFORT_STD
from drake_cafim.diagnosis.whitening.lasting_noise import lasting
from drake_cafim.effects.joint import DRY_FRICTION, JointForce, doubt_at_rest
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scenario.physics import Physics


def friction_at_rest_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) the rows' covariance by dry friction without a known width, near rest."""
    windows, r = weak.samples.windows, weak.rows_per_window
    total = sp.csr_matrix((r * len(windows), r * len(windows)))
    joints = weak.joint_samples(physics)
    for effect in physics.joint_forces:
        if effect.group != DRY_FRICTION:
            continue
        joint = physics.tree.joint_index(effect.at)
        held = sp.coo_matrix(_held(weak, effect, joints[joint]) / physics.effort_gains[joint] ** 2)
        rows, columns = (r * index + weak.dynamic.start + joint for index in (held.row, held.col))
        total = total + sp.csr_matrix((held.data, (rows, columns)), shape=total.shape)
    return sp.csr_matrix(total)


def _held(weak: WeakForm, effect: JointForce, joint: JointSamples) -> sp.csr_matrix:
    """(M, M) covariance of the impulses over the windows of what holds a joint at rest beyond the friction's law.

    Of what lasts and of what turns within a window, both of the friction's size, and of an unknown multiple of the
    joint's effort, which the friction takes away: without that, a law by which efforts do not act would explain all
    that is left at such a joint by a single number.
    """
    windows = weak.samples.windows
    size, share = doubt_at_rest(effect, joint)
    at_rest = np.flatnonzero(share)
    size, effort, time = size[at_rest], joint.u[at_rest], weak.samples.time[at_rest]
    at_rest_alone = windows.value[:, at_rest] @ sp.diags_array(share[at_rest])
    by_size = sp.csr_matrix(at_rest_alone @ sp.diags_array(size))
    by_effort = sp.csr_matrix(at_rest_alone @ sp.diags_array(RESTING_EFFORT_STD * np.clip(effort, -size, size)))
    return sp.csr_matrix(
        lasting(by_size, time, REST_LASTING)
        + lasting(by_size, time, windows.width)
        + lasting(by_effort, time, REST_LASTING)
    )
