"""A force at a joint as a table of what was learned, without a name: terms of position, velocity and one memory."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from drake_cafim.effects.effect import Start, Strength
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.typing import Array

POSITION, SPEED, SIDED, MEMORY = "q", "v", "q, sign v", "memory"
TERMS = (POSITION, SPEED, SIDED, MEMORY)


def table_name(joint: str) -> str:
    """The name of the file for the law of a joint."""
    return f"{re.sub(r'[^A-Za-z0-9_.-]', '_', joint)}_law.parquet"


@dataclass(frozen=True)
class Term:
    """A piecewise linear function: `force` (K,) N m or N at the increasing places `x` (K,); constant beyond its ends.

    Of `variables` "q" it is f(q), of "v" f(v), of "q, sign v" f(q)·tanh(v/width), with x in rad, rad/s (m, m/s). Of
    "memory" it is f·(z − tanh(v/width)) with ż = (v − |v| z)/s, see `effects.bristle`, and x is s, rad (m), alone.
    """

    variables: str
    x: tuple[float, ...]
    force: tuple[float, ...]
    width: float = 0.0
    """rad/s (m/s), of "q, sign v" and "memory"; 0 of the others."""

    def at(self, values: Array) -> tuple[Array, Array]:
        """The function and its slope at `values` (N,)."""
        x, force = np.array(self.x), np.array(self.force)
        slopes = np.append(np.diff(force) / np.diff(x), 0.0) if len(x) > 1 else np.zeros(1)
        piece = np.clip(np.searchsorted(x, values, side="right") - 1, 0, len(x) - 1)
        inside = (values >= x[0]) & (values <= x[-1])
        return np.interp(values, x, force), np.where(inside, slopes[piece], 0.0)


@dataclass(frozen=True)
class LearnedForce(JointForce):
    """Σ f(q) + f(v) + f(q)·tanh(v/w) + f·(z − tanh(v/w)), each f a table, the last a number."""

    terms: tuple[Term, ...] = ()
    table: str = ""
    """Name of the file that a scenario reads the terms from."""

    name: ClassVar[str] = "learned_force"
    strengths: ClassVar[tuple[Strength, ...]] = ()
    reference: ClassVar[str] = "Eilers, Marx, Statist. Sci. 11(2), 1996 (penalized B-splines)"
    words: ClassVar[str] = "is what remains at the joint, as a table, without a name"

    @property
    def law_table(self) -> Mapping[str, Sequence[float | str]]:
        """`variables`, `x` rad or rad/s (m, m/s), `force` N m (N) and `width` rad/s (m/s), a row a point."""
        points = [(term, x, force) for term in self.terms for x, force in zip(term.x, term.force, strict=True)]
        return {
            "variables": [term.variables for term, _, _ in points],
            "x": [x for _, x, _ in points],
            "force": [force for _, _, force in points],
            "width": [term.width for term, _, _ in points],
        }

    @property
    def slip(self) -> float | None:
        return next((term.x[0] for term in self.terms if term.variables == MEMORY), None)

    @property
    def built_up(self) -> float:
        return -sum(term.force[0] for term in self.terms if term.variables == MEMORY)

    def with_values(self, values: Mapping[str, float] | Array) -> Self:
        """Itself: it has no strengths."""
        return self

    def force(self, joint: JointSamples) -> Force:
        value, by_q, by_v = (np.zeros_like(joint.v) for _ in range(3))
        for term in self.terms:
            if term.variables == SPEED:
                own, slope = term.at(joint.v)
                value, by_v = value + own, by_v + slope
            elif term.variables == POSITION:
                own, slope = term.at(joint.q)
                value, by_q = value + own, by_q + slope
            elif term.variables == MEMORY:
                bent = joint.bent(term.x[0])
                if bent is None:
                    # with nothing known of the past, sliding is what is most probable, where z is the sign
                    continue
                sign = joint.sign(term.width)
                value = value + term.force[0] * (bent - sign.value)
                by_v = by_v - term.force[0] * sign.by_v
            else:
                (own, slope), sign = term.at(joint.q), joint.sign(term.width)
                value = value + own * sign.value
                by_q, by_v = by_q + slope * sign.value, by_v + own * sign.by_v
        return Force(value, by_q, by_v, np.zeros_like(value), np.zeros((len(value), 0)))

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        """None: it is no hypothesis of a search."""
        yield from ()

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> Self:
        """Itself: it has no coefficients."""
        return self

    def in_file(self, table: str) -> Self:
        """The same force, its terms in the file of that name."""
        changes: dict[str, Any] = {"table": table}
        return replace(self, **changes)
