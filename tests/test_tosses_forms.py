"""Tosses in every form that a scenario can describe are diagnosed, and user-defined effects are looked for in them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from drake_cafim.contact.change import Touch
from drake_cafim.contact.law import ContactParameters
from drake_cafim.diagnosis.diagnose import diagnose, estimate, examine
from drake_cafim.diagnosis.tosses.flight import fly
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.free_body_state import State
from drake_cafim.dynamics.rotations import exponential, product
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.effects.body import AerodynamicDrag, BodyForce
from drake_cafim.effects.contact import ContactEffect, ContactLook
from drake_cafim.effects.effect import Effect, Place, Strength
from drake_cafim.effects.link import Payload, TreeEffect
from drake_cafim.effects.sensor import SensorBias, SensorEffect
from drake_cafim.effects.timing import SensorDelay
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.parametrize import long_after
from tests.tosses import BALL, BLOCK, STEP, beginnings, thrown, thrown_in_drake, thrown_scene

HEAD = """
model: body.urdf
channels: {pose.body: {std: {position: 2.0e-4, rotation: 2.0e-3}}}
"""
GROUND = """
contact:
  - {bodies: [body, ground], ground: {point: [0, 0, 0], normal: [0, 0, 1]}, stiffness: 3000.0, %s}
"""
SLIPPING = GROUND % "damping: 5.0, friction: 0.3, slip_velocity: 0.01"
FORMS = {
    "no contact": "",
    "slip_velocity": SLIPPING,
    "resistance": GROUND % "damping: 5.0, friction: 0.3, resistance: 20.0",
    "frictionless": GROUND % "damping: 5.0",
    "hunt_crossley": GROUND % "law: hunt_crossley, dissipation: 0.4, friction: 0.3, slip_velocity: 0.01",
    "paper": GROUND % "law: paper, damping: 5.0, friction: 0.3, resistance: 20.0",
    "late": SLIPPING + "effects: [{effect: sensor_delay, at: pose.body, delay: 0.01}]\n",
}


@pytest.mark.parametrize("shape", long_after(1, [BALL, BLOCK]), ids=["ball", "block"])
@pytest.mark.parametrize("form", FORMS)
def test_a_throw_without_unknowns_is_diagnosed_and_estimated(form: str, shape: str, tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, shape, scenario=HEAD + FORMS[form])
    recordings = [recording.window(0.0, 0.4) for recording in thrown(scene.physics, 1, count=2)]
    found = estimate(scene, recordings[:1])
    assert found.parameters == ()
    # −ln of six normal densities at their usual misfit, per sample, for these stds
    expected = sum(np.log(std) + 0.5 * np.log(2.0 * np.pi) + 0.5 for std in (2e-4, 2e-3)) * 3.0
    assert found.train.corrected.nll == pytest.approx(expected, abs=1.5)
    verdict = diagnose(scene, recordings[:1], held_out=recordings[1:])
    assert verdict.kind == "none", str(verdict)
    assert verdict.held_out is not None and verdict.held_out.nominal.nll == pytest.approx(expected, abs=1.5)


def test_an_unknown_mass_that_may_vanish_is_no_end(tmp_path: Path) -> None:
    """Its prior reaches to zero, where the inertia is singular."""
    unknown = "unknown: [{parameter: mass, body: body, mean: 0.3, std: 0.3}]\n"
    scene = thrown_scene(tmp_path, scenario=HEAD + SLIPPING + unknown)
    (recording,) = thrown(scene.physics_at(np.array([0.25])), 2, count=1)
    (mass,) = estimate(scene, [recording.window(0.0, 0.6)]).parameters
    assert mass.value == pytest.approx(0.25, abs=4.0 * mass.std)
    nothing = scene.physics_at(np.array([0.0]))
    (lost,) = thrown(nothing, 2, count=1)
    assert np.all(np.isnan(lost["pose.body.x"][1:]))


def test_a_sensor_effect_on_nothing_that_is_tracked_is_refused(tmp_path: Path) -> None:
    effects = "effects: [{effect: sensor_bias, at: pose.body.qw, bias: 0.01}]\n"
    scene = thrown_scene(tmp_path, scenario=HEAD + SLIPPING + effects)
    recordings = thrown(thrown_scene(tmp_path, scenario=HEAD + SLIPPING).physics, 1, count=1)
    with pytest.raises(
        InputError, match=r"sensor_bias at pose\.body\.qw: expected, of a thrown body, one of pose\.body"
    ):
        estimate(scene, recordings)


@dataclass(frozen=True)
class LinearDrag(BodyForce):
    """−c v at the body's origin."""

    name: ClassVar[str] = "linear_drag"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("coefficient", "N s/m", 0.1, lower=0.0),)
    shapes: ClassVar[tuple[Strength, ...]] = (Strength("beyond", "m/s", 0.0, grid=(0.0, 5.0)),)
    reference: ClassVar[str] = "Stokes, 1851"

    def point(self, body: Body) -> Array:
        return np.zeros(3)

    def force(
        self, p_WP: Array, v_WP: Array, time: Array | None, recording: str | None, lasting: Array | float = 0.0
    ) -> Array:
        fast = np.linalg.norm(v_WP, axis=1, keepdims=True) > self.values["beyond"]
        return np.asarray(-self.values["coefficient"] * v_WP * fast)


