"""The rows' noise by the step of a simulated contact: Drake's discrete contact holds the force of a step's end.

Its solver is implicit (Castro, Han, Masterjohn, "Irrotational contact fields", 2023): over a step from t to t + h the
normal force is that of the position and the velocity at t + h, and friction has the direction of the slip there, while
the positions in the middle of that step are those at t. Next to the same law as a function of time, the normal force is
early by about a step, which acts as damping, and the friction's direction by half of one. With a sample a step, forces
are therefore in doubt by what they change from one sample to the next, alike for as long as a window; and friction anew
at each sample, since where within a step the slip turns is another thing each time.
"""

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.contact_at_rest import by_force
from drake_cafim.diagnosis.whitening.impact_noise import rows_by_sample
from drake_cafim.diagnosis.whitening.lasting_noise import lasting
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.scenario.physics import Physics

NORMAL_STEPS, FRICTION_STEPS = 1.0, 0.5
"""By how many samples the normal force and the friction are early."""


def contact_step_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) the rows' covariance by contacts under Drake's law whose force changes from one sample to the next."""
    r, windows = weak.rows_per_window, weak.samples.windows
    total = sp.csr_matrix((r * len(windows), r * len(windows)))
    start = 0
    for contact in physics.contacts:
        states = slice(start, start + contact.memory)
        start = states.stop
        if contact.law.normal != "hydroelastic":
            continue
        pushing, rubbing = _changes(weak, physics, contact, states)
        for change in (pushing, rubbing):
            summed = np.asarray(change.sum(axis=1)).ravel()
            by_window = sp.csr_matrix((summed, (np.arange(len(summed)), np.arange(len(summed)) // r)))
            total = total + lasting(by_window, windows.centers, windows.width)
        total = total + rubbing @ rubbing.T
    return sp.csr_matrix(total)


def _changes(
    weak: WeakForm, physics: Physics, contact: SphereContact, states: slice
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Changes of the rows (R, N) by a normal force and by a friction that are as early as that at each sample."""
    moving = weak.motion(physics)
    touch = contact.touch(moving)
    force, _ = contact.force(touch, weak.contact_memory(physics)[:, states])
    outward = np.broadcast_to(contact.outward(touch), force.shape)
    normal = np.einsum("ni,ni->n", force, outward)[:, None] * outward
    place, every = contact.pushed(touch), np.arange(len(force))
    pushing, rubbing = (
        by_force(weak, physics, contact, place, steps * np.gradient(part, axis=0))
        for part, steps in ((normal, NORMAL_STEPS), (force - normal, FRICTION_STEPS))
    )
    r = weak.rows_per_window
    return rows_by_sample(weak, physics, every, pushing, r), rows_by_sample(weak, physics, every, rubbing, r)
