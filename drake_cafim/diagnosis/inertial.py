"""The weak form's inertial and gravity terms as a regressor: linear in each joint's ten inertial parameters.

With φ = (m, m c, I_Jo) in the joint's moving frame J, momentum and its rate are linear in φ, and weight in φ and
gravity (Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986). A change of a mass, of a centre of mass, a
payload or a tilt is then a matrix product.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.cross import cross
from drake_cafim.diagnosis.windows import Windows
from drake_cafim.dynamics.motion import Motion, skew
from drake_cafim.dynamics.tree import FIXED, Tree
from drake_cafim.typing import Array

INERTIAL = 10
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def inertial_parameters(tree: Tree) -> Array:
    """(n, 10): mass, first moment and inertia about Jo (xx, yy, zz, xy, xz, yz) of what rides each joint, frame J."""
    result = np.zeros((len(tree.joints), INERTIAL))
    for body in tree.bodies:
        if body.joint == FIXED:
            continue
        p_JBcm = body.p_JB + body.R_JB @ body.p_BBcm
        C = skew(p_JBcm)
        I_Jo = body.R_JB @ body.I_BBcm_B @ body.R_JB.T - body.mass * C @ C
        result[body.joint] += [body.mass, *(body.mass * p_JBcm), *(I_Jo[a, b] for a, b in _PAIRS)]
    return result


@dataclass(frozen=True)
class InertialRegressor:
    """`inertia` (M, n, n, 10) and `weight` (M, n, n, 4, 3): window, row, joint, parameter, gravity axis."""

    inertia: Array
    weight: Array

    def rows(self, parameters: Array, gravity: Array) -> Array:
        """−∫ ẇ p dt − ∫ w (∂T/∂q + gravity) dt, (M, n), without rotor inertias."""
        inertial = np.tensordot(self.inertia, parameters, axes=([2, 3], [0, 1]))
        return np.asarray(inertial + np.tensordot(self.weight @ gravity, parameters[:, :4], axes=([2, 3], [0, 1])))


def inertial_regressor(smooth: Motion, v: Array, windows: Windows) -> InertialRegressor:
    """The regressor of one recording.

    `smooth` is the motion that products are evaluated at; the momentum is linear in the measured `v` (N, n), whose
    noise then stays linear.
    """
    tree, n = smooth.tree, smooth.q.shape[1]
    supports = tree.supports()
    inertia = np.zeros((len(windows), n, n, INERTIAL))
    weight = np.zeros((len(windows), n, n, 4, 3))
    for j in range(n):
        R, p = smooth.R_WJ[:, j], smooth.p_WJ[:, j]
        carriers = np.flatnonzero(supports[j])
        axes = _in_frame(smooth.axes[:, carriers], R, p)
        rates = _in_frame(smooth.axes_rate[:, carriers], R, p)
        measured = np.einsum("nka,nk->na", axes, v[:, carriers])
        momenta = _products(axes, measured)
        forces = _products(rates, _in_frame(smooth.velocities[:, j, None], R, p)[:, 0])
        heavy = (axes @ _OF_FIELD).reshape(len(v), -1, 3) @ np.swapaxes(R, 1, 2)
        shape = (len(windows), len(carriers), -1)
        inertia[:, carriers, j] = -(windows.rate @ momenta + windows.value @ forces).reshape(shape)
        weight[:, carriers, j] = -(windows.value @ heavy.reshape(len(v), -1)).reshape(*shape[:2], 4, 3)
    return InertialRegressor(inertia, weight)


def _in_frame(S_W: Array, R_WJ: Array, p_WJ: Array) -> Array:
    """Motion vectors (N, k, 6) about the world origin, world axes, taken to Jo and J axes."""
    linear = S_W[..., 3:] + cross(S_W[..., :3], p_WJ[:, None])
    return np.concatenate([S_W[..., :3] @ R_WJ, linear @ R_WJ], axis=2)


def _products(S: Array, V: Array) -> Array:
    """(N, k · 10): S · I V for motion vectors S (N, k, 6) and V (N, 6) in J, by each inertial parameter of I."""
    pairs = (S[..., :, None] * V[:, None, None, :]).reshape(-1, 36)
    return np.asarray((pairs @ _OF_PAIRS).reshape(len(S), -1))


def _unit_inertias() -> Array:
    """(10, 6, 6): the spatial inertia about Jo, angular part first, of each unit inertial parameter."""
    table = np.zeros((INERTIAL, 6, 6))
    table[0, 3:, 3:] = np.eye(3)
    table[1:4, :3, 3:] = skew(np.eye(3))
    table[1:4, 3:, :3] = -table[1:4, :3, 3:]
    for i, (a, b) in enumerate(_PAIRS):
        table[4 + i, a, b] = table[4 + i, b, a] = 1.0
    return table


_UNIT_INERTIAS = _unit_inertias()
_OF_PAIRS = np.ascontiguousarray(_UNIT_INERTIAS.reshape(INERTIAL, 36).T)
_OF_FIELD = np.ascontiguousarray(np.moveaxis(_UNIT_INERTIAS[:4, :, 3:], 1, 0).reshape(6, 12))
"""(6, 4 · 3): with a unit of gravity along each axis of J, the weight of unit mass and first moments, by axis."""
