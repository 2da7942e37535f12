"""Contact forces on points and the contacts' internal states, compiled, for known contact laws and effects.

E points are laid out as in `rigid.contact_kinematics`; `law` is the result of `law_of`.
"""

from typing import Any, cast

import numpy as np

from drake_cafim.contact.change import surface_axes
from drake_cafim.contact.normal import NORMAL_LAWS, force_before_clipping_at
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.contact_friction import (
    ROLLING_WIDTH,
    ContactAnisotropicFriction,
    ContactPresliding,
    ContactRollingResistance,
    ContactStribeckFriction,
)
from drake_cafim.effects.normal_contact import (
    ContactHuntCrossleyDissipation,
    ContactNonlinearStiffness,
    ContactViscoelasticRelaxation,
)
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

PAPER = NORMAL_LAWS.index("paper")
HYDROELASTIC = NORMAL_LAWS.index("hydroelastic")
FRICTIONLESS, SLIPPING, RESISTING = range(3)
CUBIC, DISSIPATION, RELAXING, TIME, ROLLING, STATIC, VELOCITY, DISTANCE = range(8)
"""Indices of the effects' parameters in `Law[3]`."""
NUMBERS: dict[type, dict[int, str]] = {
    ContactNonlinearStiffness: {CUBIC: "cubic"},
    ContactHuntCrossleyDissipation: {DISSIPATION: "dissipation"},
    ContactViscoelasticRelaxation: {RELAXING: "stiffness", TIME: "time_constant"},
    ContactRollingResistance: {ROLLING: "coefficient"},
    ContactStribeckFriction: {STATIC: "static", VELOCITY: "velocity"},
    ContactAnisotropicFriction: {},
    ContactPresliding: {DISTANCE: "distance"},
}
"""The effects that are known here, with the index of each of their parameters."""
OF_LAW, STRIBECK, ANISOTROPIC, PRESLIDING = range(4)
TRACTIONS: dict[type, int] = {
    ContactStribeckFriction: STRIBECK,
    ContactAnisotropicFriction: ANISOTROPIC,
    ContactPresliding: PRESLIDING,
}
"""The effects that replace the tangential law."""
Law = tuple[int, int, Array, Array, Array, int, int, int]


def law_of(contact: SphereContact | None) -> Law | None:
    """A contact's law as plain numbers for compiled code; None where an effect on it is not known here.

    The entries: normal law; kind of friction; their parameters (7,), stiffness (of the pressure
    field P), damping, dissipation, μ, w or R, narrowing and deficit;
    the effects' parameters (8,); the friction tensor (3, 3); which tangential law acts; the first index of the bristle
    and of the relaxed depth in a point's memory.
    """
    if contact is None:
        nothing = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        return PAPER, FRICTIONLESS, nothing, np.zeros(8), np.zeros((3, 3)), OF_LAW, 0, 0
    if not _are_known([type(change) for change in contact.changes]):
        return None
    # a class derived from a known effect is not known, since it may have another law
    changes = cast(tuple[ContactEffect, ...], contact.changes)
    beyond, tensor, traction, places, first = np.zeros(8), np.zeros((3, 3)), OF_LAW, dict.fromkeys(NUMBERS, 0), 0
    for change in changes:
        for index, name in NUMBERS[type(change)].items():
            beyond[index] = change.values[name]
        if TRACTIONS.get(type(change)) == ANISOTROPIC:
            tensor = np.ascontiguousarray(cast(ContactAnisotropicFriction, change).tensor(surface_axes(contact.normal)))
        traction, places[type(change)] = TRACTIONS.get(type(change), traction), first
        first += change.memory
    bristles, relaxed = places[ContactPresliding], places[ContactViscoelasticRelaxation]
    return *_unchanged_law(contact), beyond, tensor, traction, bristles, relaxed


def _are_known(kinds: list[type]) -> bool:
    """Whether all effects are known here, all different, and at most one replaces the tangential law."""
    distinct = set(kinds)
    return len(distinct) == len(kinds) and distinct <= NUMBERS.keys() and len(distinct & TRACTIONS.keys()) < 2


def _unchanged_law(contact: SphereContact) -> tuple[int, int, Array]:
    """The first three entries of `Law`: the nominal law without effects."""
    p = contact.parameters
    surface, width = FRICTIONLESS, p.slip_velocity
    if p.slip_velocity is not None:
        surface = SLIPPING
    elif p.resistance is not None:
        surface, width = RESISTING, p.resistance
    normal = p.of_normal(contact.law.normal)
    field = (normal.get("narrowing", 1.0), normal.get("deficit", 0.0))
    numbers = np.array([normal["stiffness"], p.damping, p.dissipation, p.friction, width or 0.0, *field], dtype=float)
    return NORMAL_LAWS.index(contact.law.normal), surface, numbers


