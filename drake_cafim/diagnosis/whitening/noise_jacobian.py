"""The Jacobian of the weak form's rows with respect to every recorded sample, which propagates the noise."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

from drake_cafim.diagnosis.rows.adjustment import POSITION_STEP, VELOCITY_STEP
from drake_cafim.diagnosis.rows.measurement import joint_samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.momentum_derivatives import balance_slopes
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.motion import motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

NoiseJacobian: TypeAlias = dict[str, sp.csr_matrix | LinearOperator]
"""∂rows/∂samples of each recorded column by its name: (M r, N), rows ordered window after window."""
Block: TypeAlias = tuple[str, sp.csr_matrix]
"""A column's name, and ∂rows/∂samples of it."""
Parts: TypeAlias = dict[int, tuple[sp.csr_matrix, Array]]
"""By row of a window: a matrix (M, N) over the windows, and factors (N,) of its columns."""


def noise_jacobian(weak: WeakForm, physics: Physics) -> NoiseJacobian:
    """∂rows/∂samples under `physics`, for each recorded column that is not exact."""
    return by_joint(physics, dict(motion_blocks(weak, physics)) | dict(effort_blocks(weak, physics)))


def by_joint(physics: Physics, found: NoiseJacobian) -> NoiseJacobian:
    """The blocks `found` with those of each joint's position, velocity and effort together."""
    of_joints = [f"{kind}.{name}" for name in physics.tree.joint_names for kind in "qvu"]
    return {name: found[name] for name in [*of_joints, *found] if name in found}


def effort_blocks(weak: WeakForm, physics: Physics) -> Iterator[Block]:
    """The blocks of `noise_jacobian` by the efforts."""
    s = weak.samples
    for j, name in enumerate(physics.tree.joint_names):
        if s.std[column := f"u.{name}"] > 0.0:
            block = place(weak, -s.windows.held(s.time, s.ramped[j]), weak.kinematic_rows + j)
            yield column, _of_recorded(weak, physics, column, block)


def motion_blocks(weak: WeakForm, physics: Physics) -> Iterator[Block]:
    """The blocks of `noise_jacobian` by positions, velocities and wrenches."""
    s, n = weak.samples, weak.joints
    measured = weak.measurement(physics)
    q, v = measured.q_hat, measured.v_hat
    # the mean slope of a kinked law over the noise of samples, also where the motion is estimated more accurately
    joints = joint_samples_of(s, measured, np.stack([smoother.std for smoother in s.kinked_v], axis=1))
    memory = weak.contact_memory(physics)
    servos = weak.terms(physics).servos
    _, d_q_law, d_v_law = physics.applied_at_joints(joints)
    rigid = balance_slopes(replace(weak.motion(physics), tree=physics.tree), physics)

    def recorded(name: str, block: sp.csr_matrix) -> Block:
        return name, _of_recorded(weak, physics, name, block)

    readings = [reading_windows(weak, physics, sensor, axis) for sensor in weak.sensors for axis in WRENCH_COMPONENTS]
    for j, name in enumerate(physics.tree.joint_names):
        step = np.eye(n)[j]
        force_by_q = _force_slope(weak, physics, memory, (q, v), (POSITION_STEP * step, 0.0 * step))
        force_by_v = _force_slope(weak, physics, memory, (q, v), (0.0 * step, VELOCITY_STEP * step))
        force_by_q[:, j] += d_q_law[:, j]
        law_by_v = np.zeros_like(force_by_v)
        law_by_v[:, j] = d_v_law[:, j]
        from_q = _block(weak, rigid.momentum_by_q[:, :, j], rigid.force_by_q[:, :, j], kinematic=j, rate=True)
        from_v = _block(weak, rigid.momentum_by_v[:, :, j], rigid.force_by_v[:, :, j], kinematic=j, rate=False)
        # friction is steep where it changes its sign: the noise that smoothing leaves counts, from q and v separately
        from_q = from_q + _force_rows(weak, readings, force_by_q, s.smooth_q)
        for slopes, velocity in ((force_by_v, s.smooth_v[j]), (law_by_v, s.kinked_v[j])):
            from_q = from_q + _force_rows(weak, readings, slopes, velocity.from_q)
            if s.differentiate is None:
                from_v = from_v + _force_rows(weak, readings, slopes, velocity.from_v)
        if j in servos:
            # what is read enters a second time, through the effort that the servo makes of it
            acts = place(weak, -s.windows.value, weak.kinematic_rows + j)
            from_q = from_q + acts @ sp.diags_array(servos[j].mean.d_q)
            from_v = from_v + acts @ sp.diags_array(servos[j].mean.d_v)
        if s.differentiate is None:
            yield recorded(f"q.{name}", sp.csr_matrix(from_q))
            yield recorded(f"v.{name}", sp.csr_matrix(from_v))
        else:
            yield recorded(f"q.{name}", sp.csr_matrix(from_q + from_v @ s.differentiate))
    for i, sensor in enumerate(weak.sensors):
        for k, axis in enumerate(WRENCH_COMPONENTS):
            row = weak.kinematic_rows + n + 6 * i + k
            yield recorded(f"wrench.{sensor.name}.{axis}", place(weak, s.windows.value, row))


