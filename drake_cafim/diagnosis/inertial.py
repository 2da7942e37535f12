"""The weak form's inertial and gravity terms as a regressor: linear in each joint's ten inertial parameters.

With φ = (m, m c, I_Jo) in the joint's moving frame J, momentum and its rate are linear in φ, and weight in φ and
gravity (Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986). A change of a mass, of a centre of mass, a
payload or a tilt is then a matrix product.
"""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.compiled import compiled
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.windows import Windows
from drake_cafim.dynamics.motion import Motion
from drake_cafim.typing import Array

INERTIAL = 10


@dataclass(frozen=True)
class InertialRegressor:
    """`inertia` (M, n, n, 10) and `weight` (M, n, n, 4, 3): window, row, joint, parameter, gravity axis."""

    inertia: Array
    weight: Array
    _under: dict[bytes, Array] = field(default_factory=dict, repr=False, compare=False)

    def rows(self, parameters: Array, gravity: Array) -> Array:
        """−∫ ẇ p dt − ∫ w (∂T/∂q + gravity) dt, (M, n), without rotor inertias."""
        return np.asarray(self._matrix(gravity) @ parameters.ravel()).reshape(self.inertia.shape[:2])

    def _matrix(self, gravity: Array) -> Array:
        """(M n, n 10) under a gravity (3,) m/s²; the last few are kept."""
        key = gravity.tobytes()
        if key not in self._under:
            make_room(self._under, 2)
            together = self.inertia.copy()
            together[..., :4] += self.weight @ gravity
            self._under[key] = together.reshape(-1, together.shape[2] * INERTIAL)
        return self._under[key]


def inertial_regressor(smooth: Motion, v: Array, windows: Windows) -> InertialRegressor:
    """The regressor of one recording.

    `smooth` is the motion that products are evaluated at; the momentum is linear in the measured `v` (N, n), whose
    noise then stays linear.
    """
    tree, n, M = smooth.tree, smooth.q.shape[1], len(windows)
    supports = tree.supports()
    inertia = np.zeros((M, n, n, INERTIAL))
    weight = np.zeros((M, n, n, 4, 3))
    for j in range(n):
        carriers = np.flatnonzero(supports[j])
        axes, rates = (np.ascontiguousarray(one[:, carriers]) for one in (smooth.axes, smooth.axes_rate))
        measured = np.einsum("nka,nk->na", axes, v[:, carriers])
        moving = np.ascontiguousarray(smooth.velocities[:, j])
        frame = (np.ascontiguousarray(smooth.R_WJ[:, j]), np.ascontiguousarray(smooth.p_WJ[:, j]))
        momenta, forces, weights = products(*frame, axes, rates, measured, moving)
        inertial = windows.rate @ momenta.reshape(len(v), -1) + windows.value @ forces.reshape(len(v), -1)
        inertia[:, carriers, j] = -inertial.reshape(M, -1, INERTIAL)
        weight[:, carriers, j] = -(windows.value @ weights.reshape(len(v), -1)).reshape(M, -1, 4, 3)
    return InertialRegressor(inertia, weight)


@compiled
def products(
    R: Array, p: Array, axes: Array, rates: Array, measured: Array, smooth: Array
) -> tuple[Array, Array, Array]:
    """By a link's inertial parameters, S · I V of its carriers' axes with `measured`, of their rates with `smooth`.

    The first two (N, k, 10); and (N, k, 4, 3) the axes on the weight under a unit of gravity along each world axis.
    `R` (N, 3, 3) and `p` (N, 3) are the pose of its frame; `axes` and `rates` (N, k, 6), the velocities (N, 6) in the
    world.
    """
    N, K = axes.shape[0], axes.shape[1]
    momenta, forces, weights = np.empty((N, K, INERTIAL)), np.empty((N, K, INERTIAL)), np.empty((N, K, 4, 3))
    S, V, W = np.empty(6), np.empty(6), np.empty(6)
    for i in range(N):
        _in_frame(R[i], p[i], measured[i], V)
        _in_frame(R[i], p[i], smooth[i], W)
        for k in range(K):
            _in_frame(R[i], p[i], rates[i, k], S)
            _product(S, W, forces[i, k])
            _in_frame(R[i], p[i], axes[i, k], S)
            _product(S, V, momenta[i, k])
            for x in range(3):
                g = R[i, x]
                weights[i, k, 0, x] = S[3] * g[0] + S[4] * g[1] + S[5] * g[2]
                weights[i, k, 1, x] = g[1] * S[2] - g[2] * S[1]
                weights[i, k, 2, x] = g[2] * S[0] - g[0] * S[2]
                weights[i, k, 3, x] = g[0] * S[1] - g[1] * S[0]
    return momenta, forces, weights


@compiled
def _in_frame(R: Array, p: Array, V_W: Array, V: Array) -> None:
    """V (6,) in a frame's axes and about its origin, of V_W about the world's."""
    x = V_W[3] + V_W[1] * p[2] - V_W[2] * p[1]
    y = V_W[4] + V_W[2] * p[0] - V_W[0] * p[2]
    z = V_W[5] + V_W[0] * p[1] - V_W[1] * p[0]
    for r in range(3):
        V[r] = R[0, r] * V_W[0] + R[1, r] * V_W[1] + R[2, r] * V_W[2]
        V[3 + r] = R[0, r] * x + R[1, r] * y + R[2, r] * z


@compiled
def _product(S: Array, V: Array, result: Array) -> None:
    """S · I V by each inertial parameter of I, all in one frame."""
    result[0] = S[3] * V[3] + S[4] * V[4] + S[5] * V[5]
    result[1] = V[4] * S[2] - V[5] * S[1] + S[4] * V[2] - S[5] * V[1]
    result[2] = V[5] * S[0] - V[3] * S[2] + S[5] * V[0] - S[3] * V[2]
    result[3] = V[3] * S[1] - V[4] * S[0] + S[3] * V[1] - S[4] * V[0]
    for r in range(3):
        result[4 + r] = S[r] * V[r]
    result[7] = S[0] * V[1] + S[1] * V[0]
    result[8] = S[0] * V[2] + S[2] * V[0]
    result[9] = S[1] * V[2] + S[2] * V[1]
