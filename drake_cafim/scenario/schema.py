"""The scenario file as dataclasses, loaded by Drake's `yaml_load_typed`."""

import dataclasses as dc
import re
import typing
from pathlib import Path
from typing import Any

import yaml
from pydrake.common.yaml import yaml_load_typed

from drake_cafim.errors import InputError
from drake_cafim.numerics.ranges import Range, number
from drake_cafim.recordings.topics import Topic, check_topics
from drake_cafim.scenario.shape import conform
from drake_cafim.yaml_file import read_mapping

EXPECTED = "a scenario (.yaml): a mapping with the key model"


@dc.dataclass
class Weld:
    """A body that is welded to the world at identity."""

    body: str = ""  # the body's name in the model


@dc.dataclass(unsafe_hash=True)
class Lowpass:
    """A Butterworth filter that whoever published a recording applied to a channel."""

    order: int = 2  # of the filter
    cutoff: float = number(0.0, "Hz", least=0.0, most=1e6, above=True)  # at −3 dB, of each pass
    zero_phase: bool = True  # applied forwards and backwards; false: forwards alone


@dc.dataclass
class Channel:
    """Noise of one kind of channel (`q`), of one joint's (`q.elbow`), or of a sensor (`wrench.wrist`)."""

    # Standard deviation of one sample, SI: a number; of a wrench `{force: , torque: }`, of a pose
    # `{position: , rotation: }`. Left out: estimated from the recordings. 0 of `u`: efforts are exact.
    std: dict[str, float] = dc.field(
        default_factory=dict, metadata={"range": Range(least=0.0, most=1e6), "plain": "all"}
    )
    correlation_time: float = number(0.0, "s", least=0.0, most=1e6)  # of the noise; 0: white
    hold: str = "zero_order"  # of u between samples: zero_order or first_order
    lowpass: Lowpass | None = None  # of v or u: filtered after it was measured, and so is what it is compared with
    body: str = ""  # of a wrench sensor: the body it belongs to
    frame: str = ""  # of a wrench sensor: the frame it measures in


@dc.dataclass
class Unknown:
    """A nominal parameter that may be wrong, with its Gaussian prior."""

    parameter: str = ""  # what may be wrong, see the table below
    std: float = number(0.0, least=0.0, above=True)  # of the prior, in the parameter's unit
    mean: float | None = None  # of the prior; left out: the model's value
    # The body whose parameter it is, of inertials also `all`; one of body, joint, contact, or effect with at.
    body: str | None = None
    # of inertials: the change of the model at the prior's mean, as ten log-Cholesky parameters; left out: none
    log_cholesky: list[float] = dc.field(default_factory=list, metadata={"length": 10, "range": Range(-20.0, 20.0)})
    joint: str | None = None  # the joint whose parameter it is
    contact: list[str] = dc.field(default_factory=list, metadata={"length": 2})  # the two bodies of the contact
    effect: str | None = None  # with `at`: a parameter of an effect, stated under `effects:` or not
    at: str | None = None  # the place of that effect


@dc.dataclass
class Ground:
    """A fixed half-space that the model file does not have; world frame."""

    point: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3, "range": Range(-1e6, 1e6, "m")}
    )  # on its surface
    normal: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 1.0], metadata={"length": 3, "range": Range(-1e6, 1e6)}
    )  # out of it, of any length


