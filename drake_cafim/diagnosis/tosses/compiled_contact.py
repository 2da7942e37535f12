"""What points that touch feel and remember, compiled: contact laws and what changes them, as numbers.

E points lie as in `rigid.meeting`; `law` is what `law_of` makes of a contact.
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
FRICTIONLESS, SLIPPING, RESISTING = range(3)
CUBIC, DISSIPATION, RELAXING, TIME, ROLLING, STATIC, VELOCITY, DISTANCE = range(8)
NUMBERS: dict[type, dict[int, str]] = {
    ContactNonlinearStiffness: {CUBIC: "cubic"},
    ContactHuntCrossleyDissipation: {DISSIPATION: "dissipation"},
    ContactViscoelasticRelaxation: {RELAXING: "stiffness", TIME: "time_constant"},
    ContactRollingResistance: {ROLLING: "coefficient"},
    ContactStribeckFriction: {STATIC: "static", VELOCITY: "velocity"},
    ContactAnisotropicFriction: {},
    ContactPresliding: {DISTANCE: "distance"},
}
"""Where the changes that are known here have their numbers."""
OF_LAW, STRIBECK, ANISOTROPIC, PRESLIDING = range(4)
TRACTIONS: dict[type, int] = {
    ContactStribeckFriction: STRIBECK,
    ContactAnisotropicFriction: ANISOTROPIC,
    ContactPresliding: PRESLIDING,
}
Law = tuple[int, int, Array, Array, Array, int, int, int]


def law_of(contact: SphereContact | None) -> Law | None:
    """Normal law, friction and their numbers (5,): stiffness, damping, dissipation, μ and w or R; then the changes'.

    These are numbers (8,), a tensor of friction (3, 3) without its load, which traction there is, and where in a
    point's memory bristles and relaxed depth are. None where something changes the contact that is not known here.
    """
    if contact is None:
        return PAPER, FRICTIONLESS, np.zeros(5), np.zeros(8), np.zeros((3, 3)), OF_LAW, 0, 0
    if not _known([type(change) for change in contact.changes]):
        return None
    # what is known are effects, and no class that derives from one: it may have another law
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
    return *_plain(contact), beyond, tensor, traction, bristles, relaxed


def _known(kinds: list[type]) -> bool:
    """Whether all changes are known here, no two of a kind, nor two tractions."""
    distinct = set(kinds)
    return len(distinct) == len(kinds) and distinct <= NUMBERS.keys() and len(distinct & TRACTIONS.keys()) < 2


def _plain(contact: SphereContact) -> tuple[int, int, Array]:
    p = contact.parameters
    surface, width = FRICTIONLESS, p.slip_velocity
    if p.slip_velocity is not None:
        surface = SLIPPING
    elif p.resistance is not None:
        surface, width = RESISTING, p.resistance
    numbers = np.array([p.stiffness, p.damping, p.dissipation, p.friction, width or 0.0], dtype=float)
    return NORMAL_LAWS.index(contact.law.normal), surface, numbers


@compiled
def forces(
    held: Array, rate: Array, slip: Array, position: Array, w: Array, memory: Array, normal: Array, law: Any
) -> tuple[Array, Array, Array]:
    """Forces N and moments N m (E, 3) at points, and how the plain law's forces grow with velocity (E, 3), N s/m.

    These are across slip, along it, and pressing. `w` (3,) rad/s is the body's, `memory` (E, m) the points'.
    """
    surface, damping, friction, width, rolling = law[1], law[2][1], law[2][3], law[2][4], law[3][ROLLING]
    force, moment, slopes = np.empty((len(held), 3)), np.zeros((len(held), 3)), np.zeros((len(held), 3))
    for e in range(len(held)):
        push = _pushing(held[e], rate[e], memory[e], law)
        speed = _size(slip[e])
        rubbed, slopes[e, 1] = _rubbed(friction * push, speed, surface, width)
        slopes[e, 0], slopes[e, 2] = rubbed, damping if push > 0.0 else 0.0
        for x in range(3):
            force[e, x] = -rubbed * slip[e, x]
        if law[5] != OF_LAW:
            _pull(push, speed, slip[e], position[e], memory[e], normal, law, force[e])
        for x in range(3):
            force[e, x] += push * normal[x]
        if rolling != 0.0:
            _along(w, normal, moment[e])
            size = _size(moment[e])
            share = rolling * push * np.tanh(size / ROLLING_WIDTH) / max(size, 1e-9)
            for x in range(3):
                moment[e, x] *= -share
    return force, moment, slopes


@compiled
def _size(vector: Array) -> float:
    return float(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2))


@compiled
def _along(vector: Array, normal: Array, into: Array) -> None:
    """Fills `into` (3,) with the part of a vector (3,) in the plane."""
    through = vector[0] * normal[0] + vector[1] * normal[1] + vector[2] * normal[2]
    for x in range(3):
        into[x] = vector[x] - through * normal[x]


@compiled
def _pushing(held: float, rate: float, memory: Array, law: Any) -> float:
    """N along the normal of a point `held` m deep that goes deeper by `rate` m/s."""
    stiffness, beyond = law[2][0], law[3]
    push = force_before_clipping_at(law[0], held, rate, stiffness, law[2][1], law[2][2])
    push += beyond[CUBIC] * held**3 + stiffness * held * beyond[DISSIPATION] * rate
    if beyond[RELAXING] != 0.0:
        push += beyond[RELAXING] * (held - memory[law[7]])
    return float(max(push, 0.0))


@compiled
def _rubbed(most: float, speed: float, surface: int, width: float) -> tuple[float, float]:
    """How much force there is for each m/s of slip, N s/m, and how it grows along it; `most` N is at full slip."""
    if surface == SLIPPING:
        ratio = max(speed / width, 1e-6)
        level = np.tanh(ratio)
        return most * level / (ratio * width), most * (1.0 - level**2) / width
    if surface == RESISTING:
        rubbing = width * speed > most
        return most / max(speed, 1e-12) if rubbing else width, 0.0 if rubbing else width
    return 0.0, 0.0


@compiled
def _pull(
    push: float, speed: float, slip: Array, position: Array, memory: Array, normal: Array, law: Any, into: Array
) -> None:
    """Fills `into` (3,) with the tangential force of what replaces the law's, at a point pushed by `push` N."""
    surface, friction, width, beyond, turned = law[1], law[2][3], law[2][4], law[3], slip.copy()
    if law[5] == PRESLIDING:
        _along(position - memory[law[6] + 3 : law[6] + 6], normal, turned)
        _slide(memory[law[6] : law[6] + 3], turned, beyond[DISTANCE], into)
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
    rubbed, _ = _rubbed(friction * push, speed, surface, width)
    for x in range(3):
        into[x] = -rubbed * turned[x]


