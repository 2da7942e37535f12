"""What may be missing in a toss, and linear looks at it along the arcs as they were simulated."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.diagnosis.evidence import MISFIT, scale_of
from drake_cafim.diagnosis.fitting import Fit, fit
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.tosses.columns import difference, force_rows, sensor_rows
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.pulses import strongest_pushes
from drake_cafim.diagnosis.tosses.shots import Shot
from drake_cafim.diagnosis.tosses.standing import standing
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.effects.contact import ContactEffect, ContactLook
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.link import GravityMisalignment, Payload
from drake_cafim.effects.normal_contact import ContactHuntCrossleyDissipation
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.effects.timing import SensorDelay
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

GRAIN = 1e-3
"""Of the body's mass: a load small enough for its slopes to be those of none."""
PLACES = (0.35, 0.85)
"""Of the body's size: where a load is looked for along the direction of its moment."""
Look = tuple[Array, Callable[[Array], Effect | None]]
DECIDES_BOUNCES = (SurfaceEffect, ContactHuntCrossleyDissipation)
"""Where and how high a throw bounces; friction and what contacts remember change that by less."""
ON_BODY = (Payload, AerodynamicDrag, ExternalDisturbance)


def hypotheses(problem: TossProblem) -> tuple[Effect, ...]:
    """Every effect of the catalogue that a thrown body and its tracker can show, where it can be.

    A delay of all that is measured changes nothing that can be seen, and is left out.
    """
    body = problem.body
    columns = tuple(f"pose.{body}.{axis}" for axis in "xyz")
    found: list[Effect] = []
    for effect in EFFECTS:
        if issubclass(effect, SensorDelay):
            continue
        if issubclass(effect, SensorEffect):
            found.extend(effect(place) for place in effect.sites(columns))
        elif issubclass(effect, ContactEffect | SurfaceEffect):
            contacts = problem.scene.physics.contacts
            found.extend(effect(at) for at in dict.fromkeys(effect.site(contact) for contact in contacts))
        elif issubclass(effect, ON_BODY):
            found.append(effect(body))
        elif issubclass(effect, GravityMisalignment):
            found.append(effect("world"))
    return tuple(found)


def looks(problem: TossProblem, at: Fit, effect: Effect) -> Iterator[Look]:
    """Whitened columns (R, c) along which the effect moves the rows, and the effect that coefficients stand for."""
    shot = problem.shot(at.model)
    physics = shot.physics
    if isinstance(effect, ExternalDisturbance):
        yield from _push_looks(problem, shot, at, effect)
    elif isinstance(effect, Payload):
        yield _load_look(problem, shot, at, effect)
    elif isinstance(effect, SensorEffect):
        yield problem.innovations(sensor_rows(shot, effect)), effect.from_directions
    elif isinstance(effect, ContactEffect | SurfaceEffect):
        contact = next((one for one in physics.contacts if effect.meets(one)), None)
        if contact is None:
            return
        found = list(effect.looks(contact, pressed(shot)))
        steps = [(step.ahead, step.behind, step.size) for look in found for step in look.steps]
        columns = _columns(problem, shot, effect, steps)
        first = 0
        for look in found:
            stop = first + len(look.steps)
            yield columns[:, first:stop], look.build
            first = stop
        if scale_of(at) > MISFIT:
            yield from _simulated_looks(problem, at, effect, found)
        if isinstance(effect, DECIDES_BOUNCES) and np.any(problem.base.far) and not at.model.effects:
            yield from _look_anew(problem, at, _from_afar(problem, contact, effect))
    else:
        steps = [(step.ahead, step.behind, step.size) for step in effect.directions()]
        yield _columns(problem, shot, effect, steps), effect.from_directions


def _simulated_looks(problem: TossProblem, at: Fit, effect: Effect, found: Sequence[ContactLook]) -> Iterator[Look]:
    """Looks at effects that are there or not, by their own simulation.

    Where a model is far off, what a law would change along its motion is not even in the direction in which the motion
    would change: a contact that winds up like a spring throws back what a sliding one only slows.
    """
    for look in found:
        whole = look.build(np.ones(len(look.steps)))
        if len(look.steps) == 1 and whole is not None and whole.values == dict(look.steps[0].ahead):
            rows = problem.residual(at.model.with_effects([whole]))[: problem.rows]
            yield (rows - at.residual[: problem.rows])[:, None], look.build


def _from_afar(problem: TossProblem, contact: SphereContact, effect: ContactEffect | SurfaceEffect) -> Effect:
    """The effect as it may be, by no simulation."""
    if isinstance(effect, SurfaceEffect):
        return standing(problem.arcs.tracks, contact, effect)
    return effect.with_values({strength.name: strength.typical for strength in effect.strengths})


