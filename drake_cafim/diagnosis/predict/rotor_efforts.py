"""The share of the efforts that accelerates rotors coupled elastically or with backlash to their links."""

import numpy as np

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def rotor_efforts(weak: WeakForm, physics: Physics) -> Array:
    """−J ψ̈ (N, n) N m (N), the mean from each sample to the next; zero at joints without a coupling.

    ψ is the twist of the rotor against its link and J the rotor's reflected inertia. ψ is integrated along the recorded
    motion, since it depends on the efforts far more than on the motion; its initial value is the one estimated from
    the recording's rows.
    """
    taken = np.zeros((len(weak.samples.time), weak.joints))
    if not physics.couplings:
        return taken
    whiten, jacobian = whitening(weak, physics)
    marginal = Run(weak, whiten, jacobian).marginalise_start(physics)
    start = marginal.start if marginal.paid > 0.0 else np.zeros(2 * len(physics.couplings))
    for coupling in physics.couplings:
        joint = physics.tree.joint_index(coupling.at)
        drive = weak.couplings.rotor_drives(physics)[joint]
        by_start = coupling.twist_rate_by_start(drive)
        own, start = np.split(start, [by_start.shape[1]])
        rate = coupling.twist_rate(drive) + by_start @ own
        taken[:-1, joint] -= drive.inertia * np.diff(rate) / np.diff(weak.samples.time)
    return taken
