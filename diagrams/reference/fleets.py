"""Fleets on the reference page: the folder, the table, clusters, and what they move."""

from drake_cafim.diagrams.reference.tables import table

LAYOUT = """
`cafim diagnose [SCENARIO] --fleet DIR` diagnoses every folder below DIR that holds recordings, at any depth,
one report a folder, in `--out` under the same path.

    DIR/scenario.yaml              holds for all robots that have none of their own
    DIR/arm_07/scenario.yaml       this robot's; the nearest one above a folder holds, or else SCENARIO
    DIR/arm_07/2026-W12/a.parquet  its recordings of that week

The first part of the path is the robot. The time is read from the recording's name, or else from the nearest folder's,
by ISO 8601 (`2026-W12`, `2026-03-16`, `20260316T091500`), or else from stamps that are seconds since 1970; a recording
without a time is in the table, and in no trend. `--held-out GLOB` holds out the files whose name, or path below DIR,
fits. A folder that cannot be used is one row that says why; the others go on. Robots are of one kind whose model files
have one name, joints and bodies.

What is named in any folder of a robot, or in two folders of a robot of its kind, is fitted in each of its recordings,
so that a strength is known before it was named, and in the sisters. `fleet.html` tells by an F test which of them is
not constant, since when, and how fast it drifts, and by Student's t which is unlike the sisters'; p-values are times
all that was tried, and one of 0.01 is told. From fewer than four times, no change is told.

`--shard i/N` diagnoses the i-th of N shares into a common `--out`; the same command with `--resume` and without
`--shard` gathers them, fits the strengths and writes the page. A killed run goes on with `--resume`."""
COLUMNS = {
    "robot, recording": "the first part of the path, and the rest; of a folder that failed, the folder's",
    "time": "UTC",
    "effect, place, parameter, unit": "what was fitted; empty where nothing is followed",
    "strength, std": "in this recording; of a push, and where `why` says so, in its folder",
    "probability": "by which the folder's report names the effect; empty where it does not",
    "verdict": "of the folder: none, explained, unexplained, or failed",
    "kind, folder, why": "the model's name and a digest; the path; why there is no strength",
}
CLUSTER = """
`--scheduler tcp://HOST:PORT` (`pip install drake_cafim[cluster]`) hands a fleet's folders, or a study's runs,
to the workers of a Dask scheduler (`dask scheduler`, `dask worker ADDRESS --nthreads 1`). DIR, `--out` and the scenario
have to be at the same path on all machines; recordings and reports do not move through Dask. A worker that dies costs
its task another attempt, a task that kills four is a row with that reason, and when the scheduler dies, the run waits
five minutes for one at the same address (`make cluster`).

Measured on loopback, in the fleet of 200 recordings: a task is 0.46 kB, its result 0.25 kB, and of the strengths 0.44
kB; a folder leaves 0.19 MB of files. The scheduler spends 3.3 ms of a core on a task and this command 2.4 ms, on a
busy machine. At two tasks a recording, 10⁶ recordings thus move about 2 GB, write 190 GB, and take the scheduler 1.8 h
of a core; it saturates at about 300 tasks a second, that of 150 recordings, and with folders of 1.1 s, at some 170
workers. Beyond, shares (`--shard`) on clusters of their own."""


def fleets() -> str:
    """The section's text."""
    rows = [[", ".join(f"`{name}`" for name in names.split(", ")), words] for names, words in COLUMNS.items()]
    return f"{LAYOUT.strip()}\n\n`fleet.parquet`:\n\n{table(['column', 'meaning'], rows)}\n\n{CLUSTER.strip()}"
