"""The weak form's inertial and gravity terms as a regressor: linear in each joint's ten inertial parameters.

With φ = (m, m c, I_Jo) in the joint's moving frame J, momentum and its rate are linear in φ, and weight in φ and
gravity (Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986). A change of a mass, of a centre of mass, a
payload or a tilt is then a matrix product.
"""

from dataclasses import dataclass

import numpy as np

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
        axes = {k: _in_frame(smooth.axes[:, k], R, p) for k in carriers}
        rates = {k: _in_frame(smooth.axes_rate[:, k], R, p) for k in carriers}
        measured = np.sum([axes[k] * v[:, k, None] for k in carriers], axis=0)
        momentum = _momentum_basis(measured)
        momentum_smooth = _momentum_basis(_in_frame(smooth.velocities[:, j], R, p))
        field = np.swapaxes(R, 1, 2)
        weight_basis = _weight_basis(field)
        for k in carriers:
            p_k = np.einsum("na,nia->ni", axes[k], momentum)
            force_k = np.einsum("na,nia->ni", rates[k], momentum_smooth)
            inertia[:, k, j] = -(windows.rate @ p_k) - windows.value @ force_k
            w_k = np.einsum("na,nixa->nix", axes[k], weight_basis)
            weight[:, k, j] = -(windows.value @ w_k.reshape(len(v), 12)).reshape(-1, 4, 3)
    return InertialRegressor(inertia, weight)


def _in_frame(S_W: Array, R_WJ: Array, p_WJ: Array) -> Array:
    """A motion vector about the world origin, world axes, taken to Jo and J axes."""
    linear = S_W[:, 3:] + np.cross(S_W[:, :3], p_WJ)
    return np.concatenate([np.einsum("nji,nj->ni", R_WJ, S_W[:, :3]), np.einsum("nji,nj->ni", R_WJ, linear)], axis=1)


def _momentum_basis(V: Array) -> Array:
    """(N, 10, 6): the spatial momentum of each unit inertial parameter that moves with V (N, 6) in J."""
    w, v = V[:, :3], V[:, 3:]
    basis = np.zeros((len(V), INERTIAL, 6))
    basis[:, 0, 3:] = v
    for a in range(3):
        unit = np.zeros(3)
        unit[a] = 1.0
        basis[:, 1 + a, :3] = np.cross(unit, v)
        basis[:, 1 + a, 3:] = np.cross(w, unit)
    for i, (a, b) in enumerate(_PAIRS):
        basis[:, 4 + i, a] += w[:, b]
        if a != b:
            basis[:, 4 + i, b] += w[:, a]
    return basis


def _weight_basis(R_JW: Array) -> Array:
    """(N, 4, 3, 6): the weight wrench of unit mass and first moments under unit gravity along each world axis."""
    basis = np.zeros((len(R_JW), 4, 3, 6))
    for x in range(3):
        g = R_JW[:, :, x]
        basis[:, 0, x, 3:] = g
        for a in range(3):
            unit = np.zeros(3)
            unit[a] = 1.0
            basis[:, 1 + a, x, :3] = np.cross(unit, g)
    return basis
