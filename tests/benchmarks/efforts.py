"""`python -m tests.benchmarks.efforts [--report NAME=report.json ...]`: inverse dynamics by plain regression.

What least squares on the same recordings reaches, without any search: the model as given; viscous and Coulomb friction
and an offset in each joint; with the inertials of all links as well; and, for the KUKA, a ridge regression of masses,
first moments, Coulomb friction and offset. Beside it stands what the tool's corrected model reached, read from its
reports. All figures are relative: rms of the residual over that of the effort, joint by joint, on recordings that were
held out, both sides low-passed without phase lag.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from drake_cafim.dynamics.motion import motion
from drake_cafim.dynamics.tree import Tree
from drake_cafim.recordings import read
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Flags

ORDER, WIDER, TRANSIENT, KEEP = 4, 5.0, 3.0, 0.01
"""Order of the filter, cutoff of the positions' over it, ends left out in its periods, spacing of what is fitted, s."""
LONGEST_GAP = 0.02
"""s, of lost samples that are interpolated."""
AT_REST = 0.02
"""rad/s, width of the smoothed sign of Coulomb friction."""
RIDGES = tuple(10.0 ** np.arange(-6.0, 1.0, 0.5))
SLACK = 0.1
"""Share of the error by which a ridge may be worse than the best one."""
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Machine:
    """A set of recordings, its scenario, the recordings held out in turn, and the cutoff of the filter, Hz."""

    name: str
    scenario: str
    runs: tuple[str, ...]
    held_out: tuple[int, ...]
    cutoff: float
    ridge: bool = False


MACHINES = (
    Machine("panda_gaz2019", "scenario.yaml", tuple(f"part_{k}" for k in range(5)), (4,), 12.0),
    Machine("kuka_lwr4", "scenario.yaml", tuple(f"measurements_{k}" for k in (1, 2, 3)), (2,), 2.5, ridge=True),
)


@dataclass(frozen=True)
class Filtered:
    """One recording: the filtered `efforts` (K, n), `rigid` inverse dynamics of the model (K, n), and regressors.

    `inertial` (K, n, 10 n) of the links' ten parameters, `friction` (K, n, 3): −v, −sign v, −1 of each joint.
    """

    efforts: Array
    rigid: Array
    inertial: Array
    friction: Array


def filtered(scene: Scene, recording: Recording, cutoff: float) -> Filtered:
    """The recording's regressors, each filtered like its efforts, on an even clock."""
    names = scene.tree.joint_names
    stretches = []
    for part in _without_gaps(recording, 1.5 / cutoff * 2.0 * TRANSIENT):
        time = part.time
        count = round(part.duration / float(np.median(np.diff(time)))) + 1
        even = np.linspace(time[0], time[-1], count)
        rate = (count - 1) / part.duration

        def low(values: Array, frequency: float, rate: float = rate) -> Array:
            sections = butter(ORDER, min(frequency, 0.4 * rate), fs=rate, output="sos")
            return np.asarray(sosfiltfilt(sections, values, axis=0), dtype=float)

        q = low(make_interp_spline(time, part.matrix("q", names), k=3)(even), WIDER * cutoff)
        v = np.gradient(q, 1.0 / rate, axis=0)
        a = np.gradient(v, 1.0 / rate, axis=0)
        u = np.stack([np.interp(even, time, column) for column in part.matrix("u", names).T], axis=1)
        regressor = inverse_dynamics_regressor(scene.tree, scene.physics.gravity, q, v, a)
        rotors = np.array([joint.rotor_inertia for joint in scene.tree.joints])
        rigid = regressor.reshape(len(q), len(names), -1) @ scene.physics.tree.inertial_parameters.ravel() + rotors * a
        friction = np.stack([v, np.tanh(v / AT_REST), np.ones_like(v)], axis=2)
        inside = slice(int(TRANSIENT / cutoff * rate), -int(TRANSIENT / cutoff * rate), max(1, round(KEEP * rate)))
        parts = (u, rigid, regressor.reshape(len(q), len(names), -1), friction)
        stretches.append([low(values, cutoff)[inside] for values in parts])
    return Filtered(*(np.concatenate([own[k] for own in stretches]) for k in range(4)))


def _without_gaps(recording: Recording, shortest: float) -> Iterator[Recording]:
    # a few lost packets are bridged: the filter passes nothing so short
    edges = np.flatnonzero(np.diff(recording.time) > LONGEST_GAP)
    starts, stops = [0, *(edges + 1)], [*edges, len(recording) - 1]
    for first, last in zip(starts, stops, strict=True):
        if recording.time[last] - recording.time[first] > shortest:
            yield recording.window(recording.time[first], recording.time[last])


