"""Derivatives of whitened rows by a scene's unknowns: of links, joints' friction, sensors and servos analytic.

Others are by differences.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.differences import Differences
from drake_cafim.diagnosis.joints.inertial_columns import InertialColumns
from drake_cafim.diagnosis.joints.sensor_columns import SensorColumns
from drake_cafim.diagnosis.joints.servo_columns import ServoColumns
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.whitening.joint_forces import Forces, WhitenedForces
from drake_cafim.diagnosis.whitening.whitened_run import without_start
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.unknown import inertials
from drake_cafim.typing import Array


@dataclass(frozen=True)
class UnknownColumns:
    """The columns of a Jacobian by unknowns, from `differences` and, of inertials, `sensors` and `servos`, analytic.

    `prior_std` gives the (n,) standard deviations of the priors under a model; `whitened_forces` keeps the rows of
    forces at joints.
    """

    differences: Differences
    prior_std: Callable[[Model], Array]
    sensors: SensorColumns
    servos: ServoColumns
    whitened_forces: WhitenedForces

    def of(self, model: Model) -> list[Array]:
        """Whitened rows and prior rows (R + n, 1) by each unknown, or (R + n, 10) by a link's inertials, in order."""
        scene, n = self.differences.scene, len(model.unknown)
        links = {own.start: (link, own) for link, own in inertials(scene.unknown).items()}
        physics = model.physics(scene) if links else scene.physics
        if physics.couplings:
            # what a rotor behind an elastic gear does to the rows is not linear in the link's inertia
            links = {}
        columns, i = [], 0
        while i < n:
            if i not in links:
                columns.append(self._of_one(model, i)[:, None])
                i += 1
                continue
            link, own = links[i]
            rows = self.inertials.of(physics, scene.bare or scene.physics, link, model.unknown[own])
            rows = without_start(self.differences.runs, physics, rows)
            columns.append(np.concatenate([rows, np.diag(1.0 / self.prior_std(model))[:, own]]))
            i = own.stop
        return columns

    def _of_one(self, model: Model, i: int) -> Array:
        """(R + n,) derivative by an unknown that is no link's."""
        if self.differences.scene.unknown[i].left_out:
            return np.concatenate([np.zeros(self._rows), np.diag(1.0 / self.prior_std(model))[i]])
        started = has_unknown_start(model.physics(self.differences.scene))
        rows = None if started else self.sensors.by_unknown(i)
        if rows is None and not started:
            rows = self.servos.by_unknown(model, i)
            rows = self._by_friction(model, i) if rows is None else rows
        if rows is None:
            return self.differences.by_unknown(model, i)
        prior = np.zeros(len(model.unknown))
        prior[i] = 1.0 / self.prior_std(model)[i]
        return np.concatenate([rows, prior])

    def _by_friction(self, model: Model, i: int) -> Array | None:
        """(R,) derivative by the damping of a joint or by the dry friction that the model's files state; else None."""
        unknown, physics = self.differences.scene.unknown[i], model.physics(self.differences.scene)
        if unknown.kind != "joint" or physics.couplings:
            # what a rotor behind an elastic gear does to the rows depends on the damping
            return None
        if unknown.parameter == "damping":
            forces = self._forces_of_damping(physics, unknown.at)
        elif unknown.is_stated_friction:
            forces = self._forces_of_dry_friction(physics, unknown.at)
        else:
            return None
        return self.whitened_forces.of(self.differences.runs, [forces])[0][:, 0]

    def _forces_of_damping(self, physics: Physics, at: str) -> Forces:
        """∂/∂d of the rows −∫ w (−d v) dt, divided by the gain of the joint's effort."""
        joint = physics.tree.joint_index(at)
        gain = physics.effort_gains[joint]
        each = [run.weak.terms(physics).acting.velocity[:, joint] for run in self.differences.runs]
        return joint, [velocity[:, None] / gain for velocity in each]

    def _forces_of_dry_friction(self, physics: Physics, at: str) -> Forces:
        """∂/∂T of the rows −∫ w T s(v) dt, T the sum of what the files state at a joint, s Coulomb's law of 1 N m."""
        joint, law = physics.tree.joint_index(at), JointCoulombFriction(at, {"torque": 1.0})
        gain = physics.effort_gains[joint]
        each = [run.weak.terms(physics).acting.at_joint(law, joint) for run in self.differences.runs]
        return joint, [-force[:, None] / gain for force in each]

    @property
    def _rows(self) -> int:
        return sum(int(np.prod(run.shape)) for run in self.differences.runs)

    @cached_property
    def inertials(self) -> InertialColumns:
        """The columns of links' inertias."""
        return InertialColumns(self.differences.runs)
