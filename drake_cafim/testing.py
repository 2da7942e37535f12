"""An assertion for your own test suite: it fails where a robot's model does not explain the recordings.

from drake_cafim.testing import assert_explained

def test_the_model_explains_the_arm():
    assert_explained("arm.yaml", "last_night.mcap")
"""

from collections.abc import Sequence
from pathlib import Path

from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError
from drake_cafim.output import prepare_folder
from drake_cafim.recordings import Recording, read
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scene.scene import Scene

__all__ = ["assert_explained"]

Source = Recording | str | Path


def assert_explained(
    scene: Scene | str | Path,
    recordings: Source | Sequence[Source],
    *,
    held_out: Source | Sequence[Source] = (),
    allowed: Sequence[str] = (),
    effects: Sequence[type[Effect]] = (),
    artifacts: str | Path | None = None,
    settings: Settings | None = None,
) -> Verdict:
    """Assert that the scene's model and its stated noise explain the recordings, and return the verdict.

    `scene` is a Scene or an argument of `Scene.load`; a recording is a Recording or a file's path. `allowed` names
    effects that you tolerate, as "joint_coulomb_friction@elbow" or, at any place, "joint_coulomb_friction": the
    assertion passes if nothing else is found. A permanent effect belongs under `effects:` of the scenario instead,
    with its strength. `held_out`, `effects` and `settings` are those of `drake_cafim.diagnose`.

    Raises `AssertionError` with the verdict's sentence, after writing report.html, report.json,
    scenario.corrected.yaml and replay.html to the folder `artifacts`, by default the first free
    cafim-out/assert-explained-<n>. Raises `InputError` for unusable input, and for an unknown effect in `allowed`.
    """
    scene = (scene if isinstance(scene, Scene) else Scene.load(scene, effects=effects)).with_effect_classes(effects)
    _check_allowed(allowed, scene)
    train, held = _read_all(scene, recordings), _read_all(scene, held_out)
    if not train:
        raise InputError("assert_explained: no recording was given, expected at least one")
    verdict, outcome = examine(scene, train, held_out=held, settings=settings)
    if _passes(verdict, allowed):
        return verdict
    out = prepare_folder(
        None if artifacts is None else Path(artifacts), "assert-explained", resume=False, overwrite=True
    )
    command = ["cafim", "diagnose", scene.name, "--recording", *(recording.name for recording in train)]
    command += ["--held-out", *(recording.name for recording in held)] if held else []
    write_artifacts(out, verdict, outcome, train, held, command)
    raise AssertionError(f"{verdict}\nSee {out / 'report.html'} and {out / 'replay.html'}.")


def _passes(verdict: Verdict, allowed: Sequence[str]) -> bool:
    """Whether nothing is missing, or only allowed effects; a mistake of the data always fails."""
    if verdict.data_mistakes:
        return False
    if verdict.kind != "explained":
        return verdict.kind == "none"
    keys = [accepted.effect.key for accepted in verdict.explanation]
    return all(name in allowed or f"{name}@{at}" in allowed for name, at in keys)


def _check_allowed(allowed: Sequence[str], scene: Scene) -> None:
    known = [effect.name for effect in scene.vocabulary]
    for word in allowed:
        if word.partition("@")[0] not in known:
            raise InputError(f"allowed: {word}: there is no effect of that name; valid: {', '.join(known)}")


def _read_all(scene: Scene, sources: Source | Sequence[Source]) -> list[Recording]:
    listed = [sources] if isinstance(sources, Recording | str | Path) else sources
    return [source if isinstance(source, Recording) else read(source, scene.scenario.topics) for source in listed]
