"""Five to twenty effects at once on an arm: friction of every kind, and whatever else its joints and drives lack."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import timing
from .arm_context import ArmContext
from .draw_arm import DRAWS
from .noise import loguniform
from .truth import Concealed

FEWEST, MOST, PER_JOINT = 5, 20, 5

Place = tuple[str, int]  # what is drawn there, and the joint

_KINDS: dict[str, tuple[float, tuple[str, ...]]] = {
    "dry": (
        3.0,
        (
            "joint_coulomb_friction",
            "joint_coulomb_friction",
            "joint_asymmetric_coulomb_friction",
            "joint_stribeck_friction",
            "joint_load_dependent_friction",
        ),
    ),
    "viscous": (3.0, ("joint_viscous_friction",)),
    "rotor": (1.5, ("rotor_inertia",)),
    "late": (1.0, ("actuator_delay", "actuator_lag")),
    "gain": (1.0, ("actuator_gain_error",)),
    # a spring's rest holds whatever a bias would
    "offset": (1.5, ("actuator_bias", "actuator_bias", "joint_spring")),
    "ripple": (0.7, ("torque_ripple",)),
    "sensor": (0.7, ("sensor_delay", "sensor_lag")),
}
"""What a joint may have one of: how often, and the effects that it may be."""
_PAYLOAD = 2.0

FIRST = ("actuator_delay", "actuator_lag")
"""A drive is late with its command before it multiplies it and adds to it."""
POOL = frozenset(effect for _, effects in _KINDS.values() for effect in effects) | {"payload"}


def draw_many(rng: np.random.Generator, context: ArmContext) -> tuple[Concealed, ...]:
    """The effects, each with a strength as one alone has, from invisible to obvious."""
    count = int(rng.integers(FEWEST, min(MOST, PER_JOINT * context.robot.size) + 1))
    kinds = [kind for kind in _KINDS if context.has_velocity or kind != "sensor"]
    places: list[Place] = [(kind, joint) for joint in context.moving() for kind in kinds] + [("payload", 0)]
    weights = np.array([_PAYLOAD if kind == "payload" else _KINDS[kind][0] for kind, _ in places])
    chosen = rng.choice(len(places), count, replace=False, p=weights / weights.sum())
    effects = [_drawn(rng, context, *places[index]) for index in sorted(chosen)]
    return tuple(sorted(effects, key=lambda item: item.effect not in FIRST))


def _drawn(rng: np.random.Generator, context: ArmContext, kind: str, joint: int) -> Concealed:
    if kind == "payload":
        return DRAWS["payload"](rng, context, joint)
    effect = str(rng.choice(_KINDS[kind][1]))
    if kind == "sensor":
        return _late_velocity(rng, context, effect, joint)
    return DRAWS[effect](rng, context, joint)


def _late_velocity(rng: np.random.Generator, context: ArmContext, effect: str, joint: int) -> Concealed:
    """A velocity that comes later than its encoder: it was filtered."""
    channel, seconds = f"v.{context.robot.joints[joint].name}", loguniform(rng, 1e-3, 3e-2)
    makers: dict[str, tuple[str, Callable[..., object]]] = {
        "sensor_delay": ("delay", timing.delayed),
        "sensor_lag": ("time_constant", timing.lagged),
    }
    name, maker = makers[effect]
    return Concealed(effect, channel, {name: (seconds, "s")}, sensor=maker([channel], seconds))  # type: ignore[arg-type]