@compiled
def forces(
    held: Array, rate: Array, slip: Array, position: Array, w: Array, memory: Array, normal: Array, law: Any
) -> tuple[Array, Array, Array]:
    """Forces N and moments N m (E, 3) at points, and the nominal law's slopes in velocity (E, 3), N s/m.

    The slopes are those across the slip, along it, and along the normal. `held` (E,) m is the penetration, `rate` (E,)
    m/s its rate, `slip` (E, 3) m/s; `w` (3,) rad/s is the body's angular velocity, `memory` (E, m) the points'.
    """
    surface, damping, friction, width, rolling = law[1], law[2][1], law[2][3], law[2][4], law[3][ROLLING]
    force, moment, slopes = np.empty((len(held), 3)), np.zeros((len(held), 3)), np.zeros((len(held), 3))
    for e in range(len(held)):
        push = _normal_force(held[e], rate[e], memory[e], law)
        speed = _size(slip[e])
        rubbed, slopes[e, 1] = _friction_slopes(friction * push, speed, surface, width)
        slopes[e, 0], slopes[e, 2] = rubbed, damping if push > 0.0 else 0.0
        for x in range(3):
            force[e, x] = -rubbed * slip[e, x]
        if law[5] != OF_LAW:
            _fill_traction(push, speed, slip[e], position[e], memory[e], normal, law, force[e])
        for x in range(3):
            force[e, x] += push * normal[x]
        if rolling != 0.0:
            _project(w, normal, moment[e])
            size = _size(moment[e])
            share = rolling * push * np.tanh(size / ROLLING_WIDTH) / max(size, 1e-9)
            for x in range(3):
                moment[e, x] *= -share
    return force, moment, slopes


@compiled
def _size(vector: Array) -> float:
    """The Euclidean norm of a vector (3,)."""
    return float(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2))


@compiled
def _project(vector: Array, normal: Array, into: Array) -> None:
    """Fills `into` (3,) with the projection of a vector (3,) on the plane."""
    through = vector[0] * normal[0] + vector[1] * normal[1] + vector[2] * normal[2]
    for x in range(3):
        into[x] = vector[x] - through * normal[x]


@compiled
def _normal_force(held: float, rate: float, memory: Array, law: Any) -> float:
    """The normal force, N, at penetration `held` m that grows by `rate` m/s."""
    stiffness, beyond = law[2][0], law[3]
    push = force_before_clipping_at(law[0], held, rate, stiffness, law[2][1], law[2][2], law[2][5], law[2][6])
    # of the pressure field `stiffness` is no N/m, and the effect has nothing to multiply
    linear = 0.0 if law[0] == HYDROELASTIC else stiffness
    push += beyond[CUBIC] * held**3 + linear * held * beyond[DISSIPATION] * rate
    if beyond[RELAXING] != 0.0:
        push += beyond[RELAXING] * (held - memory[law[7]])
    return float(max(push, 0.0))


@compiled
def _friction_slopes(most: float, speed: float, surface: int, width: float) -> tuple[float, float]:
    """Friction over slip speed, and its slope ∂friction/∂speed, both N s/m; `most` N is the friction at full slip."""
    if surface == SLIPPING:
        ratio = max(speed / width, 1e-6)  # tanh(x)/x at rest without 0/0
        level = np.tanh(ratio)
        return most * level / (ratio * width), most * (1.0 - level**2) / width
    if surface == RESISTING:
        rubbing = width * speed > most
        return most / max(speed, 1e-12) if rubbing else width, 0.0 if rubbing else width
    return 0.0, 0.0


@compiled
def _fill_traction(
    push: float, speed: float, slip: Array, position: Array, memory: Array, normal: Array, law: Any, into: Array
) -> None:
    """Fills `into` (3,) with the tangential force of the effect that replaces the law's, at normal force `push` N."""
    surface, friction, width, beyond, turned = law[1], law[2][3], law[2][4], law[3], slip.copy()
    if law[5] == PRESLIDING:
        _project(position - memory[law[6] + 3 : law[6] + 6], normal, turned)
        _advance_bristle(memory[law[6] : law[6] + 3], turned, beyond[DISTANCE], into)
        for x in range(3):
            into[x] *= -friction / beyond[DISTANCE] * push
        return
    if law[5] == STRIBECK:
        friction += (beyond[STATIC] - friction) * np.exp(-((speed / beyond[VELOCITY]) ** 2))
    else:
        for x in range(3):
            turned[x] = slip[0] * law[4][0, x] + slip[1] * law[4][1, x] + slip[2] * law[4][2, x]
        size = _size(turned)
        friction = size / speed if speed > 0.0 else 0.0
        for x in range(3):
            turned[x] *= speed / size if size > 0.0 else 1.0
    rubbed, _ = _friction_slopes(friction * push, speed, surface, width)
    for x in range(3):
        into[x] = -rubbed * turned[x]


@compiled
def advance_memory(
    memory: Array, held: float, pressing: bool, position: Array, spinning: Array, elapsed: float, normal: Array,
    law: Any, into: Array,
) -> None:  # fmt: skip
    """Fills `into` (m,) with a point's memory `elapsed` s later; `spinning` (3,) m/s is its slip by the body's spin."""
    bristles, relaxed, beyond = law[6], law[7], law[3]
    if law[5] == PRESLIDING:
        moved = position - memory[bristles + 3 : bristles + 6]
        _project(moved, normal, moved)
        for x in range(3):
            moved[x] += 0.5 * (memory[bristles + 6 + x] + spinning[x]) * elapsed
            into[bristles + x], into[bristles + 3 + x], into[bristles + 6 + x] = 0.0, position[x], spinning[x]
        if pressing:
            _advance_bristle(memory[bristles : bristles + 3], moved, beyond[DISTANCE], into[bristles : bristles + 3])
    if beyond[TIME] > 0.0:
        y = memory[relaxed]
        into[relaxed] = y + (held - y) * -np.expm1(-elapsed / beyond[TIME]) if pressing else 0.0


@compiled
def _advance_bristle(bristle: Array, moved: Array, distance: float, into: Array) -> None:
    """Fills `into` with the bristle (3,) m after a straight displacement `moved` (3,) m; see `ContactPresliding`."""
    way = _size(moved)
    lost = -np.expm1(-way / distance)
    share = lost / way if way > 1e-12 * distance else 1.0 / distance
    for x in range(3):
        into[x] = (1.0 - lost) * bristle[x] + distance * share * moved[x]
