"""What a sensor makes of the truth."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.effects.effect import Effect, Place, Strength
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorEffect(Effect):
    """A distortion of one measured channel, `at` its column's name."""

    place: ClassVar[Place] = Place.CHANNEL
    family: ClassVar[str] = "sensor"

    @abstractmethod
    def measured(self, time: Array, true: Array) -> Array:
        """What the sensor writes, (N,), when `true` (N,) happens at `time` (N,) s."""

    @abstractmethod
    def true(self, time: Array, measured: Array) -> Array:
        """The inverse of `measured`."""

    @abstractmethod
    def columns(self, time: Array, true: Array) -> Array:
        """∂measured/∂strengths at no effect, (N, k)."""


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
        "surface_offset": "a force offset during lasting contact looks like a raised surface",
    }

    def measured(self, time: Array, true: Array) -> Array:
        return true + self.values["bias"]

    def true(self, time: Array, measured: Array) -> Array:
        return measured - self.values["bias"]

    def columns(self, time: Array, true: Array) -> Array:
        return np.ones((len(time), 1))