@dataclass(frozen=True)
class HeavierWorld(TreeEffect):
    """Gravity times a factor."""

    place: ClassVar[Place] = Place.WORLD
    family: ClassVar[str] = "link"
    name: ClassVar[str] = "heavier_world"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("factor", "1", 0.01, lower=0.5, upper=2.0, nominal=1.0),)
    reference: ClassVar[str] = "Cavendish, 1798"

    def change(self, tree: Tree, gravity: Array) -> tuple[Tree, Array]:
        return tree, self.values["factor"] * gravity


@dataclass(frozen=True)
class QuinticStiffness(ContactEffect):
    """+ quintic·d⁵."""

    name: ClassVar[str] = "contact_quintic_stiffness"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("quintic", "N/m^5", 1e11, lower=0.0),)
    reference: ClassVar[str] = "Johnson, Contact Mechanics, 1985, ch. 4"

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array:
        return np.asarray(self.values["quintic"] * np.maximum(touch.penetration, 0.0) ** 5)

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        yield self.single("quintic", 1e9, {})


@dataclass(frozen=True)
class WarpingTracker(SensorBias):
    """A bias that grows with the time from 0.45 s on, and before: a subclass of ours that writes something else."""

    name: ClassVar[str] = "warping_tracker"

    def measured(self, time: Array, true: Array) -> Array:
        return true + self.values["bias"] * (time[:, None] - 0.45) ** 2

    def columns(self, time: Array, true: Array) -> Array:
        return np.broadcast_to(((time - 0.45) ** 2)[:, None, None], (*true.shape, 1)).copy()


OWN: list[Effect] = [
    LinearDrag("body", {"coefficient": 0.15, "beyond": 0.0}),
    HeavierWorld("world", {"factor": 1.03}),
    QuinticStiffness("body/ground", {"quintic": 2e11}),
    WarpingTracker("pose.body.y", {"bias": 0.1}),
]


@pytest.mark.parametrize("effect", long_after(0, OWN), ids=lambda item: item.name)
def test_an_effect_of_one_s_own_goes_all_the_way_in_a_throw(effect: Effect, tmp_path: Path) -> None:
    """Thrown by Drake, looked for, fitted, thrown by Drake again, and drawn."""
    # beside a few of ours: compiled code does not know a contact's law of one's own, and each fit of it takes seconds
    scene = replace(thrown_scene(tmp_path, scenario=HEAD + SLIPPING), vocabulary=(AerodynamicDrag, SensorBias))
    start = beginnings(np.random.default_rng(3), 1)
    recording = _thrown_by_drake(scene.corrected(np.zeros(0), [effect]), start)
    verdict, outcome = examine(scene, [recording], effects=[type(effect)])
    (found,) = verdict.explanation
    assert (verdict.kind, found.effect.key) == ("explained", effect.key), str(verdict)
    for strength in effect.strengths:
        value = found.values[strength.name]
        assert value.value == pytest.approx(effect.values[strength.name], abs=4.0 * value.std)
    time, positions = recording.time[::5], recording.matrix("pose.body", POSE_COMPONENTS)[::5, :3]
    bare, corrected = (
        np.sqrt(np.mean((thrown_in_drake(model, start, time)[:, :3] - positions) ** 2))
        for model in (scene, verdict.corrected)
    )
    assert corrected < 4e-4 < 0.25 * bare
    report = write_artifacts(tmp_path, verdict, outcome, [recording], [], ["a command"], replay=False)
    assert report["explanation"][0]["effect"] == effect.name
    page = (tmp_path / "report.html").read_text()
    assert escape((type(effect).__doc__ or "").split("\n")[0]) in page or effect.formula in page
    assert "what the effect gives" in page and "innovation of " in page
    again = Scene.load(tmp_path / "scenario.corrected.yaml", effects=[type(effect)])
    (known,) = again.scenario.effects
    assert (known.effect, known.at) == effect.key


