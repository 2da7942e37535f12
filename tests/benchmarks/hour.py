"""`python -m tests.benchmarks.hour [--minutes 60]`: a long log of seven joints at 1 kHz, diagnosed by the command.

MuJoCo simulates an arm whose second joint has viscous friction that its model lacks, and whose last link takes up a
payload half-way. Printed are wall and processor time, the peak memory of all processes together (what forks share
counted once, sampled every two seconds), and the verdict beside the truth.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from tests.long_recording import Long, write

SECONDS_A_MINUTE = 50.0
"""s of one core that a minute of the log takes, and that a search takes, roughly: for the word beforehand."""
SEARCHES = 400.0


def memory_of(process: int) -> float:
    """GiB of a process and of its children, in proportion where pages are shared (proc(5), smaps_rollup)."""
    total = 0.0
    with suppress(OSError):
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
        total = next(float(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:")) / 2**20
        for task in Path(f"/proc/{process}/task").iterdir():
            total += sum(memory_of(int(child)) for child in (task / "children").read_text().split())
    return total


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.hour", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--memory", type=float, default=4.0, help="GiB, as of cafim diagnose.")
    parser.add_argument("--jobs", type=int, default=-1)
    options = parser.parse_args(arguments)
    seconds = 60.0 * options.minutes
    minutes = (SECONDS_A_MINUTE * options.minutes + SEARCHES) / 60.0
    print(f"takes about {minutes:.0f} minutes of one core, in parts on two; it does not resume", flush=True)
    log = Long(7, seconds, payload=0.5, taken=0.5 * seconds)
    with tempfile.TemporaryDirectory() as place:
        scenario, out = write(log, Path(place)), Path(place) / "out"
        recording = Path(place) / "log.parquet"
        print(f"{seconds * log.rate:.0f} rows, {recording.stat().st_size / 2**20:.0f} MiB", flush=True)
        command = ["cafim", "diagnose", scenario, "--recording", recording, "--out", out, "--no-replay"]
        command += ["--memory", f"{options.memory:g}", "--jobs", f"{options.jobs}"]
        command[:1] = [sys.executable, "-c", "from drake_cafim.cli import run_cli; run_cli()"]
        began, peak, alone, said = time.monotonic(), 0.0, None, Path(place) / "said"
        with said.open("wb") as errors, subprocess.Popen(command, stderr=errors, stdout=errors) as process:
            while process.poll() is None:
                time.sleep(2.0)
                peak = max(peak, memory_of(process.pid))
                if alone is None and b"alone say" in said.read_bytes():
                    alone = time.monotonic() - began
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"wall {time.monotonic() - began:.0f} s, processor {used.ru_utime + used.ru_stime:.0f} s, {peak:.2f} GiB")
        print(f"exit status {process.returncode}; the beginning's verdict after {alone or float('nan'):.0f} s")
        if process.returncode:
            print(said.read_text()[-2000:])
            return 1
        report = json.loads((out / "report.json").read_text())
    print(f"truth: viscous friction {log.friction:g} N m s/rad, from {log.taken:g} s on {log.payload:g} kg")
    print(f"{report['verdict']}: {report['sentence']}")
    for found in report["explanation"]:
        print(f"  {found['effect']} at {found['at']}: {found['parameters']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
