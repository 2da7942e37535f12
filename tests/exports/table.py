"""`python -m tests.exports.table [--seed S] [--out DIR]`: ten public MJCF models, corrected, exported and followed.

Needs their packages, see `make exports`. Each row: how far the exported file's motion over 1 s is from the corrected
scene's in Drake, in Drake and in MuJoCo, and how far the model's was before; all over the motion's size.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from drake_cafim.commands.export import export_command
from drake_cafim.errors import InputError
from tests.descriptions.catalogue import CATALOGUE, Shipped

from .cases import corrected_scenario

NAMES = (
    "dm_control pendulum", "dm_control finger", "dm_control cart-pole", "dm_control reacher", "SO-ARM100, MJCF",
    "robosuite Panda", "robosuite iiwa", "robosuite UR5e", "robosuite Sawyer", "robosuite Kinova3",
)  # fmt: skip
LIMIT = 0.01


def row(shipped: Shipped, seed: int, out: Path) -> tuple[str, bool]:
    """A line of the table, and whether it holds."""
    if shipped.path is None:
        return f"{shipped.name:24} not installed", False
    folder = out / shipped.name.replace(" ", "_").replace(",", "")
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    try:
        path = corrected_scenario(shipped.path, folder, rng, weld=shipped.weld, lock=shipped.lock)
        result = export_command(str(path), "mjcf", None, folder / "exported", lambda text: None)
    except InputError as error:
        return f"{shipped.name:24} {error}", False
    parity = result["parity"]
    moved = "–" if parity["mujoco"] is None else f"{100 * parity['mujoco']:.3f} %"
    told = f"{100 * parity['drake']:8.5f} % {moved:>10} {100 * parity['uncorrected']:9.1f} %"
    lost = len(result["lost"])
    holds = parity["mujoco"] is not None and max(parity["drake"], parity["mujoco"]) < LIMIT and not lost
    return f"{shipped.name:24} {len(result['written']):2} written {lost} lost {told} {parity['why']}", holds


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.exports.table", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", default=NAMES, help="these models")
    parser.add_argument("--out", type=Path, default=Path("cafim-out/exports"))
    options = parser.parse_args(arguments)
    print(f"{'':24} {'':17} {'in Drake':>10} {'in MuJoCo':>10} {'before':>11}")
    good = 0
    for k, name in enumerate(options.only):
        text, holds = row(next(item for item in CATALOGUE if item.name == name), options.seed + k, options.out)
        good += holds
        print(text, flush=True)
    print(f"{good} of {len(options.only)} within {100 * LIMIT:g} % of the motion over 1 s")
    return 0 if good == len(options.only) else 1


if __name__ == "__main__":
    sys.exit(main())
