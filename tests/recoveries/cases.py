"""A scene for each effect of the vocabulary, and how it is moved and simulated."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

from .models import ARM, PRESS, ROLLER, SERVED, STAGE, scene_of
from .rig import Desired, recorded, waves

HIDDEN = {
    "joint_backlash",
    "joint_elasticity",
    "actuator_lag",
    "actuator_delay",
    "contact_presliding",
    "contact_viscoelastic_relaxation",
    "sensor_delay",
    "sensor_lag",
}
"""Effects whose state nobody measures."""
REMEMBERING = HIDDEN | {
    "clock_skew",
    "command_delay",
    "command_lag",
    "command_rate_limit",
    "command_acceleration_limit",
}
"""Effects that keep something in the Context."""


@dataclass(frozen=True)
class Case:
    """An effect in a scene, and how it is moved and simulated."""

    name: str
    at: str
    values: dict[str, Any]
    model: str = ARM
    centre: tuple[float, ...] = (0.0, 0.3, 0.5)
    size: tuple[float, ...] = (0.5, 0.4, 0.5)
    step: float = 1e-3  # s of the integrator
    rate: float = 20.0  # 1/s of the controller
    settling: float = 0.0  # s before the recording, in which what the effect remembers comes to be that of the motion
    horizon: float = 1.0  # s over which it is followed
    more: dict[str, Any] = field(default_factory=dict)

    @property
    def effect(self) -> Effect:
        """What `effects:` of the scene's file says."""
        values = dict(self.values)
        if not self.pushed:
            return effect_named(self.name)(self.at, values)
        recording, (start, stop) = values.pop("recording"), values.pop("interval")
        return ExternalDisturbance(self.at, {**values, "start": start, "stop": stop}, recording)

    def desired(self, seed: int) -> Desired:
        return waves(self.centre, self.size, seed)

    def scene(self, folder: Path, effect: bool) -> Scene:
        return scene_of(
            folder, self.model, *([{"effect": self.name, "at": self.at, **self.values}] * effect), **self.more
        )

    def training(self, true: Scene, bare: Scene) -> list[Recording]:
        """Two recordings of different motions; a push comes in the first only."""
        second = bare if self.pushed else true
        return [self._recording(scene, seed, seed, 2.5) for seed, scene in ((1, true), (2, second))]

    def held_out(self, true: Scene) -> Recording:
        """A recording that begins where the scene does, so that what the effect remembers is known.

        Of a push, which there is but once, it is the first motion with other noise, from just before the push on.
        """
        if self.pushed:
            return self._recording(true, 1, 3, 2.5).window(self.values["interval"][0] - 0.2, np.inf)
        return replace(self, settling=0.0)._recording(true, 3, 3, 1.1)

    @property
    def pushed(self) -> bool:
        return self.name == "external_disturbance"

    def _recording(self, scene: Scene, motion: int, noise: int, duration: float) -> Recording:
        """`duration` s once what the effect remembers has come to be that of the motion."""
        options = {"integrator_step": self.step, "rate": self.rate}
        found = recorded(scene, self.desired(motion), duration + self.settling, noise, **options)
        return found.window(self.settling, np.inf)


def joint(name: str, at: str, step: float = 1e-3, **values: float) -> Case:
    return Case(name, at, values, step=step)


def coupled(name: str, at: str, rate: float, **values: float) -> Case:
    return Case(name, at, values, step=2.5e-4, rate=rate, settling=0.3)


def press(name: str, at: str, step: float = 1e-3, **values: Any) -> Case:
    return Case(name, at, values, STAGE, (0.0, 0.0, 0.0192), (0.03, 0.03, 0.0015), step, 60.0, more=PRESS)


def served(name: str, at: str, step: float = 5e-4, **values: float) -> Case:
    """An effect of a position servo, or beside one: the motions are commands, and no effort is recorded."""
    return Case(name, at, values, step=step, size=(0.8, 0.6, 0.8), more=SERVED)


