"""The detectability of a concealed effect, computed from the noise-free simulation independently of the package.

The nominal equations are evaluated on noise-free measurements, multiplied by sin^4 windows of 60 ms (tosses: 100 ms)
that overlap by half, and divided by the std that the measurement noise gives each such row. With the unknown parameters
refitted (their priors as extra rows), what remains is the excess that a diagnosis can find: its sum of squares in a
channel, over the number of the channel's rows, is the strength; `clear` is 3 or more (a root-mean-square residual of
1.7 std a row). Rows are taken as independent: neighbours correlate at about -0.3, which is left out.

An effect's `sigma` is the root of the sum of squares that its removal leaves in all rows beyond what the truth leaves,
the unknown parameters refitted; `sigma_beside_rival` what another explanation of no more parameters leaves, the one
that leaves least. Half-overlapping windows keep less than whole recordings tell: the bound's own sigma is larger.

The expected log Bayes factor of the truth over another explanation is half of what the other, fitted best, leaves over,
plus (k_other - k_true)/2 ln(rows). Under 3 another name is acceptable. All of it is reckoned about the true unknown
parameters: what the nominal leaves is then the effect's own, and each explanation, the true one too, pays for the
priors that it strains. Of a pair each effect is reckoned by itself, the other one fitted beside whatever is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from .case import RECORDINGS
from .noise import ChannelNoise
from .robots import Array
from .truth import Concealed

WINDOW = 0.06  # s
CLEAR = 3.0
ACCEPT = 3.0
TRAINED = slice(0, 3)  # recordings: what is held out says nothing


@dataclass(frozen=True)
class Windows:
    """sin^4 windows over samples of `step` s; every window has the same shape."""

    step: float
    length: int  # samples in a window
    starts: np.ndarray  # (W,)

    @classmethod
    def over(cls, samples: int, step: float, seconds: float = WINDOW) -> Windows:
        length = max(8, round(seconds / step))
        return cls(step, length, np.arange(0, samples - length, max(1, length // 2)))

    @property
    def shape(self) -> tuple[Array, Array, Array]:
        """Window, its first and second derivatives in time; (length,)."""
        rate = np.pi / (self.length * self.step)
        angle = rate * self.step * (np.arange(self.length) + 0.5)
        s, c = np.sin(angle), np.cos(angle)
        return s**4, 4.0 * rate * s**3 * c, 4.0 * rate**2 * (3.0 * s**2 * c**2 - s**4)

    def sums(self, samples: int, weight: Array) -> csr_array:
        """What makes sums (W,) over windows of weight times values (samples,), times the step."""
        columns = self.starts[:, None] + np.arange(self.length)
        ends = self.length * np.arange(len(self.starts) + 1)
        weights = np.tile(self.step * weight, len(self.starts))
        return csr_array((weights, columns.ravel(), ends), shape=(len(self.starts), samples))

    def integrate(self, values: Array, weight: Array) -> Array:
        """Sums over windows (B, W, ...) of weight times values (B, N, ...), times the step."""
        sums = self.sums(values.shape[1], weight)
        return summed([sums] * len(values), values)

    def centres(self) -> np.ndarray:
        return self.starts + self.length // 2

    def noise_std(self, weight: Array, noise: ChannelNoise) -> float:
        """Std of the windowed sum of the noise under `weight`."""
        lag = np.abs(np.subtract.outer(np.arange(self.length), np.arange(self.length))) * self.step
        correlation = np.exp(-lag / noise.correlation_time) if noise.correlation_time else (lag == 0.0).astype(float)
        white = noise.quantum**2 / 12.0 * (weight @ weight)
        return self.step * float(np.sqrt(noise.std**2 * weight @ correlation @ weight + white))


def summed(sums: Sequence[csr_array], values: Array) -> Array:
    """Sums (B, W, ...) of each recording's values (B, N, ...)."""
    flat = values.reshape(*values.shape[:2], -1)
    rows = np.stack([own @ recorded for own, recorded in zip(sums, flat, strict=True)])
    return rows.reshape(*rows.shape[:2], *values.shape[2:])


