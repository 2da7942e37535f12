"""The scenario file as dataclasses, loaded by Drake's `yaml_load_typed`."""

import dataclasses as dc
import difflib
import re
import typing
from pathlib import Path
from typing import Any

import yaml
from pydrake.common.yaml import yaml_load_typed

from drake_cafim.errors import InputError
from drake_cafim.recordings.topics import Topic, check_topics


@dc.dataclass
class Weld:
    """A body that is welded to the world at identity."""

    body: str = ""


@dc.dataclass
class Channel:
    """Noise of one kind of channel (`q`), of one joint's (`q.elbow`), or of a sensor (`wrench.wrist`)."""

    # Standard deviation of one sample, SI: `{all: 2e-4}`, or by part: force, torque, position, rotation.
    # The file may hold a plain number for `all`. Empty: estimated from the recording.
    std: dict[str, float] = dc.field(default_factory=dict)
    correlation_time: float = 0.0  # s; 0: white
    hold: str = "zero_order"  # of u between samples: zero_order or first_order
    body: str = ""  # of a wrench sensor: the body it belongs to
    frame: str = ""  # of a wrench sensor: the frame it measures in


@dc.dataclass
class Unknown:
    """A nominal parameter that may be wrong, with its Gaussian prior."""

    parameter: str = ""
    std: float = 0.0  # of the prior, in the parameter's unit
    mean: float | None = None  # missing: the model's value
    body: str | None = None
    joint: str | None = None
    contact: list[str] = dc.field(default_factory=list)  # two bodies
    effect: str | None = None  # with `at`: a parameter of an entry of `effects:`
    at: str | None = None


@dc.dataclass
class Ground:
    """A fixed half-space that the model file does not have; world frame."""

    point: list[float] = dc.field(default_factory=lambda: [0.0, 0.0, 0.0])  # m
    normal: list[float] = dc.field(default_factory=lambda: [0.0, 0.0, 1.0])


@dc.dataclass
class ContactPair:
    """The nominal contact model of two bodies; the moving or tracked one first."""

    bodies: list[str] = dc.field(default_factory=list)
    law: str = "kelvin_voigt"  # or paper, hunt_crossley
    stiffness: float = 0.0  # N/m; of a box on a plane, per corner
    damping: float = 0.0  # N s/m
    dissipation: float = 0.0  # s/m, hunt_crossley
    friction: float = 0.0
    slip_velocity: float | None = None  # m/s; friction saturates as tanh(|v_t|/slip_velocity)
    resistance: float | None = None  # N s/m; the paper's R
    ground: Ground | None = None


@dc.dataclass
class EffectEntry:
    """Physics beyond the model file, as `{effect: joint_coulomb_friction, at: elbow, torque: 1.2}`."""

    effect: str = ""
    at: str = ""
    parameters: dict[str, float] = dc.field(default_factory=dict)  # written flat in the file
    interval: list[float] = dc.field(default_factory=list)  # s, external_disturbance
    recording: str | None = None


@dc.dataclass
class Servo:
    """A joint position servo that runs on the robot: effort = kp (cmd − q) − kv v."""

    kp: dict[str, float] = dc.field(default_factory=dict)  # joint to N m/rad
    kv: dict[str, float] = dc.field(default_factory=dict)  # joint to N m s/rad


@dc.dataclass
class Scenario:
    """A robot, its noise, what is not known of it, its contacts, and the physics that is known beyond its model."""

    model: str = ""  # path relative to the scenario file, or package://...
    directives: list[dict[str, typing.Any]] = dc.field(default_factory=list)  # Drake's model directives instead
    gravity: list[float] = dc.field(default_factory=lambda: [0.0, 0.0, -9.81])  # m/s², world
    weld: list[Weld] = dc.field(default_factory=list)
    lock: dict[str, float] = dc.field(default_factory=dict)  # joints that are held at a position, rad or m
    channels: dict[str, Channel] = dc.field(default_factory=dict)
    unknown: list[Unknown] = dc.field(default_factory=list)
    contact: list[ContactPair] = dc.field(default_factory=list)
    effects: list[EffectEntry] = dc.field(default_factory=list)
    servo: Servo | None = None
    topics: dict[str, Topic] = dc.field(default_factory=dict)  # names in bags, logs and foreign tables
    diagram: dict[str, typing.Any] = dc.field(default_factory=dict)  # the world that `cafim run` builds, see diagrams/
    task: dict[str, typing.Any] = dc.field(default_factory=dict)  # numbers of the planner's task, see tasks/


LAWS = ("kelvin_voigt", "paper", "hunt_crossley")
HOLDS = ("zero_order", "first_order")
_ENTRY_KEYS = ("effect", "at", "interval", "recording")


def load(path: Path) -> Scenario:
    """The scenario in the file at `path`.

    Raises `InputError` naming the file, the key, what was found and the valid choices.
    """
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file, expected a scenario (.yaml) or a model file") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as YAML: {' '.join(str(error).split())}") from None
    if not isinstance(raw, dict):
        raise InputError(f"{path}: found {type(raw).__name__}, expected a mapping with the key model")
    return parse(raw, str(path))