@compiled
def ahead(
    memory: Array, held: float, pressing: bool, position: Array, spinning: Array, elapsed: float, normal: Array,
    law: Any, into: Array,
) -> None:  # fmt: skip
    """Fills `into` (m,) with what a point remembers `elapsed` s later; `spinning` (3,) m/s is its slip by turning."""
    bristles, relaxed, beyond = law[6], law[7], law[3]
    if law[5] == PRESLIDING:
        moved = position - memory[bristles + 3 : bristles + 6]
        _along(moved, normal, moved)
        for x in range(3):
            moved[x] += 0.5 * (memory[bristles + 6 + x] + spinning[x]) * elapsed
            into[bristles + x], into[bristles + 3 + x], into[bristles + 6 + x] = 0.0, position[x], spinning[x]
        if pressing:
            _slide(memory[bristles : bristles + 3], moved, beyond[DISTANCE], into[bristles : bristles + 3])
    if beyond[TIME] > 0.0:
        y = memory[relaxed]
        into[relaxed] = y + (held - y) * -np.expm1(-elapsed / beyond[TIME]) if pressing else 0.0


@compiled
def _slide(bristle: Array, moved: Array, distance: float, into: Array) -> None:
    """Fills `into` with a bristle (3,) m after a straight way `moved` (3,) m; see `ContactPresliding`."""
    way = _size(moved)
    lost = -np.expm1(-way / distance)
    share = lost / way if way > 1e-12 * distance else 1.0 / distance
    for x in range(3):
        into[x] = (1.0 - lost) * bristle[x] + distance * share * moved[x]
