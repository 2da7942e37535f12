"""`python -m tests.benchmarks.servos DATA [--stated]`: closed-loop prediction of a servo on a pendulum, from commands.

DATA is the folder of the sets. Two of the four trajectories of `bam_xl330` are diagnosed, with kp, kv and the limit of
the servo unknown (priors of 50 %, means 0.6 and 1.6 times those of the set's scenario), and the other two are simulated
from their first sample to their last by the corrected model, from `cmd`. Printed: the mean absolute error of q, mrad,
by the firmware's gain, with the logged supply and with 7.4 V, and what was named. `--stated` leaves the search out: it
fits the nominal model alone.
"""

import argparse
import itertools
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.predict.whole_run import whole_runs
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

TRAJECTORIES = ("sin_sin", "lift_and_drop", "up_and_down", "sin_time_square")
GAINS = (100, 200, 400, 800)
SERVO = {"servo_stiffness": 0.0014447, "servo_damping": 0.02193, "servo_limit": 0.5021}
"""The set's own values: from BAM's first model."""
NOMINAL_SUPPLY = 7.4


def scene_of(folder: Path, scale: float, scratch: Path) -> Scene:
    """The set's scenario, with the servo's numbers unknown and their prior means `scale` times the stated ones."""
    text = (
        (folder / "scenario.yaml").read_text(encoding="utf-8").replace("pendulum.urdf", str(folder / "pendulum.urdf"))
    )
    text += "unknown:\n" + "".join(
        f"  - {{parameter: {name}, joint: pendulum, mean: {scale * value}, std: {0.5 * scale * value}}}\n"
        for name, value in SERVO.items()
    )
    path = scratch / f"scenario_{scale}.yaml"
    path.write_text(text, encoding="utf-8")
    return Scene.load(path)


def read(folder: Path, trajectories: Sequence[str]) -> list[Recording]:
    """The runs of these trajectories, all gains; a trajectory that is cut in two has both parts."""
    return [
        recordings.read(path)
        for name in trajectories
        for gain in GAINS
        for path in sorted((folder / "runs").glob(f"{name}_kp{gain}*.parquet"))
    ]


def with_constant_supply(recording: Recording) -> Recording:
    """The recording as if nothing but the nominal supply were known."""
    volts = np.full(len(recording), NOMINAL_SUPPLY)
    return replace(recording, columns={**recording.columns, "input_volts": volts})


def errors(scene: Scene, runs: Sequence[Recording]) -> dict[str, float]:
    """Mean absolute error of q, mrad, of each run, whole and closed through the servo."""
    prepared = prepare(scene, runs)
    assert isinstance(prepared, Prepared)
    found = {}
    for simulated in whole_runs(prepared.weak, scene.physics):
        # a run that leaves the joint's range stays where it left it, and counts
        error = simulated.predicted["q.pendulum"] - simulated.measured["q.pendulum"]
        found[simulated.recording] = 1e3 * float(np.nanmean(np.abs(error)))
    return found


def main() -> int:
    """The table, a row for each split, scale of the prior and supply."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--stated", action="store_true")
    parser.add_argument("--splits", default="all", help="main: the two of the issue alone")
    parser.add_argument("--scales", type=float, nargs="*", default=[0.6, 1.6])
    given = parser.parse_args()
    folder = given.data.resolve() / "bam_xl330"
    splits = list(itertools.combinations(TRAJECTORIES, 2))
    splits = [splits[0], splits[-1]] if given.splits == "main" else splits
    print("| trained on | prior | supply | train | test | " + " | ".join(f"kp {gain}" for gain in GAINS) + " | named |")
    print("|" + "---|" * (6 + len(GAINS)), flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        for split, scale in itertools.product(splits, given.scales):
            began = time.monotonic()
            scene = scene_of(folder, scale, Path(scratch))
            train, test = read(folder, split), read(folder, [name for name in TRAJECTORIES if name not in split])
            settings = Settings(most_effects=0) if given.stated else Settings(jobs=-1)
            verdict, _ = examine(scene, train, settings=settings)
            corrected = verdict.corrected
            named = ", ".join(str(item.sentence) for item in verdict.explanation) or "nothing"
            fitted = ", ".join(f"{known.parameter} {known.value:.4g}" for known in verdict.parameters)
            for supply in ("logged", "7.4 V"):
                seen = [with_constant_supply(run) if supply != "logged" else run for run in (*train, *test)]
                every = errors(corrected, seen)
                own = [every[run.name] for run in seen[: len(train)]]
                held = {run.name: every[run.name] for run in seen[len(train) :]}
                by_gain = [np.mean([error for name, error in held.items() if f"kp{gain}" in name]) for gain in GAINS]
                cells = [np.mean(own), np.mean(list(held.values())), *by_gain]
                print(
                    f"| {' and '.join(split)} | {scale} | {supply} | "
                    + " | ".join(f"{cell:.1f}" for cell in cells)
                    + f" | {named}; {fitted} ({time.monotonic() - began:.0f} s) |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
