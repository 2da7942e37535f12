"""Sensor effects that act on each sample by itself: bias, gain error, drift, misalignment."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from drake_cafim.effects.effect import Effect, P, Place, Strength
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorEffect(Effect):
    """A distortion of one measured channel, or of all channels of a sensor; `at` names the channel or the sensor.

    Arrays are (N, c): samples by the sensor's channels, c = 1 for a single channel.
    """

    place: ClassVar[Place] = Place.CHANNEL
    family: ClassVar[str] = "sensor"
    kind: ClassVar[str] = "sensor"
    shifts: ClassVar[bool] = False
    """Whether it records at t the value of another time, `shown(t)`."""
    needs_signal: ClassVar[bool] = False
    """Whether it would reduce the misfit by scaling noise down, where the channel holds little signal."""

    def add_to(self, physics: P) -> P:
        return physics.with_part("sensors", self)

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        if where.thrown is None or cls.in_throws:
            yield from cls.sites(where.columns)

    @property
    def scale(self) -> float:
        """∂measured/∂true of a channel."""
        return 1.0

    def shown(self, time: Array) -> Array:
        """The times s whose values are recorded at `time` s."""
        return time

    def read(self, time: Array) -> Array:
        """The times s at which the values of `time` s are recorded."""
        return time

    @abstractmethod
    def measured(self, time: Array, true: Array) -> Array:
        """The recorded values (N, c) for true values `true` (N, c) at `time` (N,) s."""

    @abstractmethod
    def true(self, time: Array, measured: Array) -> Array:
        """The true values (N, c) from recorded values `measured` (N, c): the inverse of `measured`."""

    @abstractmethod
    def columns(self, time: Array, true: Array) -> Array:
        """∂measured/∂strengths (N, c, k) at zero effect."""

    def correction(self, time: Array) -> sp.csr_matrix | None:
        """Matrix (N, N) with which `true` multiplies a channel's samples, and their noise; None for the identity."""
        return None

    def kinematic_correction(self, time: Array) -> sp.csr_matrix | None:
        """Matrix (N, N) that replaces `correction` in the kinematic rows, which compare q with v; None to use that."""
        return None

    def filter_matrix(self, time: Array) -> sp.csr_matrix | None:
        """Matrix (N, N) with which `measured` filters a channel's samples; None where samples do not mix."""
        return None

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        """The places among a recording's columns with noise where it is a hypothesis: single channels.

        Effort channels are left out: a sensor effect on an effort cannot be told from an actuator effect.
        """
        yield from (column for column in columns if not column.startswith("u."))

    def channels(self, columns: Sequence[str]) -> tuple[str, ...]:
        """Those of `columns` that the effect distorts."""
        return tuple(column for column in columns if column == self.at or column.startswith(f"{self.at}."))


def whole_sensors(columns: Sequence[str]) -> tuple[str, ...]:
    """The names of wrench and pose sensors, each of several channels, among a recording's columns."""
    names = (column.rsplit(".", 1)[0] for column in columns if column.startswith(("wrench.", "pose.")))
    return tuple(dict.fromkeys(names))


@dataclass(frozen=True)
class SensorBias(SensorEffect):
    """measured = true + bias."""

    name: ClassVar[str] = "sensor_bias"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("bias", "unit of the channel", 0.1),)
    reference: ClassVar[str] = "ISO 5725-1:2023, bias"
    formula: ClassVar[str] = "reads the truth + <i>b</i>"
    words: ClassVar[str] = "adds a constant to what is read"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "a position offset at the last joint changes the weight torque as a side load does",
        "gravity_misalignment": "a position offset at the first joint turns gravity against the arm",
        "actuator_bias": "an effort that is measured with an offset acts as one",
        "sensor_drift": "a slow drift over a short recording is an offset",
        "surface_offset": "a force offset during lasting contact looks like a raised surface",
    }

    def plausible(self) -> bool:
        """Whether a position is off by no more than half a turn: a reading that is off by a whole one is right."""
        turns = self.at.startswith("q.") and abs(self.values["bias"]) > np.pi
        return super().plausible() and not turns

    def measured(self, time: Array, true: Array) -> Array:
        return true + self.values["bias"]

    def true(self, time: Array, measured: Array) -> Array:
        return measured - self.values["bias"]

    def columns(self, time: Array, true: Array) -> Array:
        return np.ones((*true.shape, 1))


