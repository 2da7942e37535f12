"""What rotors that are not one with their links keep for themselves of the efforts."""

import numpy as np

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def rotor_efforts(weak: WeakForm, physics: Physics) -> Array:
    """−J ψ̈ (N, n), the mean from each sample to the next.

    The twist is that of the recorded motion: it answers to the efforts, and to the motion hardly. How it began is what
    the recording's rows say of it.
    """
    taken = np.zeros((len(weak.samples.time), weak.joints))
    if not physics.couplings:
        return taken
    whiten, jacobian, labels = whitening(weak, physics)
    begun = Run(weak, whiten, jacobian, tuple(labels)).marginalise_start(physics)
    start = begun.start if begun.paid > 0.0 else np.zeros(2 * len(physics.couplings))
    for coupling in physics.couplings:
        joint = physics.tree.joint_index(coupling.at)
        drive = weak.rotor_drives(physics)[joint]
        by_start = coupling.twist_rate_by_start(drive)
        own, start = np.split(start, [by_start.shape[1]])
        rate = coupling.twist_rate(drive) + by_start @ own
        taken[:-1, joint] -= drive.inertia * np.diff(rate) / np.diff(weak.samples.time)
    return taken
