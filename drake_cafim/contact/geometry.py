"""Where a sphere or a box touches a plane, how deep, and how it moves there; vectorised over samples.

The plane goes through `point` P (m) with unit normal n pointing out of the ground, both in the world frame W.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from drake_cafim.cross import cross
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ContactPoints:
    """The candidate contact points of a body against a plane, over samples (...,) and points c.

    Together they feed `ContactLaw`: penetration (..., c) m, rate (..., c) m/s and tangential velocity
    (..., c, 3) m/s in W, at p_BoC_W (..., c, 3) m from the body's origin to the point.
    """

    penetration: Array
    rate: Array
    tangential_velocity: Array
    p_BoC_W: Array


def sphere_on_plane(
    p_WBo: Array, v_WBo: Array, w_WB: Array, *, radius: float, point: Array, normal: Array
) -> ContactPoints:
    """The deepest point of a sphere of `radius` m about the body's origin: one point (c = 1).

    Positions, velocities and angular velocities are (..., 3) in W.
    """
    p_BoC_W = np.broadcast_to(-radius * np.asarray(normal), p_WBo.shape)[..., np.newaxis, :]
    return _against_plane(p_WBo, v_WBo, w_WB, p_BoC_W, point=point, normal=normal)


def box_on_plane(
    p_WBo: Array, R_WB: Array, v_WBo: Array, w_WB: Array, *, size: Array, point: Array, normal: Array
) -> ContactPoints:
    """The eight corners (c = 8) of a box of extents `size` (3,) m about the body's origin; R_WB is (..., 3, 3)."""
    corners_B = 0.5 * np.asarray(size) * np.array(list(product((-1.0, 1.0), repeat=3)))
    p_BoC_W = np.einsum("...ij,cj->...ci", R_WB, corners_B)
    return _against_plane(p_WBo, v_WBo, w_WB, p_BoC_W, point=point, normal=normal)


def _against_plane(
    p_WBo: Array, v_WBo: Array, w_WB: Array, p_BoC_W: Array, *, point: Array, normal: Array
) -> ContactPoints:
    normal = np.asarray(normal, dtype=float)
    p_PC_W = p_WBo[..., np.newaxis, :] + p_BoC_W - np.asarray(point)
    v_WC = v_WBo[..., np.newaxis, :] + cross(w_WB[..., np.newaxis, :], p_BoC_W)
    approach = -(v_WC @ normal)
    return ContactPoints(
        penetration=-(p_PC_W @ normal),
        rate=approach,
        tangential_velocity=v_WC + approach[..., np.newaxis] * normal,
        p_BoC_W=p_BoC_W,
    )
