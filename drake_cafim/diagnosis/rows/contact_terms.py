"""Contacts, forces on bodies and predicted readings of wrench sensors, evaluated along a motion of one recording."""

from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.rows.motion_terms import MotionTerms
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.motion import Motion, motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ContactTerms:
    """What contacts and forces on bodies exert at the samples, and what s wrench `sensors` then read."""

    samples: Samples
    sensors: tuple[WrenchSensor, ...]
    _smooth: list[tuple[MotionTerms, Motion]] = field(default_factory=list, repr=False, compare=False)

    def memory(self, physics: Physics, terms: MotionTerms) -> Array:
        """(N, m) states of the contacts at each sample, along the adaptively smoothed motion (`Samples.tracks`)."""
        if not any(contact.memory for contact in physics.contacts):
            return np.zeros((len(self.samples.time), 0))
        return physics.contact_memory(self.samples.time, self._smooth_motion(terms), terms.moving)

    def _smooth_motion(self, terms: MotionTerms) -> Motion:
        """The motion for contact states, from positions and velocities together; cached for the last measurement."""
        if self.samples.estimated is not None:
            return terms.moving
        if not self._smooth or self._smooth[0][0] is not terms:
            measured = terms.measured
            columns = [track.of(measured.q[:, j], measured.v[:, j]) for j, track in enumerate(self.samples.tracks)]
            smooth = motion(terms.moving.tree, np.stack(columns, axis=1), measured.v_hat)
            self._smooth[:] = [(terms, smooth)]
        return self._smooth[0][1]

    def forces_and_readings(self, physics: Physics, moving: Motion, memory: Array) -> Array:
        """Generalised forces of contacts and of forces on bodies, then undelayed sensor readings, (N, n + 6 s).

        `memory` (N, m) are the contact states.
        """
        wrench = physics.contact_wrenches(moving, memory) if physics.contacts else None
        force = np.zeros_like(moving.q) if wrench is None else moving.project(wrench)
        if physics.body_forces:
            wrenches = physics.body_wrenches(moving, self.samples.time, self.samples.recording.name)
            force = force + moving.project(wrenches)
        return np.concatenate([force, self.undelayed_readings(physics, moving, wrench)], axis=1)

    def undelayed_readings(self, physics: Physics, moving: Motion, wrench: Array | None) -> Array:
        """`readings` (N, 6 s) without the sensor effects that delay them."""
        prompt = replace(physics, sensors=tuple(effect for effect in physics.sensors if not effect.late))
        return self.readings(prompt, moving, wrench)

    def readings_along(self, physics: Physics, moving: Motion, memory: Array) -> Array:
        """`readings` (N, 6 s) along a motion on which the contact states are `memory` (N, m)."""
        return self.readings(physics, moving, physics.contact_wrenches(moving, memory) if physics.contacts else None)

    def readings(self, physics: Physics, moving: Motion, wrench: Array | None) -> Array:
        """Predicted readings (N, 6 s), sensor effects included, for the links' wrenches (N, n, 6); None: no contact."""
        predicted = [np.zeros((len(moving.q), 0))]
        for sensor in self.sensors:
            on = np.zeros((len(moving.q), 6)) if wrench is None else wrench[:, sensor.joint]
            predicted.append(self._with_sensor_effects(physics, sensor, sensor.reading(moving, on)))
        return np.concatenate(predicted, axis=1)

    def _with_sensor_effects(self, physics: Physics, sensor: WrenchSensor, reading: Array) -> Array:
        """The sensor's output (N, 6) for the exact `reading` (N, 6) under the sensor effects of `physics`.

        The prediction is changed, rather than the measurement corrected, so that the measured noise stays as it is.
        """
        names = [f"wrench.{sensor.name}.{axis}" for axis in WRENCH_COMPONENTS]
        for effect in physics.sensors:
            on = [names.index(name) for name in effect.channels(names)]
            if on:
                reading = reading.copy()
                reading[:, on] = effect.measured(self.samples.time, reading[:, on])
        return reading
