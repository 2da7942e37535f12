"""The diagnosis that a run ends with: of its own recordings, against the scenario's model."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from drake_cafim.commands.diagnose import diagnose_command
from drake_cafim.errors import InputError

FOLDER = "diagnosis"
"""Where its files stand, within the run's folder."""


def diagnose_run(
    scenario: str, out: Path, recordings: Sequence[str], progress: Callable[[str], None], *, replay: bool = True
) -> dict[str, Any]:
    """The entry `diagnosis` of run.json; the report of `recordings` is written into `out`/diagnosis.

    The last recording is held out where there are several. A scenario of which nothing can be diagnosed from these
    recordings does not end the run: `sentence` then says why, and there is no verdict.
    """
    paths = [str(out / name) for name in recordings]
    train, held = (paths[:-1], paths[-1:]) if len(paths) > 1 else (paths, [])
    folder = out / FOLDER
    folder.mkdir(exist_ok=True)
    try:
        report = diagnose_command(
            scenario, train, held, folder, lambda text: progress(f"diagnosis: {text}"), replay=replay
        )
    except InputError as error:
        folder.rmdir()
        return {"verdict": None, "sentence": f"no diagnosis: {str(error).replace(f'{out}/', '')}", "report": None}
    return {"verdict": report["verdict"], "sentence": report["sentence"], "report": f"{FOLDER}/report.json"}
