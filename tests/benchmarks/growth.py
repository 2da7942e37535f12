"""`python -m tests.benchmarks.growth [--short]`: how a diagnosis grows with samples, joints, recordings.

Arms that MuJoCo simulates are diagnosed with all hypotheses: with nothing missing, and with viscous friction in one
joint. Each diagnosis runs in a process forked from one that holds the imports alone; it loads the compiled functions by
a small diagnosis first, and its peak is its own, above what was resident before. Time is that of the processor. The
exponents are slopes of straight lines through the logarithms: 1 is linear growth, less than 1 that plus a constant.
"""

from __future__ import annotations

import argparse
import ctypes
import multiprocessing
import re
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.scene.scene import Scene
from tests.concealed import arm_case, make

EFFECTS = ("null", "single:joint_viscous_friction")
RATE = 1000.0
"""Hz of the recordings."""


@dataclass(frozen=True)
class Size:
    """What is diagnosed: `joints` of the arm, `recordings`, and `seconds` of each."""

    joints: int
    recordings: int
    seconds: float


@dataclass(frozen=True)
class Cost:
    """What it took: processor and wall time, s, peak memory above what was resident before, MiB."""

    cpu: float
    wall: float
    memory: float
    hypotheses: int
    verdict: str


def sizes(short: bool) -> dict[str, tuple[Size, ...]]:
    """The sizes by what grows in them."""
    lengths = (5.0, 10.0, 20.0) if short else (7.5, 15.0, 30.0, 60.0)
    return {
        "seconds": tuple(Size(4 if short else 7, 1, length) for length in lengths),
        "joints": tuple(Size(joints, 1, 6.0) for joints in ((2, 4, 7) if short else (2, 3, 5, 7))),
        "recordings": tuple(Size(3, count, 6.0) for count in (1, 2, 4)),
    }


def write_case(kind: str, size: Size, seed: int, folder: Path) -> None:
    """Writes an arm's recordings, evenly sampled: white noise, stated; velocities measured, efforts exact."""
    drawn = arm_case.random_settings

    def plain(rng: np.random.Generator, kind: str) -> arm_case.Settings:
        settings = replace(drawn(rng, kind), step=1.0 / RATE, samples=int(size.seconds * RATE), skip=0)
        settings = replace(settings, excitation="rich", noise="white", jitter="none", has_velocity=True)
        return replace(settings, states_std=True, effort_std=0.0, process=0.0)

    arm_case.random_settings = plain
    for attempt in range(make._ATTEMPTS):
        case = arm_case.make_arm(
            np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(attempt,))), size.joints, kind
        )
        if make.calm(case):
            break
    else:
        raise RuntimeError(f"{kind} on {size.joints} joints, seed {seed}: all worlds ran away from their controllers")
    case.write(folder)


def measured(folder: Path, count: int, warm: Path) -> Cost:
    """The cost of diagnosing the first `count` recordings of a case, after one of the small case `warm`."""
    _diagnose(warm, 1)
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    # the peak counts from here on (proc(5), clear_refs)
    Path("/proc/self/clear_refs").write_text("5")
    before, started, spent = _status("VmRSS"), time.perf_counter(), _cpu()
    hypotheses, verdict = _diagnose(folder, count)
    wall, cpu = time.perf_counter() - started, _cpu() - spent
    return Cost(cpu, wall, _status("VmHWM") - before, hypotheses, verdict)


def _diagnose(folder: Path, count: int) -> tuple[int, str]:
    said: list[str] = []
    files = sorted(folder.glob("*.parquet"))[-count:]
    verdict = diagnose(
        Scene.load(folder / "scenario.yaml"), [recordings.read(file) for file in files], progress=said.append
    )
    screened = (re.match(r"screening (\d+) hypotheses", text) for text in said)
    return max((int(found[1]) for found in screened if found), default=0), verdict.kind


def _status(name: str) -> float:
    """A size of this process in /proc/self/status, MiB."""
    found = re.search(rf"{name}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1]) / 1024.0


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """The slope p of the least-squares line log cost = p log size + c."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def rows(short: bool, seed: int) -> Iterator[str]:
    """The table's lines as they come."""
    fork = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as place, fork.Pool(1, maxtasksperchild=1) as alone:
        warm = Path(place) / "warm"
        alone.apply(write_case, (EFFECTS[1], Size(2, 1, 3.0), seed, warm))
        for kind in EFFECTS:
            for name, grown in sizes(short).items():
                yield f"{kind}, growing: {name}"
                yield (
                    f"{'joints':>8}{'recordings':>12}{'seconds':>9}{'hypotheses':>12}{'CPU s':>8}{'wall s':>8}"
                    f"{'MiB':>8}  verdict     ratios of CPU and memory"
                )
                costs: list[Cost] = []
                for size in grown:
                    folder = Path(place) / f"{kind}-{size.joints}-{size.recordings}-{size.seconds}".replace(":", "-")
                    alone.apply(write_case, (kind, size, seed, folder))
                    costs.append(alone.apply(measured, (folder, size.recordings, warm)))
                    cost, former = costs[-1], costs[-2] if len(costs) > 1 else None
                    ratios = f"{cost.cpu / former.cpu:.2f} {cost.memory / former.memory:.2f}" if former else ""
                    yield (
                        f"{size.joints:>8}{size.recordings:>12}{size.seconds:>9g}{cost.hypotheses:>12}{cost.cpu:>8.1f}"
                        f"{cost.wall:>8.1f}{cost.memory:>8.0f}  {cost.verdict:<12}{ratios}"
                    )
                values = [float(getattr(size, name)) for size in grown]
                by_cpu, by_memory = (exponent(values, [getattr(cost, k) for cost in costs]) for k in ("cpu", "memory"))
                yield f"exponents: time {by_cpu:.2f}, memory {by_memory:.2f}"
                if name == "joints":
                    pairs = [float(cost.hypotheses * size.joints) for cost, size in zip(costs, grown, strict=True)]
                    by_cpu = exponent(pairs, [cost.cpu for cost in costs])
                    yield f"           time {by_cpu:.2f} against hypotheses times joints, as each moves the rows of all"
                yield ""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.growth", description=__doc__)
    parser.add_argument("--short", action="store_true", help="short recordings of small arms: minutes")
    parser.add_argument("--seed", type=int, default=4)
    options = parser.parse_args(arguments)
    for line in rows(options.short, options.seed):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
