"""The data of a report's pictures of recordings of joints."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Channel, Evidence, Pictures, Remains, ResidualMap
from drake_cafim.diagnosis.joints.location import places_of, standardised
from drake_cafim.diagnosis.joints.missing_forces import channels, missing_force, missing_force_std, window_means
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.noise.filters import without_filtered_velocities
from drake_cafim.diagnosis.predict.forecast import Forecast, forecast
from drake_cafim.diagnosis.rows.samples import samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.effect import Effect
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics


@dataclass(frozen=True)
class JointPictures(Pictures):
    """The data of the pictures of `problem`'s recordings."""

    problem: WeakFormRows

    row_note: ClassVar[str] = (
        "“Forces” is the equation of motion of a joint: what drives it, less what its motion shows."
    )
    simulation_note: ClassVar[str] = ", driven by the recorded efforts or commands alone"

    @property
    def recordings(self) -> list[Recording]:
        return [form.samples.recording for form in self.problem.forms]

    @property
    def row_labels(self) -> list[str]:
        return [channel.label for channel in self._channels]

    @property
    def _channels(self) -> list[Channel]:
        return channels(self.problem)

    def maps(self, before: Model, after: Model) -> list[ResidualMap]:
        without, with_it = before.physics(self.problem.scene), after.physics(self.problem.scene)
        return [
            ResidualMap(
                run.name,
                run.weak.samples.windows.centers,
                run.weak.samples.windows.width,
                standardised(run, run.noisy_rows(without)),
                standardised(run, run.noisy_rows(with_it)),
            )
            for run in self.problem.runs
        ]

    def forecast(self, recording: Recording, physics: Physics) -> Forecast:
        return forecast(self.laid_out(recording), physics)

    def evidence(self, effect: Effect, without: Physics, with_it: Physics) -> Evidence:
        forms = self.problem.forms
        return Evidence(
            effect,
            self.problem.scene.tree,
            self._channels,
            forms[0].dynamic.start,
            forms[0].samples.windows.width,
            [window_means(form, with_it) for form in forms],
            [missing_force(form, without) for form in forms],
            [missing_force(form, with_it) for form in forms],
            [missing_force_std(run) for run in self.problem.runs],
        )

    def remains(self, physics: Physics, place: str) -> Remains | None:
        names = [name for _, name in places_of(self.problem)]
        if place not in names:
            return None
        row, forms = names.index(place), self.problem.forms
        j = self._joint_of(row)
        joint = self.problem.scene.tree.joints[j]
        means = [window_means(form, physics) for form in forms]
        values = np.concatenate([missing_force(form, physics)[:, row] for form in forms])
        unit = joint.position_unit
        against = [
            (f"position of {joint.name} ({unit})", np.concatenate([mean.q[:, j] for mean in means])),
            (f"velocity ({unit}/s)", np.concatenate([mean.v[:, j] for mean in means])),
            (f"effort ({joint.effort_unit})", np.concatenate([mean.u[:, j] for mean in means])),
            ("time (s)", np.concatenate([mean.time - mean.time[0] for mean in means])),
        ]
        return Remains(self._channels[row], values, against)

    def _joint_of(self, row: int) -> int:
        """The joint whose motion a row is plotted against: its own, or the one that moves the sensor."""
        weak = self.problem.forms[0]
        if row < weak.kinematic_rows:
            return row
        if row < weak.dynamic.stop:
            return int(row - weak.dynamic.start)
        sensor = (row - weak.dynamic.stop) // 6
        carrier = weak.sensors[sensor].joint if sensor < len(weak.sensors) else weak.joints - 1
        return self.problem.scene.tree.leader(max(int(carrier), 0))

    def laid_out(self, recording: Recording) -> WeakForm:
        for form in self.problem.forms:
            if form.samples.recording is recording:
                return form
        scene = self.problem.scene
        (own,), _ = without_filtered_velocities(scene, [recording])
        return WeakForm(samples_of(scene, own, self.problem.forms[0].samples.std), scene.wrench_sensors)
