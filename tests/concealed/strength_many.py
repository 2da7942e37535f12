"""How clear each of many effects is beside all the others, and by which other names it may go.

All is reckoned about the truth, on the rows of `strength` along noise-free measurements; a row's variance is that of
the measurement noise and of the force that nobody knows. An effect's sigma is what its removal leaves in these rows in
std, after the inertials of all links (with their prior) and every strength of the other effects have been fitted anew.
From `CLEAR_SIGMA` on it is clear. The windows overlap, and slow forces that nobody knows lift neighbours together: the
std is that of sums over many windows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .arm_case import PROCESS_TIME, Settings
from .case import Case, World
from .noise import ChannelNoise
from .robots import Array
from .strength import ACCEPT, TRAINED, Alternative, Windows
from .strength_arm import ArmRows, arm_alternatives, late, slow
from .truth import Concealed
from .wrong_inertials import NUMBERS, STD, changed

CLEAR_SIGMA = 10.0
_STEP = 1e-4  # relative, of a strength's tangent

Values = Mapping[str, float]


@dataclass(frozen=True)
class Footprint:
    """An effect with the rows (R,) that it alone puts in and those of a unit more of each of its strengths (R, p)."""

    item: Concealed
    rows: Array
    tangents: Array


def reckoned_many(case: Case) -> dict[str, object]:
    """Sigma of each effect, and its acceptable other names; sealed with the truth."""
    rows = ManyRows(case)
    prints = footprints(rows)
    unknown, excess = inertial_columns(rows), rows.excess()
    there = {(footprint.item.effect, footprint.item.at) for footprint in prints}
    strengths, accept = [], []
    for own, footprint in enumerate(prints):
        others = np.hstack([unknown, *(other.tangents for other in prints if other is not footprint)])
        left = Leftover(others, unknown.shape[1])
        sigma = float(np.linalg.norm(left.of(footprint.rows[:, None])))
        strengths.append({"value": sigma, "clear": sigma >= CLEAR_SIGMA})
        looks = [look for look in arm_alternatives(rows, footprint.item, excess) if (look.effect, look.at) not in there]
        accept += [name | {"of": own} for name in other_names(footprint, looks, left)]
    return {"strengths": strengths, "accept": accept}


class ManyRows(ArmRows):
    """Rows of the true arm without its effects; their std has the force that nobody knows and the efforts' noise."""

    def __init__(self, case: Case) -> None:
        world: World = case.study["world"]  # type: ignore[assignment]
        settings: Settings = case.study["settings"]  # type: ignore[assignment]
        scale: Array = case.study["scale"]  # type: ignore[assignment]
        study = case.study | {"world": replace(world, nominal=case.study["unaffected"]), "entries": []}
        super().__init__(replace(case, study=study))
        motion = world.motion
        self.true_q, self.true_v, self.true_a = (x[TRAINED] for x in (motion.q, motion.v, motion.a))
        unseen = settings.process * long_std(self.windows, ChannelNoise(1.0, PROCESS_TIME))
        measured = settings.effort_std * long_std(self.windows, ChannelNoise(1.0))
        n = self.robot.size
        self.std[..., :n] = np.sqrt(self.std[..., :n] ** 2 + (unseen**2 + measured**2) * scale**2)


def long_std(windows: Windows, noise: ChannelNoise) -> float:
    """Std of a window's sum of the noise by which sums over many windows grow as if windows were independent."""
    weight, hop = windows.shape[0], int(windows.starts[1] - windows.starts[0])
    reach = 2 + int(np.ceil((10.0 * noise.correlation_time / windows.step + windows.length) / hop))
    index = np.arange(windows.length)
    total = 0.0
    for shift in range(-reach, reach + 1):
        lag = np.abs(index[:, None] - index - shift * hop) * windows.step
        alike = np.exp(-lag / noise.correlation_time) if noise.correlation_time else (lag == 0.0).astype(float)
        total += float(weight @ alike @ weight)
    return windows.step * noise.std * float(np.sqrt(total))


def flat(rows: Array) -> Array:
    """Columns (R, Q) of rows (Q, B, W, C), of what is trained on."""
    return rows[:, TRAINED].reshape(len(rows), -1).T


def inertial_columns(rows: ManyRows) -> Array:
    """Rows (R, 10 links) that one prior std of each inertial number makes."""
    columns = []
    for index, link in enumerate(rows.robot.links):
        base = rows.carried(index, link)
        for number in range(NUMBERS):
            more = rows.carried(index, changed(link, 1e-4 * np.eye(NUMBERS)[number])) - base
            columns.append(rows.whiten(more * (STD / 1e-4)))
    return flat(np.stack(columns))


class Leftover:
    """What columns (R, Q) without a prior leave, the first `unknown` of them, in prior std, held by theirs."""

    def __init__(self, others: Array, unknown: int) -> None:
        self.unknown = unknown
        prior = np.zeros((unknown, others.shape[1]))
        prior[:, :unknown] = np.eye(unknown)
        scaled = np.vstack([others / self._sizes(others), prior / self._sizes(others)])
        basis, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
        self.basis = basis[:, sizes > 1e-9 * sizes[0]]

    @staticmethod
    def _sizes(columns: Array) -> Array:
        return np.maximum(np.linalg.norm(columns, axis=0), 1e-30)

    def of(self, columns: Array) -> Array:
        """(R + unknown, Q) of columns (R, Q)."""
        whole = np.vstack([columns, np.zeros((self.unknown, columns.shape[1]))])
        return np.asarray(whole - self.basis @ (self.basis.T @ whole))


