"""Keys and values of the scenario format that this version does not support: they are refused, never ignored."""

from collections.abc import Collection, Mapping

from drake_cafim.errors import InputError

KEYS: Mapping[tuple[str, str], str] = {
    ("Scenario", "servo"): "a position servo",
    ("Scenario", "drive"): "a position servo",
    ("Channel", "lowpass"): "a published filter",
}
"""(dataclass of the schema, key) to the feature's name in messages."""
UNKNOWNS = ("servo_stiffness", "servo_damping", "servo_limit", "inertials")
EFFECTS = (
    "servo_gain_error",
    "servo_dead_band",
    "command_delay",
    "command_lag",
    "command_rate_limit",
    "actuator_speed_limit",
    "supply_sag",
    "inertial_error",
    "contact_law",
    "learned_force",
)
PARAMETERS = {("joint_load_dependent_friction", "external")}


def refuse_key(kind: str, name: str, key: str) -> None:
    """Raises `InputError` where the key `name` of the schema's dataclass `kind` is not supported; `key` is its path."""
    if (kind, name) in KEYS:
        raise InputError(f"{key} is given, but {KEYS[kind, name]} is not supported by this version: leave the key out")


def refuse_value(value: object, waiting: Collection[str], key: str) -> None:
    """Raises `InputError` where `value` is among the unsupported ones, `waiting`; `key` names the file and the key."""
    if isinstance(value, str) and value in waiting:
        raise InputError(f"{key} is {value}, which is not supported by this version")
