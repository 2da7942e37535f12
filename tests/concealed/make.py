"""`python -m tests.concealed.make --kind KIND --rig RIG --seed S --out DIR`: one case, its truth beside the folder.

KIND: null | single:<effect> | pair | pair:<effect>,<effect> | odd | odd:<name> | many.
RIG: arm2 to arm7 | press | toss; of many, an arm; of null and single also served2 | served3.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from .arm_case import make_arm
from .case import Case, write_truth
from .press_case import make_press
from .served_case import RIGS as SERVED_RIGS
from .served_case import make_served
from .strength import Excess, Rows, reckoned
from .strength_arm import ArmRows
from .strength_many import reckoned_many
from .strength_press import PressRows
from .strength_toss import TossRows
from .toss_case import make_toss

RIGS = ("arm2", "arm3", "arm4", "arm5", "arm6", "arm7", "press", "toss", *SERVED_RIGS)
_ATTEMPTS = 6


def seed_number(seed: str) -> int:
    """Seeds are decimal numbers or 0x-prefixed hexadecimal ones."""
    return int(seed, 0)


def simulate(kind: str, rig: str, seed: int, attempt: int = 0, only: int | None = None) -> Case:
    """The case of this kind, rig and seed, its strength not yet reckoned; `only` conceals one of a pair."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(attempt,)))
    if rig == "press":
        return make_press(rng, kind, only)
    if rig == "toss":
        return make_toss(rng, kind, only)
    if rig in SERVED_RIGS:
        return make_served(rng, int(rig.removeprefix("served")), kind)
    if rig in RIGS:
        return make_arm(rng, int(rig[3:]), kind, only)
    raise ValueError(f"rig {rig!r}: expected one of {', '.join(RIGS)}")


def studied(case: Case) -> Case:
    """The case with strengths and acceptable other names in its truth."""
    return replace(case, truth=case.truth | reckoned(*seen_in(case)), study={})


def seen_in(case: Case) -> tuple[Rows, Excess]:
    """Rows of a case that still has its study, and what its effects leave in them."""
    kinds: dict[str, type[PressRows] | type[TossRows]] = {"press": PressRows, "toss": TossRows}
    rows: Rows = kinds[case.rig](case) if case.rig in kinds else ArmRows(case)
    return rows, rows.excess()


def paired(case: Case, alone: list[Case]) -> Case:
    """A pair's case with strengths and acceptable other names in its truth, from those of each of the two by itself.

    In a common channel one would lend the other its strength; for its names the other is fitted beside.
    """
    seen = [seen_in(single) for single in alone]
    names, strengths = [], []
    for own, (rows, excess) in enumerate(seen):
        others, left = seen[1 - own]
        told = reckoned(rows, excess, (others.effects[0], left.rows))
        # With the other one in it, a motion may not come to where an effect is.
        seen_at_all = leaves_a_trace(case, alone[1 - own])
        strengths += [item | {"clear": item["clear"] and seen_at_all} for item in told["strengths"]]  # type: ignore[attr-defined]
        names += [item | {"of": own} for item in told["accept"]]  # type: ignore[attr-defined]
    return replace(case, truth=case.truth | {"strengths": strengths, "accept": names}, study={})


def make(kind: str, rig: str, seed: int) -> Case:
    """The case of this kind, rig and seed; always the same one.

    An oddity too faint to be seen is drawn again, and so is a world that ran away from its controller.
    """
    for attempt in range(_ATTEMPTS):
        case = simulate(kind, rig, seed, attempt)
        if not calm(case):
            continue
        if kind.startswith("pair"):
            return paired(case, [simulate(kind, rig, seed, attempt, only) for only in (0, 1)])
        if kind == "many":
            return replace(case, truth=case.truth | reckoned_many(case), study={})
        case = case if "strengths" in case.truth else studied(case)
        if not kind.startswith("odd") or case.truth["strengths"][0]["clear"]:  # type: ignore[index]
            return case
    if not calm(case):
        raise RuntimeError(f"{kind} on {rig}, seed {seed:#x}: {_ATTEMPTS} worlds ran away")
    return case if "strengths" in case.truth else studied(case)


def leaves_a_trace(both: Case, without: Case) -> bool:
    """Whether what `without` lacks moves a channel that is not held out by more than its noise, which both share."""
    for name, table in both.recordings.items():
        if name.startswith("held"):
            continue
        for column in table.columns.drop("time"):
            values, others = (np.asarray(source[column], dtype=float) for source in (table, without.recordings[name]))
            change = values[: len(others)] - others[: len(values)]
            # fourth differences of white noise are sqrt(70) times as large
            if np.sqrt(np.nanmean(change**2)) > np.nanstd(np.diff(values, 4)) / np.sqrt(70.0):
                return True
    return False


def calm(case: Case) -> bool:
    """Whether the recordings are finite, no joint turned more than about one and a half times and none raced."""
    limits = {"q.": 9.0, "v.": 30.0, "pose.": 9.0}
    for table in case.recordings.values():
        if not np.isfinite(table.to_numpy()).all():
            return False
        for prefix, limit in limits.items():
            moved = [column for column in table if column.startswith(prefix)]
            if moved and np.abs(table[moved].to_numpy()).max() > limit:
                return False
    return True


def told(truth: dict[str, object]) -> str:
    """The truth in one line."""
    effects: list[dict[str, object]] = truth["effects"]  # type: ignore[assignment]
    strengths: list[dict[str, object]] = truth["strengths"]  # type: ignore[assignment]
    lines = [
        f"{item['effect']} at {item['at']} (strength {size['value']:.3g})"
        for item, size in zip(effects, strengths, strict=False)
    ]
    return "; ".join(lines) or "nothing concealed"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.make", description=__doc__)
    parser.add_argument("--kind", default="null")
    parser.add_argument("--rig", default="arm3", choices=RIGS)
    parser.add_argument("--seed", default="1")
    parser.add_argument("--out", type=Path, required=True, help="the case's folder; the truth goes to OUT.truth.json")
    options = parser.parse_args(arguments)
    started = time.perf_counter()
    case = make(options.kind, options.rig, seed_number(options.seed))
    case.write(options.out)
    write_truth(options.out.with_name(options.out.name + ".truth.json"), case.truth)
    print(f"{options.out}: {case.truth['rig']}, {told(case.truth)} ({time.perf_counter() - started:.1f} s)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
