"""`python -m tests.concealed.served COUNT [--first SEED]`: the proof's cases commanded by position alone, not sealed.

Every fourth case conceals nothing, the others one effect at one joint. Printed: a row a case, and how many clear ones
were told exactly.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.scene.scene import Scene

from .make import make, told
from .served_case import UNITS


def main() -> int:
    """The rows, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    effects = tuple(UNITS)
    clear, exact, nulls, alarms = 0, 0, 0, 0
    for seed in range(given.first, given.first + given.count):
        began = time.process_time()
        effect = effects[(seed - seed // 4) % len(effects)] if seed % 4 else ""
        case = make(f"single:{effect}" if effect else "null", f"served{2 + seed % 2}", seed)
        with tempfile.TemporaryDirectory() as folder:
            case.write(Path(folder))
            train = [recordings.read(path) for path in sorted(Path(folder).glob("train*"))]
            verdict = diagnose(Scene.load(Path(folder) / "scenario.yaml"), train)
        found = [list(explanation.effect.key) for explanation in verdict.explanation]
        wanted = [[item["effect"], item["at"]] for item in case.truth["effects"]]  # type: ignore[attr-defined]
        right = verdict.kind == case.truth["verdict"] and found == wanted
        if not effect:
            nulls, alarms = nulls + 1, alarms + (not right)
        elif case.truth["strengths"][0]["clear"]:  # type: ignore[index]
            clear, exact = clear + 1, exact + right
        print(
            f"{seed} {'right' if right else 'WRONG'} {told(case.truth)}: {verdict} "
            f"({time.process_time() - began:.0f} s)",
            flush=True,
        )
    print(f"clear and exact: {exact} of {clear}; false alarms: {alarms} of {nulls}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