def inverse_dynamics_regressor(tree: Tree, gravity: Array, q: Array, v: Array, a: Array) -> Array:
    """(K, n, n, 10): the efforts M(q) v̇ + h by the inertial parameters of each link, as `Tree.inertial_parameters`.

    Of a link in its own frame, with angular velocity ω and acceleration α, and a base that accelerates against gravity:
    force m a + α × h + ω × (ω × h), moment I α + ω × I ω + h × a (Atkeson, An, Hollerbach, 1986).
    """
    moving = motion(tree, q, v)
    n, count = q.shape[1], len(q)
    acceleration = np.zeros((count, n, 6))
    for j, joint in enumerate(tree.joints):
        parent = acceleration[:, joint.parent] if joint.parent >= 0 else np.concatenate([np.zeros(3), -gravity])
        acceleration[:, j] = parent + moving.axes[:, j] * a[:, j, None] + moving.axes_rate[:, j] * v[:, j, None]
    result = np.zeros((count, n, n, 10))
    for j, carried in enumerate(tree.supports()):
        R, p = moving.R_WJ[:, j], moving.p_WJ[:, j]

        def inside(twist: Array, R: Array = R, p: Array = p) -> tuple[Array, Array]:
            turning, moved = twist[..., :3], twist[..., 3:] + np.cross(twist[..., :3], p)
            return tuple(np.einsum("kba,kb->ka", R, part) for part in (turning, moved))

        w, speed = inside(moving.velocities[:, j])
        alpha, linear = inside(acceleration[:, j])
        linear = linear + np.cross(w, speed)
        force, moment = np.zeros((count, 3, 10)), np.zeros((count, 3, 10))
        force[:, :, 0] = linear
        for axis in range(3):
            h = np.eye(3)[axis]
            force[:, :, 1 + axis] = np.cross(alpha, h) + np.cross(w, np.cross(w, h))
            moment[:, :, 1 + axis] = np.cross(h, linear)
        for k, (r, s) in enumerate(PAIRS):
            unit = np.zeros((3, 3))
            unit[r, s] = unit[s, r] = 1.0
            moment[:, :, 4 + k] = alpha @ unit + np.cross(w, w @ unit)
        for i in np.flatnonzero(carried):
            turning, moved = inside(moving.axes[:, i])
            result[:, i, j] = np.einsum("ka,kaf->kf", turning, moment) + np.einsum("ka,kaf->kf", moved, force)
    return result


def relative(residual: Array, efforts: Array) -> Array:
    """(n,) rms of the residual over that of the effort."""
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0) / np.mean(efforts**2, axis=0)))


def with_friction(train: Filtered, test: Filtered) -> Array:
    """(n,) residuals with viscous and Coulomb friction and an offset, joint by joint."""
    left = np.empty_like(test.efforts)
    for j in range(left.shape[1]):
        found = np.linalg.lstsq(train.friction[:, j], (train.efforts - train.rigid)[:, j], rcond=None)[0]
        left[:, j] = (test.efforts - test.rigid)[:, j] - test.friction[:, j] @ found
    return relative(left, test.efforts)


def with_inertials(
    train: Filtered, test: Filtered, ridge: float = 1e-8, kept: Flags | None = None, viscous: bool = True
) -> Array:
    """(n,) residuals with the inertials of all links too, of the smallest change that fits.

    `ridge` weighs the change of each parameter, in units of its mean effect;
    `kept` (10 n,) are the inertial parameters that change; `viscous` friction may be left out.
    """
    kept = np.ones(train.inertial.shape[2], dtype=bool) if kept is None else kept
    columns, wanted = _together(train, kept, viscous)
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0.0] = 1.0
    columns = columns / size
    inertials = int(np.count_nonzero(kept))
    weights = np.where(np.arange(columns.shape[1]) < inertials, ridge, 1e-10) * len(wanted)
    found = np.linalg.solve(columns.T @ columns + np.diag(weights), columns.T @ wanted) / size
    columns, wanted = _together(test, kept, viscous)
    left = (wanted - columns @ found).reshape(test.efforts.shape)
    return relative(left, test.efforts)


