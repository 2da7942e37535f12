"""Effects that a joint driven by a servo may lack, and the values to begin with, whose effect is simulated."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.problem import at_joint
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.actuator import ActuatorEffect
from drake_cafim.effects.effect import Direction, Effect, Place
from drake_cafim.effects.joint import SLIP_VELOCITY, JointForce
from drake_cafim.effects.joint_samples import JointSamples, concatenate
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.link import Payload, TreeEffect
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

T = TypeVar("T")
SHARE = 0.1
"""Root mean square of a force that is tried, over that of the servo's effort."""
MOST_STARTS, TOO_MANY = 5, 30
"""Most starts of one law that are tried; a law with more than the second needs all of them, and none is."""


@dataclass(frozen=True)
class Start:
    """An effect to begin with: `parts`, each with one coefficient `sizes` of its law, and the law for coefficients."""

    effect: Effect
    parts: tuple[Effect, ...]
    sizes: tuple[float, ...]
    law: Callable[[Array], Effect | None]


def hypotheses(scene: Scene, forms: Sequence[WeakForm], joint: str) -> list[Effect]:
    """The effects of the vocabulary at a joint, its servo and its encoder that a simulation from commands can show.

    Not those that transform efforts with a memory: a late command stands for them.
    """
    driven = {scene.tree.joint_names[j] for form in forms for j in form.samples.commands}
    servos = tuple(servo for servo in scene.physics.servos if servo.joint in driven)
    columns = tuple(f"q.{name}" for name in scene.tree.joint_names)
    where = Surroundings(scene.tree, scene.physics.contacts, columns, servos=servos)
    stated = {effect.key for effect in (*scene.of_model, *scene.known)}
    shown, found = _Shown(), []
    for kind in scene.vocabulary:
        for at in kind.attachments(where):
            effect = kind(at)
            if at_joint(at, joint) and effect.key not in stated and shown(effect):
                found.append(effect)
    return found


@dataclass(frozen=True)
class _Shown(ByKind[bool]):
    """Whether a simulation from commands can show an effect of each kind at a joint."""

    def other(self, effect: Effect) -> bool:
        return False

    def joint_force(self, effect: JointForce) -> bool:
        return True

    def servo(self, effect: ServoEffect) -> bool:
        return True

    def actuator(self, effect: ActuatorEffect) -> bool:
        usual = effect.with_values({strength.name: strength.typical for strength in effect.strengths})
        return usual.past == 0.0 and usual.settling is None

    def sensor(self, effect: SensorEffect) -> bool:
        return not effect.late

    def tree(self, effect: TreeEffect) -> bool:
        return effect.place is Place.JOINT

    def load(self, effect: Payload) -> bool:
        return False


@dataclass(frozen=True)
class StartsByKind(ByKind[Iterator[Start]]):
    """The starts of an effect at a joint, beside a `model` of the scene that recordings `forms` are of."""

    scene: Scene
    forms: Sequence[WeakForm]
    model: Model

    def joint_force(self, effect: JointForce) -> Iterator[Start]:
        physics, joint = self._physics, self._joint(effect)
        samples = concatenate([_with_load(form.law_samples(physics), physics, joint) for form in self.forms])
        own = [other for other in self.model.effects if other.at == effect.at and "slip_velocity" in other.values]
        widths = [other.values["slip_velocity"] for other in own] or [SLIP_VELOCITY.nominal, SLIP_VELOCITY.grid[0]]
        for width in widths:
            yield from _of_law(effect, samples, effort_rms(self.forms, physics, joint), width)

    def servo(self, effect: ServoEffect) -> Iterator[Start]:
        joint = self._joint(effect)
        driven = [(form, form.samples.commands[joint]) for form in self.forms if joint in form.samples.commands]
        rate = np.concatenate([np.gradient(sent.position, form.samples.time) for form, sent in driven])
        error = np.concatenate([sent.position - form.samples.q[:, joint] for form, sent in driven])
        for look in _spread(list(effect.looks(rate, error))):
            yield _of_steps(effect, look, lambda c, look=look: effect.from_look(look, c))  # type: ignore[misc]

    def actuator(self, effect: ActuatorEffect) -> Iterator[Start]:
        efforts = np.concatenate([form.law_samples(self._physics)[self._joint(effect)].u for form in self.forms])
        for look in _spread(list(effect.looks(efforts))):
            yield _of_steps(effect, look, lambda c, look=look: effect.from_look(look, c))  # type: ignore[misc]

    def other(self, effect: Effect) -> Iterator[Start]:
        yield _of_steps(effect, effect.directions(), effect.from_directions)

    @property
    def _physics(self) -> Physics:
        return self.model.physics(self.scene)

    def _joint(self, effect: Effect) -> int:
        return self.scene.tree.joint_index(effect.at.removeprefix("q."))


