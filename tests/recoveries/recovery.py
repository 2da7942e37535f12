"""Recovery of one effect: simulation by Drake, diagnosis, and simulation of the corrected scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_cafim.diagnosis.diagnose import diagnose, examine
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

from .cases import HIDDEN, Case
from .following import Following, following, start_of

STANDARD_DEVIATIONS = 3.0
"""Of noise, start and strengths together, within which a scene follows a recording."""


@dataclass(frozen=True)
class Recovery:
    """What a diagnosis made of a case."""

    case: Case
    verdict: Verdict
    again: Verdict | None
    """On the same recordings, with the corrected scene as its file says it."""
    followed: Following | None
    """By the corrected scene; None where that lacks the effect."""
    bare: Following | None
    """By the scene without the effect, beside what is to be expected of the corrected one."""

    @property
    def named(self) -> bool:
        """Whether the effect, at its place, is all that was found."""
        found = [(accepted.effect.name, accepted.effect.at) for accepted in self.verdict.explanation]
        return self.verdict.kind == "explained" and found == [(self.case.name, self.case.at)]

    @property
    def errors(self) -> dict[str, float]:
        """By strength that vanishes with the effect: its error as a share of its distance from there."""
        if not self.named:
            return {}
        effect = self.verdict.explanation[0].effect
        true = self.case.values
        return {
            s.name: abs(effect.values[s.name] - true[s.name]) / abs(true[s.name] - s.nominal)
            for s in effect.strengths
            if s.amplitude
        }

    @property
    def tolerance(self) -> float:
        return 0.10 if self.case.name in HIDDEN else 0.05

    @property
    def follows(self) -> bool:
        return self.followed is not None and self.followed.worst <= STANDARD_DEVIATIONS


def recovered(case: Case, folder: Path) -> Recovery:
    """The case simulated and diagnosed.

    Where its effect was found, the corrected scene is written, read back, diagnosed with, and followed on a recording
    that was held out.
    """
    for name in ("true", "bare"):
        (folder / name).mkdir()
    true, bare = case.scene(folder / "true", True), case.scene(folder / "bare", False)
    train = case.training(true, bare)
    verdict, outcome = examine(bare, train)
    found = Recovery(case, verdict, None, None, None)
    if not found.named:
        return found
    corrected, held = read_back(verdict.corrected, folder / "out"), case.held_out(true)
    start = start_of(corrected, held, case.step)
    followed = following(corrected, _nearby(bare, outcome.best), held, start, case.horizon, case.step)
    without = following(bare, [], held, start, case.horizon, case.step)
    return Recovery(case, verdict, diagnose(corrected, train), followed, Following(without.error, followed.expected))


def read_back(scene: Scene, folder: Path) -> Scene:
    """The scene of the file that says what this one is."""
    folder.mkdir()
    path = folder / "scenario.corrected.yaml"
    path.write_text(as_yaml(scene.scenario, scene.folder, folder))
    return Scene.load(path)


def _nearby(bare: Scene, best: Fit) -> list[Scene]:
    """The corrected scene, one standard deviation along each axis of what is not known of unknowns and strengths."""
    [effect] = best.model.effects
    n = len(best.model.unknown)
    return [
        bare.corrected(best.model.unknown + axis[:n], [effect.with_values(effect.vector + axis[n:])])
        for axis in _axes(best).T
    ]


def _axes(best: Fit) -> Array:
    variance, directions = np.linalg.eigh(best.covariance)
    return np.asarray(directions * np.sqrt(np.clip(variance, 0.0, None)))


def sentences(found: Recovery) -> Sequence[str]:
    """What a case fails, in words; none if it does not."""
    result = []
    if not found.named:
        return [f"found: {found.verdict}"]
    for name, error in found.errors.items():
        if error > found.tolerance:
            result.append(f"{name} is {100 * error:.1f} % off")
    if found.followed is not None and not found.follows:
        result.append(f"follows with {found.followed.worst:.1f} times the expected error")
    if found.again is not None and found.again.kind != "none":
        result.append(f"with the corrected scene: {found.again}")
    return result