def _together(data: Filtered, kept: Flags, viscous: bool) -> tuple[Array, Array]:
    """All joints' columns (K n, p) and efforts beyond the rigid ones (K n,)."""
    count, n = data.efforts.shape
    laws = data.friction if viscous else data.friction[:, :, 1:]
    k = laws.shape[2]
    friction = np.zeros((count, n, k * n))
    for j in range(n):
        friction[:, j, k * j : k * j + k] = laws[:, j]
    columns = np.concatenate([data.inertial[:, :, kept], friction], axis=2)
    return columns.reshape(count * n, -1), (data.efforts - data.rigid).ravel()


def ridge_regression(train: Sequence[Filtered], test: Filtered) -> tuple[Array, float]:
    """(n,) residuals with masses, first moments, Coulomb friction and offsets, and the ridge.

    It is the largest whose error, N m, on training runs that were left out of the fit is at most `SLACK` above the
    least: runs that repeat each other would choose none.
    """
    masses = np.tile(np.arange(10) < 4, train[0].efforts.shape[1])

    def left(ridge: float) -> float:
        cases = [(_joined([*train[:k], *train[k + 1 :]]), own) for k, own in enumerate(train)]
        shares = [with_inertials(others, own, ridge, masses, viscous=False) for others, own in cases]
        sizes = [np.sqrt(np.mean(own.efforts**2, axis=0)) for _, own in cases]
        return float(np.sqrt(np.mean([(share * size) ** 2 for share, size in zip(shares, sizes, strict=True)])))

    errors = {ridge: left(ridge) for ridge in RIDGES}
    best = max(ridge for ridge, error in errors.items() if error <= (1.0 + SLACK) * min(errors.values()))
    return with_inertials(_joined(train), test, best, masses, viscous=False), best


def _joined(parts: Sequence[Filtered]) -> Filtered:
    names = ("efforts", "rigid", "inertial", "friction")
    return Filtered(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def figures(machine: Machine, data: Path) -> Iterator[tuple[str, Array]]:
    """The residuals of each regression, by its name."""
    folder = data / machine.name
    raw = yaml.safe_load((folder / machine.scenario).read_text()) | {"unknown": []}
    raw["model"] = str((folder / raw["model"]).resolve())
    scene = Scene.load(_written(raw))
    runs = [
        filtered(scene, read(folder / "runs" / f"{name}.parquet", scene.scenario.topics), machine.cutoff)
        for name in machine.runs
    ]
    train = [run for k, run in enumerate(runs) if k not in machine.held_out]
    test, all_train = _joined([runs[k] for k in machine.held_out]), _joined(train)
    yield "as given", relative(test.efforts - test.rigid, test.efforts)
    yield "viscous, Coulomb, offset", with_friction(all_train, test)
    yield "with all inertials", with_inertials(all_train, test)
    if machine.ridge:
        found, ridge = ridge_regression(train, test)
        yield f"ridge {ridge:.0e} of masses, moments, friction", found


def _written(raw: dict[str, object]) -> Path:
    path = Path(tempfile.mkdtemp(prefix="efforts-")) / "scenario.yaml"
    path.write_text(yaml.safe_dump(raw))
    return path


def reported(path: Path) -> Iterator[tuple[str, str]]:
    """What a report says of its held-out recordings, model by model."""
    fit = json.loads(path.read_text())["fit"]["held_out"]
    for name in ("nominal_as_given", "nominal", "named", "corrected"):
        effort = (fit.get(name) or {}).get("effort") or {}
        if effort:
            cutoff = next(iter(effort.values()))["cutoff"]
            row = " ".join(
                "  –  " if item["relative"] is None else f"{item['relative']:5.3f}" for item in effort.values()
            )
            yield f"the tool, {name} ({cutoff:g} Hz)", row


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.efforts", description=__doc__)
    parser.add_argument("--data", type=Path, default=os.environ.get("DRAKE_CAFIM_DATA"), help="folder of the sets")
    parser.add_argument("--report", nargs="*", default=[], help="NAME=report.json of a diagnosis, printed beside")
    options = parser.parse_args(arguments)
    if options.data is None:
        raise SystemExit("--data or DRAKE_CAFIM_DATA must name the folder of the recorded sets")
    data = options.data / "data" if (options.data / "data").is_dir() else options.data
    reports = [entry.partition("=") for entry in options.report]
    for machine in MACHINES:
        held = ", ".join(machine.runs[k] for k in machine.held_out)
        print(f"{machine.name}, {held} held out, {machine.cutoff:g} Hz")
        for name, row in figures(machine, data):
            print(f"  {name:45}", " ".join(f"{value:5.3f}" for value in row), flush=True)
        for own, _, path in reports:
            if own == machine.name:
                for name, text in reported(Path(path)):
                    print(f"  {name:45} {text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
