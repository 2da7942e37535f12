"""The hypotheses for a toss, and their first-order regressors along the simulated arcs (looks)."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pushes import push_over
from drake_cafim.diagnosis.fit.search_problem import Look, Looks
from drake_cafim.diagnosis.thresholds import (
    MISFIT_REDUCED_CHI_SQUARE,
    THROWN_LOAD_PLACES,
    WHOLE_EFFECT_LARGEST_COEFFICIENT,
    WHOLE_EFFECT_LEAST_COEFFICIENT,
)
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows
from drake_cafim.diagnosis.tosses.jacobian import difference, force_rows, sensor_rows
from drake_cafim.diagnosis.tosses.poses import why_turns_matter
from drake_cafim.diagnosis.tosses.pulses import strongest_pushes
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.diagnosis.tosses.surface_search import fit_surface
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.contact import ContactEffect, ContactLook
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.link import Payload, TreeEffect
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

GRAIN = 1e-3
"""Mass of a load over that of the body, small enough for its slopes to be those at zero mass."""


def hypotheses(problem: ArcRows) -> tuple[Effect, ...]:
    """Every effect of the scene's vocabulary that is observable in a toss, at each of its places.

    A delay common to all channels is not observable. An unmodeled contact is left out as well, since its regressors
    need recordings that touch it at rest. Where positions alone were measured, so are loads off a ball's centre.
    """
    body = problem.body
    columns = tuple(f"pose.{body}.{axis}" for axis in "xyz")
    where = Surroundings(problem.scene.tree, problem.scene.physics.contacts, columns, body)
    found = [effect(at) for effect in problem.scene.vocabulary for at in effect.attachments(where)]
    if problem.noise.turns_measured:
        return tuple(found)
    turns_matter = _TurnsMatter(problem.scene.physics)
    return tuple(effect for effect in found if not turns_matter(effect))


@dataclass(frozen=True)
class _TurnsMatter(ByKind[bool]):
    """Whether the body's motion depends on its rotation once the effect acts at its typical strengths."""

    physics: Physics

    def other(self, effect: Effect) -> bool:
        return False

    def tree(self, effect: TreeEffect) -> bool:
        typical = effect.with_values({s.name: s.nominal + s.typical for s in effect.strengths})
        return bool(why_turns_matter(self.physics.with_effects([typical])))


def looks(problem: ArcRows, at: Fit, effect: Effect) -> Looks:
    """The first-order regressors of `effect` beyond the fitted model `at`."""
    return _LooksByKind(problem, at)(effect)


@dataclass(frozen=True)
class _LooksByKind(ByKind[Looks]):
    """By kind of effect: whitened columns (R, c), and the effect that coefficients (c,) of them stand for."""

    problem: ArcRows
    at: Fit

    @property
    def _shot(self) -> Shot:
        return self.problem.shot(self.at.model)

    def push(self, effect: ExternalDisturbance) -> Looks:
        tried = strongest_pushes(self.problem, self.at)[1]
        return Looks(_push_looks(self.problem, self._shot, self.at, effect), tried)

    def load(self, effect: Payload) -> Looks:
        return Looks(iter([_load_look(self.problem, self._shot, self.at, effect)]))

    def sensor(self, effect: SensorEffect) -> Looks:
        return Looks(iter([(self.problem.innovations(sensor_rows(self._shot, effect)), effect.from_directions)]))

    def contact(self, effect: ContactEffect) -> Looks:
        return Looks(_contact_looks(self.problem, self._shot, self.at, effect, _typical))

    def surface(self, effect: SurfaceEffect) -> Looks:
        def from_afar(contact: SphereContact, effect: SurfaceEffect) -> Effect:
            return fit_surface(self.problem.arcs.tracks, contact, effect)

        return Looks(_contact_looks(self.problem, self._shot, self.at, effect, from_afar))

    def other(self, effect: Effect) -> Looks:
        """By finite differences along the effect's directions, for each shape of its law."""
        return Looks(_difference_looks(self.problem, self._shot, effect))


def _difference_looks(problem: ArcRows, shot: Shot, effect: Effect) -> Iterator[Look]:
    """A look by finite differences for each shape of the effect's law."""
    for shaped in _of_each_shape(effect):
        steps = [(step.ahead, step.behind, step.size) for step in shaped.directions()]
        yield _columns(problem, shot, shaped, steps), shaped.from_directions


OnContact = TypeVar("OnContact", ContactEffect, SurfaceEffect)


def _contact_looks(
    problem: ArcRows, shot: Shot, at: Fit, effect: OnContact, from_afar: Callable[[SphereContact, OnContact], Effect]
) -> Iterator[Look]:
    """Looks along the simulated touches; where the model misfits, also by simulations with the effect in it.

    `from_afar` gives a start value of the effect without a simulation.
    """
    contact = next((contact for contact in shot.physics.contacts if effect.meets(contact)), None)
    if contact is None:
        return
    found = list(effect.looks(contact, simulated_touches(shot)))
    steps = [(step.ahead, step.behind, step.size) for look in found for step in look.steps]
    columns = _columns(problem, shot, effect, steps)
    first = 0
    for look in found:
        stop = first + len(look.steps)
        yield columns[:, first:stop], look.build
        first = stop
    if scale_of(at) > MISFIT_REDUCED_CHI_SQUARE:
        yield from _simulated_looks(problem, at, effect, found)
    if effect.decides_bounces and np.any(problem.base.far) and not at.model.effects:
        yield from _look_anew(problem, at, from_afar(contact, effect))


