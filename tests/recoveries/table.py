"""`python -m tests.recoveries.table [EFFECT...]`: a row for each effect of the vocabulary, or for those that are named.

Each is simulated by Drake and diagnosed from its own recordings, and the corrected scene follows another one. Errors of
following are multiples of the standard deviation that noise, start and strengths let one expect, of the worst channel.
The status is 1 if any effect was not recovered.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from drake_cafim.numerics.rounding import short

from .cases import CASES, Case
from .recovery import Recovery, recovered, sentences

HEADINGS = ("effect", "place", "true strength", "found", "error", "follows at", "without it at", "s", "")


def row(found: Recovery, seconds: float) -> str:
    """The case's row of the table."""
    case = found.case
    effects = [followed.effect for followed in found.verdict.explanation if found.named]
    names = [strength.name for effect in effects for strength in effect.strengths]
    fitted = ", ".join(f"{name} {short(effects[0].values[name])}" for name in names)
    true = ", ".join(f"{name} {value}" for name, value in case.values.items() if name != "recording")
    error = f"{100 * max(found.errors.values()):.1f} %" if found.errors else ""
    follows, without = (f"{followed.worst:.2f}" if followed else "" for followed in (found.followed, found.bare))
    failures = "; ".join(sentences(found)) or "recovered"
    return f"| {' | '.join((case.name, case.at, true, fitted, error, follows, without, f'{seconds:.0f}', failures))} |"


def tabulated(case: Case) -> bool:
    """Prints the case's row; whether the effect was recovered."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        found = recovered(case, Path(folder))
    print(row(found, time.process_time() - began), flush=True)
    return not sentences(found)


def main() -> int:
    """The table, printed row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("effects", nargs="*", metavar="EFFECT")
    wanted = parser.parse_args().effects
    unknown = sorted(set(wanted) - {case.name for case in CASES})
    if unknown:
        parser.error(f"{', '.join(unknown)}: no such effect; there are: {', '.join(case.name for case in CASES)}")
    print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}", flush=True)
    done = [tabulated(case) for case in CASES if case.name in wanted or not wanted]
    print(f"\n{sum(done)} of {len(done)} recovered")
    return 0 if all(done) else 1


if __name__ == "__main__":
    sys.exit(main())