def footprints(rows: ManyRows) -> list[Footprint]:
    """Of each of the effects, beside the others at its joint."""
    found = []
    for item in rows.effects:
        if item.sensor is not None:
            own = sensed(rows, item)[:, None]
            found.append(Footprint(item, own[:, 0], own))
        elif item.effect == "payload":
            found.append(_payload(rows, item))
        else:
            found.append(_at_joint(rows, item))
    return found


def sensed(rows: ManyRows, item: Concealed) -> Array:
    """(R,) that a late velocity puts in."""
    j = rows.names.index(item.at.split(".")[-1])
    change = rows.v[:, :, j] - rows.true_v[:, :, j]
    torque = rows.slope_with(j, 1) * change[:, :, None] + rows.slope_with(j, 2) * rows.rate(change)[:, :, None]
    return flat(rows.whiten(torque, v=rows.only(j, change))[None])[:, 0]


def _payload(rows: ManyRows, item: Concealed) -> Footprint:
    link = rows.robot.link_index(item.at)
    body, values = rows.robot.links[link], _values(item)
    base = rows.carried(link, body)

    def added(now: Values) -> Array:
        load = body.with_point_mass(now["mass"], np.array([now[axis] for axis in "xyz"]))
        return base - rows.carried(link, load)

    own = added(values)
    steps = {name: _STEP * max(abs(value), 0.05) for name, value in values.items()}
    more = [(added({**values, name: values[name] + step}) - own) / step for name, step in steps.items()]
    whole = flat(np.stack([rows.whiten(torque) for torque in (own, *more)]))
    return Footprint(item, whole[:, 0], whole[:, 1:])


def _at_joint(rows: ManyRows, item: Concealed) -> Footprint:
    j = rows.names.index(item.at)
    beside = {other.effect: _values(other) for other in rows.effects if other.at == item.at}
    alone, values = {k: v for k, v in beside.items() if k != item.effect}, beside[item.effect]
    own = joint_torque(rows, j, beside)
    more = []
    for name, value in values.items():
        step = _STEP * max(abs(value), 1e-3)
        more.append((joint_torque(rows, j, {**beside, item.effect: {**values, name: value + step}}) - own) / step)
    whole = flat(rows.whiten_at(j, [own - joint_torque(rows, j, alone), *more]))
    return Footprint(item, whole[:, 0], whole[:, 1:])


def _values(item: Concealed) -> Values:
    return {name: value for name, (value, _) in item.parameters.items()}


def joint_torque(rows: ManyRows, j: int, effects: Mapping[str, Values]) -> Array:
    """(B, N) that a joint has beyond its command under all of its `effects`, along the true motion."""
    q, v, a, u = (x[:, :, j] for x in (rows.true_q, rows.true_v, rows.true_a, rows.u))
    acting = u
    for name, seconds in (("actuator_delay", "delay"), ("actuator_lag", "time_constant")):
        if name in effects:
            acting = u + {"actuator_delay": late, "actuator_lag": slow}[name](rows, j, effects[name][seconds])
    total = acting * effects.get("actuator_gain_error", {"gain": 1.0})["gain"] - u
    sign, speed = np.tanh(v / 0.005), np.abs(v)
    for name, p in effects.items():
        if name == "joint_viscous_friction":
            total = total - p["coefficient"] * v
        elif name == "joint_coulomb_friction":
            total = total - p["torque"] * sign
        elif name == "joint_asymmetric_coulomb_friction":
            total = total - np.where(v > 0.0, p["torque_positive"], p["torque_negative"]) * sign
        elif name == "joint_stribeck_friction":
            total = (
                total - (p["coulomb"] + (p["static"] - p["coulomb"]) * np.exp(-((speed / p["velocity"]) ** 2))) * sign
            )
        elif name == "joint_load_dependent_friction":
            total = total - (p["torque"] + p["coefficient"] * np.abs(u)) * sign
        elif name == "joint_spring":
            total = total - p["stiffness"] * (q - p["rest"])
        elif name == "rotor_inertia":
            total = total - p["inertia"] * a
        elif name == "torque_ripple":
            total = total + p["amplitude"] * np.sin(p["cycles"] * q + p["phase"])
        elif name == "actuator_bias":
            total = total + p["torque"]
    return total


def other_names(footprint: Footprint, looks: Sequence[Alternative], left: Leftover) -> Iterator[dict[str, object]]:
    """Names that explain as well what this effect does, all others being there: expected log Bayes factors under 3."""
    mine, count = left.of(footprint.rows[:, None])[:, 0], len(footprint.rows)
    best: dict[tuple[str, str], float] = {}
    for look in looks:
        columns = left.of(flat(look.regressors))
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
        taken, *_ = np.linalg.lstsq(columns, mine, rcond=1e-8)
        remains = 0.5 * float(np.sum((mine - columns @ taken) ** 2))
        factor = remains + 0.5 * (look.parameters - len(footprint.item.parameters)) * np.log(count)
        name = (look.effect, look.at)
        best[name] = min(factor, best.get(name, np.inf))
    for (effect, at), factor in best.items():
        if factor < ACCEPT:
            yield {"effect": effect, "at": at, "log_bayes_factor": float(factor)}