@dataclass(frozen=True)
class Excess:
    """Whitened rows by channel about the true unknown parameters: what the nominal leaves, what a prior std does."""

    channels: tuple[str, ...]
    rows: Array  # (B, W, C) in std
    unknown: Array  # (P, B, W, C)
    centres: Array  # (B, W) s
    offset: Array  # (P,) of the true unknown parameters from their priors' means, in prior std

    def remaining(self, others: Array | None = None, members: slice = TRAINED) -> Array:
        """Rows (b, W, C) after the unknown parameters, and any `others` (Q, B, W, C) without a prior, are fitted."""
        rows = self.rows[members]
        left, _, _ = self._fit(rows.ravel(), others, members)
        return left.reshape(rows.shape)

    def cost(self, others: Array | None = None, rows: Array | None = None) -> float:
        """Half the squares that a fit to `rows` (B, W, C; else the excess) leaves, those of its priors among them."""
        members = TRAINED
        left, strain, _ = self._fit((self.rows if rows is None else rows)[members].ravel(), others, members)
        return 0.5 * float(left @ left + strain @ strain)

    def amount(self, other: Array) -> float:
        """How much of `other` (B, W, C) the best fit takes."""
        _, _, amounts = self._fit(self.rows[TRAINED].ravel(), other[None], TRAINED)
        return float(amounts[0])

    def _fit(self, rows: Array, others: Array | None, members: slice) -> tuple[Array, Array, Array]:
        """Rows and priors left over, in std, and the amounts of the others."""
        unknown = self.unknown[:, members].reshape(len(self.unknown), rows.size).T
        free = np.zeros((rows.size, 0)) if others is None else others[:, members].reshape(len(others), -1).T
        scale = np.maximum(np.linalg.norm(free, axis=0), 1e-30)
        design = np.hstack([unknown, free / scale])
        if design.shape[1] == 0:
            return rows, self.offset, np.zeros(0)
        prior = np.hstack([np.eye(unknown.shape[1]), np.zeros((unknown.shape[1], free.shape[1]))])
        fit, *_ = np.linalg.lstsq(np.vstack([design, prior]), np.concatenate([rows, self.offset]), rcond=1e-10)
        return rows - design @ fit, self.offset - prior @ fit, fit[unknown.shape[1] :] / scale


def offsets(entries: Sequence[Mapping[str, object]], values: Mapping[str, float]) -> Array:
    """True unknown parameters (P,) from their priors' means, in prior std; `values` as in a truth."""
    far = [(true_value(entry, values) - float(entry["mean"])) / float(entry["std"]) for entry in entries]  # type: ignore[arg-type]
    return np.array(far)


def true_value(entry: Mapping[str, object], values: Mapping[str, float]) -> float:
    """Of an unknown parameter; a contact's stand under their names alone."""
    name = str(entry["parameter"])
    place = entry.get("body", entry.get("joint"))
    return float(values[name if place is None else f"{name}.{place}"])


@dataclass(frozen=True)
class Alternative:
    """Another explanation: its name and place, its whitened regressors (Q, B, W, C) and number of parameters."""

    effect: str
    at: str
    regressors: Array
    parameters: int


def strength(
    excess: Excess, channels: Sequence[str] | None, interval: tuple[float, float] | None, member: int | None
) -> dict[str, object]:
    """Per channel and of the affected one: mean square of the remaining rows, and whether that is clear.

    A pulse is judged in its own recording and interval, and must add up to 100 besides.
    """
    left = excess.remaining()
    per = {name: float(np.mean(left[:, :, i] ** 2)) for i, name in enumerate(excess.channels)}
    names = [name for name in (channels or excess.channels) if name in per]
    total = max(float(np.sum(left[:, :, excess.channels.index(name)] ** 2)) for name in names)
    value = max(per[name] for name in names)
    if interval is not None and member is not None:
        inside = (excess.centres[member] > interval[0] - 0.02) & (excess.centres[member] < interval[1] + 0.02)
        squares = left[member][inside] ** 2
        value = float(squares.mean(axis=0).max()) if len(squares) else 0.0
        total = float(squares.sum(axis=0).max()) if len(squares) else 0.0
        return {"value": value, "total": total, "clear": bool(value >= CLEAR and total >= 100.0), "channels": per}
    return {"value": value, "total": total, "clear": bool(value >= CLEAR), "channels": per}


