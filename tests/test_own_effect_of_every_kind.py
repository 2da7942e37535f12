"""One class of each kind of effect of a user's own: simulated by Drake, looked for, fitted, simulated again, drawn."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from drake_cafim.contact.change import Touch
from drake_cafim.contact.law import ContactParameters
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.effects.actuator import ActuatorBias, ActuatorEffect, Effort
from drake_cafim.effects.body import BodyForce
from drake_cafim.effects.contact import ContactEffect, ContactLook
from drake_cafim.effects.effect import Effect, Place, Start, Strength
from drake_cafim.effects.joint import JointForce, JointViscousFriction
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.link import TreeEffect
from drake_cafim.effects.sensor import SensorBias, SensorEffect
from drake_cafim.effects.surroundings import SystemPlace
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.parametrize import long_after
from tests.recoveries.models import BALL, STAGE_JOINT, STAGE_LINK, WALL
from tests.recoveries.rig import recorded, replayed, waves

LIFT = (
    '<robot name="lift" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
    + STAGE_LINK.format(name="wall", mass=1.0, more=WALL)
    + STAGE_LINK.format(name="tool", mass=0.8, more=BALL)
    + STAGE_JOINT.format(name="z", parent="base", child="tool", axis="0 0 1")
    + '<joint name="mount" type="fixed"><parent link="base"/><child link="wall"/></joint></robot>'
)
SCENARIO = """
model: lift.urdf
weld: [{body: base}]
channels: {q: {std: 1.0e-5}, v: {std: 2.0e-4}, u: {std: 0.0}}
"""
CONTACT = """
contact: [{bodies: [tool, wall], law: kelvin_voigt, stiffness: 3000.0, damping: 30.0}]
"""


@dataclass(frozen=True)
class CubicFriction(JointForce):
    """−c v³."""

    name: ClassVar[str] = "joint_cubic_friction"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("coefficient", "N s^3/m^3", 1.0, lower=0.0),)
    reference: ClassVar[str] = "an oil's data sheet"

    def force(self, joint: JointSamples) -> Force:
        c, v, nothing = self.values["coefficient"], joint.v, np.zeros_like(joint.v)
        return Force(-c * v**3, nothing, -3.0 * c * v**2, nothing, -(v**3)[:, None])

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        yield Start(-(joint.v**3)[:, None])

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "CubicFriction":
        return self.with_values(coefficients)


@dataclass(frozen=True)
class ThickGrease(JointViscousFriction):
    """−c v, of grease: a subclass of ours."""

    name: ClassVar[str] = "joint_thick_grease"


class Amplifier(LeafSystem):
    """u + c u², as a user's own system: `asked` (n,) in, `acting` (n,) out."""

    made: ClassVar[list["Amplifier"]] = []

    def __init__(self, effect: "BentAmplifier", joints: int) -> None:
        LeafSystem.__init__(self)
        self.effect = effect
        self.DeclareVectorInputPort("asked", joints)
        self.DeclareVectorOutputPort("acting", joints, self._calc)
        Amplifier.made.append(self)

    def _calc(self, context: Context, output: BasicVector) -> None:
        asked = np.array(self.get_input_port().Eval(context))
        output.SetFromVector(asked + self.effect.values["bend"] * asked**2)


@dataclass(frozen=True)
class BentAmplifier(ActuatorEffect):
    """u + c u² acts."""

    name: ClassVar[str] = "bent_amplifier"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("bend", "1/N", 0.01),)
    reference: ClassVar[str] = "an amplifier's data sheet"

    def drive(self, effort: Effort) -> Effort:
        return Effort(effort.times, effort.values + self.values["bend"] * effort.values**2)

    def system(self, place: SystemPlace) -> Any:
        return Amplifier(self, len(place.tree.joints))


@dataclass(frozen=True)
class Updraught(BodyForce):
    """A force upwards that falls with the height, F exp(−z/0.3 m)."""

    name: ClassVar[str] = "updraught"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("force", "N", 0.3),)
    reference: ClassVar[str] = "a fan's data sheet"

    def point(self, body: Body) -> Array:
        return np.zeros(3)

    def force(
        self, p_WP: Array, v_WP: Array, time: Array | None, recording: str | None, lasting: Array | float = 0.0
    ) -> Array:
        return np.asarray(self.values["force"] * np.exp(-p_WP[:, 2:] / 0.3) * np.array([0.0, 0.0, 1.0]))


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
class QuadraticStiffness(ContactEffect):
    """+ c·d²."""

    name: ClassVar[str] = "contact_quadratic_stiffness"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("quadratic", "N/m^2", 1e5, lower=0.0),)
    reference: ClassVar[str] = "Johnson, Contact Mechanics, 1985, ch. 4"

    def push(self, touch: Touch, parameters: ContactParameters, memory: Array) -> Array:
        return np.asarray(self.values["quadratic"] * np.maximum(touch.penetration, 0.0) ** 2)

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        yield self.single("quadratic", 1e4, {})