def _look_anew(problem: TossProblem, at: Fit, start: Effect) -> Iterator[Look]:
    """All of an effect that is fitted from `start`, with arcs thrown anew and unknowns as the priors mean them.

    Under physics that is far off, arcs bounce where none was, unknowns go where they fit that, and slopes along either
    say nothing of what is missing. Later fits of this effect begin where this one ends.
    """
    model = Model(problem.scene.priors.mean, (start,))
    if not problem.plausible(model):
        return
    anew = TossProblem.settled(problem.scene, problem.arcs, problem.noise, model)
    thrown = anew.residual(model)
    if float(thrown @ thrown) > at.chi_square:
        return
    found = fit(anew, model).model
    problem.lead(found, anew.shot(found))
    rows = problem.residual(at.model.with_effects(found.effects))[: problem.rows]
    yield (rows - at.residual[: problem.rows])[:, None], lambda c: found.effects[0] if 0.3 < c[0] < 3.0 else None


Step = tuple[Mapping[str, float], Mapping[str, float] | None, float]


def _columns(problem: TossProblem, shot: Shot, effect: Effect, steps: Sequence[Step]) -> Array:
    """Whitened columns (R, c) of finite steps of an effect's strengths."""
    if not steps:
        return np.zeros((problem.rows, 0))
    changes, deeper = [], []
    for ahead, behind, size in steps:
        down: Physics = shot.physics
        if behind is not None:
            down = down.with_effects([effect.with_values(behind)])
        change, landed = difference(shot, shot.physics.with_effects([effect.with_values(ahead)]), down)
        changes.append(change / size)
        deeper.append(landed / size)
    return problem.innovations(force_rows(shot, changes, deeper))


def _load_look(problem: TossProblem, shot: Shot, at: Fit, effect: Payload) -> Look:
    """By a small mass and its first moments: a free body's motion is linear in no more than that."""
    mass, arm = GRAIN * shot.body.inertial[0], 0.5 * _size(shot)
    origin = {"mass": mass, "x": 0.0, "y": 0.0, "z": 0.0}
    steps: list[Step] = [(origin, None, mass)]
    steps += [(origin | {axis: arm}, origin | {axis: -arm}, 2.0 * mass * arm) for axis in "xyz"]

    def build(coefficients: Array) -> Effect | None:
        moment = coefficients[1:]
        size = float(np.linalg.norm(moment))
        if size == 0.0:
            return None
        masses = [size / (part * _size(shot)) for part in PLACES]
        masses += [float(coefficients[0])] if coefficients[0] > size / (2.0 * _size(shot)) else []
        loads = [effect.with_values(np.array([one, *(moment / one)])) for one in masses]
        rows = [problem.residual(at.model.with_effects([load])) for load in loads]
        return min(zip(loads, rows, strict=True), key=lambda pair: float(pair[1] @ pair[1]))[0]

    return _columns(problem, shot, effect, steps), build


def _size(shot: Shot) -> float:
    """m from the body's origin to what may touch; of a body that nothing touches, by its inertia."""
    contact = shot.body.contact
    if contact is None:
        mass, _, inertia, _ = shot.body.inertial
        return float(np.sqrt(np.trace(inertia) / mass))
    return float(np.max(np.linalg.norm(contact.points, axis=1)) + contact.radius)


def pressed(shot: Shot) -> Touch:
    """All touches of the arcs as they were simulated."""
    f, body = shot.flights.fine, shot.body
    rows, points = np.nonzero(f.mode)
    state = f.state[rows]
    lever = body.levers(rotation_matrices(state.quaternion))[np.arange(len(rows)), :, points]
    return body.touch(state, lever, np.ones(len(rows), dtype=bool))


def _push_looks(problem: TossProblem, shot: Shot, at: Fit, effect: ExternalDisturbance) -> Iterator[Look]:
    """A pulse along each axis, at the strongest pushes and a little beside them."""
    for push in strongest_pushes(problem, at)[0][:2]:
        duration = push.stop - push.start
        name = problem.runs[push.run].name
        steps, intervals = [], []
        for center in (-0.15, 0.0, 0.15):
            for width in (0.8, 1.0, 1.25):
                middle = 0.5 * (push.start + push.stop) + center * duration
                interval = {"start": middle - 0.5 * width * duration, "stop": middle + 0.5 * width * duration}
                intervals.append(interval)
                for axis in "xyz":
                    steps.append((dict.fromkeys("xyz", 0.0) | {axis: 1.0} | interval, None, 1.0))
        columns = _columns(problem, shot, ExternalDisturbance(effect.at, {}, name), steps)
        for k, interval in enumerate(intervals):
            yield columns[:, 3 * k : 3 * k + 3], partial(_pushed, effect.at, interval, name)


def _pushed(at: str, interval: Mapping[str, float], recording: str, peak: Array) -> Effect:
    x, y, z = (float(component) for component in peak)
    return ExternalDisturbance(at, {"x": x, "y": y, "z": z, **interval}, recording)