@dc.dataclass
class ContactPair:
    """The nominal contact model of two bodies; the moving or tracked one first."""

    bodies: list[str] = dc.field(default_factory=list, metadata={"length": 2})  # their names
    law: str = "kelvin_voigt"  # of the normal force: kelvin_voigt, paper, hunt_crossley or hydroelastic
    # K, of all laws but hydroelastic; of a box on a plane, per corner
    stiffness: float = number(0.0, "N/m", least=0.0, above=True)
    damping: float = number(0.0, "N s/m", least=0.0, most=1e9)  # C, of kelvin_voigt and paper
    dissipation: float = number(0.0, "s/m", least=0.0, most=1e6)  # c, of hunt_crossley and hydroelastic
    modulus: float = number(0.0, "Pa", least=0.0, above=True)  # E, of hydroelastic
    # the radius of the sphere as of the law hydroelastic, stated or looked for; left out: that of the model's
    radius: float | None = number(None, "m", least=0.0, above=True)
    # of hydroelastic: half the smallest extent of the flat body where that is the soft one; left out: the sphere is
    half_extent: float | None = number(None, "m", least=0.0, above=True)
    # of hydroelastic: Drake's resolution hint for the sphere's mesh; left out: an exact sphere
    resolution: float = number(0.0, "m", least=0.0)
    friction: float = number(0.0, least=0.0, most=100.0)  # μ
    # −μ λ tanh(|v_t|/slip_velocity) along the sliding velocity v_t; friction needs this or resistance
    slip_velocity: float | None = number(None, "m/s", least=0.0, most=100.0, above=True)
    resistance: float | None = number(None, "N s/m", least=0.0, most=1e9, above=True)  # −R v_t, at most μ λ
    ground: Ground | None = None  # what the second body is, where the model file does not have it
    # of a fixed box that a sphere touches: the one `nearest` to where the robot starts, or `all` with their edges
    faces: str = "nearest"


@dc.dataclass
class EffectEntry:
    """Physics beyond the model file, as `{effect: joint_coulomb_friction, at: elbow, torque: 1.2}`."""

    effect: str = ""  # its name in the vocabulary
    at: str = ""  # where it acts
    # the effect's own parameters by name, written beside `effect` and `at`
    parameters: dict[str, float] = dc.field(default_factory=dict, metadata={"flat": True})
    interval: list[float] = dc.field(default_factory=list, metadata={"length": 2})  # s; of external_disturbance
    recording: str | None = None  # of external_disturbance: the recording in which it acts; left out: in each
    law: str | None = None  # of contact_law: the law of the contact, hydroelastic
    table: str | None = None  # of learned_force: the file of its terms, relative to the scenario's


@dc.dataclass
class Supply:
    """The logged voltage of a servo's supply, with which kp and the limit scale."""

    column: str = ""  # the recording's column
    nominal: float = number(1.0, least=0.0, above=True)  # the voltage at which kp and the limit are as stated


@dc.dataclass
class ServoEntry:
    """A position servo that runs on the robot: effort = clip(kp (cmd − q), −limit, limit) − kv v."""

    # N m/rad: a number, by joint, or `{column: kp_firmware, scale: 0.0014}`, a multiple of a recording's column
    kp: dict[str, float | str] = dc.field(default_factory=dict, metadata={"plain": "all", "range": Range(0.0, 1e9)})
    kv: dict[str, float] = dc.field(
        default_factory=dict, metadata={"plain": "all", "range": Range(0.0, 1e9)}
    )  # N m s/rad, a number or by joint
    limit: dict[str, float] = dc.field(
        default_factory=dict, metadata={"plain": "all", "range": Range(0.0, 1e9, above=True)}
    )  # N m at standstill, of kp (cmd − q) alone; a number or by joint
    supply: Supply | None = None  # where the supply voltage is logged
    drive: str = ""  # `servo`: a joint with a `u.` column is driven by its servo all the same


