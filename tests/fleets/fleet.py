"""`python -m tests.fleets.fleet --out DIR`: a sealed fleet, diagnosed as a user would, then opened and scored.

The seed comes from the system's entropy; the truth's salted hash is printed before the diagnosis starts. With
`--cluster` the fleet is diagnosed a second time by a Dask scheduler with two workers, and the tables are compared.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from tests.concealed.seal import Seal, case_seed, fresh_seed

from .cluster import cluster
from .make import accused_healthy, make_fleet, weeks_between


def diagnosed(fleet: Path, out: Path, *options: str) -> tuple[dict[str, object], float]:
    """The command's JSON and its seconds."""
    started = time.perf_counter()
    line = [str(Path(sys.executable).parent / "cafim"), "diagnose", "--fleet", str(fleet), "--out", str(out), "--json"]
    told = subprocess.run([*line, "--overwrite", *options], stdout=subprocess.PIPE, check=True)
    return json.loads(told.stdout), time.perf_counter() - started


def lines(truth: dict[str, object], found: dict[str, object]) -> list[tuple[str, bool, str]]:
    """What is required of the diagnosis: the requirement, whether it holds, what was found."""
    table: list[tuple[str, bool, str]] = []
    changed = {(entry["robot"], entry["effect"], entry["at"]): entry for entry in found["changed"]}  # type: ignore[attr-defined]
    for key in ("drifts", "lost"):
        true: dict[str, object] = truth[key]  # type: ignore[assignment]
        name = f"{true['effect']} at {true['at']} of {true['robot']}"
        entry = changed.get((true["robot"], true["effect"], true["at"]))
        table.append((f"{name} is told to have changed", entry is not None, entry["course"] if entry else "not told"))
        if entry is None:
            continue
        off = weeks_between(str(true["from"]), str(entry["onset"]))
        table.append((f"its start, {true['from']}, within a week", abs(off) <= 1.0, f"{str(entry['onset'])[:10]}"))
        if key == "drifts":
            drift = entry["drift_per_week"] or {"value": float("nan"), "interval": 0.0}
            inside = abs(drift["value"] - float(str(true["slope_per_week"]))) <= drift["interval"]
            what = f"{drift['value']:.4f} ± {drift['interval']:.4f} a week"
            table.append((f"its drift of {true['slope_per_week']:.4f} a week in the interval", inside, what))
        else:
            low = abs(entry["now"]["value"] - float(str(true["gain"]))) <= 1.96 * entry["now"]["std"]
            what = f"{entry['now']['value']:.4f} ± {1.96 * entry['now']['std']:.4f}"
            table.append((f"its gain of {true['gain']:.4f} in the interval", low, what))
    accused = accused_healthy(truth, found["accused"])  # type: ignore[arg-type]
    table.append(("no healthy robot is accused", not accused, ", ".join(accused) or "none"))
    failed = sorted(item["folder"] for item in found["failed"])  # type: ignore[attr-defined]
    table.append(("the broken files, and no others, are told", failed == truth["broken"], ", ".join(failed)))
    return table


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fleets.fleet", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/fleet"))
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--weeks", type=int, default=10)
    parser.add_argument("--duration", type=float, default=3.0, help="s of a recording")
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--cluster", action="store_true", help="diagnose it on a Dask cluster too, and compare")
    parser.add_argument("--seed", help="for debugging only; it is told")
    options = parser.parse_args(arguments)
    shutil.rmtree(options.out / "fleet", ignore_errors=True)
    options.out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(case_seed(options.seed or fresh_seed(), 0))
    started = time.perf_counter()
    truth = make_fleet(options.out / "fleet", rng, options.robots, options.weeks, options.duration)
    seal = Seal.close(truth)
    print(f"{options.robots * options.weeks} recordings in {time.perf_counter() - started:.0f} s", flush=True)
    print(f"sealed {seal.digest}" + (f", seed {options.seed}" if options.seed else ""), flush=True)
    found, seconds = diagnosed(options.out / "fleet", options.out / "processes", "--jobs", str(options.jobs))
    print(f"diagnosed in {seconds:.0f} s", flush=True)
    (options.out / "truth.json").write_text(json.dumps({"salt": seal.salt, "digest": seal.digest} | truth, indent=1))
    table = lines(seal.truth, found)
    if options.cluster:
        with cluster() as dask:
            _, seconds = diagnosed(options.out / "fleet", options.out / "dask", "--scheduler", dask.address)
        print(f"diagnosed on the cluster in {seconds:.0f} s", flush=True)
        tables = [(options.out / name / "fleet.parquet").read_bytes() for name in ("processes", "dask")]
        table.append(("the same table on processes and on the cluster", tables[0] == tables[1], f"{len(tables[0])} B"))
    for what, holds, how in table:
        print(f"{'holds' if holds else 'FAILS':6} {what}: {how}")
    print(options.out / "processes" / "fleet.html")
    return 0 if all(holds for _, holds, _ in table) else 1


if __name__ == "__main__":
    sys.exit(main())
