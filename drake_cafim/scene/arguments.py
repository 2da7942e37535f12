"""Check of what a script gives to `diagnose` and `estimate`."""

from collections.abc import Sequence

from drake_cafim.errors import InputError, check_type
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene


def check_arguments(scene: object, recordings: object, held_out: object = ()) -> None:
    """Raises `InputError` unless these are a scene, one or more recordings, and any number of them."""
    check_type("scene", scene, Scene, "a Scene, as Scene.load returns")
    for name, group in (("recordings", recordings), ("held_out", held_out)):
        check_type(name, group, Sequence, "a list of recordings")
        assert isinstance(group, Sequence)
        for i, recording in enumerate(group):
            check_type(f"{name}[{i}]", recording, Recording, "a Recording, as drake_cafim.read returns")
    if not recordings:
        raise InputError("recordings is empty, expected at least one")
