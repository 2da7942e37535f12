"""The rows' terms of couplings: rotors behind elasticity or backlash, whose motion is simulated and not measured."""

from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.rows.motion_terms import MotionTermsCache
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.scenario.physics import FreeResponse, Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class CouplingRows:
    """The twist ψ between rotor and link at each joint of one recording, and its terms in the dynamic rows."""

    terms: MotionTermsCache
    _trials: dict[tuple[object, ...], Array] = field(default_factory=dict, repr=False, compare=False)
    _drives: dict[tuple[object, ...], tuple[RotorDrive, ...]] = field(default_factory=dict, repr=False, compare=False)
    _responses: dict[tuple[object, ...], FreeResponse] = field(default_factory=dict, repr=False, compare=False)

    def rotor_drives(self, physics: Physics) -> tuple[RotorDrive, ...]:
        """The excitation of each joint's twist between rotor and link.

        Cached for the last physics, whatever its couplings are, since the excitation does not depend on them.
        """
        effects = (*physics.joint_forces, *physics.actuators, *physics.sensors, *physics.body_forces)
        inertial = (
            physics.tree.inertial_parameters.tobytes(),
            physics.gravity.tobytes(),
            physics.rotor_inertias.tobytes(),
            *((effect.key, *effect.values.values()) for effect in physics.sensors),
        )
        key = (
            *inertial,
            physics.dampings.tobytes(),
            *((effect.key, *effect.values.values()) for effect in effects),
            *((contact.name, str(contact)) for contact in physics.contacts),
        )
        if key not in self._drives:
            self._drives.clear()
            terms, time = self.terms.of(physics), self.terms.samples.time
            if inertial not in self._responses:
                self._responses.clear()
                # the inertial parameters may differ from those that the motion was computed with
                self._responses[inertial] = physics.free_response(replace(terms.moving, tree=physics.tree))
            self._drives[key] = physics.rotor_drives(
                time, self._responses[inertial], terms.driven.mean_effort(physics), terms.joints
            )
        return self._drives[key]

    def rows(self, physics: Physics, coupling: JointCoupling) -> Array:
        """(M,) the term of a coupling in its joint's dynamic row: −∫ ẇ J ψ̇ dt, rotor inertia J, twist ψ."""
        drive = self.rotor_drives(physics)[physics.tree.joint_index(coupling.at)]
        rate = self.terms.samples.windows.rate
        return np.asarray(-drive.inertia * (rate @ coupling.twist_rate(drive)), dtype=float)

    def trial_rows(self, physics: Physics, trial: JointCoupling) -> Array:
        """`rows` (M,) of a value for screening, computed under the first physics and reused for later ones.

        A rotor's motion takes long to simulate, and screening need not be exact.
        """
        key = (*trial.key, *trial.values.values())
        if key not in self._trials:
            self._trials[key] = self.rows(physics, trial)
        return self._trials[key]
