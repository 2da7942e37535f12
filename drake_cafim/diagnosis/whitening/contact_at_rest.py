"""The rows' noise where a contact sticks by Drake's friction, whose force there is not a function of the slip.

Drake's contact sticks with whatever force it takes, up to μ λ. The law's μ λ tanh(v/w) puts a creep in its place, and
differs from the force by up to μ λ (1 − tanh(v/w)) in each direction along the surface, for as long as it sticks. The
friction of other laws is a function of the slip, by a width or resistance that the scenario states.
"""

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import REST_LASTING
from drake_cafim.diagnosis.whitening.impact_noise import rows_by_sample
from drake_cafim.diagnosis.whitening.lasting_noise import lasting
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.joint import FAINT
from drake_cafim.numerics.cross import cross
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def contact_at_rest_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) the rows' covariance by contacts that stick under Drake's law."""
    rows = len(weak.samples.windows) * weak.rows_per_window
    total = sp.csr_matrix((rows, rows))
    if not any(_sticks(contact) for contact in physics.contacts):
        return total
    moving, start = weak.motion(physics), 0
    memory = weak.contact_memory(physics)
    for contact in physics.contacts:
        states, start = memory[:, start : start + contact.memory], start + contact.memory
        if not _sticks(contact):
            continue
        touch = contact.touch(moving)
        force, _ = contact.force(touch, states)
        normal = np.maximum(np.einsum("ni,ni->n", force, np.broadcast_to(contact.outward(touch), force.shape)), 0.0)
        share = 1.0 - np.tanh(np.linalg.norm(touch.slip, axis=1) / contact.parameters.slip_velocity)
        doubt = np.where(share > FAINT, contact.parameters.friction * normal * share, 0.0)
        near = np.flatnonzero(doubt > 0.0)
        if not len(near):
            continue
        for along in touch.axes.T[:2]:
            pushed = by_force(weak, physics, contact, touch.position, doubt[:, None] * along)
            by_sample = rows_by_sample(weak, physics, near, pushed[near], weak.rows_per_window)
            total = total + lasting(by_sample, weak.samples.time[near], REST_LASTING)
    return sp.csr_matrix(total)


def _sticks(contact: SphereContact) -> bool:
    given = contact.parameters
    return contact.law.normal == "hydroelastic" and bool(given.friction) and given.slip_velocity is not None


def by_force(weak: WeakForm, physics: Physics, contact: SphereContact, place: Array, force: Array) -> Array:
    """(N, n + 6 s) generalised forces and sensor readings by a `force` (N, 3) on the contact's link at `place`."""
    moving = weak.motion(physics)
    wrench = moving.no_wrenches
    wrench[:, contact.joint] = np.concatenate([cross(place, force), force], axis=1)
    written = weak.contacts.undelayed_readings(physics, moving, wrench)
    written = written - weak.contacts.undelayed_readings(physics, moving, None)
    return np.asarray(np.concatenate([moving.project(wrench) / physics.effort_gains, written], axis=1))
