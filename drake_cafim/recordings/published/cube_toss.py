"""The tracked acrylic cube of ContactNets, thrown on a board, 148 Hz.

S. Pfrommer, M. Halm, M. Posa, "ContactNets", CoRL 2020, arXiv 2009.11193. A file holds one PyTorch tensor
(1, N, 19): position in half widths of the cube, quaternion with its real part first, velocities (backward
differences of the poses, left out) and zeros. There are no stamps; each toss starts after its release.
"""

from pathlib import Path

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.published.published_set import PublishedSet, Run
from drake_cafim.recordings.published.torch_file import read_tensor
from drake_cafim.recordings.recording import POSE_COMPONENTS
from drake_cafim.typing import Array

HALF_WIDTH = 0.0524  # m
PERIOD = 1 / 148  # s


def table(path: Path, run: Run) -> dict[str, Array]:
    """Time and X_WB of the cube: position in m, quaternion normalised and with continuous sign."""
    tensor = read_tensor(path)
    if tensor.ndim != 3 or tensor.shape[0] != 1 or tensor.shape[2] != 19:
        raise InputError(f"{path}: the tensor has shape {tensor.shape}, expected (1, N, 19)")
    states = tensor[0][slice(*run.rows)]
    q = states[:, 3:7] / np.linalg.norm(states[:, 3:7], axis=1, keepdims=True)
    turned = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    q[1:] *= np.cumprod(turned)[:, None]
    poses = np.column_stack([states[:, :3] * HALF_WIDTH, q])
    names = (f"pose.cube.{component}" for component in POSE_COMPONENTS)
    return {"time": np.arange(len(states)) * PERIOD, **dict(zip(names, poses.T, strict=True))}


SHA256 = {  # by the number of the toss
    0: "ca18c107abf690bb78eb2993f268fb0522eeb6613198e9a462a61eae69e858eb",
    27: "b08e61b8c9d3968005c91e797b022284ad64d93f18115079bad6574b4e0ce23b",
    54: "28372fb54c8a961821fbd3077b6a981c67df103330c7af6ca1a11a8c1b3ea647",
    81: "8099e854384f8cb2cd1f520260f55363f8b52dd1bb11ae6aafa048f72f3bff7c",
    108: "1ba3586ed097a671688e9a3f7d4c03186576e50c1e47a887953193d878439783",
    136: "f4e1c82242ffc7a4513745493a8939a21e997935bf10ca853f4af90a19ef96f8",
    164: "167ebf14efcc06692f9028e89c2918a6b5d5fac0338c9743ec9c92f6d84c4cdf",
    191: "d3ebd04aa51e9fcb2a846a4f73535815f3424ae4adcf3e16b6ef18e380ec0ca6",
    219: "fb16ac5ce921dd5a8d53585565dcbb815592f5bf51b665661072a00bce59e8c5",
    247: "603a730df56ac9d92f070084097778dcdad5c05c403afba6fe9ba83cebbbc04c",
    274: "f08e461091fca5835fdb6a9f246f77b47ee9eb0056f759e8b48ca7645768d16d",
    301: "3b1b8ad9e365c5ae810edd87910457a90dd3f34966ae61f771315aab9ddcaca7",
    329: "5e371d45bf79ce6ad39ac8f51fe048344c7591005931626e8a6f162f57fbe4a7",
    356: "1448e489aa276232e2762576797aadb40ba4fd82b6a134fffd70a8bd941cbff2",
    383: "0aeb387950b5d865eeae2a439633c421757b03100e5be30b61b6fe71b0872b74",
    410: "fb67e04ee8737527b3cf38e0ceee59c47759fc3ffb9f13bf2a1f5563d5b7ebd1",
    437: "980fa80a827dd2548b102c52bdc5a901ba8bff1f544597cc22590621fdcf133b",
    466: "469c6f52e4943da02f7f48c82d6489db03541e5f3e8e50f1ea3f6ed4c289e543",
    494: "253888586600bd4fd170c2b92fe8ab48eeb5aad2f004f5706ae7cf65f4620b67",
    522: "f979a38833e7faa72369a293595d82f26939526d36dd65e38f20d34767b4c5d2",
}

CUBE_TOSS = PublishedSet(
    name="cube_toss",
    url="https://github.com/DAIRLab/contact-nets",
    commit="c3dc21c94577ff4ed99123f0b00bfe57bb2d1d90",
    licence="BSD-3-Clause",
    runs={
        f"toss_{number:03d}": Run(source=f"data/tosses_processed/{number}.pt", sha256=sha256)
        for number, sha256 in SHA256.items()
    },
    table=table,
)
