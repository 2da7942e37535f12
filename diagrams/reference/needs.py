"""Time and memory of a diagnosis, measured: `python -m drake_cafim.diagrams.reference.needs` prints the rows again.

Each case runs in a process of its own, with the compiled code of an earlier one. A case is the two-joint arm of the
tutorials with stiff grease in its elbow, 4 s at 250 Hz a recording.
"""

import subprocess
import sys

CASES = (1, 4, 16)
"""Numbers of recordings."""
MEASURED = ((1, 1.1, 380), (4, 2.4, 450), (16, 8.0, 680))
"""Recordings, s of one core, and MB at most, on one of two cores of a virtual machine (AMD EPYC)."""
_CASE = """
import resource
from drake_cafim import Scene, diagnose
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record, stiff_grease
runs = [record(stiff_grease, seed, f"run_{seed}") for seed in range(%d)]
scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
def spent():
    now = resource.getrusage(resource.RUSAGE_SELF)
    return now.ru_utime + now.ru_stime
before = spent()
verdict = diagnose(scene, runs)
assert verdict.kind == "explained", str(verdict)
print(spent() - before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


def measure(count: int) -> tuple[int, float, int]:
    """One case: the number of recordings, s of one core, MB at most."""
    done = subprocess.run([sys.executable, "-c", _CASE % count], check=True, capture_output=True, text=True)
    seconds, memory = map(float, done.stdout.split())
    return count, round(seconds, 1), int(round(memory, -1))


if __name__ == "__main__":
    for case in CASES:
        print(measure(case))
