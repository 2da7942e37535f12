"""The DFKI double pendulum, design A.0: torque-controlled, 500 Hz, recorded for system identification.

F. Wiebe, S. Vyas, L. J. Maywald, S. Kumar, F. Kirchner, "Open source dual-purpose acrobot and pendubot platform",
IEEE Robotics and Automation Magazine, 2023. The columns end in 1 for the shoulder and 2 for the elbow; u is the
measured torque on the joint's side, u_cmd the commanded one.
"""

from pathlib import Path

from drake_cafim.recordings.published.published_set import PublishedSet, Run, columns_of_csv
from drake_cafim.typing import Array

SIGNALS = {"pos_meas": "q", "vel_meas": "v", "tau_meas": "u", "tau_con": "u_cmd"}
JOINTS = ("shoulder", "elbow")
NAMES = {"time": "time"} | {
    f"{signal}{number}": f"{kind}.{joint}"
    for number, joint in enumerate(JOINTS, start=1)
    for signal, kind in SIGNALS.items()
}
FOLDER = "data/experiment_records/design_A.0/20220815/sys_id"


def table(path: Path, run: Run) -> dict[str, Array]:
    """The measured columns; the filtered ones and tau_fric, which is zero in every file, are left out."""
    return columns_of_csv(path, run, NAMES)


SHA256 = {
    "trajectory_00": "7b75a4b1b5e87bb90ba4251dd8757e93bb7f02e3731a64a4c2cc715f106a4b4d",
    "trajectory_01": "b3460b88181b01effb70396a1a58b191bc9e24539d3eaaa05f2ad7dc480d6fee",
    "trajectory_02": "d029848464e22971f15067aed34467a2a1b59098edea7fcebe74b5879c4c2e65",
    "trajectory_03": "7ed5c7039cbab4ca396b461942476a0327bd42cff4ca1c8b30dd173e514109a1",
    "trajectory_04": "f018c7d607660df4a49f7382e73e477d9d0a928e70a3fe0df15eaa54ba3709ea",
    "trajectory_05": "b28054082b795e481074356887a2efcdd6087b5d9ecc26d7e23b6e2b66c0917c",
    "trajectory_11": "da245e6612491a2d23a7f100864113b787e8083b4652ac55c5fa4fa8ccf7ec3d",
    "trajectory_12": "1da4e2e8a51d68a5e663039afae2ace76427cf603456d5d5cf4bc4195ce117a0",
    "trajectory_13": "fa377939ace9fd5a7a16db1f29226a8218003e4ca24e6fc4645fe375b3074cd1",
}

DOUBLE_PENDULUM_A0 = PublishedSet(
    name="double_pendulum_A0",
    url="https://github.com/dfki-ric-underactuated-lab/double_pendulum",
    commit="1e8544e67f3da72a51ee52fbbb278e131ce2a43f",
    licence="BSD-3-Clause",
    runs={run: Run(source=f"{FOLDER}/{run}.csv", sha256=sha256) for run, sha256 in SHA256.items()},
    table=table,
)
