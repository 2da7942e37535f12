"""The diagnosis that a run ends with: of its own recordings, against the scenario's model."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from drake_cafim.commands.diagnose import diagnose_command
from drake_cafim.errors import InputError, OutputError

FOLDER = "diagnosis"
"""Where its files stand, within the run's folder."""


def diagnose_run(
    scenario: str, out: Path, recordings: Sequence[str], progress: Callable[[str], None], *, replay: bool = True
) -> dict[str, Any]:
    """The entry `diagnosis` of run.json; the report of `recordings` is written into `out`/diagnosis.

    Its recordings are named from `out`, so that the report is the same in whatever folder it is made. The last one is
    held out where there are several. A scenario of which nothing can be diagnosed from these recordings does not end
    the run: `sentence` then says why, and there is no verdict. Raises `OutputError` where files cannot be written.
    """
    train, held = (recordings[:-1], recordings[-1:]) if len(recordings) > 1 else (recordings, ())
    folder = out / FOLDER
    folder.mkdir(exist_ok=True)
    try:
        report = diagnose_command(
            scenario, train, held, folder, lambda text: progress(f"diagnosis: {text}"), replay=replay, base=out
        )
    except OutputError:
        raise
    except InputError as error:
        folder.rmdir()
        return {"verdict": None, "sentence": f"no diagnosis: {str(error).replace(f'{out}/', '')}", "report": None}
    return {"verdict": report["verdict"], "sentence": report["sentence"], "report": f"{FOLDER}/report.json"}
