"""Derivatives of the momentum and of the rigid-body forces with respect to positions and velocities."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.dynamics.motion import Motion, mass_matrix, motion
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

STEP = 1e-6
"""Step of the forward differences, rad or m; they keep six digits, and the noise needs only a few."""


@dataclass(frozen=True)
class BalanceSlopes:
    """∂p/∂q, ∂p/∂v, ∂f/∂q and ∂f/∂v, (N, n, n) each, [sample, component, variable]; p = M v, f = ∂T/∂q + gravity."""

    momentum_by_q: Array
    momentum_by_v: Array
    force_by_q: Array

    @property
    def force_by_v(self) -> Array:
        """∂f/∂v, by symmetry of the kinetic energy's second derivatives: ∂f_k/∂v_j = ∂p_j/∂q_k."""
        return np.swapaxes(self.momentum_by_q, 1, 2)


def balance_slopes(moving: Motion, physics: Physics) -> BalanceSlopes:
    """The derivatives along the motion `moving`, by forward differences in q."""
    n = moving.q.shape[1]
    momentum, force = physics.momentum_and_force(moving)
    by_q = []
    for step in STEP * np.eye(n):
        ahead = physics.momentum_and_force(motion(physics.tree, moving.q + step, moving.v))
        by_q.append(((ahead[0] - momentum) / STEP, (ahead[1] - force) / STEP))
    M = mass_matrix(moving) + np.diag(physics.rotor_inertias)
    momentum_by_q, force_by_q = (np.stack(columns, axis=2) for columns in zip(*by_q, strict=True))
    return BalanceSlopes(momentum_by_q, M, force_by_q)