@dc.dataclass
class Scenario:
    """A robot's model, the noise of its sensors, its unknown parameters, its contacts, and effects known to act."""

    model: str = ""  # .urdf, .sdf, .xml (MJCF) or .dmd.yaml: a path relative to the scenario file, or package://...
    directives: list[dict[str, typing.Any]] = dc.field(default_factory=list)  # Drake's model directives, in its place
    gravity: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, -9.81], metadata={"length": 3, "range": Range(-1e4, 1e4, "m/s²")}
    )  # in the world
    weld: list[Weld] = dc.field(default_factory=list)  # bodies that are fixed to the world
    packages: dict[str, str] = dc.field(default_factory=dict)  # where package://name/... leads, relative to the file
    # Joints that are held: at a position, rad or m; as a list at the file's value or 0; `unrecorded`: those without q.
    lock: dict[str, float] | list[str] | str = dc.field(default_factory=dict)
    unlimited: list[str] = dc.field(default_factory=list)  # joints at which no effort limit of the model's files acts
    # Noise by kind of column (`q`, `v`, `u`), by column (`q.elbow`), sensor (`wrench.wrist`) or body (`pose.ball`).
    channels: dict[str, Channel] = dc.field(default_factory=dict)
    unknown: list[Unknown] = dc.field(default_factory=list)  # parameters of the model that may simply be wrong
    contact: list[ContactPair] = dc.field(default_factory=list)  # the contacts of the nominal model
    effects: list[EffectEntry] = dc.field(default_factory=list)  # physics beyond the model file that is known to act
    servo: ServoEntry | None = None  # a position servo that runs on the robot: `cmd.` and `q.` are then enough
    topics: dict[str, Topic] = dc.field(default_factory=dict)  # names in bags, logs and foreign tables
    diagram: dict[str, typing.Any] = dc.field(default_factory=dict)  # the world that `cafim run` builds, see diagrams/
    task: dict[str, typing.Any] = dc.field(default_factory=dict)  # numbers of the planner's task, see tasks/
    random_seed: typing.Any = None  # of hardware_sim; not used
    simulation_duration: typing.Any = None  # s, of hardware_sim; not used
    simulator_config: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used
    plant_config: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used
    scene_graph_config: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used
    lcm_buses: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used
    # of hardware_sim; not used: efforts are those that were recorded, or commanded, at the joints
    model_drivers: dict[str, typing.Any] = dc.field(default_factory=dict)
    cameras: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used
    visualization: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used
    initial_position: dict[str, typing.Any] = dc.field(default_factory=dict)  # of hardware_sim; not used


MOST_ORDER = 20
"""Highest order of a `lowpass`."""
LAWS = ("kelvin_voigt", "paper", "hunt_crossley", "hydroelastic")
FACES = ("nearest", "all")
FIELD = ("modulus", "radius", "half_extent", "resolution")
"""The keys of a contact that only the law hydroelastic has."""
OF_HARDWARE_SIM = (
    "random_seed", "simulation_duration", "simulator_config", "plant_config", "scene_graph_config", "lcm_buses",
    "model_drivers", "cameras", "visualization", "initial_position",
)  # fmt: skip
"""Keys of a scenario file of Drake's hardware_sim, besides `directives`; they are taken as they are."""
FREE = ("directives", "diagram", "task", "lock", *OF_HARDWARE_SIM)
"""Keys whose values are YAML of any shape."""
UNRECORDED = "unrecorded"
"""The value of `lock:` that holds all joints without a column in the recordings."""
HOLDS = ("zero_order", "first_order")
CHANNELS = ("q", "v", "u", "cmd", "wrench", "pose")


def load(path: Path, name: str = "") -> Scenario:
    """The scenario in the file at `path`; of a file with several, as Drake's hardware_sim has them, the one of `name`.

    Raises `InputError` that names the file, the key, what was found and the valid choices.
    """
    raw = read_mapping(path, EXPECTED)
    named = [
        key for key, value in raw.items() if isinstance(value, dict) and ("directives" in value or "model" in value)
    ]
    if name or (named and not {"model", "directives"} & set(raw)):
        if name and name not in raw:
            raise InputError(
                f"{path}: there is no scenario {name}, expected one of {', '.join(map(str, named)) or 'none'}"
            )
        if not name and len(named) > 1:
            raise InputError(f"{path}: it holds the scenarios {', '.join(named)}, expected one as {path}#{named[0]}")
        raw, source = raw[name or named[0]], f"{path}#{name or named[0]}"
        if not isinstance(raw, dict):
            raise InputError(f"{source}: found {type(raw).__name__}, expected {EXPECTED}")
        return parse(raw, source)
    return parse(raw, str(path))


