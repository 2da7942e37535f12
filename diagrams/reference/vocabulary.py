"""The effects: law, parameters, places, and what each is confused with."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drake_cafim.diagrams.reference.tables import code, table
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.effects.effect import Effect, Strength
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.stated import bounds, is_required
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.numerics.ranges import LARGEST
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scene.scene import Scene

BODY = """<link name="BODY"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link>"""
ROTOR = """<transmission><type>transmission_interface/SimpleTransmission</type><joint name="JOINT">
<hardwareInterface>EffortJointInterface</hardwareInterface></joint>
<actuator name="motor"><drake:rotor_inertia value="0.01"/><drake:gear_ratio value="1"/></actuator></transmission>"""
ROBOT = f"""<robot name="r"><link name="base"/>{BODY}<joint name="JOINT" type="revolute"><parent link="base"/>
<child link="BODY"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>{{}}</robot>"""
CONTACT = (
    "contact: [{bodies: [BODY, SURFACE], ground: {}, stiffness: 1000.0, damping: 1.0, friction: 0.3, "
    "slip_velocity: 0.01}]"
)
FAMILIES = {
    "joint": "Joint and transmission",
    "actuator": "Actuator",
    "link": "Link and environment",
    "contact": "Contact",
    "surface": "Surface",
    "sensor": "Sensor and timing",
}

SERVED = "that a position servo drives"


@dataclass(frozen=True)
class Settings:
    """A robot with one joint, a wrench sensor and a contact, a thrown ball on the ground, and the robot with less."""

    robot: Surroundings
    thrown: Surroundings
    measured_effort: Surroundings
    without_rotor: Surroundings
    known_inertials: Surroundings
    served: Surroundings

    def on_robot(self, effect: type[Effect]) -> list[str]:
        """The places on the robot, with a position servo or without."""
        return list(dict.fromkeys([*effect.attachments(self.robot), *effect.attachments(self.served)]))

    def places(self, effect: type[Effect]) -> list[str]:
        """Where the effect is looked for, in sentences; the conditions are found by what the lesser robots lack."""
        here, there = self.on_robot(effect), list(effect.attachments(self.thrown))
        conditions = {
            "whose effort is commanded (`std: 0`)": self.measured_effort,
            "whose rotor's inertia is in the model": self.without_rotor,
            "whose inertials are under `unknown:`": self.known_inertials,
            SERVED: self.robot,
            "that no position servo drives": self.served,
        }
        met = [words for words, less in conditions.items() if here and not list(effect.attachments(less))]
        # without a servo it is nowhere, whatever else is different
        met = [SERVED] if SERVED in met else met
        found = [f"of robots at {_places(here)} {' and '.join(met)}".rstrip()] if here else []
        return found + ([f"of thrown bodies at {_places(there)}"] if there else [])


BUILT_UP = (
    "With a `slip` <i>s</i>, a displacement, it builds up after the motion turns round (Dahl, Aerospace Corporation "
    "TOR-0158, 1968): <i>z</i>, <i>ż</i> = (<i>v</i> − |<i>v</i>| <i>z</i>)/<i>s</i>, is in the place of "
    "tanh(<i>v</i>/<i>w</i>). A search takes that where it fits better than noise would."
)


def vocabulary() -> str:
    """A section for each effect, by family."""
    settings = _settings()
    families = dict.fromkeys(effect.family for effect in EFFECTS)
    parts = []
    for family in families:
        parts.append(f"### {FAMILIES.get(family, family.capitalize())}")
        parts += [_section(effect, settings) for effect in EFFECTS if effect.family == family]
    return "\n\n".join(parts)


def overview() -> str:
    """A table of all effects with their laws."""
    settings = _settings()
    rows = []
    for effect in EFFECTS:
        places = _places([*settings.on_robot(effect), *effect.attachments(settings.thrown)])
        rows.append([f"[{effect.name}](#{effect.name})", places, _law(effect)])
    return table(["effect", "`at`", "law"], rows)


def _section(effect: type[Effect], settings: Settings) -> str:
    lines = [f"#### {effect.name}", f"**Law:** {_law(effect)}"]
    if effect.words:
        lines.append(f"It {effect.words}.")
    if effect.slips:
        lines.append(BUILT_UP)
    lines.append(f"**Looked for** {'; '.join(settings.places(effect))}.")
    if effect.brief:
        lines.append("It acts once: `interval: [start, stop]` (s) and `recording` say when.")
    stated = [s for s in (*effect.strengths, *effect.shapes) if not (effect.brief and s.name in ("start", "stop"))]
    head = ["parameter", "unit", "range", "without the effect", "typical"]
    lines.append(table(head, [_parameter(strength, effect) for strength in stated]))
    alternatives = [
        code(other.name) for other in EFFECTS if other.group == effect.group and other.group and other is not effect
    ]
    if alternatives:
        lines.append(f"**At most one at a place** of it and {', '.join(alternatives)}.")
    confused = [f"- {code(name)}: {reason}" for name, reason in _confused(effect)]
    if confused:
        lines += ["**Confused with**", "\n".join(confused)]
    lines.append(f"**Source:** {effect.reference}")
    return "\n\n".join(lines)


def _law(effect: type[Effect]) -> str:
    return effect.formula or (effect.__doc__ or "").strip().splitlines()[0].rstrip(".")


def _confused(effect: type[Effect]) -> Iterator[tuple[str, str]]:
    """Names of effects that are confused with this one, by either one's statement, with the reason."""
    yield from effect.alike.items()
    for other in EFFECTS:
        if effect.name in other.alike and other.name not in effect.alike:
            yield other.name, other.alike[effect.name]


