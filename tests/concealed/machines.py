"""The seven real machines: which recordings are learnt from and held out, and how their blocks are divided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from .ablation import Machine

BLOCKS = 4
"""Number of blocks of a recording that a null divides between its two sides."""


@dataclass(frozen=True)
class RealSet:
    """A folder of the sets, the recordings to learn from and held out, and what publications add to its scenario."""

    folder: str
    train: Sequence[str]
    held: Sequence[str]
    published: Mapping[str, Any] | None = None
    """Further channels of the scenario: what the set's README knows and its scenario does not say."""

    hidden: tuple[str, ...] = ()
    """Kinds of alteration that its motion cannot show, or that are others there."""

    @property
    def thrown(self) -> bool:
        """Whether it is a thrown body, of which recordings are never cut."""
        return self.folder == "cube_toss"


_KUKA = {"order": 6, "cutoff": 2.0, "zero_phase": True}
SETS: Mapping[str, RealSet] = {
    item.folder: item
    for item in (
        RealSet(
            "emps_drive",
            ("ident_0", "ident_1"),
            ("ident_2",),
            # a level drive has no place that it knows; what rides on it is its own mass, and a tilt is a bias
            hidden=("position bias", "drift", "payload", "gravity"),
        ),
        RealSet("simple_pendulum", ("dircol", "energy"), ("ilqr",)),
        RealSet("double_pendulum_A0", ("trajectory_00", "trajectory_02", "trajectory_04"), ("trajectory_03",)),
        RealSet("double_pendulum_C1", ("20230629_143339", "20230629_143524", "20230629_143601"), ("20230629_143704",)),
        RealSet(
            "kuka_lwr4",
            ("measurements_1", "measurements_2"),
            ("measurements_3",),
            {"v": {"lowpass": _KUKA}, "u": {"hold": "first_order", "lowpass": _KUKA}},
        ),
        RealSet("panda_gaz2019", ("part_0", "part_1", "part_2", "part_3"), ("part_4",)),
        RealSet("cube_toss", ("toss_000", "toss_027", "toss_054", "toss_081", "toss_108", "toss_136"), ("toss_164",)),
    )
}
"""The machines by name."""


def raw_machine(data: Path, name: str) -> Machine:
    """A set as it was published."""
    own, folder = SETS[name], data / name
    scenario = yaml.safe_load((folder / "scenario.yaml").read_text())
    if own.published:
        scenario["channels"] = scenario["channels"] | dict(own.published)
    names = [f"train_{k}.parquet" for k in range(len(own.train))] + [f"held_{k}.parquet" for k in range(len(own.held))]
    tables = {
        alias: pd.read_parquet(folder / "runs" / f"{run}.parquet")
        for alias, run in zip(names, (*own.train, *own.held), strict=True)
    }
    return Machine(scenario, (folder / str(scenario["model"])).read_text(), tables)


def divided(machine: Machine, thrown: bool, rng: np.random.Generator) -> tuple[Machine, Machine]:
    """The machine with one half of its blocks, and with the other, drawn by `rng`; each block is a recording."""
    blocks = [block for table in machine.tables.values() for block in ([table] if thrown else _blocks(table))]
    order = rng.permutation(len(blocks))
    sides = []
    for half in (order[::2], order[1::2]):
        tables = {f"train_{k}.parquet": blocks[i].reset_index(drop=True) for k, i in enumerate(sorted(half))}
        sides.append(replace(machine, tables=tables))
    return sides[0], sides[1]


def _blocks(table: pd.DataFrame) -> list[pd.DataFrame]:
    edges = np.linspace(0, len(table), BLOCKS + 1).astype(int)
    return [table.iloc[start:stop] for start, stop in pairwise(edges)]
