"""Columns of the whitened rows by forces at one joint, of which hundreds are tried: their products, unwhitened.

Forces F at a joint j have the products (L⁻¹E_jF)ᵀ(L⁻¹E_jF) = FᵀK_jjF, see `force_information`, and
(L⁻¹E_jF)ᵀz = Fᵀ E_jᵀ L⁻ᵀz: only what they are multiplied with is whitened, once for all of them.
"""

from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.fit.columns import Columns, Nuisance, Products
from drake_cafim.diagnosis.joints.pulses import force_information
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.typing import Array


@dataclass(frozen=True)
class JointForceColumns(Columns):
    """Rows by forces at the joint with index `joint`: their integrals `forces` (ΣM, c) over the windows of all runs."""

    problem: WeakFormRows
    joint: int
    forces: Array
    known: list[Array] = field(default_factory=list, repr=False, compare=False)
    """Σ FᵀKF (c, c), once it was computed: it outlives these columns where the forces are tried again."""

    def whitened(self) -> Array:
        return self._whitened(self.forces)

    def times(self, coefficients: Array) -> Array:
        return self._whitened(self.forces @ coefficients[:, None])[:, 0]

    def _whitened(self, forces: Array) -> Array:
        """The whitened rows (R, c) by `forces` (ΣM, c)."""
        each = zip(self.problem.runs, _by_run(self.problem, forces), strict=True)
        return np.concatenate([run.whitened(_in_rows(run, self.joint, part)) for run, part in each])

    def products(self, nuisance: Nuisance) -> Products:
        here = nuisance.known(self.joint, lambda: self._at_joint(nuisance))
        beside = here.T @ self.forces
        if not self.known:
            parts = enumerate(_by_run(self.problem, self.forces))
            found = [
                part.T @ (force_information(self.problem, index).at_joint[self.joint] @ part) for index, part in parts
            ]
            self.known.append(np.sum(found, axis=0))
        return Products(self.known[0], beside[:-1], beside[-1])

    def _at_joint(self, nuisance: Nuisance) -> Array:
        """(ΣM, p + 1) E_jᵀ L⁻ᵀ of the nuisance's basis and its residual."""
        runs, found, start = self.problem.runs, [], 0
        backwards = nuisance.known("transposed", lambda: self._transposed(nuisance))
        for run in runs:
            own = backwards[start : start + run.rows].reshape(*run.shape, -1)
            found.append(own[:, run.weak.dynamic.start + self.joint])
            start += run.rows
        return np.concatenate(found)

    def _transposed(self, nuisance: Nuisance) -> Array:
        """(R, p + 1) L⁻ᵀ of the nuisance's basis and its residual."""
        rows = np.column_stack([nuisance.basis, nuisance.residual])[: self.problem.rows]
        ends = np.cumsum([run.rows for run in self.problem.runs])[:-1]
        each = zip(self.problem.runs, np.split(rows, ends), strict=True)
        return np.concatenate([run.whiten.transposed(part) for run, part in each])


def _by_run(problem: WeakFormRows, forces: Array) -> list[Array]:
    """The `forces` (ΣM, c) over the windows of each recording."""
    return np.split(forces, np.cumsum([run.shape[0] for run in problem.runs])[:-1])


def _in_rows(run: Run, joint: int, part: Array) -> Array:
    """(M, r, c) rows in which forces (M, c) over the windows stand at a joint."""
    rows = np.zeros((*run.shape, part.shape[1]))
    rows[:, run.weak.dynamic.start + joint] = part
    return rows
