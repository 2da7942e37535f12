"""Contact-aware experiment design and estimation for robots, and diagnosis of the physics that their models lack.

The public names, loaded when they are first used (pydrake takes half a second):

- `Scene`: a model, its channels and its unknown parameters; `Scene.load`, `Scene.from_model`.
- `read`, `write`, `Recording`: recordings of a robot.
- `diagnose`, `Verdict`, `Settings`: where recordings and model differ, which physics is missing, with probabilities.
- `estimate`: the scene's unknown parameters alone.
- `drake_cafim.testing.assert_explained`: for your own tests; fails where the model does not explain the recordings.
- `InputError`: unusable input, described in one sentence.

For your own Diagram: `drake_cafim.design.system.CaOed` plans informative contact motions,
`drake_cafim.estimation.system.CaMap` estimates parameters from measured forces, and `Scene.add_to` adds a scene's
plant with its effects. Three scripts to start from: `drake_cafim.diagrams.tutorials`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from drake_cafim.errors import InputError

if TYPE_CHECKING:
    from drake_cafim.diagnosis.diagnose import diagnose, estimate
    from drake_cafim.diagnosis.search.state import Settings
    from drake_cafim.diagnosis.verdict import Verdict
    from drake_cafim.recordings import read, write
    from drake_cafim.recordings.recording import Recording
    from drake_cafim.scene.scene import Scene

__all__ = ["InputError", "Recording", "Scene", "Settings", "Verdict", "diagnose", "estimate", "read", "write"]

_HOMES = {
    "Recording": "drake_cafim.recordings.recording",
    "Scene": "drake_cafim.scene.scene",
    "Settings": "drake_cafim.diagnosis.search.search",
    "Verdict": "drake_cafim.diagnosis.verdict",
    "diagnose": "drake_cafim.diagnosis.diagnose",
    "estimate": "drake_cafim.diagnosis.diagnose",
    "read": "drake_cafim.recordings",
    "write": "drake_cafim.recordings",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'drake_cafim' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