def _thrown_by_drake(scene: Scene, start: State) -> Recording:
    """Half a second with the noise that the scenario states."""
    time = np.arange(0.0, 0.5, STEP)
    poses, rng = thrown_in_drake(scene, start, time), np.random.default_rng(5)
    poses[:, :3] += rng.normal(0.0, 2e-4, (len(time), 3))
    poses[:, 3:] = product(exponential(rng.normal(0.0, 2e-3, (len(time), 3))), poses[:, 3:])
    return Recording("toss_0", time, {f"pose.body.{axis}": poses[:, k] for k, axis in enumerate(POSE_COMPONENTS)})


@pytest.mark.parametrize(
    "effect",
    [*OWN, Payload("body", {"mass": 0.05, "x": 0.01, "y": 0.0, "z": 0.02}), SensorDelay("pose.body", {"delay": 0.02})],
    ids=lambda item: item.name,
)
def test_drake_throws_a_body_as_the_diagnosis_does(effect: Effect, tmp_path: Path) -> None:
    """Of one's own and of ours; each moves the body, or what is read of it, by more than a centimetre."""
    bare = thrown_scene(tmp_path, scenario=HEAD + SLIPPING)
    scene = bare.corrected(np.zeros(0), [effect])
    (expected,) = thrown(scene.physics, 3, count=1, noise=(0.0, 0.0))
    (without,) = thrown(bare.physics, 3, count=1, noise=(0.0, 0.0))
    expected, without = expected.window(0.0, 0.4), without.window(0.0, 0.4)
    if isinstance(effect, SensorEffect):
        for column in effect.channels(["pose.body.x", "pose.body.y", "pose.body.z"]):
            expected = _written(expected, replace(effect, at=column))
    found = thrown_in_drake(scene, beginnings(np.random.default_rng(3), 1), expected.time)
    poses = expected.matrix("pose.body", POSE_COMPONENTS)
    np.testing.assert_allclose(found[:, :3], poses[:, :3], atol=3e-6)
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:], axis=1), 1.0, atol=1e-9)
    if not isinstance(effect, SensorEffect):
        np.testing.assert_allclose(np.abs(np.sum(found[:, 3:] * poses[:, 3:], axis=1)), 1.0, atol=1e-9)
    moved = np.abs(poses[:, :3] - without.matrix("pose.body", POSE_COMPONENTS)[:, :3])
    assert np.max(moved) > 0.01


@pytest.mark.long
def test_drake_lets_a_block_land_on_its_corners(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, BLOCK, com="0.003 -0.002 0.001", scenario=HEAD + SLIPPING)
    # flat, a little turned, so that the corners of its underside touch one after the other
    turned = exponential(np.array([[0.02, 0.03, 0.5]]))
    start = State.of(np.array([[0.0, 0.0, 0.035]]), turned, np.array([[0.3, 0.1, -0.4]]), np.array([[0.5, -0.5, 1.0]]))
    times = np.linspace(0.0, 0.03, 4)
    tight = np.array([1e-6] * 3 + [1e-5] * 3)
    single = np.zeros(1, dtype=int)
    flights = fly(FreeBody(scene.physics), start, times[None], single + len(times), single, ("a",), tight)
    found = thrown_in_drake(scene, start, times)
    np.testing.assert_allclose(found[:, :3], flights.at_samples.p, atol=3e-6)
    np.testing.assert_allclose(np.abs(np.sum(found[:, 3:] * flights.at_samples.quaternion, axis=1)), 1.0, atol=1e-9)
    assert np.count_nonzero(flights.fine.mode.any(axis=0)) > 1


def _written(recording: Recording, effect: SensorEffect) -> Recording:
    column = effect.at
    values = effect.measured(recording.time, recording[column][:, None])[:, 0]
    return replace(recording, columns={**recording.columns, column: values})
