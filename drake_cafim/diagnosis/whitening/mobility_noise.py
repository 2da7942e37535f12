"""The kinematic rows' noise where the mass matrix is not known well enough.

Between samples, positions and velocities are compared with a correction for the steps of acceleration M⁻¹ Δu. A
relative error ρ of M⁻¹ leaves ρ times the correction in the row. Where that is far below the noise it does not matter;
where a model's inertia is far too small, the row would show the error by thousands of standard deviations, although it
is of sensors, not of inertia, that these rows speak. With it as noise no row shows more than 1/ρ.
"""

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics


def mobility_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) diagonal: the variance of the kinematic rows by a relative error `MASS_MATRIX_STD` of M⁻¹."""
    windows, r = len(weak.samples.windows), weak.rows_per_window
    variance = np.zeros((windows, r))
    if weak.kinematic_rows:
        terms = weak.terms(physics)
        variance[:, : weak.kinematic_rows] = (terms.driven.doubted_steps(physics) * terms.louder) ** 2
    return sp.csr_matrix(sp.diags_array(variance.ravel()))
