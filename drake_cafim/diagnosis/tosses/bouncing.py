"""The same steps as `flight`, compiled, for bodies that nothing moves but their weight and a contact's plain law.

Each body flies by itself, so that none waits for those that touch. Bodies and points are laid out as in `rigid`; a
`body` is its mass, centre of mass, inertia and the inverse of all, as in `FreeBody.inertial`, and gravity (3,) m/s².
"""

from typing import Any

import numpy as np

from drake_cafim.compiled import compiled
from drake_cafim.contact.normal import NORMAL_LAWS
from drake_cafim.diagnosis.tosses import rigid
from drake_cafim.diagnosis.tosses.rosenbrock import (
    ALPHA,
    EMBEDDED,
    GAMMA,
    LANDED,
    LONGEST,
    MOST_STEPS,
    SHIFT,
    SHORTEST,
    WEIGHTS,
)
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import rotation_matrices_of
from drake_cafim.typing import Array, Indices

PAPER, HUNT_CROSSLEY = NORMAL_LAWS.index("paper"), NORMAL_LAWS.index("hunt_crossley")
FRICTIONLESS, SLIPPING, RESISTING = range(3)


def plain_law(contact: SphereContact | None) -> tuple[int, int, Array]:
    """Which normal law and which friction, and their numbers: stiffness, damping, dissipation, μ and w or R."""
    if contact is None:
        return PAPER, FRICTIONLESS, np.zeros(5)
    p = contact.parameters
    surface, width = FRICTIONLESS, p.slip_velocity
    if p.slip_velocity is not None:
        surface = SLIPPING
    elif p.resistance is not None:
        surface, width = RESISTING, p.resistance
    numbers = np.array([p.stiffness, p.damping, p.dissipation, p.friction, width or 0.0], dtype=float)
    return NORMAL_LAWS.index(contact.law.normal), surface, numbers


@compiled
def bounced(
    start: Array, times: Array, counts: Any, allowed: Array, body: Any, plane: Any, law: Any
) -> tuple[Array, Indices, Array, Array, Array, Any]:
    """States (B, S, 13) at the samples, and the steps between: `flight`, `time`, `step`, `state`, `mode` of `Fine`.

    `start` (B, 13), `times` (B, S) s and `counts` (B,) as in `fly`; `allowed` (6,) m/s and rad/s is how much a step may
    be off for each second of it.
    """
    B, S = times.shape
    points, below, normal, height = plane
    out, K, found, room = np.zeros((B, S, 13)), points.shape[1], 0, 64 * (B + 1)
    flight, time_at, taken = np.empty(room, dtype=np.int64), np.empty(room), np.empty(room)
    states, modes = np.empty((room, 13)), np.empty((room, K), dtype=np.bool_)
    for b in range(B):
        now, time, following, usual = start[b : b + 1].copy(), times[b, 0], 1, 1e-3
        out[b, 0] = now[0]
        R = _turned(now)
        deep, sinking = rigid.depths(now, R, points, below, normal, height)
        mode = deep > 0.0
        for _ in range(MOST_STEPS):
            if following >= counts[b]:
                break
            left, touching = times[b, following] - time, np.any(mode)
            first, damping = _accelerated(now, R, mode, body, plane, law, touching)
            landing = rigid.landing(now, R, points, deep, sinking, mode, first, normal)[0]
            step = min(usual, left, max(landing, SHORTEST))
            # a crumb of a step before a sample is left to the one before
            if left - step < 1e-9:
                step = left
            ended, error = _step(now, mode, body, plane, law, first, damping, touching, step, allowed)
            turned = _turned(ended)
            deeper, faster = rigid.depths(ended, turned, points, below, normal, height)
            past = False
            for k in range(K):
                past |= not mode[0, k] and deeper[0, k] > LANDED
            good = (error < 1.0 and not past) or step <= SHORTEST
            wanted = step * min(max(0.9 * max(error, 1e-8) ** (-1.0 / 3.0), 0.2), 4.0)
            if past and error < 1.0:
                wanted = 0.5 * step
            elif good and step < usual:
                # a step cut short by a sample or a landing says little of the next one
                wanted = max(wanted, usual)
            usual = min(max(wanted, SHORTEST), LONGEST)
            if not good:
                continue
            if found == room:
                flight, time_at, taken = _longer(flight), _longer(time_at), _longer(taken)
                states, modes, room = _longer(states), _longer(modes), 2 * room
            flight[found], time_at[found], taken[found] = b, time, step
            states[found], modes[found] = now[0], mode[0]
            found += 1
            now, R, deep, sinking, time = ended, turned, deeper, faster, time + step
            for k in range(K):
                into = sinking[0, k] > 0.0
                mode[0, k] = deep[0, k] > 0.0 or into if mode[0, k] else deep[0, k] > -1e-8 and into
            if abs(times[b, following] - time) < 1e-12:
                time, out[b, following] = times[b, following], now[0]
                following += 1
    return out, flight[:found], time_at[:found], taken[:found], states[:found], modes[:found]


