"""Mistakes of the data that look like physics: a sign turned, joints swapped, an effort without gravity.

A recording that agrees with the model once it is put right needs no missing physics to explain it. Each recording is
looked at by itself, since files of one robot need not come from one program.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.suspicions import Suspicion, suspicions
from drake_cafim.diagnosis.rows.samples import retaken, samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import (
    MISTAKE_CHI_SQUARE_PER_ROW,
    MISTAKE_CHI_SQUARE_SHARE_LEFT,
    MISTAKE_EXCERPT_SAMPLES,
    MISTAKE_EXCERPT_TRAVEL_SHARE,
    MISTAKE_PART_SHARE_LEFT,
    MISTAKES_A_RECORDING,
    MISTAKES_TRIED_EXACTLY,
)
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def data_mistakes(scene: Scene, recordings: Sequence[Recording], std: dict[str, float]) -> tuple[str, ...]:
    """A sentence for each mistake, with the files that have it; empty where there is none.

    χ² is of the whitened rows under the model as given. What not all recordings share must put a recording right as
    far as those without it are: otherwise it would stand in for physics that this recording shows and others do not.
    """
    found = [_Looked.at(scene, recording, std) for recording in recordings]
    shared = set.intersection(*({one.key for one in looked.mistakes} for looked in found))
    clean = max((looked.left for looked in found if not looked.mistakes), default=0.0)
    files: dict[tuple[str, str], list[str]] = {}
    for looked in found:
        for one in looked.mistakes:
            if one.key in shared or not clean or looked.left <= max(MISTAKE_CHI_SQUARE_PER_ROW, clean):
                files.setdefault(one.key, []).append(looked.name)
    return tuple(f"{subject} of {_listed(names)} {words}" for (subject, words), names in files.items())


@dataclass(frozen=True)
class _Looked:
    """The `mistakes` of the recording `name`, and the χ² a row that is `left` once they are put right."""

    name: str
    mistakes: tuple[Suspicion, ...]
    left: float

    @classmethod
    def at(cls, scene: Scene, recording: Recording, std: dict[str, float]) -> "_Looked":
        """Mistakes one after the other, while each explains most of what the ones before it leave."""
        excerpt = _Excerpts.of(scene, recording, std)
        supposed: list[Suspicion] = []
        left, accepted = [excerpt.chi_square], 0
        while len(supposed) < MISTAKES_A_RECORDING and excerpt.glaring:
            better = excerpt.better()
            if better is None:
                break
            suspicion, excerpt = better
            supposed.append(suspicion)
            left.append(excerpt.chi_square)
            agrees = all(excerpt.agrees(suspicion) for suspicion in supposed if suspicion.scales)
            if agrees and left[-1] < MISTAKE_CHI_SQUARE_SHARE_LEFT * left[accepted]:
                accepted = len(supposed)
            elif left[-1] > MISTAKE_PART_SHARE_LEFT * left[-2]:
                break
        return cls(recording.name, tuple(supposed[:accepted]), left[accepted])


@dataclass(frozen=True)
class _Excerpts:
    """Stretches of one recording as whitened rows under the model as given."""

    scene: Scene
    std: dict[str, float]
    problem: WeakProblem
    rows: tuple[Array, ...]
    """Of each stretch, (R,)."""

    @classmethod
    def of(cls, scene: Scene, recording: Recording, std: dict[str, float]) -> "_Excerpts":
        """Of the stretches in which the joints move; those with more gaps than windows are left out."""
        return cls._over(scene, std, _stretches(scene, recording))

    @classmethod
    def _over(cls, scene: Scene, std: dict[str, float], stretches: Sequence[Recording]) -> "_Excerpts":
        forms = []
        for one in stretches:
            with contextlib.suppress(InputError):
                forms.append(WeakForm(samples_of(scene, one, std), scene.wrench_sensors))
        problem = WeakProblem.of(scene, forms, Model(scene.priors.mean))
        physics = _nominal(scene)
        return cls(scene, std, problem, tuple(run.residual(physics) for run in problem.runs))

    @property
    def chi_square(self) -> float:
        """A row; 0 where there is none."""
        return float(np.mean(np.concatenate(self.rows) ** 2)) if self.rows else 0.0

    @property
    def glaring(self) -> bool:
        return self.chi_square >= MISTAKE_CHI_SQUARE_PER_ROW

    def agrees(self, suspicion: Suspicion) -> bool:
        """Whether the motion is of the right size once `suspicion`, which scales it down, is put right."""
        if self.glaring:
            return False
        smaller = [suspicion.scaled_again(run.weak.samples.recording) for run in self.problem.runs]
        still = self._over(self.scene, self.std, smaller).chi_square
        return self.chi_square < MISTAKE_CHI_SQUARE_SHARE_LEFT * still

    def better(self) -> "tuple[Suspicion, _Excerpts] | None":
        """The suspicion whose putting right leaves least, and what it leaves; None where each makes it worse."""
        quick = self._quickly()
        best: tuple[Suspicion, _Excerpts] | None = None
        for index in np.argsort([left for left, _ in quick], kind="stable")[:MISTAKES_TRIED_EXACTLY]:
            left, suspected = quick[index]
            if left >= self.chi_square:
                break
            right = self._righted(suspected)
            if right.chi_square < (best[1].chi_square if best else self.chi_square):
                best = suspected[0], right
        return best

    def _quickly(self) -> list[tuple[float, list[Suspicion]]]:
        """χ² a row under the covariance of what was given, and the suspicion in each stretch."""
        physics, joints = _nominal(self.scene), self._glaring_joints()
        by_stretch = [list(suspicions(self.scene, run.weak.samples.recording, joints)) for run in self.problem.runs]
        result = []
        for suspected in zip(*by_stretch, strict=True):
            rows = []
            for run, one in zip(self.problem.runs, suspected, strict=True):
                righted = retaken(run.weak.samples, self.scene, one.put_right(run.weak.samples.recording))
                rows.append(run.whitened(WeakForm(righted, self.scene.wrench_sensors).residual(physics)))
            result.append((float(np.mean(np.concatenate([one.ravel() for one in rows]) ** 2)), list(suspected)))
        return result

    def _righted(self, suspected: Sequence[Suspicion]) -> "_Excerpts":
        runs = zip(self.problem.runs, suspected, strict=True)
        right = [one.put_right(run.weak.samples.recording) for run, one in runs]
        return self._over(self.scene, self.std, right)

    def _glaring_joints(self) -> list[int]:
        """The joints whose rows are far beyond noise in any stretch."""
        found: set[int] = set()
        for run, rows in zip(self.problem.runs, self.rows, strict=True):
            squares = np.mean(rows.reshape(run.shape) ** 2, axis=0)
            dynamic = squares[run.weak.dynamic]
            kinematic = squares[: run.weak.kinematic_rows] if run.weak.kinematic_rows else np.zeros_like(dynamic)
            found |= {j for j in range(len(dynamic)) if max(dynamic[j], kinematic[j]) > MISTAKE_CHI_SQUARE_PER_ROW}
        return sorted(found)


def _stretches(scene: Scene, recording: Recording) -> list[Recording]:
    """The middle of a recording, and for joints that hardly move there the stretch in which they move most."""
    q = np.nan_to_num(recording.matrix("q", scene.tree.joint_names))
    last = max(0, len(q) - MISTAKE_EXCERPT_SAMPLES)
    starts = [last // 2, *range(0, last + 1, MISTAKE_EXCERPT_SAMPLES // 2)]
    travel = np.stack([np.ptp(q[start : start + MISTAKE_EXCERPT_SAMPLES], axis=0) for start in starts])
    chosen = [0]
    for j in range(q.shape[1]):
        if travel[chosen, j].max() < MISTAKE_EXCERPT_TRAVEL_SHARE * travel[:, j].max():
            chosen.append(int(np.argmax(travel[:, j])))
    return [_part(recording, slice(starts[k], starts[k] + MISTAKE_EXCERPT_SAMPLES)) for k in dict.fromkeys(chosen)]


def _part(recording: Recording, part: slice) -> Recording:
    columns = {name: values[part] for name, values in recording.columns.items()}
    return replace(recording, time=recording.time[part], columns=columns)


def _nominal(scene: Scene) -> Physics:
    return Model(scene.priors.mean).physics(scene)


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
