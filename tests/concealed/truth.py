"""The truth of a case: its effects with their places and strengths, and how they change a simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from .laws import Laws
from .robots import Array, Robot

Sensor = Callable[["Channels"], "Channels"]


@dataclass(frozen=True)
class Channels:
    """Noise-free measurements: column name -> function of time (B, N) -> (B, N), and the sampling instants."""

    time: Array
    columns: dict[str, Callable[[Array], Array]]


@dataclass(frozen=True)
class Concealed:
    """One effect beyond the nominal model."""

    effect: str
    at: str
    parameters: dict[str, tuple[float, str]]
    laws: Laws = field(default_factory=Laws)
    change: Callable[[Robot], Robot] | None = None  # of the true robot
    contact: dict[str, object] = field(default_factory=dict)  # changes of the contact law's fields
    sensor: Sensor | None = None
    interval: tuple[float, float] | None = None
    recording: str | None = None
    exact: bool = True  # the law is the vocabulary's own
    variant: str = ""
    place_kind: str = ""

    def statement(self) -> dict[str, object]:
        """The effect in the form of truth.json."""
        told: dict[str, object] = {
            "effect": self.effect,
            "at": self.at,
            "parameters": {name: [value, unit] for name, (value, unit) in self.parameters.items()},
        }
        if self.interval is not None:
            told |= {"interval": list(self.interval), "recording": self.recording}
        if not self.exact:
            told |= {"exact": False, "variant": self.variant}
        return told


JOINT = (
    "joint_viscous_friction",
    "joint_coulomb_friction",
    "joint_asymmetric_coulomb_friction",
    "joint_stribeck_friction",
    "joint_load_dependent_friction",
    "joint_spring",
    "joint_backlash",
    "joint_hard_stop",
    "joint_elasticity",
    "rotor_inertia",
    "torque_ripple",
)
ACTUATOR = (
    "actuator_delay",
    "actuator_lag",
    "actuator_saturation",
    "actuator_gain_error",
    "actuator_bias",
    "actuator_dead_zone",
)
LINK = ("payload", "gravity_misalignment", "aerodynamic_drag", "external_disturbance", "unmodeled_contact")
CONTACT = (
    "contact_stribeck_friction",
    "contact_adhesion",
    "contact_nonlinear_stiffness",
    "contact_viscoelastic_relaxation",
    "contact_hunt_crossley_dissipation",
    "contact_rolling_resistance",
    "contact_anisotropic_friction",
    "contact_presliding",
    "surface_offset",
    "surface_tilt",
)
SENSOR = (
    "sensor_bias",
    "sensor_gain_error",
    "sensor_drift",
    "sensor_delay",
    "sensor_lag",
    "sensor_misalignment",
    "clock_skew",
)
SERVO = (
    "servo_gain_error",
    "servo_dead_band",
    "supply_sag",
    "command_delay",
    "command_lag",
    "command_rate_limit",
    "command_acceleration_limit",
    "actuator_speed_limit",
)
"""What only arms that are commanded by position show."""
VOCABULARY = JOINT + ACTUATOR + LINK + CONTACT + SENSOR
FAMILY = {
    **dict.fromkeys(JOINT, "joint"),
    **dict.fromkeys(ACTUATOR, "actuator"),
    **dict.fromkeys(LINK, "link"),
    **dict.fromkeys(CONTACT, "contact"),
    **dict.fromkeys(SENSOR, "sensor"),
    **dict.fromkeys(SERVO, "servo"),
}
ODD = (
    "odd_warming_viscosity",
    "odd_cross_coupling",
    "odd_bouc_wen_hysteresis",
    "odd_torque_oscillation",
    "odd_speed_dependent_gain",
    "odd_sloshing_mass",
    "odd_latching_brake",
    "odd_negative_damping",
    "odd_tip_magnet",
    "odd_patchy_friction",
    "odd_gusts",
)