def parse(raw: dict[str, Any], source: str) -> Scenario:
    """The scenario in the mapping `raw`; `source` names it in messages."""
    plain = conform(raw, Scenario, f"{source}: ")
    free: dict[str, Any] = {key: plain.pop(key) for key in FREE if key in plain}
    servo = plain.pop("servo", None)
    try:
        scenario: Scenario = yaml_load_typed(schema=Scenario, data=yaml.safe_dump(plain))
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"{source}: {' '.join(str(error).split())}") from None
    for key, value in free.items():  # YAML of any shape, which the schema cannot type
        setattr(scenario, key, value)
    if servo is not None:
        supply = servo.pop("supply", None)
        scenario.servo = ServoEntry(**servo, supply=None if supply is None else Supply(**supply))
    _check(scenario, source)
    return scenario


def _check(scenario: Scenario, source: str) -> None:
    """Check what the types of the schema cannot express, as keys that exclude each other. Raises `InputError`."""
    if not scenario.model and not scenario.directives:
        raise InputError(f"{source}: the key model is missing, expected the path of a .urdf, .sdf, .xml or .dmd.yaml")
    if scenario.model and scenario.directives:
        raise InputError(f"{source}: model and directives are both given, expected one of them")
    check_topics(scenario.topics, source)
    if scenario.servo is not None:
        _check_servo(scenario.servo, f"{source}: servo")
    _check_lock(scenario.lock, source)
    for i, weld in enumerate(scenario.weld):
        if weld.body in ("", "world"):
            raise InputError(f"{source}: weld[{i}].body is {weld.body!r}, expected a body of the model")
        if weld in scenario.weld[:i]:
            raise InputError(f"{source}: weld[{i}].body is {weld.body!r}, which is welded already")
    for name, channel in scenario.channels.items():
        _check_channel(name, channel, f"{source}: channels.{name}", source)
    for i, pair in enumerate(scenario.contact):
        _check_contact(pair, f"{source}: contact[{i}]")
    for i, unknown in enumerate(scenario.unknown):
        _check_unknown(unknown, f"{source}: unknown[{i}]")


def _check_channel(name: str, channel: Channel, key: str, source: str) -> None:
    kind = name.split(".")[0]
    if kind not in CHANNELS or (kind in ("wrench", "pose") and not name.partition(".")[2]):
        raise InputError(
            f"{source}: unknown channel {name!r} in channels; valid kinds: q, v, u, cmd, wrench.<sensor>, pose.<body>"
        )
    parts = {"wrench": {"force", "torque"}, "pose": {"position", "rotation"}}.get(kind, {"all"})
    wrong = set(channel.std) - parts
    if wrong:
        expected = "one number" if parts == {"all"} else " and ".join(sorted(parts))
        found = "one number" if wrong == {"all"} else ", ".join(sorted(wrong))
        raise InputError(f"{key}.std has {found}, expected {expected}")
    if channel.hold not in HOLDS:
        raise InputError(f"{key}.hold is {channel.hold!r}; valid: {', '.join(HOLDS)}")
    if kind != "u" and channel.hold != HOLDS[0]:
        raise InputError(f"{key}.hold is {channel.hold!r}, but only u is held between its samples")
    if channel.lowpass is not None:
        _check_lowpass(kind, channel.lowpass, f"{key}.lowpass")
    if kind != "wrench" and (channel.body or channel.frame):
        raise InputError(f"{key} has body or frame, which only a wrench.<sensor> has")


def _check_lowpass(kind: str, lowpass: Lowpass, key: str) -> None:
    if kind not in ("u", "v"):
        raise InputError(f"{key} is given, but a filter is supported of u and v only, expected it there")
    if not 1 <= lowpass.order <= MOST_ORDER:
        raise InputError(f"{key}.order is {lowpass.order}, expected a whole number from 1 to {MOST_ORDER}")
    if not lowpass.cutoff > 0.0:
        raise InputError(f"{key} has no cutoff, expected a number in Hz")


