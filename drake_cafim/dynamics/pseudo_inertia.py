"""A body's ten inertial parameters as its pseudo-inertia, and as log-Cholesky parameters relative to a model's.

The pseudo-inertia J = ∫ (x; 1) (x; 1)ᵀ dm (4, 4) = [[Σ, h], [hᵀ, m]], with Σ = ½ tr(I) 1 − I, is positive definite
exactly for a distribution of positive mass (Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018). With J₀ = L Lᵀ the model's,

    J(θ) = L U(θ) U(θ)ᵀ Lᵀ,    U = e^α [[e^d₁, s₁₂, s₁₃, t₁], [0, e^d₂, s₂₃, t₂], [0, 0, e^d₃, t₃], [0, 0, 0, 1]]

is so for every θ = (α, d₁, d₂, d₃, s₁₂, s₂₃, s₁₃, t₁, t₂, t₃) and is J₀ at θ = 0 (Rucker, Wensing, IEEE RA-L 7(2),
2022). L is upper triangular and refers to the centre of mass, so that to first order 2 α is the relative change of the
mass, 2 d and s are those of the second moments a unit of mass, and t moves the centre of mass in units of the radii of
gyration: a prior that is the same in all of θ is the same in whatever frame and unit the model was written.
"""

from dataclasses import replace

import numpy as np

from drake_cafim.dynamics.tree import Body
from drake_cafim.typing import Array

PARAMETERS = 10
"""Number of a body's inertial parameters."""
SENSITIVITY = np.array([2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
"""(10,) relative change of the pseudo-inertia by a unit of each log-Cholesky parameter, at the model."""
LEAST_RADIUS = 1e-3
"""m, the least radius of gyration about any plane through the centre of mass: a point mass has no size to scale."""
_PAIRS = ((0, 1), (1, 2), (0, 2))
_ROWS, _COLUMNS = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


def pseudo_inertia(body: Body) -> Array:
    """J (4, 4) of a body about its own origin, in its own axes."""
    c, I = body.p_BBcm, body.I_BBcm_B  # noqa: E741
    second = 0.5 * np.trace(I) * np.eye(3) - I + body.mass * np.outer(c, c)
    return _assembled(second, body.mass * c, body.mass)


def inertial_parameters(J: Array) -> Array:
    """(..., 10) of J (..., 4, 4): mass kg, first moment (3,) kg m, inertia about the origin (xx, yy, zz, xy, xz, yz).

    They are linear in J, so that derivatives of J give those of the parameters.
    """
    second = J[..., :3, :3]
    inertia = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    return np.concatenate([J[..., 3, 3, None], J[..., :3, 3], inertia[..., _ROWS, _COLUMNS]], axis=-1)


def pseudo_inertia_of(parameters: Array) -> Array:
    """J (4, 4) of the ten `parameters` (10,) as `inertial_parameters` orders them."""
    inertia = np.zeros((3, 3))
    inertia[_ROWS, _COLUMNS] = inertia[_COLUMNS, _ROWS] = parameters[4:]
    return _assembled(0.5 * np.trace(inertia) * np.eye(3) - inertia, parameters[1:4], float(parameters[0]))


def in_frame(J: Array, R: Array, p: Array) -> Array:
    """J (..., 4, 4) of a body in frame B, expressed in a frame in which B has the pose `R` (3, 3), `p` (3,) m."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return np.asarray(X @ J @ X.T)


def is_consistent(J: Array) -> bool:
    """Whether J (4, 4) of a positive mass is that of a body no thinner than `LEAST_RADIUS`."""
    return bool(np.linalg.eigvalsh(_central(J))[0] >= J[3, 3] * LEAST_RADIUS**2)


def factor(J: Array) -> Array:
    """The upper triangular L (4, 4) with J = L Lᵀ; second moments below those of `LEAST_RADIUS` are raised to them."""
    mass, central = float(J[3, 3]), _central(J)
    if not is_consistent(J):
        moments, axes = np.linalg.eigh(central)
        central = (axes * np.maximum(moments, mass * LEAST_RADIUS**2)) @ axes.T
    L = np.zeros((4, 4))
    L[:3, :3], L[:3, 3], L[3, 3] = _upper_factor(central), J[:3, 3] / np.sqrt(mass), np.sqrt(mass)
    return L


def _central(J: Array) -> Array:
    """The second moments (3, 3) about the centre of mass."""
    return np.asarray(J[:3, :3] - np.outer(J[:3, 3], J[:3, 3]) / J[3, 3])


def log_cholesky(J: Array, model: Array) -> Array:
    """θ (10,) of the pseudo-inertia J relative to that of the `model`, each (4, 4).

    Raises `numpy.linalg.LinAlgError` where J is not positive definite.
    """
    L = factor(model)
    X = np.linalg.solve(L, np.linalg.solve(L, J).T)
    U = _upper_factor(0.5 * (X + X.T))
    alpha = np.log(U[3, 3])
    U = U / U[3, 3]
    return np.array([alpha, *np.log(np.diag(U)[:3]), *(U[i, j] for i, j in _PAIRS), *U[:3, 3]])


def changed(model: Array, theta: Array) -> Array:
    """J(θ) (4, 4) for θ `theta` (10,) relative to the pseudo-inertia of the `model` (4, 4)."""
    LU = factor(model) @ _triangle(theta)
    return np.asarray(LU @ LU.T)


def slopes(model: Array, theta: Array) -> Array:
    """∂J/∂θ (10, 4, 4) at `theta` (10,)."""
    L, U = factor(model), _triangle(theta)
    by = np.zeros((PARAMETERS, 4, 4))
    by[0] = U
    scale = np.exp(theta[0])
    for k in range(3):
        by[1 + k, k, k] = U[k, k]
        by[7 + k, k, 3] = scale
    for k, (i, j) in enumerate(_PAIRS):
        by[4 + k, i, j] = scale
    half = L @ by @ U.T @ L.T
    return np.asarray(half + np.swapaxes(half, 1, 2))


def with_pseudo_inertia(body: Body, J: Array) -> Body:
    """The body with the mass, the centre of mass and the inertia of J (4, 4)."""
    mass, central = float(J[3, 3]), _central(J)
    inertia = np.trace(central) * np.eye(3) - central
    return replace(body, mass=mass, p_BBcm=J[:3, 3] / mass, I_BBcm_B=inertia)


def _assembled(second: Array, moment: Array, mass: float) -> Array:
    J = np.zeros((4, 4))
    J[:3, :3], J[:3, 3], J[3, :3], J[3, 3] = second, moment, moment, mass
    return J


def _triangle(theta: Array) -> Array:
    """U(θ) (4, 4)."""
    U = np.diag([*np.exp(theta[1:4]), 1.0])
    for value, (i, j) in zip(theta[4:7], _PAIRS, strict=True):
        U[i, j] = value
    U[:3, 3] = theta[7:]
    return np.asarray(np.exp(theta[0]) * U)


def _upper_factor(A: Array) -> Array:
    """The upper triangular U with A = U Uᵀ: a Cholesky factor with rows and columns in reverse."""
    return np.asarray(np.linalg.cholesky(A[::-1, ::-1])[::-1, ::-1])
