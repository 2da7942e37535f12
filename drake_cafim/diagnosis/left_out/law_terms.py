"""Candidate terms of a learned law at one joint: penalized B-splines of position, velocity and both, and one memory.

A spline of cubic pieces on even knots, its first differences penalized (Eilers, Marx, Statist. Sci. 11(2), 1996), so
that it is flat where no recording leads; with second differences it would go on along a slope that noise gave it. The
term of velocity has the smoothed sign tanh(v/w) beside its spline, which a step at v = 0 needs; that of position and
direction is a spline of position times that sign. The term of memory lets dry friction build up over a displacement
after the motion turns round (`effects.bristle`), where a smoothed sign has all of it at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import BSpline

from drake_cafim.effects.bristle import bristle_along
from drake_cafim.effects.joint import SLIP_VELOCITY, SLIPS, JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.learned_force import MEMORY, POSITION, SIDED, SPEED, Term
from drake_cafim.typing import Array

DEGREE, PIECES = 3, 24
POINTS = 241
"""Points of a table over the range that was recorded."""
LEAST_RANGE = 1e-6
"""rad (m) or rad/s (m/s): a joint that moves less than that has no law."""
NEAR_ZERO = 3.0
"""Widths of the smoothed sign to either side of v = 0 over which a table is finer."""
WIDTH_SHARE = 0.02
"""Width w over the largest speed, of 95 % of the time, that was recorded; not below that of Coulomb friction."""


@dataclass(frozen=True)
class Candidate:
    """One term at one joint: its columns and their penalty, over the range of its variable.

    Of the term of memory both ends of the range are the displacement over which friction builds up.
    """

    variables: str
    lower: float
    upper: float
    width: float

    @property
    def penalty(self) -> Array:
        """(c, c) Σ of squared first differences of the spline's coefficients."""
        splines = PIECES + DEGREE
        if self.variables == MEMORY:
            return np.zeros((1, 1))
        rises = np.diff(np.eye(splines), axis=0)
        whole = np.zeros((self.count, self.count))
        whole[:splines, :splines] = rises.T @ rises
        return whole

    @property
    def count(self) -> int:
        """The number of columns."""
        return 1 if self.variables == MEMORY else PIECES + DEGREE + (self.variables == SPEED)

    def columns(self, joint: JointSamples) -> Array:
        """(N, c) forces at the samples by each coefficient, of one recording's samples in order."""
        if self.variables == POSITION:
            return self._splines(joint.q)
        sign = joint.sign(self.width).value[:, None]
        if self.variables == MEMORY:
            return bristle_along(joint.q, self.lower)[:, None] - sign
        if self.variables == SPEED:
            return np.concatenate([self._splines(joint.v), sign], axis=1)
        return self._splines(joint.q) * sign

    def term(self, coefficients: Array) -> Term:
        """The table of the term with these `coefficients` (c,)."""
        if self.variables == MEMORY:
            return Term(MEMORY, (self.lower,), (float(coefficients[0]),), self.width)
        x = np.linspace(self.lower, self.upper, POINTS)
        if self.variables == SPEED:
            near = self.width * np.linspace(-NEAR_ZERO, NEAR_ZERO, POINTS)
            x = np.unique(np.concatenate([x, near[(near > self.lower) & (near < self.upper)]]))
            force = self._splines(x) @ coefficients[:-1] + coefficients[-1] * np.tanh(x / self.width)
        else:
            force = self._splines(x) @ coefficients
        width = self.width if self.variables == SIDED else 0.0
        return Term(self.variables, tuple(map(float, x)), tuple(map(float, force)), width)

    def _splines(self, x: Array) -> Array:
        """(N, PIECES + DEGREE) B-splines at `x` (N,), constant beyond the range."""
        step = (self.upper - self.lower) / PIECES
        knots = self.lower + step * np.arange(-DEGREE, PIECES + DEGREE + 1)
        # at the last knot itself no piece begins
        inside = np.clip(x, self.lower, self.upper - 1e-9 * step)
        return np.asarray(BSpline.design_matrix(inside, knots, DEGREE).toarray(), dtype=float)


def candidates(recorded: Sequence[JointSamples], dry: JointForce | None = None) -> list[Candidate]:
    """The terms that the recordings of a joint allow; none where it hardly moves.

    The memory is of the `dry` friction that is known there, with its width w, and builds up once.
    """
    q, v = (np.concatenate([getattr(part, name) for part in recorded]) for name in ("q", "v"))
    if np.ptp(q) < LEAST_RANGE or np.ptp(v) < LEAST_RANGE:
        return []
    width = max(SLIP_VELOCITY.nominal, WIDTH_SHARE * float(np.quantile(np.abs(v), 0.95)))
    ranges = {POSITION: q, SPEED: v, SIDED: q}
    found = [Candidate(name, float(x.min()), float(x.max()), width) for name, x in ranges.items()]
    if dry is not None and dry.slip is not None:
        return found
    sliding = width if dry is None else dry.values.get(SLIP_VELOCITY.name, SLIP_VELOCITY.nominal)
    return [*found, *(Candidate(MEMORY, slip, slip, sliding) for slip in SLIPS if slip < np.ptp(q))]


def with_steps_in_one_term(terms: Sequence[Term]) -> list[Term]:
    """The terms with the same sum, where the mean force against or along the motion is all in the term of velocity.

    A step at v = 0 there and a mean of the term of position and direction are the same force: fitted together, they
    may be large and cancel, and what each looks like would mean nothing.
    """
    sided = next((term for term in terms if term.variables == SIDED), None)
    if sided is None or not any(term.variables == SPEED for term in terms):
        return list(terms)
    mean = float(trapezoid(sided.force, sided.x)) / (sided.x[-1] - sided.x[0])
    moved = []
    for term in terms:
        force = np.array(term.force)
        if term.variables == SPEED:
            force = force + mean * np.tanh(np.array(term.x) / sided.width)
        elif term is sided:
            force = force - mean
        moved.append(replace(term, force=tuple(map(float, force))))
    return moved