def _check_servo(servo: ServoEntry, key: str) -> None:
    if servo.supply is not None and not servo.supply.column:
        raise InputError(f"{key}.supply has no column, expected the recording's column of the voltage")
    if servo.drive not in ("", "servo"):
        raise InputError(f"{key}.drive is {servo.drive!r}; valid: servo")
    by_column = "column" in servo.kp or "scale" in servo.kp
    if by_column and (set(servo.kp) != {"column", "scale"} or not isinstance(servo.kp["column"], str)):
        raise InputError(f"{key}.kp is {servo.kp}, expected a number, numbers by joint, or column and scale")
    for name, value in servo.kp.items():
        if name != "column" and not isinstance(value, float):
            raise InputError(f"{key}.kp.{name} is {value!r}, expected a number")


def _check_contact(pair: ContactPair, key: str) -> None:
    if len(pair.bodies) != 2 or pair.bodies[0] == pair.bodies[1]:
        raise InputError(f"{key}.bodies is {pair.bodies}, expected the names of two bodies")
    if pair.law not in LAWS:
        raise InputError(f"{key}.law is {pair.law!r}; valid: {', '.join(LAWS)}")
    if pair.faces not in FACES:
        raise InputError(f"{key}.faces is {pair.faces!r}; valid: {', '.join(FACES)}")
    field = pair.law == "hydroelastic"
    needed, unit = ("modulus", "Pa") if field else ("stiffness", "N/m")
    if not getattr(pair, needed) > 0.0:
        raise InputError(f"{key} has no {needed}, expected a number in {unit}")
    if pair.friction and (pair.slip_velocity is None) == (pair.resistance is None):
        raise InputError(f"{key} needs exactly one of slip_velocity and resistance")
    dissipates = pair.law in ("hunt_crossley", "hydroelastic")
    lacking = ["damping" if dissipates else "dissipation", "stiffness" if field else "modulus"]
    for other in lacking:
        if getattr(pair, other):
            raise InputError(f"{key}.{other} is {getattr(pair, other):g}, but the law {pair.law} has no {other}")
    if pair.ground is not None and not sum(part * part for part in pair.ground.normal):
        raise InputError(f"{key}.ground.normal is {pair.ground.normal}, expected a direction")


def _check_unknown(unknown: Unknown, key: str) -> None:
    if not unknown.parameter:
        raise InputError(f"{key} has no parameter, expected its name")
    places = [unknown.body, unknown.joint, "/".join(unknown.contact) or None, unknown.effect]
    if sum(place is not None for place in places) != 1 or (unknown.effect is None) != (unknown.at is None):
        raise InputError(f"{key} ({unknown.parameter}) needs exactly one of body, joint, contact, effect with at")
    if unknown.log_cholesky and unknown.parameter != "inertials":
        raise InputError(f"{key} ({unknown.parameter}) has log_cholesky, which only inertials have")
    if not unknown.std > 0:
        raise InputError(f"{key} ({unknown.parameter}) has no std, expected that of its prior")


def _check_lock(lock: Any, source: str) -> None:
    fits = lock == UNRECORDED
    if isinstance(lock, dict):
        fits = all(isinstance(value, int | float) and not isinstance(value, bool) for value in lock.values())
    elif isinstance(lock, list):
        fits = all(isinstance(name, str) for name in lock)
    if not fits:
        raise InputError(
            f"{source}: lock is {lock!r}, expected a list of joints, joints with positions (rad or m), or {UNRECORDED}"
        )


def package_reference(text: str) -> str | None:
    """The package's name when `text` is a `package://name/...` address, else None."""
    match = re.match(r"package://([^/]+)/", text)
    return match.group(1) if match else None
