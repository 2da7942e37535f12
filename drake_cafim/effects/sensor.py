"""What a sensor makes of the truth at each moment: offset, scale, drift, a turned frame."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from drake_cafim.effects.effect import Effect, Place, Strength
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorEffect(Effect):
    """A distortion of one measured channel, or of all channels of a sensor; `at` is the name of either.

    Arrays are (N, c): samples by the sensor's channels, one for a single channel.
    """

    place: ClassVar[Place] = Place.CHANNEL
    family: ClassVar[str] = "sensor"

    @abstractmethod
    def measured(self, time: Array, true: Array) -> Array:
        """What the sensor writes when `true` happens at `time` (N,) s."""

    @abstractmethod
    def true(self, time: Array, measured: Array) -> Array:
        """The inverse of `measured`."""

    @abstractmethod
    def columns(self, time: Array, true: Array) -> Array:
        """∂measured/∂strengths at no effect, (N, c, k)."""

    def correction(self, time: Array) -> sp.csr_matrix | None:
        """(N, N) by which `true` scales or moves a channel's samples, and their noise; None where it does not."""
        return None

    def facing(self, time: Array) -> sp.csr_matrix | None:
        """(N, N) that stands in for `correction` where q and v only face each other; None where nothing does."""
        return None

    def writing(self, time: Array) -> sp.csr_matrix | None:
        """(N, N) by which `measured` mixes the samples of a channel; None where each is written at its own time."""
        return None

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        """Where among a recording's columns with noise the effect can be looked for: single channels.

        An effort's sensor is left out: what it does to an effort is what the actuator effects do.
        """
        yield from (column for column in columns if not column.startswith("u."))

    def channels(self, columns: Sequence[str]) -> tuple[str, ...]:
        """Which of `columns` the effect is on."""
        return tuple(column for column in columns if column == self.at or column.startswith(f"{self.at}."))


def whole_sensors(columns: Sequence[str]) -> tuple[str, ...]:
    """The sensors of several channels among a recording's columns."""
    names = (column.rsplit(".", 1)[0] for column in columns if column.startswith(("wrench.", "pose.")))
    return tuple(dict.fromkeys(names))


@dataclass(frozen=True)
class SensorBias(SensorEffect):
    """The truth + bias is written."""

    name: ClassVar[str] = "sensor_bias"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("bias", "unit of the channel", 0.1),)
    reference: ClassVar[str] = "ISO 5725-1:2023, bias"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "a position offset at the last joint changes the weight torque as a side load does",
        "gravity_misalignment": "a position offset at the first joint turns gravity against the arm",
        "actuator_bias": "an effort that is measured with an offset acts as one",
        "sensor_drift": "a slow drift over a short recording is an offset",
        "surface_offset": "a force offset during lasting contact looks like a raised surface",
    }

    def measured(self, time: Array, true: Array) -> Array:
        return true + self.values["bias"]

    def true(self, time: Array, measured: Array) -> Array:
        return measured - self.values["bias"]

    def columns(self, time: Array, true: Array) -> Array:
        return np.ones((*true.shape, 1))


@dataclass(frozen=True)
class SensorGainError(SensorEffect):
    """gain times the truth is written."""

    name: ClassVar[str] = "sensor_gain_error"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("gain", "1", 0.05, lower=0.5, upper=2.0, nominal=1.0),)
    reference: ClassVar[str] = "ISO 5725-1:2023; Hollerbach, Wampler, Int. J. Robotics Research 15(6), 1996"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_bias": "where the channel hardly changes, a share of it is an offset",
        "actuator_gain_error": "a motion that is read too large asks for too large efforts",
        "payload": "at a joint that inertia dominates, more motion and more mass look alike",
    }

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        # a pose that is read too large is so along all axes: its unit of length is wrong
        yield from (column for column in columns if not column.startswith(("u.", "pose.")))
        yield from (sensor for sensor in whole_sensors(columns) if sensor.startswith("pose."))

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
    """The truth + rate·t is written."""

    name: ClassVar[str] = "sensor_drift"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("rate", "unit of the channel/s", 0.01),)
    reference: ClassVar[str] = "IEEE Std 1554-2005, drift"
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
    """Rᵀ f is written for force and torque f of a wrench sensor, R = Rx(roll) Ry(pitch) Rz(yaw)."""

    name: ClassVar[str] = "sensor_misalignment"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("roll", "rad", 0.03, lower=-np.pi, upper=np.pi),
        Strength("pitch", "rad", 0.03, lower=-np.pi / 2, upper=np.pi / 2),
        Strength("yaw", "rad", 0.03, lower=-np.pi, upper=np.pi),
    )
    reference: ClassVar[str] = "Traversaro, Pucci, Nori, IEEE/RSJ IROS, 2015 (force-torque sensors in place)"
    alike: ClassVar[Mapping[str, str]] = {
        "surface_tilt": "a turned surface pushes from where a turned sensor thinks it does",
        "sensor_bias": "a steady force seen under an angle is an offset across it",
        "contact_anisotropic_friction": "both put force across the direction of sliding",
    }

    @classmethod
    def sites(cls, columns: Sequence[str]) -> Iterator[str]:
        yield from (sensor for sensor in whole_sensors(columns) if sensor.startswith("wrench."))

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
        # Rᵀ f = f − θ × f to first order
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