@dataclass(frozen=True)
class Leftovers:
    """Half the squares, beyond those of the truth, that are left by the nominal model and by each rival (name, place).

    `count` rows and prior rows are compared; each rival stands with its number of parameters.
    """

    nominal: float
    rivals: Sequence[tuple[tuple[str, str], int, float]]
    count: int

    @classmethod
    def of(
        cls,
        excess: Excess,
        rivals: Sequence[Alternative],
        same: Sequence[Alternative] = (),
        beside: Array | None = None,
    ) -> Leftovers:
        """`same` are looks at the truth itself, whose own strengths may relieve the priors.

        `beside` (Q, B, W, C) is fitted with every explanation.
        """
        silent = np.zeros_like(excess.rows)
        own_looks = [alternative.regressors for alternative in same] if len(excess.unknown) else []
        truth = min(excess.cost(_joined(beside, look), silent) for look in (None, *own_looks))
        left = [
            ((it.effect, it.at), it.parameters, excess.cost(_joined(beside, it.regressors)) - truth) for it in rivals
        ]
        return cls(excess.cost(beside) - truth, left, excess.rows[TRAINED].size)

    def sigmas(self, own: int) -> dict[str, object]:
        """How many standard deviations of all rows the effect is away from nothing, and from its nearest rival.

        Rivals with more than the truth's `own` parameters do not count: laws that contain it would all be at zero.
        """
        least = min((left for _, parameters, left in self.rivals if parameters <= own), default=self.nominal)
        names = (("sigma", self.nominal), ("sigma_beside_rival", min(least, self.nominal)))
        return {name: float(np.sqrt(2.0 * max(left, 0.0))) for name, left in names}

    def acceptable(self, own: int) -> list[dict[str, object]]:
        """Explanations whose expected log Bayes factor against the truth is under 3; for faint effects `none` is one.

        The truth has `own` parameters.
        """
        nominal = self.nominal - 0.5 * own * np.log(self.count)
        if nominal < ACCEPT:
            return [{"effect": "none", "at": "", "log_bayes_factor": float(nominal)}]
        found: dict[tuple[str, str], float] = {}
        for name, parameters, left in self.rivals:
            factor = left + 0.5 * (parameters - own) * np.log(self.count)
            if factor < ACCEPT:
                found[name] = min(float(factor), found.get(name, np.inf))
        return [{"effect": effect, "at": at, "log_bayes_factor": factor} for (effect, at), factor in found.items()]


def _joined(first: Array | None, second: Array | None) -> Array | None:
    parts = [part for part in (first, second) if part is not None]
    return np.concatenate(parts) if parts else None


def secant(excess: Excess, change: Callable[[float], Array], first: float, rounds: int = 3) -> Array:
    """Rows (B, W, C) a unit of one strength, taken over as much of it as explains the excess best.

    A surface, or the encoder that tells its depth, moved by half the depth is not twice one moved by a quarter.
    """
    rows = change(first) / first
    for _ in range(rounds):
        best = excess.amount(rows)
        if not np.isfinite(best) or abs(best) < abs(first):
            return rows
        rows = change(best) / best
    return rows


class Rows(Protocol):
    """What a rig's case is reckoned by."""

    effects: tuple[Concealed, ...]

    def excess(self) -> Excess: ...
    def shown_in(self, item: Concealed) -> list[str] | None: ...
    def alternatives(self, item: Concealed, excess: Excess) -> list[Alternative]: ...


def reckoned(rows: Rows, excess: Excess, beside: tuple[Concealed, Array] | None = None) -> dict[str, object]:
    """Strength of each of the effects, and of one alone the acceptable other names; sealed with the truth.

    `beside` is the other effect of a pair and the rows (B, W, C) that it leaves by itself.
    """
    told = []
    for item in rows.effects:
        member = RECORDINGS.index(item.recording) if item.recording else None
        told.append(strength(excess, rows.shown_in(item), item.interval, member))
    result: dict[str, object] = {"strengths": told, "accept": []}
    if len(rows.effects) == 1 and not rows.effects[0].effect.startswith("odd_"):
        own, left = len(rows.effects[0].parameters), _leftovers(rows, excess, beside)
        result = {"strengths": [told[0] | left.sigmas(own)], "accept": left.acceptable(own)}
    return result


def _leftovers(rows: Rows, excess: Excess, beside: tuple[Concealed, Array] | None) -> Leftovers:
    own = rows.effects[0]
    looks = rows.alternatives(own, excess)
    taken, fitted = {(own.effect, own.at)}, None
    if beside is not None:
        other, footprint = beside
        taken |= {(other.effect, other.at)}
        fitted = _fitted_beside(rows.alternatives(other, excess), other, footprint, excess)
    same = [look for look in looks if (look.effect, look.at) == (own.effect, own.at)]
    rivals = [look for look in looks if (look.effect, look.at) not in taken]
    return Leftovers.of(excess, rivals, same, fitted)


def _fitted_beside(looks: Sequence[Alternative], other: Concealed, footprint: Array, excess: Excess) -> Array:
    """Regressors (Q, B, W, C) of a pair's other effect: what it leaves by itself, and the look that is most like it."""
    # Tosses of a pair need not last alike.
    left = np.zeros_like(excess.rows)
    windows = min(left.shape[1], footprint.shape[1])
    left[:, :windows] = footprint[:, :windows]
    alike = [look for look in looks if (look.effect, look.at) == (other.effect, other.at)]
    best = min(alike, key=lambda look: excess.cost(look.regressors, left), default=None)
    return left[None] if best is None else np.concatenate([left[None], best.regressors])
