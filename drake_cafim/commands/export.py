"""`cafim export`: a scene's values back into its model file, with a check by simulation."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drake_cafim.commands.inputs import read_all, refuse_thrown
from drake_cafim.errors import InputError
from drake_cafim.export.files import Exported, export, model_of
from drake_cafim.export.in_mujoco import in_mujoco
from drake_cafim.export.parity import Motion, Parity, difference, in_drake, motion_of
from drake_cafim.export.values import Form
from drake_cafim.output import write_text
from drake_cafim.scene.scene import Scene

ABOUT = "export.json"


def export_command(
    address: str,
    form: Form,
    recording: str | None,
    out: Path,
    progress: Callable[[str], None],
    packages: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """What was written and what was lost, with the check, written to `out` beside the model and its scenario.

    `recording` gives the motion of the check. Raises `InputError` for a scenario that cannot be used or exported.
    """
    scene = Scene.load(address, packages=packages)
    refuse_thrown(scene, "cafim export")
    read = read_all(scene, [recording]) if recording else []
    scene = scene.for_recordings(read) if read else scene
    moved = motion_of(scene, read[0] if read else None)
    progress("writing the model")
    exported = export(scene, form, out)
    progress("simulating the corrected scene and the exported model")
    parity = check(scene, exported, form, moved)
    result = {
        "schema": "drake_cafim.export/1",
        "model": exported.model.name,
        "others": [path.relative_to(out).as_posix() for path in exported.others],
        "scenario": exported.scenario.name,
        "written": list(exported.written),
        "lost": list(exported.lost),
        "parity": asdict(parity),
    }
    write_text(out / ABOUT, json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    return result


def check(scene: Scene, exported: Exported, form: Form, moved: Motion) -> Parity:
    """How far the exported model's motion is from the scene's."""
    reference = in_drake(scene, moved)
    again = Scene.load(exported.scenario)
    bare = Scene.build(_uncorrected(scene), scene.folder, scene.name)
    apart, uncorrected = (difference(scene, in_drake(item, moved), reference) for item in (again, bare))
    if form != "mjcf":
        return Parity(apart, uncorrected, None)
    try:
        found = in_mujoco(exported.model, model_of(scene), scene, moved)
    except InputError as error:
        return Parity(apart, uncorrected, None, str(error))
    return Parity(apart, uncorrected, difference(scene, found, reference))


def _uncorrected(scene: Scene) -> Any:
    """The scenario without effects and unknowns: the model as its file says."""
    from dataclasses import replace

    return replace(scene.scenario, effects=[], unknown=[])


def in_words(result: Mapping[str, Any]) -> str:
    """The result as text for a terminal."""
    lines = [f"wrote: {line}" for line in result["written"]] or ["the scenario adds nothing to its model"]
    lines += [f"lost:  {line}" for line in result["lost"]]
    parity = result["parity"]
    lines.append(
        f"over {1:g} s in Drake: {100 * parity['drake']:.3g} % of the motion from the corrected scene, which is "
        f"{100 * parity['uncorrected']:.3g} % from the model as it was"
    )
    if parity["mujoco"] is not None:
        lines.append(f"over {1:g} s in MuJoCo: {100 * parity['mujoco']:.3g} % of the motion from the corrected scene")
    elif parity["why"]:
        lines.append(f"not simulated in MuJoCo: {parity['why']}")
    return "\n".join(lines)