def _of_steps(effect: Effect, steps: Sequence[Direction], law: Callable[[Array], Effect | None]) -> Start:
    """A start by differences from the model without the effect: half of a step that goes to both sides."""
    ahead = tuple(effect.with_values(step.ahead) for step in steps)
    sizes = tuple(step.size if step.behind is None else 0.5 * step.size for step in steps)
    return Start(effect, ahead, sizes, law)


def _with_load(samples: Sequence[JointSamples], physics: Physics, joint: int) -> JointSamples:
    """The samples of a joint with the effort by gravity and contacts there."""
    loads = physics.loads(np.stack([own.q for own in samples], axis=1))
    return replace(samples[joint], load=loads[:, joint])


def _of_law(effect: JointForce, samples: JointSamples, effort: float, width: float) -> Iterator[Start]:
    """Starts whose friction changes its sign over the same `width` as what acts there; none of a law with too many.

    They are those of the nearest width on the law's grid: a joint that sticks has one that is narrower than all.
    """
    nearest = min(SLIP_VELOCITY.grid, key=lambda own: abs(np.log(own / width)))
    starts = [s for s in effect.starts(samples) if s.shape.get(SLIP_VELOCITY.name, nearest) == nearest]
    for start in _spread(starts) if len(starts) <= TOO_MANY else []:
        shape = dict(start.shape)
        if SLIP_VELOCITY.name in shape:
            shape[SLIP_VELOCITY.name] = width
        rms = np.sqrt(np.mean(start.columns**2, axis=0))
        if not np.all(rms > 0.0):
            continue
        sizes = SHARE * effort / rms
        unit = np.eye(len(sizes))
        # a law that its shape alone determines acts whole
        whole = effect.from_coefficients(unit[0], shape)
        if np.array_equal(whole.vector, effect.from_coefficients(2.0 * unit[0], shape).vector):
            yield Start(effect, (whole,), (1.0,), lambda c, whole=whole: whole)  # type: ignore[misc]
            continue
        parts = tuple(effect.from_coefficients(size * own, shape) for size, own in zip(sizes, unit, strict=True))
        yield Start(
            effect,
            parts,
            tuple(sizes.tolist()),
            lambda c, shape=shape: effect.from_coefficients(c, shape),  # type: ignore[misc]
        )


def _spread(items: Sequence[T]) -> list[T]:
    """At most `MOST_STARTS` of the items, spread evenly."""
    at = np.unique(np.linspace(0, len(items) - 1, min(len(items), MOST_STARTS)).round().astype(int))
    return [items[k] for k in at] if len(items) else []


def effort_rms(forms: Sequence[WeakForm], physics: Physics, joint: int) -> float:
    """Root mean square of a servo's effort, N m (N), along the recorded motion."""
    servo = physics.servo_at(physics.tree.joint_names[joint])
    return float(np.sqrt(np.mean(_efforts(forms, servo, joint) ** 2)))


def largest_asked(forms: Sequence[WeakForm], physics: Physics, joint: int) -> float:
    """The largest effort, N m (N), that a servo without a limit would make along the recorded motion."""
    servo = physics.servo_at(physics.tree.joint_names[joint])
    return float(np.max(np.abs(_efforts(forms, replace(servo, limit=np.inf), joint))))


def _efforts(forms: Sequence[WeakForm], servo: Servo, joint: int) -> Array:
    """N m (N), the efforts of a servo at rest, at the samples of all recordings in which it drives its joint."""
    efforts = []
    for form in forms:
        sent = form.samples.commands.get(joint)
        if sent is not None:
            q = form.samples.q[:, joint]
            efforts.append(servo.effort(sent.position, q, 0.0 * q, sent.gain, sent.supply).value)
    return np.concatenate(efforts)
