"""What the whitened rows tell of forces at the joints, whatever their course over the windows.

A force at joint j enters one row of each window. With E_j those columns of the identity and C = L Lᵀ the covariance of
the rows, forces F at joint j and G at joint k have the products (L⁻¹E_jF)ᵀ(L⁻¹E_kG) = FᵀK_jkG, K_jk = E_jᵀC⁻¹E_k.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.whitening.covariance import Whitening
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.typing import Array, Indices

PART, REACH, FAINT = 32, 8, 1e-6
"""Windows whose forces are whitened at once, how many windows later they may still be felt in whitened rows, and the
share of the squared rows in the last quarter of these up to which they are not felt beyond; while it is larger, twice
as many later windows are taken."""
FAINT_IN_PRODUCTS = 1e-14
"""The same share of what is left out of K, where forces of one sign may add up."""

DENSE_SHARE = 0.1
"""Share of the entries of K from which on it is stored whole: products are then ten times as fast an entry."""


@dataclass(frozen=True)
class ForceInformation:
    """K of a recording with M windows: `at_joint` the (M, M) K_jj, and all of it for windows that are near each other.

    `near` (D, M, n, n) has the products of forces over window i, at its first joint, and over window i + d, at its
    second one, in [d, i].
    """

    at_joint: tuple[sp.csr_matrix | Array, ...]
    near: Array

    def of_pulse(self, first: int, weights: Array) -> Array:
        """(n, n) products of forces at the joints that act with the same `weights` (m,), m ≤ D, from a window on."""
        found = np.zeros(self.near.shape[2:])
        for d in range(len(weights)):
            both = weights[: len(weights) - d] * weights[d:]
            block = np.tensordot(both, self.near[d, first : first + len(both)], 1)
            found += block if d == 0 else block + block.T
        return found

    @classmethod
    def of(cls, run: Run, apart: int) -> "ForceInformation":
        """That of a recording; `near` for windows less than `apart` from each other."""
        (M, r), n = run.shape, run.weak.joints
        places = [r * np.arange(M) + run.weak.dynamic.start + j for j in range(n)]
        units = [sp.csr_matrix((np.ones(M), (place, np.arange(M))), shape=(run.rows, M)) for place in places]
        near = np.zeros((apart, M, n, n))
        entries: list[list[tuple[Indices, Indices, Array]]] = [[] for _ in range(n)]
        before: list[tuple[int, int, Array]] = []
        first = 0
        for felt in zip(*(whitened_parts(run.whiten, unit, FAINT_IN_PRODUCTS) for unit in units), strict=True):
            start = felt[0][0].start
            before = [entry for entry in before if entry[1] + entry[2].shape[1] > start]
            before.append((first, start, _stacked(felt)))
            for earlier, begin, other in before:
                _add_products(near, entries, (earlier, other[:, start - begin :]), (first, before[-1][2]))
            first += before[-1][2].shape[2]
        return cls(tuple(_matrix(own, M) for own in entries), near)


def whitened_parts(whiten: Whitening, factor: sp.csr_matrix, faint: float = FAINT) -> Iterator[tuple[slice, Array]]:
    """Rows, and there L⁻¹ F of a `factor` F (R, M), by parts of its columns: a force is not felt long after it acted.

    Whole, it would take memory and time in proportion to the square of a recording's length.
    """
    count, windows = factor.shape
    each = count // windows
    for first in range(0, windows, PART):
        reach, felt = REACH, True
        while felt:
            rows = slice(first * each, min((first + PART + reach) * each, count))
            seen = whiten.factor.block(rows.start, rows.stop).solve(factor[rows, first : first + PART].toarray())
            late = float(np.sum(seen[-(reach // 4) * each :] ** 2))
            felt = rows.stop < count and late > faint * float(np.sum(seen**2))
            reach *= 2
        yield rows, seen


def _stacked(felt: tuple[tuple[slice, Array], ...]) -> Array:
    """(n, F, k) what is felt of k windows' forces at each joint in the same F rows."""
    longest = max(len(seen) for _, seen in felt)
    return np.stack([np.pad(seen, ((0, longest - len(seen)), (0, 0))) for _, seen in felt])


def _add_products(
    near: Array,
    entries: list[list[tuple[Indices, Indices, Array]]],
    earlier: tuple[int, Array],
    later: tuple[int, Array],
) -> None:
    """Adds the products of what is felt (n, F, k) of two parts, each from a window on, in rows from the same on."""
    (first, one_part), (second, other_part) = earlier, later
    shared = min(one_part.shape[1], other_part.shape[1])
    own, others = one_part[:, :shared], other_part[:, :shared]
    n, _, k = own.shape
    if second - (first + k - 1) < len(near):
        flat = [part.transpose(1, 0, 2).reshape(shared, -1) for part in (own, others)]
        blocks = (flat[0].T @ flat[1]).reshape(n, k, n, -1)
        for d in range(len(near)):
            at = np.arange(max(first, second - d), min(first + k, second - d + blocks.shape[3]))
            near[d, at] = blocks[:, at - first, :, at + d - second]
        at_joints = [blocks[j, :, j] for j in range(n)]
    else:
        at_joints = [own[j].T @ others[j] for j in range(n)]
    for j, block in enumerate(at_joints):
        i, m = np.meshgrid(first + np.arange(k), second + np.arange(block.shape[1]), indexing="ij")
        entries[j].append((i.ravel(), m.ravel(), block.ravel()))
        if first != second:
            entries[j].append((m.ravel(), i.ravel(), block.ravel()))


def _matrix(entries: list[tuple[Indices, Indices, Array]], size: int) -> sp.csr_matrix | Array:
    """(size, size) with these rows, columns and values."""
    rows, columns, values = (np.concatenate(each) for each in zip(*entries, strict=True))
    found = sp.csr_matrix((values, (rows, columns)), shape=(size, size))
    return found if found.nnz < DENSE_SHARE * size**2 else np.asarray(found.toarray())
