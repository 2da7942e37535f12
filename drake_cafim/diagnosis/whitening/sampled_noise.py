"""The rows' covariance by the noise of the samples, propagated through their Jacobian."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from drake_cafim.diagnosis.noise.coloured import covariance
from drake_cafim.diagnosis.rows.filtered_windows import FilteredWindows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.noise_jacobian import (
    Block,
    NoiseJacobian,
    by_joint,
    effort_blocks,
    motion_blocks,
)
from drake_cafim.numerics.row_products import SymmetricBand
from drake_cafim.scenario.physics import Physics


@dataclass(frozen=True)
class KeptJacobian(Mapping[str, sp.csr_matrix | LinearOperator]):
    """The noise Jacobian of `weak` under `physics`; its `blocks` are computed again when they were forgotten."""

    weak: WeakForm
    physics: Physics
    names: tuple[str, ...]
    blocks: NoiseJacobian = field(repr=False, compare=False)

    def __getitem__(self, name: str) -> sp.csr_matrix | LinearOperator:
        if not self.blocks:
            self.blocks.update(sampled_noise(self.weak, self.physics)[2].blocks)
        return self.blocks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def forget(self) -> None:
        """Frees the blocks, which take hundreds of megabytes of a long recording."""
        self.blocks.clear()


def sampled_noise(
    weak: WeakForm, physics: Physics, keep: bool = True
) -> tuple[SymmetricBand, SymmetricBand, KeptJacobian]:
    """The covariances (R, R) by the noise of the samples under `physics`, and the noise Jacobian if that is to `keep`.

    The first is by the samples of motion and wrenches, the second by those of efforts, which are inputs.

    Of efforts that their maker filtered, a window covers all samples that the filter reaches, thousands of them: the
    noise of motion is propagated to narrow windows, of which the filtered ones are combinations.
    """
    windows = weak.samples.windows
    found: NoiseJacobian = {}

    def kept(blocks: Iterable[Block]) -> Iterator[Block]:
        for name, block in blocks:
            if keep:
                found[name] = block
            yield name, block

    if isinstance(windows, FilteredWindows):
        narrow = WeakForm(replace(weak.samples, windows=windows.narrow), weak.sensors)
        F = sp.csr_matrix(sp.kron(windows.of_narrow, sp.eye_array(weak.rows_per_window)))
        of_narrow = sampled_covariance(narrow, kept(motion_blocks(narrow, physics)))
        of_motion = SymmetricBand.of(F @ of_narrow.full() @ F.T)
        found = {name: aslinearoperator(F) @ aslinearoperator(block) for name, block in found.items()}
        of_efforts = sampled_covariance(weak, kept(effort_blocks(weak, physics)))
    else:
        of_motion = sampled_covariance(weak, kept(motion_blocks(weak, physics)))
        of_efforts = sampled_covariance(weak, kept(effort_blocks(weak, physics)))
        found = by_joint(physics, found)
    return of_motion, of_efforts, KeptJacobian(weak, physics, tuple(found), found)


def sampled_covariance(weak: WeakForm, jacobian: Iterable[Block]) -> SymmetricBand:
    """Σ std² J Σ Jᵀ (R, R) over the noise `jacobian` J (R, N) of each column and the correlation Σ of its samples.

    A column at a time: as one matrix, the Jacobian of a long recording takes gigabytes.
    """
    samples, rows = weak.samples, weak.rows_per_window * len(weak.samples.windows)
    alike = {memory: covariance(samples.time, memory) for memory in set(samples.memories.values())}
    total = SymmetricBand.zeros(rows)
    for name, block in jacobian:
        memory = samples.memories.get(name)
        correlated = block if memory is None else sp.csr_matrix(block @ alike[memory])
        total.add(samples.std[name] ** 2, correlated, block)
    return total
