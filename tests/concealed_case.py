"""What a diagnosis gets of a concealed case."""

from pathlib import Path

from drake_cafim import recordings
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.concealed.case import Case


def written(case: Case, folder: Path) -> tuple[Scene, list[Recording]]:
    """The scene and the recordings that are not held out, from the case's files in `folder`."""
    case.write(folder)
    return Scene.load(folder / "scenario.yaml"), [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2, 3)]