def parse(raw: dict[str, Any], source: str) -> Scenario:
    """The scenario in the mapping `raw`; `source` names it in messages."""
    raw = {key: value for key, value in raw.items() if value is not None}
    _refuse_unknown_keys(raw, source)
    free: dict[str, Any] = {key: raw.pop(key) for key in ("directives", "diagram", "task") if key in raw}
    plain = _with_plain_std(_with_effect_parameters(raw))
    try:
        scenario: Scenario = yaml_load_typed(schema=Scenario, data=yaml.safe_dump(plain))
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"{source}: {' '.join(str(error).split())}") from None
    for key, value in free.items():  # YAML of any shape, which the schema cannot type
        setattr(scenario, key, value)
    _check(scenario, source)
    return scenario


def _with_plain_std(raw: dict[str, Any]) -> dict[str, Any]:
    """`std: 1e-3` written as `std: {all: 1e-3}`, the one form that the schema types."""
    channels = {}
    for name, channel in (raw.get("channels") or {}).items():
        channel = dict(channel or {})
        if not isinstance(channel.get("std", {}), dict):
            channel["std"] = {"all": channel["std"]}
        channels[name] = channel
    return raw | {"channels": channels}


def _with_effect_parameters(raw: dict[str, Any]) -> dict[str, Any]:
    """The flat parameters of each entry of `effects:` gathered under `parameters`."""
    entries = []
    for entry in raw.get("effects") or []:
        kept = {key: value for key, value in entry.items() if key in _ENTRY_KEYS and value is not None}
        flat = {key: value for key, value in entry.items() if key not in (*_ENTRY_KEYS, "parameters")}
        entries.append(kept | {"parameters": entry.get("parameters", {}) | flat})
    return raw | {"effects": entries}


def _refuse_unknown_keys(raw: dict[str, Any], source: str) -> None:
    def check(mapping: Any, kind: type, where: str, also: tuple[str, ...] = ()) -> None:
        if not isinstance(mapping, dict):
            raise InputError(f"{source}: {where} is {mapping!r}, expected a mapping")
        valid = (*(field.name for field in dc.fields(kind)), *also)
        for key in mapping:
            if key not in valid:
                near = difflib.get_close_matches(str(key), valid, n=1)
                hint = f" (did you mean {near[0]}?)" if near else ""
                raise InputError(f"{source}: unknown key {key!r} in {where}{hint}; valid keys: {', '.join(valid)}")

    check(raw, Scenario, "the scenario")
    for key in ("diagram", "task"):
        if not isinstance(raw.get(key, {}), dict):
            raise InputError(f"{source}: {key} is {raw[key]!r}, expected a mapping")
    for name, channel in (raw.get("channels") or {}).items():
        check(channel or {}, Channel, f"channels.{name}")
    for key, kind in (("weld", Weld), ("unknown", Unknown), ("contact", ContactPair)):
        entries = raw.get(key) or []
        if not isinstance(entries, list):
            raise InputError(f"{source}: {key} is {entries!r}, expected a list")
        for entry in entries:
            check(entry, kind, f"an entry of {key}")
            if entry.get("ground") is not None and key == "contact":
                check(entry["ground"], Ground, "ground")
    if raw.get("servo") is not None:
        check(raw["servo"], Servo, "servo")


def _check(scenario: Scenario, source: str) -> None:
    if not scenario.model and not scenario.directives:
        raise InputError(f"{source}: the key model is missing, expected the path of a .urdf, .sdf, .xml or .dmd.yaml")
    check_topics(scenario.topics, source)
    if len(scenario.gravity) != 3:
        raise InputError(f"{source}: gravity is {scenario.gravity}, expected three numbers in m/s²")
    for name, channel in scenario.channels.items():
        kind = name.split(".")[0]
        if kind not in ("q", "v", "u", "cmd", "wrench", "pose"):
            raise InputError(
                f"{source}: unknown channel {name!r}; valid kinds: q, v, u, cmd, wrench.<sensor>, pose.<body>"
            )
        parts = {"wrench": {"force", "torque"}, "pose": {"position", "rotation"}}.get(kind, {"all"})
        wrong = set(channel.std) - parts
        if wrong:
            raise InputError(
                f"{source}: channels.{name}.std has {', '.join(sorted(wrong))}, expected {' and '.join(sorted(parts))}"
            )
        if any(not value >= 0 for value in channel.std.values()):
            raise InputError(f"{source}: channels.{name}.std is {channel.std}, expected numbers of at least 0")
        if channel.hold not in HOLDS:
            raise InputError(f"{source}: channels.{name}.hold is {channel.hold!r}; valid: {', '.join(HOLDS)}")
    for pair in scenario.contact:
        if len(pair.bodies) != 2:
            raise InputError(f"{source}: contact.bodies is {pair.bodies}, expected two names")
        if pair.law not in LAWS:
            raise InputError(f"{source}: contact.law is {pair.law!r}; valid: {', '.join(LAWS)}")
        if pair.friction and (pair.slip_velocity is None) == (pair.resistance is None):
            raise InputError(
                f"{source}: contact {'/'.join(pair.bodies)} needs exactly one of slip_velocity and resistance"
            )
    for unknown in scenario.unknown:
        places = [unknown.body, unknown.joint, "/".join(unknown.contact) or None, unknown.at]
        if sum(place is not None for place in places) != 1:
            raise InputError(
                f"{source}: unknown {unknown.parameter!r} needs exactly one of body, joint, contact, effect with at"
            )
        if not unknown.std > 0:
            raise InputError(
                f"{source}: unknown {unknown.parameter!r} has std {unknown.std}, expected a positive number"
            )


def package_reference(text: str) -> str | None:
    """The package's name when `text` is a `package://name/...` address, else None."""
    match = re.match(r"package://([^/]+)/", text)
    return match.group(1) if match else None
