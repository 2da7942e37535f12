"""Which cases a proof consists of: kinds and rigs by slot."""

from __future__ import annotations

import numpy as np

from .draw_arm import DRAWS
from .draw_contact import ODD_CONTACT
from .odd_arm import DRAWS as ODD_ARM
from .press_case import ON_STAGE
from .served_case import RIGS as SERVED_RIGS
from .served_case import UNITS as SERVED_EFFECTS
from .toss_case import ODD_TOSS, ON_TOSS
from .truth import FAMILY, VOCABULARY

FULL = {"single": 400, "null": 310, "odd": 105, "pair": 105, "many": 230, "served": 290}
MANY_AT_LEAST = 6
ARMS = ("arm2", "arm3", "arm6", "arm7")
EVERY_ARM = ("arm2", "arm3", "arm4", "arm5", "arm6", "arm7")
_ARM_WEIGHTS = (0.25, 0.3, 0.2, 0.25)

Slot = tuple[str, str]  # kind, rig


def rigs_of(effect: str) -> list[str]:
    """Rigs on which an effect can be concealed, arms counted once."""
    rigs = []
    if effect in DRAWS:
        rigs.append("arm")
    if effect in ON_STAGE:
        rigs.append("press")
    if effect in ON_TOSS:
        rigs.append("toss")
    return rigs


def _arm(rng: np.random.Generator) -> str:
    return str(rng.choice(ARMS, p=_ARM_WEIGHTS))


def _single_rig(rng: np.random.Generator, effect: str) -> str:
    rigs = rigs_of(effect)
    # An effect of joints or drives lives on arms; stages and tosses show a few of them too.
    weights = np.array([4.0 if rig == "arm" else 1.0 for rig in rigs])
    if FAMILY[effect] == "contact":
        weights = np.array([2.0 if rig == "press" else 1.0 for rig in rigs])
    if FAMILY[effect] == "sensor":
        weights = np.ones(len(rigs))
    rig = str(rng.choice(rigs, p=weights / weights.sum()))
    return _arm(rng) if rig == "arm" else rig


def _any_rig(rng: np.random.Generator) -> str:
    rig = str(rng.choice(["arm", "press", "toss"], p=[0.6, 0.25, 0.15]))
    return _arm(rng) if rig == "arm" else rig


def counts(size: int) -> dict[str, int]:
    """Numbers of cases a kind: in the proportions of the full proof, at least one of each kind and each family.

    Of cases with many effects, which take as long as ten others, a short form has half as many, yet six from 40 on.
    `served` counts the cases that are commanded by position, whatever they conceal.
    """
    total = sum(FULL.values())
    if size >= 900:
        grown = {kind: max(count, round(size * count / total)) for kind, count in FULL.items()}
        return grown
    shares = {kind: max(1, round(size * count / total)) for kind, count in FULL.items()}
    shares["many"] = max(MANY_AT_LEAST if size >= 40 else 1, round(0.5 * size * FULL["many"] / total))
    others = sum(count for kind, count in shares.items() if kind != "single")
    shares["single"] = max(len({FAMILY[effect] for effect in VOCABULARY}), size - others)
    return shares


def counted_as(slot: Slot) -> str:
    """The key of `counts` under which a slot is: of an arm that is commanded by position, whatever it conceals."""
    kind, rig = slot
    return "served" if rig in SERVED_RIGS else kind.partition(":")[0]


def composition(rng: np.random.Generator, size: int) -> list[Slot]:
    """The slots in random order; single effects go round all families first, so that a short form has them all."""
    number = counts(size)
    slots: list[Slot] = [(f"single:{effect}", _single_rig(rng, effect)) for effect in _round(rng, number["single"])]
    slots += [("null", _any_rig(rng)) for _ in range(number["null"])]
    slots += [_odd(rng, index) for index in range(number["odd"])]
    slots += [("pair", _any_rig(rng)) for _ in range(number["pair"])]
    slots += [("many", str(rng.choice(EVERY_ARM))) for _ in range(number["many"])]
    slots += _served(rng, number["served"])
    return [slots[index] for index in rng.permutation(len(slots))]


def _served(rng: np.random.Generator, count: int) -> list[Slot]:
    """Arms that are commanded by position: a quarter of them nulls, the others go round what these conceal."""
    lap = [f"single:{effect}" for effect in rng.permutation(sorted(SERVED_EFFECTS))]
    kinds = ["null" if index % 4 == 3 else lap[(index - index // 4) % len(lap)] for index in range(count)]
    return [(kind, str(rng.choice(SERVED_RIGS))) for kind in kinds]


def _round(rng: np.random.Generator, count: int) -> list[str]:
    """Effects, each as often as the others; first of all one of each family."""
    families = [
        [effect for effect in VOCABULARY if FAMILY[effect] == family]
        for family in dict.fromkeys(FAMILY[effect] for effect in VOCABULARY)
    ]
    first = [str(rng.choice(family)) for family in families]
    rest = [effect for effect in VOCABULARY if effect not in first]
    lap = first + [rest[index] for index in rng.permutation(len(rest))]
    return [lap[index % len(lap)] for index in range(count)]


def _odd(rng: np.random.Generator, index: int) -> Slot:
    every = (
        [(name, "arm") for name in sorted(ODD_ARM)]
        + [(name, "press") for name in sorted(ODD_CONTACT)]
        + [(name, "toss") for name in sorted(ODD_TOSS)]
    )
    name, rig = every[(5 * index + int(rng.integers(len(every)))) % len(every)]
    return f"odd:{name}", _arm(rng) if rig == "arm" else rig
