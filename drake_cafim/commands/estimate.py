"""`cafim estimate`: estimates the scenario's unknown parameters from recordings, without a verdict."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_cafim.commands.inputs import read_all
from drake_cafim.diagnosis.diagnose import estimate
from drake_cafim.output import write_text
from drake_cafim.report.report_json import as_text, comparison_of, parameters_of, report_of
from drake_cafim.scene.scene import Scene


def estimate_command(
    address: str,
    recordings: Sequence[str],
    out: Path,
    progress: Callable[[str], None],
    packages: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The report with `parameters` and `fit`, written to `out`."""
    scene = Scene.load(address, packages=packages)
    found = estimate(scene, read_all(scene, recordings), progress=progress)
    fit = {"train": comparison_of(found.train), "held_out": None}
    report = report_of(None, parameters_of(found.parameters), fit, {}, found)
    write_text(out / "report.json", as_text(report))
    return report