def _of_each_shape(effect: Effect) -> Iterator[Effect]:
    """The hypothesis with every combination of grid values of its law's shapes; itself where it has no shapes."""
    grids = [shape.grid or (shape.nominal,) for shape in effect.shapes]
    for values in itertools.product(*grids):
        named = {shape.name: value for shape, value in zip(effect.shapes, values, strict=True)}
        yield replace(effect, values={**effect.values, **named})


def _simulated_looks(problem: ArcRows, at: Fit, effect: Effect, found: Sequence[ContactLook]) -> Iterator[Look]:
    """Looks at effects without a continuous strength, by a simulation with the effect in the model.

    Where the model misfits, the first-order change along its own motion may point in the wrong direction: presliding
    bristles store energy and throw a body back that sliding friction only slows down.
    """
    for look in found:
        whole = look.build(np.ones(len(look.steps)))
        if len(look.steps) == 1 and whole is not None and whole.values == dict(look.steps[0].ahead):
            rows = problem.residual(at.model.with_effects([whole]))[: problem.rows]
            yield (rows - at.residual[: problem.rows])[:, None], look.build


def _typical(contact: SphereContact, effect: ContactEffect) -> Effect:
    """The effect with its strengths at their typical values."""
    return effect.with_values({strength.name: strength.typical for strength in effect.strengths})


def _look_anew(problem: ArcRows, at: Fit, start: Effect) -> Iterator[Look]:
    """One column: the whole change of the rows by the effect fitted from `start`, with unknowns at their prior means.

    Under a wrong surface or a wrong bounce, simulated arcs bounce where the real ones do not and the unknowns are
    fitted to that: derivatives there say nothing about the missing effect. Arcs and unknowns therefore start anew, and
    later fits of this effect start from this one.
    """
    model = Model(problem.scene.priors.mean, (start,))
    if not problem.plausible(model):
        return
    anew = problem.linearised_at(problem.scene, problem.arcs, problem.noise, model)
    residual = anew.residual(model)
    # a start that fits worse than the present model is not worth a fit
    if float(residual @ residual) > at.chi_square:
        return
    found = fit(anew, model).model
    problem.seed(found, anew.shot(found))
    rows = problem.residual(at.model.with_effects(found.effects))[: problem.rows]
    yield (
        (rows - at.residual[: problem.rows])[:, None],
        lambda c: (
            found.effects[0] if WHOLE_EFFECT_LEAST_COEFFICIENT < c[0] < WHOLE_EFFECT_LARGEST_COEFFICIENT else None
        ),
    )


Step = tuple[Mapping[str, float], Mapping[str, float] | None, float]


def _columns(problem: ArcRows, shot: Shot, effect: Effect, steps: Sequence[Step]) -> Array:
    """Whitened columns (R, c) by finite steps (ahead, behind, size) of an effect's strengths."""
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


def _load_look(problem: ArcRows, shot: Shot, at: Fit, effect: Payload) -> Look:
    """Regressors of a small mass m and of its moments m p: a free body's motion is linear in these alone."""
    mass, arm = GRAIN * shot.body.inertial[0], 0.5 * _size(shot)
    origin = {"mass": mass, "x": 0.0, "y": 0.0, "z": 0.0}
    steps: list[Step] = [(origin, None, mass)]
    steps += [(origin | {axis: arm}, origin | {axis: -arm}, 2.0 * mass * arm) for axis in "xyz"]

    def build(coefficients: Array) -> Effect | None:
        moment = coefficients[1:]
        size = float(np.linalg.norm(moment))
        if size == 0.0:
            return None
        masses = [size / (part * _size(shot)) for part in THROWN_LOAD_PLACES]
        masses += [float(coefficients[0])] if coefficients[0] > size / (2.0 * _size(shot)) else []
        loads = [effect.with_values(np.array([mass, *(moment / mass)])) for mass in masses]
        rows = [problem.residual(at.model.with_effects([load])) for load in loads]
        # a load so heavy that the body is lost in rounding beside it gives no finite residual
        known = [(float(r @ r), k) for k, r in enumerate(rows) if np.all(np.isfinite(r))]
        return loads[min(known)[1]] if known else None

    return _columns(problem, shot, effect, steps), build


def _size(shot: Shot) -> float:
    """The largest distance, m, from the body's origin to a touch point; without contact √(tr I/m)."""
    contact = shot.body.contact
    if contact is None:
        mass, _, inertia, _ = shot.body.inertial
        return float(np.sqrt(np.trace(inertia) / mass))
    return float(np.max(np.linalg.norm(contact.points, axis=1)) + contact.radius)


def simulated_touches(shot: Shot) -> Touch:
    """The kinematics of all touches in the simulated arcs, one row for each point and step."""
    f, body = shot.flights.fine, shot.body
    rows, points = np.nonzero(f.mode)
    state = f.state[rows]
    lever = body.touch_points.levers(rotation_matrices(state.quaternion))[np.arange(len(rows)), :, points]
    return body.touch_points.touch(state, lever, np.ones(len(rows), dtype=bool))


def _push_looks(problem: ArcRows, shot: Shot, at: Fit, effect: ExternalDisturbance) -> Iterator[Look]:
    """Regressors of a pulse along each axis, at the two strongest pushes and at slightly shifted intervals."""
    for push in strongest_pushes(problem, at)[0][:2]:
        name, intervals = problem.runs[push.run].name, list(push.intervals())
        steps: list[Step] = []
        for start, stop in intervals:
            zero = {**dict.fromkeys("xyz", 0.0), "start": start, "stop": stop}
            steps += [(zero | {axis: 1.0}, None, 1.0) for axis in "xyz"]
        columns = _columns(problem, shot, effect.during(0.0, 0.0, name), steps)
        for k, interval in enumerate(intervals):
            yield columns[:, 3 * k : 3 * k + 3], partial(push_over, effect, interval, name)