@compiled
def _turned(state: Array) -> Array:
    R: Array = rotation_matrices_of(np.ascontiguousarray(state[:, 3:7]))
    return R


@compiled
def _longer(values: Any) -> Any:
    return np.concatenate((values, values))


@compiled
def _step(
    state: Array, mode: Any, body: Any, plane: Any, law: Any, first: Array, damping: Array, touching: bool, step: float,
    allowed: Array,
) -> tuple[Array, float]:  # fmt: skip
    """The state a step later, and the largest error in units of what is allowed; see `flight`."""
    h, slopes, at, change = np.full(1, step), np.zeros((4, 1, 13)), state, first
    stiff = np.ascontiguousarray(damping[0])
    inverse = np.ascontiguousarray(np.linalg.inv(np.eye(6) - GAMMA * step * stiff)) if touching else np.eye(6)
    for i in range(4):
        if i:
            at = rigid.onwards(state, h, ALPHA[i], slopes)
            change, _ = _accelerated(at, _turned(at), mode, body, plane, law, False)
        if touching:
            push = change[0].copy()
            for j in range(i):
                push += step * SHIFT[i, j] * (stiff @ np.ascontiguousarray(slopes[j, 0, 7:]))
            change = (inverse @ push).reshape(1, 6)
        rigid.rates(at, change, slopes[i])
    error = 0.0
    for x in range(6):
        missed = 0.0
        for i in range(4):
            missed += (WEIGHTS[i] - EMBEDDED[i]) * slopes[i, 0, 7 + x]
        error = max(error, abs(step * missed) / allowed[x])
    return rigid.onwards(state, h, WEIGHTS, slopes), error if np.isfinite(error) else 1e6


@compiled
def _accelerated(
    state: Array, R: Array, mode: Any, body: Any, plane: Any, law: Any, stiff: bool
) -> tuple[Array, Array]:
    """v̇ then ω̇ (1, 6) of a body (1, 13), and where it is `stiff` the slopes (1, 6, 6) of `FreeBody.damping`."""
    points, below, normal, height = plane
    mass, center, inertia, inverse, gravity = body
    wrench, damping = np.zeros((1, 2, 3)), np.zeros((1, 6, 6))
    if np.any(mode):
        rows, _, lever = rigid.near(R, points, below, np.zeros(mode.shape), mode, 0.0)
        touching = np.ones(len(rows), dtype=np.bool_)
        held, rate, slip, _ = rigid.meeting(state[rows], lever, touching, normal, height)
        force, slopes = _forces(held, rate, slip, normal, law)
        rigid.pushed(wrench, rows, lever, force, np.zeros(force.shape))
        if stiff:
            along, across, onward, into = slip.copy(), slopes[:, 0].copy(), slopes[:, 1].copy(), slopes[:, 2].copy()
            for e in range(len(rows)):
                along[e] /= max(np.sqrt(np.sum(slip[e] ** 2)), 1e-12)
            damping = rigid.damped(R, inverse, rows, lever, along, across, onward, into, normal)
    return rigid.accelerated(state, R, wrench, mass, center, inertia, inverse, gravity), damping


@compiled
def _forces(held: Array, rate: Array, slip: Array, normal: Array, law: Any) -> tuple[Array, Array]:
    """Forces (E, 3) N at points, and how they grow with velocity (E, 3), N s/m: across slip, along it, and pressing."""
    kind, surface, numbers = law
    stiffness, damping, dissipation, friction, width = numbers
    force, slopes = np.empty((len(held), 3)), np.zeros((len(held), 3))
    for e in range(len(held)):
        if kind == PAPER:
            push = stiffness * held[e] - damping * abs(rate[e])
        elif kind == HUNT_CROSSLEY:
            push = stiffness * held[e] * (1.0 + dissipation * rate[e])
        else:
            push = stiffness * held[e] + damping * rate[e]
        push = max(push, 0.0)
        most, speed, rubbed = friction * push, np.sqrt(np.sum(slip[e] ** 2)), 0.0
        if surface == SLIPPING:
            ratio = max(speed / width, 1e-6)
            level = np.tanh(ratio)
            rubbed = most * level / (ratio * width)
            slopes[e, 0], slopes[e, 1] = rubbed, most * (1.0 - level**2) / width
        elif surface == RESISTING:
            rubbing = width * speed > most
            rubbed = most / max(speed, 1e-12) if rubbing else width
            slopes[e, 0], slopes[e, 1] = rubbed, 0.0 if rubbing else width
        slopes[e, 2] = damping if push > 0.0 else 0.0
        for x in range(3):
            force[e, x] = push * normal[x] - rubbed * slip[e, x]
    return force, slopes
