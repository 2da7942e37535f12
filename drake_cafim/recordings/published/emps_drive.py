"""EMPS, an electro-mechanical positioning system with one linear axis, at 1 kHz.

A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System
Identification Benchmarks, Eindhoven, 2019. The MATLAB file holds t (s), qm and qg (m: measured on the motor's
encoder, reference, both on the load's side), vir (V) and gtau (N/V); the effort is gtau times vir.
"""

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from drake_cafim.errors import InputError
from drake_cafim.recordings.published.published_set import PublishedSet, Run
from drake_cafim.typing import Array

NAMES = ("t", "qm", "qg", "vir", "gtau")


def table(path: Path, run: Run) -> dict[str, Array]:
    """The columns of the run's rows of the file; time starts at zero, nothing is filtered."""
    try:
        held = loadmat(path)
    except (ValueError, OSError, NotImplementedError, EOFError) as error:
        raise InputError(f"{path}: not a MATLAB file ({' '.join(str(error).split())})") from error
    missing = [name for name in NAMES if name not in held]
    if missing:
        raise InputError(f"{path}: there is no variable {missing[0]}, expected {', '.join(NAMES)}")
    t, qm, qg, vir, gtau = (np.asarray(held[name], dtype=np.float64).ravel() for name in NAMES)
    rows = slice(*run.rows)
    return {
        "time": t[rows] - t[rows][0],
        "q.carriage": qm[rows],
        "u.carriage": gtau[0] * vir[rows],
        "q_ref.carriage": qg[rows],
    }


EMPS_DRIVE = PublishedSet(
    name="emps_drive",
    url="https://github.com/forgi86/sysid-neural-continuous",
    commit="956aa7ecd73061b0321c6f6098d74c9e4a7ce67a",
    licence="Apache-2.0 (that repository); the authors publish the set as a free benchmark",
    runs={
        "ident_0": Run(
            source="examples/EMPS/data/DATA_EMPS.mat",
            rows=(0, 8280),
            sha256="abd07795ff576998562d8cfe23ce0008d9fdcaa6f1ad5a2a00511b2017e48e29",
        ),
        "ident_1": Run(
            source="examples/EMPS/data/DATA_EMPS.mat",
            rows=(8280, 16560),
            sha256="73022a9306ca175e22138522b30c6f1a1de42d595d8e4e7b7bfde51eb962463e",
        ),
        "ident_2": Run(
            source="examples/EMPS/data/DATA_EMPS.mat",
            rows=(16560, 24841),
            sha256="1f0b683b39338a2adcb6c3923a7b925a5bfb12af2de9e3096f4d34595a4c6201",
        ),
    },
    table=table,
)
