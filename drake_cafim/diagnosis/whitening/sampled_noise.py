"""The rows' covariance by the noise of the samples, propagated through their Jacobian."""

from dataclasses import replace

import scipy.sparse as sp
from scipy.sparse.linalg import aslinearoperator

from drake_cafim.diagnosis.noise.coloured import covariance
from drake_cafim.diagnosis.rows.filtered_windows import FilteredWindows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.noise_jacobian import (
    NoiseJacobian,
    effort_jacobian,
    motion_jacobian,
    noise_jacobian,
)
from drake_cafim.scenario.physics import Physics


def sampled_noise(weak: WeakForm, physics: Physics) -> tuple[sp.csr_matrix, sp.csr_matrix, NoiseJacobian]:
    """The covariances (R, R) by the noise of the samples under `physics`, and the noise Jacobian.

    The first is by the samples of motion and wrenches, the second by those of efforts, which are inputs.

    Of efforts that their maker filtered, a window covers all samples that the filter reaches, thousands of them: the
    noise of motion is propagated to narrow windows, of which the filtered ones are combinations.
    """
    windows = weak.samples.windows
    if not isinstance(windows, FilteredWindows):
        jacobian = noise_jacobian(weak, physics)
        efforts = {name: block for name, block in jacobian.items() if name.startswith("u.")}
        motion = {name: block for name, block in jacobian.items() if name not in efforts}
        return _covariance(weak, motion), _covariance(weak, efforts), jacobian
    narrow = WeakForm(replace(weak.samples, windows=windows.narrow), weak.sensors)
    motion, efforts = motion_jacobian(narrow, physics), effort_jacobian(weak, physics)
    F = sp.csr_matrix(sp.kron(windows.of_narrow, sp.eye_array(weak.rows_per_window)))
    of_motion = sp.csr_matrix(F @ _covariance(narrow, motion) @ F.T)
    combined = {name: aslinearoperator(F) @ aslinearoperator(block) for name, block in motion.items()}
    return of_motion, _covariance(weak, efforts), combined | efforts


def _covariance(weak: WeakForm, jacobian: NoiseJacobian) -> sp.csr_matrix:
    """Σ std² J Σ Jᵀ (R, R) over the noise `jacobian` J (R, N) of each column and the correlation Σ of its samples.

    A column at a time: as one matrix, the Jacobian of a long recording takes gigabytes.
    """
    samples, rows = weak.samples, weak.rows_per_window * len(weak.samples.windows)
    alike = {memory: covariance(samples.time, memory) for memory in set(samples.memories.values())}
    total = sp.csr_matrix((rows, rows))
    for name, block in jacobian.items():
        memory = samples.memories.get(name)
        correlated = block if memory is None else sp.csr_matrix(block @ alike[memory])
        total = total + samples.std[name] ** 2 * (correlated @ block.T)
    return sp.csr_matrix(total)