@dataclass(frozen=True)
class BentSensor(SensorEffect):
    """x + c x² is written."""

    name: ClassVar[str] = "bent_sensor"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("bend", "1/unit of the channel", 0.1),)
    reference: ClassVar[str] = "a sensor's data sheet"

    def measured(self, time: Array, true: Array) -> Array:
        return np.asarray(true + self.values["bend"] * true**2)

    def true(self, time: Array, measured: Array) -> Array:
        c = self.values["bend"]
        return measured if c == 0.0 else np.asarray((np.sqrt(1.0 + 4.0 * c * measured) - 1.0) / (2.0 * c))

    def columns(self, time: Array, true: Array) -> Array:
        return np.asarray(true**2)[..., None]


OWN: list[Effect] = [
    CubicFriction("z", {"coefficient": 6.0}),
    ThickGrease("z", {"coefficient": 0.8}),
    BentAmplifier("z", {"bend": 0.01}),
    Updraught("tool", {"force": 1.0}),
    HeavierWorld("world", {"factor": 1.03}),
    QuadraticStiffness("tool/wall", {"quadratic": 4e5}),
    BentSensor("v.z", {"bend": 0.05}),
]
SAME: dict[str, type[Effect]] = {"heavier_world": JointViscousFriction}
"""What is looked for beside it where a bias, on one vertical joint, is the very same."""
DRAWN = {"joint_cubic_friction": "velocity of z", "joint_thick_grease": "velocity of z"}


def _scene(folder: Path, effect: Effect, *, with_it: bool) -> Scene:
    (folder / "lift.urdf").write_text(LIFT)
    text = SCENARIO + (CONTACT if effect.of_contact else "")
    if with_it:
        values = ", ".join(f"{name}: {value}" for name, value in effect.values.items())
        text += f"effects: [{{effect: {effect.name}, at: {effect.at}, {values}}}]\n"
    path = folder / ("with_it.yaml" if with_it else "scenario.yaml")
    path.write_text(text)
    return Scene.load(path, effects=[type(effect)])


def _error(scene: Scene, recording: Recording) -> float:
    """m, the root mean square of 0.3 s simulated in Drake under the recording's efforts from its middle on."""
    middle = float(recording.time[len(recording) // 2])
    part = recording.window(middle, middle + 0.3)
    start = np.array([part["q.z"][0], part["v.z"][0]])
    found = replayed(scene, part, start, 0.25, 5e-4)
    count = min(len(found), len(part))
    return float(np.sqrt(np.mean((found["q.z"][:count] - part["q.z"][:count]) ** 2)))


@pytest.mark.parametrize("effect", long_after(3, OWN), ids=lambda item: item.name)
def test_it_goes_all_the_way(effect: Effect, tmp_path: Path) -> None:
    truth, bare = (_scene(tmp_path, effect, with_it=with_it) for with_it in (True, False))
    # some millimetres into the wall, held there by a stiff controller, or in the air above it
    centre, size, rate = (0.015, 0.003, 60.0) if effect.of_contact else (0.3, 0.2, 20.0)
    Amplifier.made.clear()
    recording = recorded(truth, waves([centre], [size], seed=3), 1.0, rate=rate)
    assert bool(Amplifier.made) == (effect.name == "bent_amplifier")
    # beside a few of ours, for time
    looking = replace(bare, vocabulary=(SensorBias, SAME.get(effect.name, ActuatorBias)))
    verdict, outcome = examine(looking, [recording], effects=[type(effect)], settings=Settings(most_effects=1))
    (found,) = verdict.explanation
    assert (verdict.kind, found.effect.key) == ("explained", effect.key), str(verdict)
    for name, value in found.values.items():
        assert value.value == pytest.approx(effect.values[name], abs=4.0 * value.std, rel=0.02)
    if effect.place is not Place.CHANNEL:
        assert _error(verdict.corrected, recording) < 0.5 * _error(bare, recording)
    else:
        builder = DiagramBuilder()
        verdict.corrected.add_to(builder)
        assert any("bent_sensor at v.z" in item.get_name() for item in builder.GetSystems())
    write_artifacts(tmp_path / "out", verdict, outcome, [recording], [], ["a command"], replay=False)
    page = (tmp_path / "out" / "report.html").read_text()
    assert (type(effect).__doc__ or "").split("\n")[0] in page or effect.formula in page
    assert DRAWN.get(effect.name, "what the effect gives") in page
    assert Scene.load(tmp_path / "out" / "scenario.corrected.yaml", effects=[type(effect)]).scenario.effects


@dataclass(frozen=True)
class OfNoKind(Effect):
    """Something that no model has a place for."""

    name: ClassVar[str] = "of_no_kind"
    place: ClassVar[Place] = Place.JOINT
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("size", "1", 1.0),)
    reference: ClassVar[str] = ""


def test_an_effect_of_no_kind_is_refused(tmp_path: Path) -> None:
    scene = _scene(tmp_path, OWN[0], with_it=False)
    with pytest.raises(InputError, match=r"class OfNoKind: it is of no known kind, expected a subclass of Joint"):
        scene.with_effect_classes([OfNoKind])
    with pytest.raises(TypeError, match="of_no_kind: OfNoKind does not define how it enters the physics"):
        scene.physics.with_effects([OfNoKind("z", {"size": 1.0})])
    with pytest.raises(TypeError, match="of_no_kind: it acts at all times"):
        OfNoKind("z", {"size": 1.0}).during(0.0, 1.0, None)