@dataclass(frozen=True)
class SensorGainError(SensorEffect):
    """measured = gain × true."""

    name: ClassVar[str] = "sensor_gain_error"
    needs_signal: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("gain", "1", 0.05, lower=0.5, upper=2.0, nominal=1.0),)
    reference: ClassVar[str] = "ISO 5725-1:2023; Hollerbach, Wampler, Int. J. Robotics Research 15(6), 1996"
    formula: ClassVar[str] = "reads <i>g</i> × the truth"
    words: ClassVar[str] = "scales what is read"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_bias": "where the channel hardly changes, a share of it is an offset",
        "actuator_gain_error": "a motion that is read too large asks for too large efforts",
        "payload": "at a joint that inertia dominates, more motion and more mass look alike",
    }

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        # a pose's gain is common to all its axes: it means a wrong unit of length
        yield from (column for column in columns if not column.startswith(("u.", "pose.")))
        yield from (sensor for sensor in whole_sensors(columns) if sensor.startswith("pose."))

    @property
    def scale(self) -> float:
        return self.values["gain"]

    def measured(self, time: Array, true: Array) -> Array:
        return self.values["gain"] * true

    def true(self, time: Array, measured: Array) -> Array:
        return measured / self.values["gain"]

    def correction(self, time: Array) -> sp.csr_matrix:
        return sp.csr_matrix(sp.eye_array(len(time)) / self.values["gain"])

    def columns(self, time: Array, true: Array) -> Array:
        return true[..., None]


@dataclass(frozen=True)
class SensorDrift(SensorEffect):
    """measured = true + rate·t."""

    name: ClassVar[str] = "sensor_drift"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("rate", "unit of the channel/s", 0.01),)
    reference: ClassVar[str] = "IEEE Std 1554-2005, drift"
    formula: ClassVar[str] = "reads the truth + <i>r</i> <i>t</i>"
    words: ClassVar[str] = "moves away from the truth steadily"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_bias": "a slow drift over a short recording is an offset",
        "clock_skew": "in a steady motion a growing delay is a drift",
    }

    def measured(self, time: Array, true: Array) -> Array:
        return true + self.values["rate"] * time[:, None]

    def true(self, time: Array, measured: Array) -> Array:
        return measured - self.values["rate"] * time[:, None]

    def columns(self, time: Array, true: Array) -> Array:
        return np.broadcast_to(time[:, None, None], (*true.shape, 1)).copy()


@dataclass(frozen=True)
class SensorMisalignment(SensorEffect):
    """measured = Rᵀ f for force and for torque f of a wrench sensor, R = Rx(roll) Ry(pitch) Rz(yaw)."""

    name: ClassVar[str] = "sensor_misalignment"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("roll", "rad", 0.03, lower=-np.pi, upper=np.pi),
        Strength("pitch", "rad", 0.03, lower=-np.pi / 2, upper=np.pi / 2),
        Strength("yaw", "rad", 0.03, lower=-np.pi, upper=np.pi),
    )
    reference: ClassVar[str] = "Traversaro, Pucci, Nori, IEEE/RSJ IROS, 2015 (force-torque sensors in place)"
    formula: ClassVar[str] = "reads R<sup>T</sup> <i>f</i>"
    words: ClassVar[str] = "is mounted askew"
    alike: ClassVar[Mapping[str, str]] = {
        "surface_tilt": "a turned surface pushes from where a turned sensor thinks it does",
        "sensor_bias": "a steady force seen under an angle is an offset across it",
        "contact_anisotropic_friction": "both put force across the direction of sliding",
    }

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        yield from (sensor for sensor in whole_sensors(columns) if sensor.startswith("wrench."))

    def contradiction(self) -> str:
        whole = self.at.startswith("wrench.") and self.at.rsplit(".", 1)[1] not in WRENCH_COMPONENTS
        return "" if whole else f"at is {self.at}, expected a whole wrench sensor, as wrench.wrist"

    @property
    def rotation(self) -> Array:
        """R (3, 3)."""
        roll, pitch, yaw = self.vector
        return _about(0, roll) @ _about(1, pitch) @ _about(2, yaw)

    def measured(self, time: Array, true: Array) -> Array:
        return np.concatenate([true[:, :3] @ self.rotation, true[:, 3:] @ self.rotation], axis=1)

    def true(self, time: Array, measured: Array) -> Array:
        return np.concatenate([measured[:, :3] @ self.rotation.T, measured[:, 3:] @ self.rotation.T], axis=1)

    def columns(self, time: Array, true: Array) -> Array:
        # to first order in the angles θ, Rᵀ f = f − θ × f
        turned = [
            np.concatenate([-np.cross(axis, true[:, :3]), -np.cross(axis, true[:, 3:])], axis=1) for axis in np.eye(3)
        ]
        return np.stack(turned, axis=2)


def _about(axis: int, angle: float) -> Array:
    """The rotation by `angle` rad about a coordinate axis."""
    result = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result[i, i] = result[j, j] = np.cos(angle)
    result[i, j], result[j, i] = -np.sin(angle), np.sin(angle)
    return result
