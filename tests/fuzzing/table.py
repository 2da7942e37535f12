"""`make fuzz`: hostile inputs by the hundred thousand, and a table of what became of them.

make fuzz                                       # the long form: hours, which it says; resumed where it was ended
make fuzz FUZZ="--minutes 10"                   # as much as ten minutes allow, from the first input on
make fuzz FUZZ="--only models --from 1200 --inputs 1"     # one input again
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

from drake_cafim.output import write_text
from tests.fuzzing.campaign import Cases, Tally, try_cases
from tests.fuzzing.commands import CommandCases, compile_once
from tests.fuzzing.diagnoses import DiagnosisCases
from tests.fuzzing.models import ModelCases
from tests.fuzzing.recordings import RecordingCases
from tests.fuzzing.scenarios import ScenarioCases

FORMS: dict[str, tuple[Callable[[], Cases], int, float, int]] = {
    # the inputs; how many there are in the long form; seconds of computing an input; inputs in a fork
    "recordings": (RecordingCases, 1_000_000, 0.006, 500),
    "models": (ModelCases, 50_000, 0.05, 100),
    "scenarios": (ScenarioCases, 100_000, 0.03, 200),
    "diagnoses": (DiagnosisCases, 5_000, 1.0, 20),
    "command lines": (CommandCases, 500, 1.5, 10),
}
SHARES = {"recordings": 0.2, "models": 0.2, "scenarios": 0.2, "diagnoses": 0.2, "command lines": 0.2}
"""Of the minutes, where these are given."""


def main() -> None:
    """Try the inputs, and print the table; the exit status is 1 where there was a fault."""
    arguments = _parse()
    os.environ["OMP_NUM_THREADS"] = "1"
    chosen = [name for name in FORMS if arguments.only in (None, name)]
    state = Path(arguments.out)
    if arguments.minutes is None and arguments.inputs is None:
        hours = sum(FORMS[name][1] * FORMS[name][2] for name in chosen) / 3600
        print(f"about {hours:.1f} hours of one core; what was done is in {state}, the same command goes on from there")
    tallies = {}
    if {"command lines", "diagnoses"} & set(chosen):
        compile_once()
    for name in chosen:
        make, total, _, batch = FORMS[name]
        file = state / f"{name.replace(' ', '_')}.json"
        tally = Tally.read(file) if arguments.start is None else Tally(done=arguments.start)
        if arguments.inputs is not None:
            total = tally.done + arguments.inputs
        seconds = 1e9 if arguments.minutes is None else 60.0 * arguments.minutes * SHARES[name]
        seconds /= sum(SHARES[other] for other in chosen) if arguments.minutes is not None else 1.0
        save = _saver(file, tally) if arguments.start is None else lambda: None
        try_cases(make(), tally, total, time.monotonic() + seconds, save, batch=batch)
        tallies[name] = tally
        print(_row(name, tally, FORMS[name][1]), flush=True)
    print("\n" + table(tallies))
    raise SystemExit(any(tally.faults for tally in tallies.values()))


def table(tallies: dict[str, Tally]) -> str:
    """What became of the inputs, a row each; below it each kind of fault with the first input that shows it."""
    kinds = ("result", "refused", "traceback", "hang", "crash", "memory", "message")
    lines = [f"| inputs | tried | {' | '.join(kinds)} | hours |", "|---" * (len(kinds) + 3) + "|"]
    for name, tally in tallies.items():
        counts = [str(sum(tally.counts[key] for key in tally.counts if key.startswith(kind))) for kind in kinds]
        lines.append(f"| {name} | {tally.done} | {' | '.join(counts)} | {tally.seconds / 3600:.2f} |")
    faults = [
        f"{name} {number} ({tally.times[fault]} times): {fault}"
        for name, tally in tallies.items()
        for fault, number in sorted(tally.faults.items(), key=lambda item: -tally.times[item[0]])
    ]
    return "\n".join([*lines, "", *faults])


def _row(name: str, tally: Tally, total: int) -> str:
    return f"{name}: {tally.done} of {total}, {dict(tally.counts)}, {len(tally.faults)} kinds of fault"


def _saver(file: Path, tally: Tally) -> Callable[[], None]:
    return lambda: write_text(file, json.dumps(tally.as_json(), indent=1) + "\n")


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Hostile inputs, and a table of what became of them.")
    parser.add_argument("--minutes", type=float, help="as many inputs as this time allows; left out: the long form")
    parser.add_argument("--only", choices=list(FORMS), help="one kind of input")
    parser.add_argument("--from", dest="start", type=int, help="the first input; the state is then left alone")
    parser.add_argument("--inputs", type=int, help="how many")
    parser.add_argument("--out", default="cafim-out/fuzz", help="where the state is kept, which a second call reads")
    return parser.parse_args()


if __name__ == "__main__":
    main()
