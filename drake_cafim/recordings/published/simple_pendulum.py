"""The DFKI torque-limited simple pendulum: of each run the swing-up, before the pendulum is pushed by hand.

F. Wiebe et al., "Torque-limited simple pendulum", JOSS 2022, doi 10.21105/joss.03884. The torque is the measured
one on the joint's side.
"""

from pathlib import Path

from drake_cafim.recordings.published.published_set import PublishedSet, Run, columns_of_csv
from drake_cafim.typing import Array

NAMES = {"time": "time", "position": "q.shoulder", "velocity": "v.shoulder", "torque": "u.shoulder"}


def table(path: Path, run: Run) -> dict[str, Array]:
    """The measured columns of the run's rows of the file, which are those of the swing-up."""
    return columns_of_csv(path, run, NAMES)


SIMPLE_PENDULUM = PublishedSet(
    name="simple_pendulum",
    url="https://github.com/dfki-ric-underactuated-lab/torque_limited_simple_pendulum",
    commit="ed17ea2d32a35ad944944ca03ef57693e2986732",
    licence="BSD-3-Clause",
    runs={
        "dircol": Run(
            source="results/control_method_direct_collocation/data_measured.csv",
            rows=(0, 1167),
            sha256="d08d776e49a11cc7784847e760b99cef8aab1a5ad91d989893878432d0bd5a76",
        ),
        "energy": Run(
            source="results/control_method_energy_shaping/data_measured.csv",
            rows=(0, 1200),
            sha256="92b41115b5bc8b3fe094c83efd37ae6c1f8aa94d3eb63174dc0ea62dd78c5ccf",
        ),
        "ilqr": Run(
            source="results/control_method_ilqr/data_measured.csv",
            rows=(0, 130),
            sha256="457b30377ef4f787f7be389bae68ee01b4d03decf66b6e77c8b5aa887c8666ad",
        ),
    },
    table=table,
)