def _of_recorded(weak: WeakForm, physics: Physics, name: str, block: sp.csr_matrix) -> sp.csr_matrix:
    """(M r, N) the rows' derivative by the column `name` as recorded, from the `block` by it as corrected."""
    s = weak.samples
    first = np.tile(np.arange(weak.rows_per_window) < weak.kinematic_rows, len(s.windows))
    # chain rule: the last correction applied to the samples comes first in the product
    for effect in reversed(physics.sensors):
        if name.startswith("wrench.") or not effect.channels((name,)):
            continue
        correction, facing = effect.correction(s.time), effect.kinematic_correction(s.time)
        if correction is not None and facing is not None:
            kinematic, dynamic = (sp.diags_array(kind.astype(float)) for kind in (first, ~first))
            block = sp.csr_matrix(kinematic @ block @ facing + dynamic @ block @ correction)
        elif correction is not None:
            block = sp.csr_matrix(block @ correction)
    if name in s.bridges:
        block = sp.csr_matrix(block @ s.bridges[name])
    scale = np.ones(weak.rows_per_window)
    scale[weak.dynamic] = 1.0 / physics.effort_gains
    block.data *= np.repeat(np.tile(scale, len(s.windows)), np.diff(block.indptr))
    return block


def _force_slope(
    weak: WeakForm, physics: Physics, memory: Array, at: tuple[Array, Array], step: tuple[Array, Array]
) -> Array:
    """(N, n + 6 s) derivative of `forces_and_readings` along the `step` in (q, v), by central differences."""
    if not physics.contacts and not physics.body_forces:
        return np.zeros((len(at[0]), weak.joints + 6 * len(weak.sensors)))
    ahead, behind = (motion(physics.tree, at[0] + sign * step[0], at[1] + sign * step[1]) for sign in (1.0, -1.0))
    lasting = weak.motion(physics).lasting
    ahead, behind = replace(ahead, lasting=lasting), replace(behind, lasting=lasting)
    change = weak.contacts.forces_and_readings(physics, ahead, memory)
    change = change - weak.contacts.forces_and_readings(physics, behind, memory)
    return np.asarray(change / (2.0 * np.sum(step)))


def reading_windows(weak: WeakForm, physics: Physics, sensor: WrenchSensor, axis: str) -> sp.csr_matrix:
    """(M, N) windows applied to the exact reading of one axis: the test functions times the sensor effects' filters."""
    windows = weak.samples.windows.value
    for effect in reversed(physics.sensors):
        if effect.channels((f"wrench.{sensor.name}.{axis}",)):
            writing = effect.filter_matrix(weak.samples.time)
            windows = windows if writing is None else sp.csr_matrix(windows @ writing)
    return windows


def _block(weak: WeakForm, momentum: Array, force: Array, kinematic: int, rate: bool) -> sp.csr_matrix:
    """(M r, N) the rows' derivative by one column of samples, from those (N, n) of `momentum` and `force`.

    `kinematic` is the joint whose kinematic row contains the column, as a position if `rate`, else as a velocity.
    """
    windows, first = weak.samples.windows, weak.dynamic.start
    rates: Parts = {first + k: (windows.rate, -momentum[:, k]) for k in range(weak.joints)}
    values: Parts = {first + k: (windows.value, -force[:, k]) for k in range(weak.joints)}
    if weak.kinematic_rows:
        (rates if rate else values)[kinematic] = windows.rate if rate else windows.velocity, np.ones(len(momentum))
    return sp.csr_matrix(_interleave(weak, rates) + _interleave(weak, values))


def _force_rows(weak: WeakForm, readings: list[sp.csr_matrix], slopes: Array, smooth: sp.csr_matrix) -> sp.csr_matrix:
    """(M r, N) the rows' derivative by one column of samples through forces and readings.

    `slopes` (N, n + 6 s) are the derivatives of forces and readings by the smoothed column, `smooth` (N, N) @ samples.
    """
    every = [*[weak.samples.windows.value] * weak.joints, *readings]
    nonzero = [k for k in range(len(every)) if np.any(slopes[:, k])]
    parts = {weak.dynamic.start + k: (every[k], -slopes[:, k]) for k in nonzero}
    return sp.csr_matrix(_interleave(weak, parts) @ smooth)


def place(weak: WeakForm, matrix: sp.csr_matrix, row: int) -> sp.csr_matrix:
    """Rows (M r, c) in which the `row`-th of each window is that of `matrix` (M, c), and all others are 0."""
    coo = sp.coo_matrix(matrix)
    shape = (len(weak.samples.windows) * weak.rows_per_window, matrix.shape[1])
    return sp.csr_matrix((coo.data, (coo.row * weak.rows_per_window + row, coo.col)), shape=shape)


def _interleave(weak: WeakForm, parts: Parts) -> sp.csr_matrix:
    """Rows (M r, N) in which the k-th of each window is that of `parts[k]`; assembled at once, which is faster."""
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
