"""`python -m tests.concealed.make --kind KIND --rig RIG --seed S --out DIR`: one case, its truth beside the folder.

KIND: null | single:<effect> | pair | pair:<effect>,<effect> | odd | odd:<name>; RIG: arm2 | arm3 | arm6 | arm7 | press | toss.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from .arm_case import make_arm
from .case import Case, write_truth
from .press_case import make_press
from .toss_case import make_toss

RIGS = ("arm2", "arm3", "arm6", "arm7", "press", "toss")


def seed_number(seed: str) -> int:
    """Seeds are decimal numbers or 0x-prefixed hexadecimal ones."""
    return int(seed, 0)


def make(kind: str, rig: str, seed: int) -> Case:
    """The case of this kind, rig and seed; always the same one."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    if rig.startswith("arm"):
        return make_arm(rng, int(rig[3:]), kind)
    if rig == "press":
        return make_press(rng, kind)
    if rig == "toss":
        return make_toss(rng, kind)
    raise ValueError(f"rig {rig!r}: expected one of {', '.join(RIGS)}")


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
    told = "; ".join(f"{item['effect']} at {item['at']}" for item in case.truth["effects"]) or "nothing concealed"  # type: ignore[attr-defined]
    print(f"{options.out}: {case.truth['rig']}, {told} ({time.perf_counter() - started:.1f} s)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
