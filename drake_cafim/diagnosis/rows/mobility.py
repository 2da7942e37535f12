"""The mobility M⁻¹ along a recorded motion, which turns steps of effort into steps of acceleration."""

from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.dynamics.inverses import inverses
from drake_cafim.dynamics.motion import Motion, mass_matrix
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

CACHED = 6
"""Most cached mobilities of a recording."""

Rotors = tuple[float, ...]
"""The rotor inertia of each joint, rounded to two digits: far closer than a mass matrix is known."""


def rotors_of(physics: Physics) -> Rotors:
    """The joints' rotor inertias, kg m² or kg, with which `Mobility` is cached."""
    return tuple(float(f"{inertia:.2g}") for inertia in physics.rotor_inertias)


@dataclass(frozen=True)
class Mobility:
    """M⁻¹ (N, n, n) along the motion `moving` of N samples, by the rotor inertias of the physics.

    A rotor may be a thousand times the link that a model has in its place: with the model's own inertia, the steps of
    acceleration that correct the comparison of positions and velocities would be a thousand times too large.
    """

    moving: Motion
    _known: dict[Rotors, Array] = field(default_factory=dict, repr=False, compare=False)

    def of(self, physics: Physics) -> Array:
        """The mobility under the rotor inertias of `physics`; cached."""
        rotors = rotors_of(physics)
        if rotors not in self._known:
            make_room(self._known, CACHED)
            moving = replace(self.moving, tree=physics.tree)
            self._known[rotors] = inverses(mass_matrix(moving) + np.diag(rotors))
        return self._known[rotors]
