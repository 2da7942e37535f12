"""The whole page, put together."""

from drake_cafim.diagrams.reference.columns import columns
from drake_cafim.diagrams.reference.fleets import fleets
from drake_cafim.diagrams.reference.limits import LIMITS, answer
from drake_cafim.diagrams.reference.needs import MEASURED
from drake_cafim.diagrams.reference.scenario_keys import scenario_keys
from drake_cafim.diagrams.reference.tables import table
from drake_cafim.diagrams.reference.vocabulary import overview, vocabulary

HEAD = """# Reference

Every key of a scenario, every column of a recording, every effect, what a diagnosis needs, and what is not supported.
SI units throughout; world z is up; quaternions are (w, x, y, z).
`python -m drake_cafim.diagrams.reference > diagrams/reference.md` writes this page, and a test compares the two.

- [The scenario](#the-scenario): [keys](#the-file), [unknowns](#what-unknown-may-name),
  [laws of contact](#the-laws-of-contact)
- [The columns of a recording](#the-columns-of-a-recording)
- [The effects](#the-effects)
- [Fleets and clusters](#fleets-and-clusters)
- [Export](#export)
- [Time and memory](#time-and-memory)
- [What is not supported](#what-is-not-supported)
"""
RECORDING = """A table, one row a sample: `.parquet`, `.csv`, `.npz`, ROS 1 and 2 bags, MCAP, LCM logs. An empty cell
is a missing measurement. Under `noise`, report.json lists by column the std of one sample under which the recordings
were read (`std`, `unit`, `correlation_time` in s, and whether the scenario `stated` it); `cafim discriminate` takes it
from there where the scenario states none."""
EFFECTS = """`at` is where an effect acts: in a report, and under `effects:` of a scenario, as
`{effect: joint_coulomb_friction, at: elbow, torque: 1.2}`. A unit in parentheses is that of a prismatic joint.
*Typical* is the usual size, and the std of the weak prior that the evidence needs; *one of* lists the values that a
search tries."""
NEEDS = """The time grows with the number of hypotheses (places times effects), with the samples, and with what is
missing: where nothing is, it ends after one screening. Measured by `python -m drake_cafim.diagrams.reference.needs`, on
the tutorials' arm of two joints with viscous friction that its model lacks, 4 s at 250 Hz a recording, on one of two
cores of a virtual machine (AMD EPYC); memory is that of the whole process. The first diagnosis takes some seconds more,
to compile.

Recordings that would need more than `--memory` GiB (4 by default: about 36 s of seven joints at 1 kHz, some minutes of
two) are diagnosed in parts, so that memory grows with their length by some bytes a row only: each part is looked at,
effects are looked for in those that tell most, and strengths and intervals are of all. The program itself takes half a
GiB besides. Throws are never in parts, nor are recordings for `cafim estimate` or for `drake_cafim.diagnose`."""
PROOF = """In the proof of 920 cases, arms and throws (`make prove PROVE="--size 920"`, see the README), making a case
and diagnosing it took 22 s of a core in the mean, and two had no verdict after 600 s. Thrown boxes take minutes."""
EXPORT = """`cafim export SCENARIO --to urdf|sdf|mjcf` writes the unknowns' means and the effects into a copy of the
model file that they came from, as scenario.corrected.yaml states them; every other byte stays, but for the addresses of
meshes and includes, which are made to lead to the same files from `--out`. All formats hold masses, centres of mass,
inertias, payloads (as part of their body), viscous and Coulomb friction, rotor inertia and effort limits; SDFormat and
MJCF springs; MJCF the gain of a motor (its gear) and a tilt of gravity (`<option gravity>`), which stay in the
scenario too. Beside a friction in an MJCF stands `solreffriction="0.005 1"`, since MuJoCo's own lets a joint slip for
0.02 s where it turns around. What a format cannot hold is told line by line and stays in scenario.exported.yaml. The
copy is simulated over 1 s in Drake, and an MJCF in MuJoCo where it is installed, without contact and limits; by the
efforts of `--recording`, or swinging about where it hangs."""
UNSUPPORTED = """Each sentence is what a small model with it is answered, as this page was written. An error ends the
command with exit status 2; with a note in the report, the model is taken without it."""
MORE = """A thrown body is one free body with at most one contact: a ball or a box on a plane. `cafim discriminate` and
`cafim replay` are of robots alone. Masses that only a mesh gives are not known."""


def page() -> str:
    """The page as Markdown."""
    needs = [[str(count), f"{seconds:g} s", f"{memory} MB"] for count, seconds, memory in MEASURED]
    limits = [[limit.what, "note" if limit.noted else "error", answer(limit)] for limit in LIMITS]
    parts = [
        HEAD,
        f"## The scenario\n\n{scenario_keys()}",
        f"## The columns of a recording\n\n{RECORDING}\n\n{columns()}",
        f"## The effects\n\n{EFFECTS}\n\n{overview()}\n\n{vocabulary()}",
        f"## Fleets and clusters\n\n{fleets()}",
        f"## Export\n\n{EXPORT}",
        f"## Time and memory\n\n{NEEDS}\n\n{table(['recordings', 'time of one core', 'memory'], needs)}\n\n{PROOF}",
        f"## What is not supported\n\n{UNSUPPORTED}\n\n{table(['what', '', 'what is said'], limits)}\n\n{MORE}",
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"
