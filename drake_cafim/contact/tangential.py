"""The tangential force of a contact, in two forms, and its derivatives.

With sliding velocity v (m/s, of the body that the force acts on, relative to the other body) and normal force λ:

    slip_velocity w   f = −μ λ tanh(|v| / w) v / |v|
    resistance R      f = −min(μ λ, R |v|) v / |v|          (paper, "Contact Model")

In the second form f depends on μ only where μ λ < R |v|; elsewhere ∂f/∂μ is exactly zero.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.contact.normal import Scalars
from drake_cafim.typing import Array


@dataclass(frozen=True)
class TangentialForce:
    """f (..., m) in N and its derivatives; `wrt_velocity` is (..., m, m), the others (..., m).

    `wrt_width` is with respect to the slip velocity w or to the resistance R, whichever form is used.
    """

    force: Array
    wrt_normal: Array
    wrt_velocity: Array
    wrt_friction: Array
    wrt_width: Array


def _speed(velocity: Array) -> tuple[Array, Any]:
    """|v| (...,) with 1 in place of 0, so that AutoDiffXd never differentiates sqrt(0), and where it was 0."""
    square = (velocity * velocity).sum(axis=-1)
    resting = square == 0
    return np.asarray(np.sqrt(np.where(resting, square + 1.0, square))), resting


def slip_force(normal: Array, velocity: Array, *, friction: Scalars, slip_velocity: Scalars) -> Array:
    """f (..., m) in N for normal force (...,) N and sliding velocity (..., m) m/s, by tanh(|v|/w)."""
    speed, resting = _speed(velocity)
    ratio = np.where(resting, 1.0 / slip_velocity, np.tanh(speed / slip_velocity) / speed)
    return _lift(-friction * normal * ratio, 1) * velocity


def resistance_force(normal: Array, velocity: Array, *, friction: Scalars, resistance: Scalars) -> Array:
    """f (..., m) in N for normal force (...,) N and sliding velocity (..., m) m/s, by min(μλ, R|v|)."""
    speed, resting = _speed(velocity)
    sliding = np.logical_and(friction * normal < resistance * speed, resting == 0)
    ratio = np.where(sliding, friction * normal / speed, resistance)
    return -_lift(ratio, 1) * velocity


def slip_force_derivatives(
    normal: Array, velocity: Array, *, friction: Scalars, slip_velocity: Scalars
) -> TangentialForce:
    """`slip_force` with its analytic derivatives."""
    speed, resting = _speed(velocity)
    level = np.tanh(speed / slip_velocity)
    steepness = (1.0 - level**2) / slip_velocity  # d level / d|v|
    ratio = np.where(resting, 1.0 / slip_velocity, level / speed)
    ratio_slope = np.where(resting, 0.0, (steepness - ratio) / speed**2)  # (d ratio / d|v|) / |v|
    strength = friction * normal
    shape = ratio[..., np.newaxis] * velocity
    outer = velocity[..., :, np.newaxis] * velocity[..., np.newaxis, :]
    identity = np.eye(velocity.shape[-1])
    wrt_velocity = -_lift(strength, 2) * (_lift(ratio, 2) * identity + _lift(ratio_slope, 2) * outer)
    # d tanh(|v|/w)/dw = −(|v|/w) · steepness; at rest the shape v/w has derivative −v/w² = 0
    width_slope = np.where(resting, 0.0, steepness / slip_velocity)
    return TangentialForce(
        force=-_lift(strength, 1) * shape,
        wrt_normal=-_lift(friction * np.ones_like(normal), 1) * shape,
        wrt_velocity=wrt_velocity,
        wrt_friction=-_lift(normal, 1) * shape,
        wrt_width=_lift(strength * width_slope, 1) * velocity,
    )


def resistance_force_derivatives(
    normal: Array, velocity: Array, *, friction: Scalars, resistance: Scalars
) -> TangentialForce:
    """`resistance_force` with its analytic derivatives; ∂f/∂μ is zero where R |v| < μ λ."""
    speed, resting = _speed(velocity)
    sliding = np.logical_and(friction * normal < resistance * speed, resting == 0)
    direction = np.where(_lift(sliding, 1), velocity / _lift(speed, 1), 0.0)
    identity = np.eye(velocity.shape[-1])
    projection = identity - direction[..., :, np.newaxis] * direction[..., np.newaxis, :]
    viscous = np.where(sliding, 0.0, 1.0)
    strength = np.where(sliding, friction * normal, 0.0)
    wrt_velocity = -_lift(strength / speed, 2) * projection - _lift(resistance * viscous, 2) * identity
    return TangentialForce(
        force=resistance_force(normal, velocity, friction=friction, resistance=resistance),
        wrt_normal=-_lift(friction * np.ones_like(normal), 1) * direction,
        wrt_velocity=wrt_velocity,
        wrt_friction=-_lift(normal, 1) * direction,
        wrt_width=-_lift(viscous, 1) * velocity,
    )


def _lift(values: Array, axes: int) -> Array:
    """`values` (...) with `axes` axes of length one appended."""
    return np.asarray(values).reshape(np.shape(values) + (1,) * axes)
