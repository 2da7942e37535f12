"""The planner interface: from a nominal spline and a score of command sequences to an improved spline."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, get_args

import numpy as np

from drake_cafim.design.splines import sample
from drake_cafim.typing import Array

PlannerName: TypeAlias = Literal["predictive-sampling", "cem", "mppi", "gradient"]
PLANNERS: tuple[str, ...] = get_args(PlannerName)


@dataclass(frozen=True)
class PlannerConfig:
    """Parameters of all planners; the defaults are the paper's where it states them."""

    candidates: int = 10  # rollouts a planning step, paper
    horizon: int = 10  # steps, paper
    knots: int = 4
    knot_std: float = 1.0  # m/s, paper
    iterations: int = 2  # of cem and mppi; the rollouts are divided among them
    elites: float = 0.4  # fraction kept by cem
    temperature: float = 0.1  # of mppi, in units of the score's spread
    gradient_step: float = 0.3  # m/s, longest step of gradient ascent


@dataclass(frozen=True)
class Scored:
    """Scores (N,) of candidates, larger is better, and the Fisher information (N, n, n) that each would bring."""

    scores: Array
    fisher: Array


Score: TypeAlias = Callable[[Array], Scored]
"""From commands (N, H, nu) to their scores."""


@dataclass(frozen=True)
class Plan:
    """The chosen knots (K, nu) and commands (H, nu), the Fisher information (n, n) they promise, and all candidates."""

    knots: Array
    commands: Array
    fisher: Array
    candidates: Array  # (N, H, nu)
    scores: Array  # (N,)


class Planner(Protocol):
    """A planner; `nominal` is (K, nu), the bounds (nu,)."""

    @property
    def config(self) -> PlannerConfig:
        """Its numbers."""
        ...

    def rollouts(self, numbers: int) -> int:
        """How many command sequences are scored in a planning step whose knots hold `numbers` numbers, K nu."""
        ...

    def __call__(self, nominal: Array, score: Score, bounds: tuple[Array, Array], random: np.random.Generator) -> Plan:
        """The best spline found."""
        ...


def candidate_commands(knots: Array, horizon: int, bounds: tuple[Array, Array]) -> Array:
    """Commands (N, H, nu) of knots (N, K, nu) within bounds: a cubic overshoots its knots, so it is clamped again."""
    return np.asarray(np.clip(sample(knots, horizon), *bounds))


def around(
    nominal: Array, count: int, std: float | Array, bounds: tuple[Array, Array], random: np.random.Generator
) -> Array:
    """Knots (count, K, nu): the nominal first, then Gaussian ones about it; clamped to bounds."""
    knots = np.repeat(nominal[np.newaxis], count, axis=0)
    knots[1:] += std * random.standard_normal(knots[1:].shape)
    return np.asarray(np.clip(knots, *bounds))


def best_index(scores: Array, random: np.random.Generator) -> int:
    """Index of the greatest score, ties broken at random: keeping the nominal would never leave a plateau."""
    best = np.flatnonzero(scores == scores.max())
    return int(best[0] if len(best) == 1 else random.choice(best))