CASES = [
    joint("joint_viscous_friction", "turn", coefficient=0.5),
    joint("joint_coulomb_friction", "lift", 1e-4, torque=0.5),
    joint("joint_asymmetric_coulomb_friction", "elbow", 1e-4, torque_positive=0.3, torque_negative=0.15),
    joint("joint_stribeck_friction", "lift", 1e-4, coulomb=0.3, static=0.7, velocity=0.3),
    joint("joint_load_dependent_friction", "lift", 1e-4, torque=0.3, coefficient=0.06),
    joint("joint_spring", "turn", stiffness=3.0, rest=0.3),
    Case(
        "joint_backlash", "turn", {"gap": 0.01, "stiffness": 400.0, "damping": 4.0}, step=2.5e-4, rate=6.0, settling=0.3
    ),
    joint("joint_hard_stop", "turn", 5e-4, position=0.3, stiffness=60.0, damping=0.5, side=1.0),
    coupled("joint_elasticity", "elbow", 8.0, stiffness=300.0, damping=3.0),
    joint("rotor_inertia", "lift", inertia=0.05),
    joint("torque_ripple", "turn", amplitude=0.4, cycles=21.0, phase=0.7),
    joint("actuator_delay", "lift", delay=0.0063),
    joint("actuator_lag", "elbow", time_constant=0.008),
    joint("actuator_saturation", "lift", limit=8.0),
    joint("actuator_gain_error", "elbow", gain=0.9),
    joint("actuator_bias", "lift", torque=0.5),
    joint("actuator_dead_zone", "turn", width=0.3),
    served("servo_gain_error", "elbow", gain=0.8),
    served("servo_dead_band", "turn", width=0.01),
    served("supply_sag", "lift", sag=0.02),
    served("command_delay", "elbow", delay=0.0083),
    served("command_lag", "lift", time_constant=0.012),
    served("command_rate_limit", "turn", rate=1.2),
    served("command_acceleration_limit", "turn", acceleration=4.0),
    served("actuator_speed_limit", "turn", no_load_speed=3.0, stall_torque=6.0),
    joint("payload", "l3", mass=0.4, x=0.2, y=0.05, z=-0.05),
    # beside what the scenario says is uncertain about the link
    replace(
        joint(
            "inertial_error",
            "l3",
            mass=0.7,
            com_x=0.05,
            com_y=-0.06,
            com_z=0.04,
            ixx=0.05,
            iyy=0.08,
            izz=0.09,
            ixy=0.02,
            ixz=-0.03,
            iyz=0.02,
        ),
        more={"unknown": [{"parameter": "inertials", "body": "l3", "std": 0.1}]},
    ),
    joint("gravity_misalignment", "world", roll=0.05, pitch=-0.08),
    joint("aerodynamic_drag", "l3", coefficient=1.5),
    # where all three directions are felt: an arm of three joints has no joint that is turned by a push along its links
    replace(
        press("external_disturbance", "tool", x=1.5, y=-2.0, z=1.0, interval=[1.2, 1.5], recording="seed 1"),
        centre=(0.0, 0.0, 0.1),
        size=(0.03, 0.03, 0.03),
    ),
    joint("unmodeled_contact", "l3", 5e-4, offset=0.2, stiffness=500.0, damping=10.0, nx=0.0, ny=0.0, nz=1.0),
    press("contact_stribeck_friction", "tool/wall", static=0.7, velocity=0.03),
    press("contact_adhesion", "tool/wall", force=1.0, range=1e-3),
    press("contact_nonlinear_stiffness", "tool/wall", cubic=2e9),
    press("contact_viscoelastic_relaxation", "tool/wall", stiffness=1500.0, time_constant=0.03),
    press("contact_hunt_crossley_dissipation", "tool/wall", dissipation=5.0),
    replace(
        press("contact_rolling_resistance", "tool/wall", coefficient=0.002),
        model=ROLLER,
        centre=(0.0, 0.0192, 0.0),
        size=(0.03, 0.0015, 0.5),
    ),
    press("contact_anisotropic_friction", "tool/wall", friction_1=0.55, friction_2=0.3, angle=0.6),
    press("contact_law", "tool/wall", modulus=6e5, dissipation=3.0),
    press("contact_presliding", "tool/wall", 2.5e-4, distance=4e-4),
    press("surface_offset", "wall", offset=0.0004),
    press("surface_tilt", "wall", y_slope_x=0.01, y_slope_y=-0.015),
    joint("sensor_bias", "q.lift", bias=0.02),
    joint("sensor_gain_error", "v.lift", gain=1.05),
    joint("sensor_drift", "q.lift", rate=0.01),
    joint("sensor_delay", "v.elbow", delay=0.0053),
    joint("sensor_lag", "q.lift", time_constant=0.007),
    press("sensor_misalignment", "wrench.wrist", roll=0.05, pitch=-0.04, yaw=0.06),
    joint("clock_skew", "q.lift", skew=-0.004),
]
