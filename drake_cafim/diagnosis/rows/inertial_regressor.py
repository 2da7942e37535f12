"""The weak form's inertial and gravity terms as a regressor: linear in each joint's ten inertial parameters.

With φ = (m, m c, I_Jo) in the joint's moving frame J, momentum and its rate are linear in φ, and weight in φ and
gravity (Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986). A change of a mass, of a centre of mass, a
payload or a tilt is then a matrix product.
"""

from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.test_functions import Windows
from drake_cafim.dynamics.motion import Motion, motion, rates
from drake_cafim.dynamics.recursions import into_frame
from drake_cafim.dynamics.tree import Tree
from drake_cafim.numerics.cache import make_room
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices

INERTIAL = 10
"""Inertial parameters of a link: m, m c (3), I_Jo (6)."""
CACHED_REGRESSORS = 4
"""Most cached regressors of each link."""
WINDOWS_AT_ONCE = 128
"""Number of windows whose terms are computed together, to limit memory."""


@dataclass(frozen=True)
class InertialRegressor:
    """The regressor Y of the dynamic rows, Y φ, for inertial parameters φ (m, 10) of the m moving frames.

    `inertia` (M, n, m, 10) and `weight` (M, n, m, 4, 3), with the axes: window, row, joint, parameter, gravity axis.
    """

    inertia: Array
    weight: Array
    _under: dict[bytes, Array] = field(default_factory=dict, repr=False, compare=False)

    def rows(self, parameters: Array, gravity: Array) -> Array:
        """−∫ ẇ p dt − ∫ w (∂T/∂q + gravity) dt, (M, n), without rotor inertias.

        `parameters` (m, 10) are the links' inertial parameters, `gravity` (3,) is in m/s².
        """
        return np.asarray(self._matrix(gravity) @ parameters.ravel()).reshape(self.inertia.shape[:2])

    def _matrix(self, gravity: Array) -> Array:
        """Y (M n, n 10) under `gravity` (3,) m/s²; cached for the last two."""
        key = gravity.tobytes()
        if key not in self._under:
            make_room(self._under, 2)
            together = self.inertia.copy()
            together[..., :4] += self.weight @ gravity
            self._under[key] = together.reshape(-1, together.shape[2] * INERTIAL)
        return self._under[key]


