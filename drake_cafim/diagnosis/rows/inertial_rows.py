"""The inertial and gravity terms of one recording's rows along one motion, computed only as far as they are needed.

A sensor's delay moves the motion with each of its values, and most of these are asked for under one set of masses only.
Momenta and forces are then computed for these masses, n numbers at each sample. Once several sets are asked for along
the same motion, the regressor is built, n m 10 numbers at each sample, and gives all others by a matrix product.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.inertial_regressor import InertialRegressor, LinkRegressors
from drake_cafim.dynamics.motion import Motion, inertial_force, momentum
from drake_cafim.dynamics.tree import Tree
from drake_cafim.typing import Array

COMPUTED_ALONE = 3
"""Largest number of sets of masses and gravity whose rows are computed without the regressor, which costs as much."""


@dataclass(frozen=True)
class InertialRows:
    """−∫ ẇ p dt − ∫ w (∂T/∂q + gravity) dt along the motion `smooth`; the arguments are those of `LinkRegressors`."""

    links: LinkRegressors
    smooth: Motion
    v: Array
    at_points: tuple[Array, Array]
    value: sp.csr_matrix
    _alone: dict[tuple[bytes, bytes], Array] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def regressor(self) -> InertialRegressor:
        """The regressor of these terms, linear in the links' inertial parameters."""
        return self.links.regressor(self.smooth, self.v, self.at_points, self.value)

    def of(self, tree: Tree, gravity: Array) -> Array:
        """(M, n) the terms under the masses of `tree` and `gravity` (3,) m/s², without rotor inertias."""
        parameters = tree.inertial_parameters
        key = parameters.tobytes(), gravity.tobytes()
        if key in self._alone:
            return self._alone[key]
        if "regressor" in self.__dict__ or len(self._alone) == COMPUTED_ALONE:
            return self.regressor.rows(parameters, gravity)
        self._alone[key] = self._compute(tree, gravity)
        return self._alone[key]

    def _compute(self, tree: Tree, gravity: Array) -> Array:
        # momenta are linear in the measured velocities, at smoothed positions
        momenta = self.links.windows.rate @ momentum(tree, self.smooth.q, self.v)
        return np.asarray(-momenta - self.value @ inertial_force(tree, *self.at_points, gravity))
