"""`python -m tests.descriptions.table`: public robot descriptions as shipped, loaded, simulated and compared.

The packages are those of the extra `descriptions`; what is not installed is left out and said so. A description that
`--out` already has is not tried again.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.scenario.schema import Scenario, Weld
from drake_cafim.scene.scene import Scene
from tests.descriptions.catalogue import CATALOGUE, Shipped
from tests.descriptions.inverse_dynamics import (
    efforts_by_mujoco,
    efforts_by_pinocchio,
    efforts_here,
    frictions_here,
)

SAMPLES = 20
DURATION = 0.05
"""s that each description is simulated."""
WIDEST = 2.0
"""rad or m from zero that joints without nearer limits are put."""
SAME = 1e-6


def examined(shipped: Shipped, path: Path) -> dict[str, Any]:
    """What became of one description."""
    started = time.monotonic()
    weld = [Weld(shipped.weld)] if shipped.weld else []
    try:
        scenario = Scenario(model=path.name, weld=weld, lock=list(shipped.lock))
        scene = Scene.build(scenario, path.parent, shipped.name)
    except InputError as error:
        return {"name": shipped.name, "refused": str(error)}
    result: dict[str, Any] = {"name": shipped.name, "joints": len(scene.tree.joints), "notes": scene.stated.notes}
    result["load_s"] = round(time.monotonic() - started, 2)
    result["simulated"] = simulated(scene)
    return result | compared(scene, path)


def simulated(scene: Scene) -> bool | str:
    """Whether the scene with all that its file states runs in Drake, or why not."""
    builder = DiagramBuilder()
    plant = scene.add_to(builder, MultibodyPlantConfig(time_step=1e-3))
    builder.ExportInput(plant.effort, "effort")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.get_input_port(0).FixValue(context, np.zeros(len(scene.tree.joints)))
    try:
        simulator.AdvanceTo(DURATION)
    except RuntimeError as error:
        return str(error)
    return bool(np.all(np.isfinite(plant.plant.GetPositions(plant.plant.GetMyContextFromRoot(context)))))


def compared(scene: Scene, path: Path) -> dict[str, Any]:
    """Inverse dynamics here against a library's, relative to the largest effort of each joint."""
    random = np.random.default_rng(0)
    limits = np.array([joint.position_limits for joint in scene.tree.joints])
    q = random.uniform(*np.clip(limits, -WIDEST, WIDEST).T, size=(SAMPLES, len(limits)))
    v, a = random.normal(size=(2, *q.shape))
    library = "Pinocchio" if path.suffix == ".urdf" else "MuJoCo"
    try:
        reference = efforts_by_pinocchio if library == "Pinocchio" else efforts_by_mujoco
        theirs, friction = reference(scene, path, q, v, a)
    except (ImportError, ValueError) as error:  # the library is not there, or refuses the file
        return {"library": library, "difference": None, "why": str(error)}
    ours = efforts_here(scene, q, v, a)
    scale = np.max(np.abs(theirs), axis=0)
    difference = np.max(np.abs(ours - theirs), axis=0) / np.where(scale > 0.0, scale, 1.0)
    return {
        "library": library,
        "difference": float(np.max(difference)),
        "worst": scene.tree.joint_names[int(np.argmax(difference))],
        "same_friction": bool(np.allclose(list(frictions_here(scene).values()), list(friction.values()))),
    }


def line(result: dict[str, Any]) -> str:
    """One row of the table."""
    if "refused" in result:
        return f"{result['name']:26} refused: {result['refused']}"
    if result["difference"] is None:
        return f"{result['name']:26} {result['joints']:3}  simulated {result['simulated']}  {result['why']}"
    same = "same" if result["difference"] < SAME else f"differs at {result['worst']}"
    friction = "same friction" if result["same_friction"] else "FRICTION DIFFERS"
    mended = sum("principal moments" in note or "no mass" in note for note in result["notes"])
    return (
        f"{result['name']:26} {result['joints']:3}  simulated {result['simulated']!s:5} {result['library']:10} "
        f"{result['difference']:8.1e} {same}, {friction}{f', {mended} inertias mended' if mended else ''}"
    )


def main() -> None:
    """The table, row by row as it is found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/descriptions.json"))
    parser.add_argument("names", nargs="*", help="only these")
    arguments = parser.parse_args()
    known: dict[str, Any] = json.loads(arguments.out.read_text("utf-8")) if arguments.out.is_file() else {}
    absent = []
    for shipped in CATALOGUE:
        if arguments.names and shipped.name not in arguments.names:
            continue
        if shipped.path is None:
            absent.append(shipped.name)
            continue
        if shipped.name not in known or arguments.names:
            known[shipped.name] = examined(shipped, shipped.path)
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            write_text(arguments.out, json.dumps(known, indent=1))
        print(line(known[shipped.name]), flush=True)
    rows = list(known.values())
    loaded = [row for row in rows if row.get("simulated") is True]
    same = [row for row in loaded if row["difference"] is not None and row["difference"] < SAME]
    print(f"{len(loaded)} of {len(rows)} loaded and simulated, {len(same)} with the same inverse dynamics", end="")
    print(f"; not installed: {', '.join(absent)}" if absent else "")


if __name__ == "__main__":
    main()
