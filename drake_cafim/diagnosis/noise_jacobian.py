"""How the noise of the samples reaches the rows: their slopes in every recorded sample."""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.balance_slopes import balance_slopes
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.motion import motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

Parts: TypeAlias = dict[int, tuple[sp.csr_matrix, Array]]
"""By row of a window: a matrix (M, N) over the windows, and what its columns are multiplied by, (N,)."""
POSITION_STEP, VELOCITY_STEP = 1e-6, 1e-5


def noise_jacobian(weak: WeakForm, physics: Physics) -> tuple[sp.csr_matrix, list[tuple[str, slice]]]:
    """∂rows/∂samples as a sparse (M r, columns), and which slice belongs to which recording column.

    Slices are N wide; rows run window after window.
    """
    s, n = weak.samples, weak.joints
    measured = weak.measurement(physics)
    q, v = measured.q_hat, measured.v_hat
    joints = weak.joint_samples(physics)
    memory = weak.contact_memory(physics)
    _, d_q_law, d_v_law = physics.applied_at_joints(joints)
    rigid = balance_slopes(replace(weak.motion(physics), tree=physics.tree), physics)
    first = np.arange(weak.rows_per_window) < weak.kinematic_rows
    kinematic, dynamic = (sp.diags_array(np.tile(kind, len(s.windows)).astype(float)) for kind in (first, ~first))
    blocks: list[sp.csr_matrix] = []
    labels: list[tuple[str, slice]] = []

    def add(name: str, block: sp.csr_matrix) -> None:
        # the last correction made is the first that the rows see
        for effect in reversed(physics.sensors):
            if name.startswith("wrench.") or not effect.channels((name,)):
                continue
            correction, facing = effect.correction(s.time), effect.facing(s.time)
            if correction is not None and facing is not None:
                block = sp.csr_matrix(kinematic @ block @ facing + dynamic @ block @ correction)
            elif correction is not None:
                block = sp.csr_matrix(block @ correction)
        if name in s.bridges:
            block = sp.csr_matrix(block @ s.bridges[name])
        start = sum(b.shape[1] for b in blocks)
        blocks.append(block)
        labels.append((name, slice(start, start + block.shape[1])))

    readings = [reading_windows(weak, physics, sensor, axis) for sensor in weak.sensors for axis in WRENCH_COMPONENTS]
    for j, name in enumerate(physics.tree.joint_names):
        step = np.eye(n)[j]
        felt_by_q = _felt_slope(weak, physics, memory, (q, v), (POSITION_STEP * step, 0.0 * step))
        felt_by_v = _felt_slope(weak, physics, memory, (q, v), (0.0 * step, VELOCITY_STEP * step))
        felt_by_q[:, j] += d_q_law[:, j]
        law_by_v = np.zeros_like(felt_by_v)
        law_by_v[:, j] = d_v_law[:, j]
        from_q = _block(weak, rigid.momentum_by_q[:, :, j], rigid.force_by_q[:, :, j], kinematic=j, rate=True)
        from_v = _block(weak, rigid.momentum_by_v[:, :, j], rigid.force_by_v[:, :, j], kinematic=j, rate=False)
        # a friction that turns its sign is steep: what smoothing leaves of the noise counts, and from where it comes
        from_q = from_q + _felt(weak, readings, felt_by_q, s.smooth_q)
        for slopes, velocity in ((felt_by_v, s.smooth_v[j]), (law_by_v, s.kinked_v[j])):
            from_q = from_q + _felt(weak, readings, slopes, velocity.from_q)
            if s.differentiate is None:
                from_v = from_v + _felt(weak, readings, slopes, velocity.from_v)
        if s.differentiate is None:
            add(f"q.{name}", sp.csr_matrix(from_q))
            add(f"v.{name}", sp.csr_matrix(from_v))
        else:
            add(f"q.{name}", sp.csr_matrix(from_q + from_v @ s.differentiate))
        if s.std[f"u.{name}"] > 0.0:
            add(f"u.{name}", place(weak, -s.windows.held(s.time), weak.kinematic_rows + j))
    for i, sensor in enumerate(weak.sensors):
        for k, axis in enumerate(WRENCH_COMPONENTS):
            row = weak.kinematic_rows + n + 6 * i + k
            add(f"wrench.{sensor.name}.{axis}", place(weak, s.windows.value, row))
    scale = np.ones(weak.rows_per_window)
    scale[weak.dynamic] = 1.0 / physics.effort_gains
    whole = sp.csr_matrix(sp.hstack(blocks, format="csr"))
    whole.data *= np.repeat(np.tile(scale, len(s.windows)), np.diff(whole.indptr))
    return whole, labels