@dataclass(frozen=True)
class LinkRegressors:
    """One recording's regressors by link, of which the last few of each link are cached.

    A link's part depends on the joints that carry it alone, so that a change of one joint's sensor effects leaves the
    parts of most links valid.
    """

    windows: Windows
    _known: dict[int, dict[tuple[bytes, ...], tuple[Array, Array]]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def regressor(
        self, smooth: Motion, v: Array, at_points: tuple[Array, Array], value: sp.csr_matrix
    ) -> InertialRegressor:
        """The regressor along a motion.

        `smooth` is the motion at the samples, at which nonlinear factors are evaluated; the momentum is linear in the
        measured velocities `v` (N, n), so that their noise enters the rows linearly. Forces are evaluated on positions
        and velocities `at_points` (P, n) each, P points of time, and integrated by `value` (M, P): between samples they
        bend where efforts step.
        """
        n, m, M = smooth.q.shape[1], smooth.p_WJ.shape[1], len(self.windows)
        columns = [_digest(smooth.q[:, j], smooth.v[:, j], v[:, j]) for j in range(n)]
        carriers = [np.flatnonzero(carried) for carried in smooth.tree.supports()]
        keys = [tuple(columns[k] for k in own) for own in carriers]
        new = {
            j: (np.zeros((M, len(own), INERTIAL)), np.zeros((M, len(own), 4, 3)))
            for j, own in enumerate(carriers)
            if keys[j] not in self._known.setdefault(j, {})
        }
        # part by part, as the terms at all points of a long recording take gigabytes
        for begin in range(0, M if new else 0, WINDOWS_AT_ONCE):
            own = slice(begin, begin + WINDOWS_AT_ONCE)
            part = _Part.of(self.windows.rate[own], value[own], smooth, v, at_points)
            for j, (inertia, weight) in new.items():
                inertia[own], weight[own] = part.of_link(j, carriers[j])
        for j, found in new.items():
            make_room(self._known[j], CACHED_REGRESSORS)
            self._known[j][keys[j]] = found
        inertia, weight = np.zeros((M, n, m, INERTIAL)), np.zeros((M, n, m, 4, 3))
        for j, own_carriers in enumerate(carriers):
            inertia[:, own_carriers, j], weight[:, own_carriers, j] = self._known[j][keys[j]]
        return InertialRegressor(inertia, weight)


@dataclass(frozen=True)
class _Part:
    """Some of the windows, with the motion that they cover: `rate` (m, N'), `value` (m, P') and what they multiply."""

    tree: Tree
    rate: sp.csr_matrix
    value: sp.csr_matrix
    samples: tuple[Array, ...]
    """Poses, axes and joint rates at N' samples, as `momenta_of` takes them."""
    points: tuple[Array, ...]
    """Poses, axes, their rates and velocities at P' points, as `forces_of` takes them."""

    @classmethod
    def of(
        cls, rate: sp.csr_matrix, value: sp.csr_matrix, smooth: Motion, v: Array, at_points: tuple[Array, Array]
    ) -> "_Part":
        """The part of the rows `rate` (m, N) and `value` (m, P) of all windows."""
        tree = smooth.tree
        rate, samples = _reduced(rate)
        value, points = _reduced(value)
        there = motion(tree, *(values[points] for values in at_points))
        at_samples = (smooth.R_WJ[samples], smooth.p_WJ[samples], smooth.axes[samples], rates(tree, v[samples]))
        return cls(
            tree,
            rate,
            value,
            tuple(np.ascontiguousarray(values) for values in at_samples),
            (there.R_WJ, there.p_WJ, there.axes, there.axes_rate, there.velocities),
        )

    def of_link(self, j: int, carriers: Indices) -> tuple[Array, Array]:
        """The parts (m, k, 10) and (m, k, 4, 3) of link `j` in the rows of the k joints that carry it, `carriers`."""
        k, frames = len(carriers), np.flatnonzero(self.tree.carriers()[j])
        momenta = momenta_of(j, frames, *self.samples)
        forces, weights = forces_of(j, frames, *self.points)
        if self.tree.followers:
            share = self.tree.following[0][np.ix_(frames, carriers)]
            momenta, forces, weights = (
                np.moveaxis(np.tensordot(part, share, (1, 0)), -1, 1) for part in (momenta, forces, weights)
            )
        inertial = self.rate @ momenta.reshape(len(momenta), -1) + self.value @ forces.reshape(len(forces), -1)
        weighed = self.value @ weights.reshape(len(weights), -1)
        return -inertial.reshape(-1, k, INERTIAL), -weighed.reshape(-1, k, 4, 3)


def _reduced(rows: sp.csr_matrix) -> tuple[sp.csr_matrix, slice]:
    """`rows` (m, N) from their first column that is not zero to the last one, and the slice of these columns."""
    if not rows.nnz:
        return rows[:, :0], slice(0, 0)
    first, stop = int(rows.indices.min()), int(rows.indices.max()) + 1
    own = (rows.data, rows.indices - first, rows.indptr)
    return sp.csr_matrix(own, shape=(rows.shape[0], stop - first)), slice(first, stop)


def _digest(*columns: Array) -> bytes:
    """A hash of the values of `columns`, as a cache key."""
    return blake2b(b"".join(column.tobytes() for column in columns), digest_size=24).digest()


@compiled
def momenta_of(j: int, carriers: Indices, R: Array, p: Array, axes: Array, v: Array) -> Array:
    """Derivatives (N, k, 10) by link `j`'s inertial parameters of the momenta S · I V for the axes S of its `carriers`.

    V = Σ S v is the link's spatial velocity. `R` (N, n, 3, 3) and `p` (N, n, 3) m are the poses of the links' frames in
    the world; the joints' `axes` S (N, n, 6) are expressed in the world about its origin; `v` is (N, n).
    """
    N, K = axes.shape[0], len(carriers)
    momenta = np.empty((N, K, INERTIAL))
    S, V, together = np.empty(6), np.empty(6), np.empty(6)
    for i in range(N):
        together[:] = 0.0
        for c in carriers:
            for r in range(6):
                together[r] += axes[i, c, r] * v[i, c]
        into_frame(R[i, j], p[i, j], together, V)
        for k in range(K):
            into_frame(R[i, j], p[i, j], axes[i, carriers[k]], S)
            _product(S, V, momenta[i, k])
    return momenta


@compiled
def forces_of(
    j: int, carriers: Indices, R: Array, p: Array, axes: Array, rates: Array, velocities: Array
) -> tuple[Array, Array]:
    """Derivatives by link `j`'s inertial parameters of forces along the axes S of its k `carriers`.

    Returns Ṡ · I V with the spatial velocity V, (P, k, 10), and the projections of the weight on S under unit gravity
    along each world axis, (P, k, 4, 3). The axes' `rates` Ṡ and the links' `velocities` V are (P, n, 6); the rest is as
    for `momenta_of`.
    """
    P, K = axes.shape[0], len(carriers)
    forces, weights = np.empty((P, K, INERTIAL)), np.empty((P, K, 4, 3))
    S, W = np.empty(6), np.empty(6)
    for i in range(P):
        into_frame(R[i, j], p[i, j], velocities[i, j], W)
        for k in range(K):
            into_frame(R[i, j], p[i, j], rates[i, carriers[k]], S)
            _product(S, W, forces[i, k])
            into_frame(R[i, j], p[i, j], axes[i, carriers[k]], S)
            for x in range(3):
                gx, gy, gz = R[i, j, x, 0], R[i, j, x, 1], R[i, j, x, 2]
                weights[i, k, 0, x] = S[3] * gx + S[4] * gy + S[5] * gz
                weights[i, k, 1, x] = gy * S[2] - gz * S[1]
                weights[i, k, 2, x] = gz * S[0] - gx * S[2]
                weights[i, k, 3, x] = gx * S[1] - gy * S[0]
    return forces, weights


@compiled
def _product(S: Array, V: Array, result: Array) -> None:
    """Writes the derivatives of S · I V by the ten parameters of I into `result` (10,); S and V (6,) in one frame."""
    result[0] = S[3] * V[3] + S[4] * V[4] + S[5] * V[5]
    result[1] = V[4] * S[2] - V[5] * S[1] + S[4] * V[2] - S[5] * V[1]
    result[2] = V[5] * S[0] - V[3] * S[2] + S[5] * V[0] - S[3] * V[2]
    result[3] = V[3] * S[1] - V[4] * S[0] + S[3] * V[1] - S[4] * V[0]
    for r in range(3):
        result[4 + r] = S[r] * V[r]
    result[7] = S[0] * V[1] + S[1] * V[0]
    result[8] = S[0] * V[2] + S[2] * V[0]
    result[9] = S[1] * V[2] + S[2] * V[1]
