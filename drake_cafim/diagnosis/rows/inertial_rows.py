"""The inertial and gravity terms of one recording's rows along one motion, computed only as far as they are needed.

A sensor's delay moves the motion with each of its values, and most of these are asked for under one set of masses only:
momenta and forces are then computed for these masses, n numbers at each sample. Along the motion as measured, many sets
are asked for: there the regressor, n m 10 numbers at each sample, gives them by a matrix product.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.inertial_regressor import InertialRegressor, LinkRegressors
from drake_cafim.dynamics.motion import Motion, inertial_force, momentum
from drake_cafim.dynamics.tree import Tree
from drake_cafim.numerics.cache import make_room
from drake_cafim.typing import Array

CACHED = 4
"""Sets of masses and gravity whose rows are cached."""


@dataclass(frozen=True)
class InertialRows:
    """−∫ ẇ p dt − ∫ w (∂T/∂q + gravity) dt along the motion `smooth`; the arguments are those of `LinkRegressors`."""

    links: LinkRegressors
    smooth: Motion
    v: Array
    at_points: tuple[Array, Array]
    value: sp.csr_matrix
    by_regressor: bool
    """Whether the rows are the regressor's. Were it used as soon as it is there, what is left of a model would depend,
    by rounding, on what was asked before."""
    _alone: dict[tuple[bytes, bytes], Array] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def regressor(self) -> InertialRegressor:
        """The regressor of these terms, linear in the links' inertial parameters."""
        return self.links.regressor(self.smooth, self.v, self.at_points, self.value)

    def of(self, tree: Tree, gravity: Array) -> Array:
        """(M, n) the terms under the masses of `tree` and `gravity` (3,) m/s², without rotor inertias."""
        parameters = tree.inertial_parameters
        key = parameters.tobytes(), gravity.tobytes()
        if key not in self._alone:
            make_room(self._alone, CACHED)
            known = self.regressor.rows(parameters, gravity) if self.by_regressor else self._compute(tree, gravity)
            self._alone[key] = known
        return self._alone[key]

    def _compute(self, tree: Tree, gravity: Array) -> Array:
        # momenta are linear in the measured velocities, at smoothed positions
        momenta = self.links.windows.rate @ momentum(tree, self.smooth.q, self.v)
        return np.asarray(-momenta - self.value @ inertial_force(tree, *self.at_points, gravity))
