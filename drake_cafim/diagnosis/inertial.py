"""The weak form's inertial and gravity terms as a regressor: linear in each joint's ten inertial parameters.

With φ = (m, m c, I_Jo) in the joint's moving frame J, momentum and its rate are linear in φ, and weight in φ and
gravity (Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986). A change of a mass, of a centre of mass, a
payload or a tilt is then a matrix product.
"""

from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np

from drake_cafim.compiled import compiled
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.windows import Windows
from drake_cafim.dynamics.motion import Motion
from drake_cafim.typing import Array, Indices

INERTIAL = 10
LINKS_KEPT = 4
"""Of a link's part under motions that are tried."""


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


@dataclass(frozen=True)
class LinkRegressors:
    """The parts of one recording's regressors that are a link's; the last few of each link are kept.

    They know of the joints that carry the link alone: what is tried of the sensors of one leaves most links as they
    were.
    """

    windows: Windows
    _known: dict[int, dict[tuple[bytes, ...], tuple[Array, Array]]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def regressor(self, smooth: Motion, v: Array) -> InertialRegressor:
        """The regressor of a motion.

        `smooth` is the motion that products are evaluated at; the momentum is linear in the measured `v` (N, n), whose
        noise then stays linear.
        """
        n, M = smooth.q.shape[1], len(self.windows)
        inertia, weight = np.zeros((M, n, n, INERTIAL)), np.zeros((M, n, n, 4, 3))
        columns = [_digest(smooth.q[:, j], smooth.v[:, j], v[:, j]) for j in range(n)]
        for j, carried in enumerate(smooth.tree.supports()):
            carriers = np.flatnonzero(carried)
            known, key = self._known.setdefault(j, {}), tuple(columns[k] for k in carriers)
            if key not in known:
                make_room(known, LINKS_KEPT)
                known[key] = self._of(smooth, v, j, carriers)
            inertia[:, carriers, j], weight[:, carriers, j] = known[key]
        return InertialRegressor(inertia, weight)

    def _of(self, smooth: Motion, v: Array, j: int, carriers: Indices) -> tuple[Array, Array]:
        """(M, k, 10) and (M, k, 4, 3) of link `j` at its carriers."""
        rate, value, N, k = self.windows.rate, self.windows.value, len(v), len(carriers)
        places = (smooth.R_WJ, smooth.p_WJ, smooth.axes, smooth.axes_rate, v, smooth.velocities)
        momenta, forces, weights = products(j, carriers, *(np.ascontiguousarray(one) for one in places))
        inertial = rate @ momenta.reshape(N, -1) + value @ forces.reshape(N, -1)
        weighed = value @ weights.reshape(N, -1)
        return -inertial.reshape(-1, k, INERTIAL), -weighed.reshape(-1, k, 4, 3)


def _digest(*columns: Array) -> bytes:
    """What tells numbers apart."""
    return blake2b(b"".join(column.tobytes() for column in columns), digest_size=24).digest()


@compiled
def products(
    j: int, carriers: Indices, R: Array, p: Array, axes: Array, rates: Array, v: Array, smooth: Array
) -> tuple[Array, Array, Array]:
    """By link `j`'s inertial parameters, S · I V of its `carriers`' axes with measured V, of their rates with `smooth`.

    The first two (N, k, 10); and (N, k, 4, 3) the axes on the weight under a unit of gravity along each world axis.
    `R` (N, n, 3, 3) and `p` (N, n, 3) are the poses of the links' frames; `axes` and `rates` (N, n, 6), the `smooth`
    velocities (N, n, 6) in the world; measured ones are Σ S v with `v` (N, n).
    """
    N, K = axes.shape[0], len(carriers)
    momenta, forces, weights = np.empty((N, K, INERTIAL)), np.empty((N, K, INERTIAL)), np.empty((N, K, 4, 3))
    S, V, W, measured = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for i in range(N):
        measured[:] = 0.0
        for c in carriers:
            for r in range(6):
                measured[r] += axes[i, c, r] * v[i, c]
        _in_frame(R[i, j], p[i, j], measured, V)
        _in_frame(R[i, j], p[i, j], smooth[i, j], W)
        for k in range(K):
            _in_frame(R[i, j], p[i, j], rates[i, carriers[k]], S)
            _product(S, W, forces[i, k])
            _in_frame(R[i, j], p[i, j], axes[i, carriers[k]], S)
            _product(S, V, momenta[i, k])
            for x in range(3):
                gx, gy, gz = R[i, j, x, 0], R[i, j, x, 1], R[i, j, x, 2]
                weights[i, k, 0, x] = S[3] * gx + S[4] * gy + S[5] * gz
                weights[i, k, 1, x] = gy * S[2] - gz * S[1]
                weights[i, k, 2, x] = gz * S[0] - gx * S[2]
                weights[i, k, 3, x] = gx * S[1] - gy * S[0]
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