def _felt_slope(
    weak: WeakForm, physics: Physics, memory: Array, at: tuple[Array, Array], step: tuple[Array, Array]
) -> Array:
    """The slope of `touched_and_pushed` along a step in (q, v), by central differences, (N, n + 6 s)."""
    if not physics.contacts and not physics.body_forces:
        return np.zeros((len(at[0]), weak.joints + 6 * len(weak.sensors)))
    ahead, behind = (motion(physics.tree, at[0] + sign * step[0], at[1] + sign * step[1]) for sign in (1.0, -1.0))
    lasting = weak.motion(physics).lasting
    ahead, behind = replace(ahead, lasting=lasting), replace(behind, lasting=lasting)
    change = weak.touched_and_pushed(physics, ahead, memory) - weak.touched_and_pushed(physics, behind, memory)
    return np.asarray(change / (2.0 * np.sum(step)))


def reading_windows(weak: WeakForm, physics: Physics, sensor: WrenchSensor, axis: str) -> sp.csr_matrix:
    """The windows (M, N) over a predicted reading: a sensor that is late mixes its times."""
    windows = weak.samples.windows.value
    for effect in reversed(physics.sensors):
        if effect.channels((f"wrench.{sensor.name}.{axis}",)):
            writing = effect.writing(weak.samples.time)
            windows = windows if writing is None else sp.csr_matrix(windows @ writing)
    return windows


def _block(weak: WeakForm, momentum: Array, force: Array, kinematic: int, rate: bool) -> sp.csr_matrix:
    """Rows' derivative by one column of samples from the point-wise ones (N, n) of the rigid bodies."""
    windows, first = weak.samples.windows, weak.dynamic.start
    rates: Parts = {first + k: (windows.rate, -momentum[:, k]) for k in range(weak.joints)}
    values: Parts = {first + k: (windows.value, -force[:, k]) for k in range(weak.joints)}
    if weak.kinematic_rows:
        (rates if rate else values)[kinematic] = windows.rate if rate else windows.value, np.ones(len(momentum))
    return sp.csr_matrix(_interleave(weak, rates) + _interleave(weak, values))


def _felt(weak: WeakForm, readings: list[sp.csr_matrix], slopes: Array, smooth: sp.csr_matrix) -> sp.csr_matrix:
    """Rows' derivative by one column of samples, of what is felt, by `slopes` (N, n + 6 s), once it is smoothed."""
    every = [*[weak.samples.windows.value] * weak.joints, *readings]
    felt = [k for k in range(len(every)) if np.any(slopes[:, k])]
    parts = {weak.dynamic.start + k: (every[k], -slopes[:, k]) for k in felt}
    return sp.csr_matrix(_interleave(weak, parts) @ smooth)


def place(weak: WeakForm, matrix: sp.csr_matrix, row: int) -> sp.csr_matrix:
    """The rows (M r, c) of which each window's `row`-th are those of `matrix` (M, c), and the others 0."""
    coo = sp.coo_matrix(matrix)
    shape = (len(weak.samples.windows) * weak.rows_per_window, matrix.shape[1])
    return sp.csr_matrix((coo.data, (coo.row * weak.rows_per_window + row, coo.col)), shape=shape)


def _interleave(weak: WeakForm, parts: Parts) -> sp.csr_matrix:
    """The rows (M r, N) of which each window's k-th are those of `parts[k]`, all at once."""
    counts = np.zeros((len(weak.samples.windows), weak.rows_per_window), dtype=np.int64)
    begins, total = counts.copy(), 0
    indices, data = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for k, (matrix, weights) in parts.items():
        counts[:, k], begins[:, k] = np.diff(matrix.indptr), total + matrix.indptr[:-1]
        total += matrix.nnz
        indices.append(matrix.indices)
        data.append(matrix.data * weights[matrix.indices])
    starts = np.append(0, np.cumsum(counts))
    taken = np.arange(total) + np.repeat(begins.ravel() - starts[:-1], counts.ravel())
    rows = (np.concatenate(data)[taken], np.concatenate(indices)[taken], starts)
    return sp.csr_matrix(rows, shape=(counts.size, len(weak.samples.time)))
