"""Prints how near the diagnosis' fits come to the Cramér–Rao bound, a line a cell.

    python -m tests.benchmarks.efficiency [--draws 200] [--short] [--out cafim-out/efficiency] [--beside DIR] [WORD ...]

Each cell is a machine with one effect, simulated by a maker that is not Drake and recorded with noise, again and again.
The effect's strength and the scenario's unknowns are refitted, as a diagnosis fits an effect that it has named but
without the search. Efficiency is the inverse mean squared error over the information of the bound; honesty the stated
standard deviation over the true scatter. Both have 99 % bootstrap intervals.

What was finished stands in the folder and is not done again, whatever the code that did it; `--beside` names the folder
of another version's run, whose figures are printed beside these. `--short` takes 30 draws, about ten minutes. WORDs
choose the cells whose names contain one of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from drake_cafim.cli import progress_line

from .catalogue import CELLS
from .measure import Line, kept, line_of, measured

LEAST_MEDIAN, LEAST, HONEST = 0.8, 0.5, (0.85, 1.15)
"""What the issue asks for: the median efficiency, what no interval may lie below, and what each honesty must meet."""
SHORT = 30


def told(name: str, line: Line, std: float, segments: int, bend: float, before: Line | None) -> str:
    low, high = line.efficiency_interval
    small, large = line.honesty_interval
    near = "ok" if high >= LEAST else "LOW"
    honest = "ok" if large >= HONEST[0] and small <= HONEST[1] else "OFF"
    cells = [
        f"{name:40}{std:10.2g}{segments:5d}{bend:7.2g}",
        f"{line.efficiency:8.2g} [{low:.2g}, {high:.2g}]".ljust(26) + f"{near:4}",
        f"{line.honesty:7.2f} [{small:.2f}, {large:.2f}]".ljust(24) + f"{honest:4}",
        f"{line.bias:6.1f}{line.reduced_chi_square:8.3f}{line.failed:6d}{line.seconds:7.2f}",
    ]
    if before is not None:
        cells.append(f"{before.efficiency:8.2g}{before.honesty:7.2f}")
    return " ".join(cells)


HEADER = (
    f"{'cell':40}{'bound σ':>10}{'cuts':>5}{'bend':>7} {'efficiency [99 %]':30} {'honesty [99 %]':28}"
    f"{'bias':>6}{'χ²/dof':>9}{'failed':>6}{'s':>7}"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--short", action="store_true")
    parser.add_argument(
        "--rows", action="store_true", help="Fit whitened rows alone, as a search does; give another --out."
    )
    parser.add_argument("--out", type=Path, default=Path("cafim-out/efficiency"))
    parser.add_argument("--beside", type=Path)
    arguments = parser.parse_args()
    draws = SHORT if arguments.short else arguments.draws
    cells = [c for c in CELLS if not arguments.words or any(word in c.name for word in arguments.words)]
    print(HEADER + ("   before: eff., hon." if arguments.beside else ""), flush=True)
    lines = []
    for cell in cells:
        with progress_line() as progress:
            bound, found = measured(cell, draws, arguments.out, progress, not arguments.rows)
        before = None
        if arguments.beside and (other := kept(cell, arguments.beside)):
            before = line_of(cell, bound, list(other.values()))
        lines.append(line_of(cell, bound, found))
        std = float(bound.std[len(cell.unknown)])
        print(told(cell.name, lines[-1], std, bound.segments, bound.bend, before), flush=True)
    median = float(np.median([line.efficiency for line in lines]))
    below = sum(line.efficiency_interval[1] < LEAST for line in lines)
    off = sum(line.honesty_interval[1] < HONEST[0] or line.honesty_interval[0] > HONEST[1] for line in lines)
    print(
        f"{len(lines)} cells of {draws} draws: median efficiency {median:.2g} (asked for: ≥ {LEAST_MEDIAN}); "
        f"intervals below {LEAST}: {below} (0); honesty outside {HONEST[0]} to {HONEST[1]}: {off} (0)"
    )


if __name__ == "__main__":
    main()