def _parameter(strength: Strength, effect: type[Effect]) -> list[str]:
    unit = "" if strength.unit == "1" else strength.unit
    if strength.linear_unit is not None:
        unit += f" ({strength.linear_unit or '1'})"
    shape = strength in effect.shapes
    absent = "∞" if strength.inverse else f"{strength.nominal:g}" if strength.amplitude and not shape else ""
    if strength.through:
        absent = f"any, where {strength.through} is 0"
    name = code(strength.name) + (" (required)" if not shape and is_required(strength, effect) else "")
    typical = f"one of {', '.join(f'{x:g}' for x in strength.grid)}" if strength.grid else f"{strength.typical:g}"
    return [name, unit, _range(strength), absent, typical]


def _range(strength: Strength) -> str:
    if strength.choices:
        return " or ".join(f"{choice:g}" for choice in strength.choices)
    within = bounds(strength)
    least = "" if within.least <= -LARGEST else f"≥ {within.least:g}"
    most = "" if within.most >= LARGEST else f"≤ {within.most:g}"
    return ", ".join(part for part in (least, most) if part)


def _places(found: list[str]) -> str:
    """The places as addresses of a scenario, as `q.<joint>`; a sensor's components and a body's axes are one."""
    parts = {}
    for place in found:
        plain = place
        for word in ("JOINT", "BODY", "SURFACE", "SENSOR"):
            plain = plain.replace(word, f"<{word.lower()}>")
        head, _, last = plain.rpartition(".")
        plain = f"{head}.<axis>" if last in (*WRENCH_COMPONENTS, "x", "y", "z") else plain
        parts[code(plain)] = True
    return ", ".join(parts)


def _settings() -> Settings:
    with tempfile.TemporaryDirectory() as scratch:
        robot = _scene(Path(scratch), ROBOT.format(ROTOR), "weld: [{body: base}]")
        plain = _scene(Path(scratch), ROBOT.format(""), "weld: [{body: base}]")
        ball = _scene(Path(scratch), f'<robot name="r">{BODY}</robot>', "")
    columns = ["q.JOINT", "v.JOINT", *(f"wrench.SENSOR.{axis}" for axis in WRENCH_COMPONENTS)]
    return Settings(
        Surroundings(robot.tree, robot.physics.contacts, columns, inertials=("BODY",)),
        Surroundings(ball.tree, ball.physics.contacts, [f"pose.BODY.{axis}" for axis in "xyz"], "BODY"),
        Surroundings(robot.tree, robot.physics.contacts, [*columns, "u.JOINT"], inertials=("BODY",)),
        Surroundings(plain.tree, plain.physics.contacts, columns, inertials=("BODY",)),
        Surroundings(robot.tree, robot.physics.contacts, columns),
        Surroundings(
            robot.tree,
            robot.physics.contacts,
            columns,
            inertials=("BODY",),
            servos=[Servo("JOINT", stiffness=10.0, damping=1.0, limit=9.0)],
        ),
    )


def _scene(folder: Path, model: str, more: str) -> Scene:
    (folder / "model.urdf").write_text(model, encoding="utf-8")
    (folder / "scenario.yaml").write_text(f"model: model.urdf\n{CONTACT}\n{more}\n", encoding="utf-8")
    return Scene.load(folder / "scenario.yaml")
