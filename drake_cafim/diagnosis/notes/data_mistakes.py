"""Finds mistakes of joints' data that look like physics: a wrong sign, unit or zero, swapped joints, lost gravity."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.data_mistakes import Corrected, Suspicion, correct, sentences, shared_by_all
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.notes.effort_units import cost_beside_physics, effort_factors
from drake_cafim.diagnosis.notes.first_order import COMMON, fit_to_first_order
from drake_cafim.diagnosis.notes.suspicions import in_another_unit, suspicions
from drake_cafim.diagnosis.rows.samples import samples_of, with_recording
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import (
    MISTAKE_CHI_SQUARE_PER_ROW,
    MISTAKE_CHI_SQUARE_SHARE_LEFT,
    MISTAKE_EXCERPT_SAMPLES,
    MISTAKE_EXCERPT_TRAVEL_SHARE,
    MISTAKE_MODEL_ACCURACY,
    MISTAKE_PART_SHARE_LEFT,
    MISTAKES_TRIED_EXACTLY,
)
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def data_mistakes(scene: Scene, recordings: Sequence[Recording], std: dict[str, float]) -> tuple[str, ...]:
    """A sentence for each mistake, with the files that have it; empty where there is none (see `sentences`).

    χ² is of the whitened rows under the model as given. Parts of one recording are tested together.
    """
    whole = _in_whole(recordings)
    given = [_Excerpts.of(scene, parts, std) for parts in whole]
    found = [
        excerpt.with_right_efforts(correct(parts[0].name, excerpt)) for parts, excerpt in zip(whole, given, strict=True)
    ]
    return sentences(_beyond_physics(given, found))


def _in_whole(recordings: Sequence[Recording]) -> list[list[Recording]]:
    """The parts of each recording: those that follow each other, of one name, and each later than the one before."""
    found: list[list[Recording]] = []
    for recording in recordings:
        before = found[-1][-1] if found else None
        if before is not None and recording.name == before.name and recording.time[0] > before.time[-1]:
            found[-1].append(recording)
        else:
            found.append([recording])
    return found


def _beyond_physics(
    given: "Sequence[_Excerpts]", found: "Sequence[Corrected[_Excerpts]]"
) -> "list[Corrected[_Excerpts]]":
    """`found`, less what one file is said to have wrong and physics that all files share explains as well.

    Where a robot lacks much, or its masses are unknown, one file may by chance agree with the model better once it is
    taken for wrong. The unknowns, and a friction and a bias of each joint, are then the same for all files.
    """
    shared = shared_by_all(found)
    if all(item.keys <= shared for item in found):
        return list(found)
    before, after = _fitted_together(given), _fitted_together([item.excerpt for item in found])
    return [
        item
        if item.keys <= shared or right < MISTAKE_CHI_SQUARE_SHARE_LEFT * left
        else replace(item, mistakes=(), left=excerpt.chi_square, excerpt=excerpt)
        for item, excerpt, left, right in zip(found, given, before, after, strict=True)
    ]


def _fitted_together(excerpts: "Sequence[_Excerpts]") -> tuple[float, ...]:
    """χ² per row of each file, once what is `COMMON` and the unknowns are fitted to all of them to first order.

    Without bounds: physics of any kind at a joint is to have its chance.
    """
    return fit_to_first_order([excerpt.problem for excerpt in excerpts], COMMON, bounded=False).left


@dataclass(frozen=True)
class _Excerpts:
    """Stretches of one recording as whitened rows under the model as given."""

    scene: Scene
    std: dict[str, float]
    problem: WeakProblem
    rows: tuple[Array, ...]
    """Whitened rows (R,) of each stretch."""

    @classmethod
    def of(cls, scene: Scene, parts: Sequence[Recording], std: dict[str, float]) -> "_Excerpts":
        """The stretches in which the joints move; those without a window, by gaps, are left out."""
        return cls._over(scene, std, _stretches(scene, parts))

    @classmethod
    def _over(cls, scene: Scene, std: dict[str, float], stretches: Sequence[Recording]) -> "_Excerpts":
        forms = []
        for stretch in stretches:
            with contextlib.suppress(InputError):
                forms.append(WeakForm(samples_of(scene, stretch, std), scene.wrench_sensors))
        problem = WeakProblem.as_measured(scene, forms, Model(scene.priors.mean), MISTAKE_MODEL_ACCURACY)
        physics = _nominal(scene)
        return cls(scene, std, problem, tuple(run.residual(physics) for run in problem.runs))

    @property
    def chi_square(self) -> float:
        """χ² per row; 0 where there is no row."""
        return float(np.mean(np.concatenate(self.rows) ** 2)) if self.rows else 0.0

    def scaled_again(self, suspicion: Suspicion) -> float:
        """χ² per row once the motion that `suspicion` has scaled down is scaled down again."""
        smaller = [suspicion.scaled_again(run.weak.samples.recording) for run in self.problem.runs]
        return self._over(self.scene, self.std, smaller).chi_square

    def with_right_efforts(self, corrected: "Corrected[_Excerpts]") -> "Corrected[_Excerpts]":
        """`corrected`, but for what physics explains better; or that efforts have another unit, if that leaves less.

        Motors that are all too weak, or too strong, are no mistake of the data, and then nothing else is either.
        """
        doubted = any(mistake.like_physics for mistake in corrected.mistakes)
        if self.chi_square < MISTAKE_CHI_SQUARE_PER_ROW or (corrected.mistakes and not doubted):
            return corrected
        plain = cost_beside_physics(self.problem)
        other = cost_beside_physics(corrected.excerpt.problem) if doubted else plain
        if doubted and plain < MISTAKE_PART_SHARE_LEFT * other:
            corrected, other = Corrected(corrected.name, (), self.chi_square, self), plain

        def scaled(factors: Mapping[str, float]) -> list[Suspicion]:
            return [in_another_unit(run.weak.samples.recording, factors) for run in self.problem.runs]

        factors = effort_factors(self.problem, lambda tried: self._correct(scaled(tried)).problem, plain, other)
        if factors is None:
            return corrected
        suspected = scaled(factors.by_joint)
        rest = correct(corrected.name, self._correct(suspected))
        return replace(rest, mistakes=(*(suspected[:1] if factors.are_units else ()), *rest.mistakes))

    def best_correction(self) -> "tuple[Suspicion, _Excerpts] | None":
        """The suspicion whose correction leaves the least χ², and the corrected excerpts; None where all raise it."""
        best: tuple[Suspicion, _Excerpts] | None = None
        for suspected in self._most_likely():
            right = self._correct(suspected)
            if right.chi_square < (best[1].chi_square if best else self.chi_square):
                best = suspected[0], right
        return best

    def _most_likely(self) -> list[list[Suspicion]]:
        """Of the corrections that lower χ² under the present covariance the few that leave least, in that order.

        Each is a suspicion by stretch. Squares only add up, so that a correction is left once it is at more than those.
        """
        physics, joints = _nominal(self.scene), self._glaring_joints()
        laws = bool(physics.joint_forces or physics.couplings)
        by_stretch = [list(suspicions(self.scene, run.weak.samples.recording, joints)) for run in self.problem.runs]
        found: list[tuple[float, list[Suspicion]]] = []
        bound = float(sum(rows @ rows for rows in self.rows))
        for suspected in zip(*by_stretch, strict=True):
            squares = 0.0
            for run, suspicion in zip(self.problem.runs, suspected, strict=True):
                samples = run.weak.samples
                right = with_recording(samples, self.scene, suspicion.correct(samples.recording), laws)
                rows = run.whitened(WeakForm(right, self.scene.wrench_sensors).residual(physics))
                squares += float(np.sum(rows**2))
                if not squares < bound:
                    break
            else:
                found = sorted([*found, (squares, list(suspected))], key=lambda pair: pair[0])[:MISTAKES_TRIED_EXACTLY]
                bound = found[-1][0] if len(found) == MISTAKES_TRIED_EXACTLY else bound
        return [suspected for _, suspected in found]

    def _correct(self, suspected: Sequence[Suspicion]) -> "_Excerpts":
        runs = zip(self.problem.runs, suspected, strict=True)
        right = [suspicion.correct(run.weak.samples.recording) for run, suspicion in runs]
        return self._over(self.scene, self.std, right)

    def _glaring_joints(self) -> list[int]:
        """The joints whose rows exceed noise by far in any stretch."""
        found: set[int] = set()
        for run, rows in zip(self.problem.runs, self.rows, strict=True):
            squares = np.mean(rows.reshape(run.shape) ** 2, axis=0)
            dynamic = squares[run.weak.dynamic]
            kinematic = squares[: run.weak.kinematic_rows] if run.weak.kinematic_rows else np.zeros_like(dynamic)
            found |= {j for j in range(len(dynamic)) if max(dynamic[j], kinematic[j]) > MISTAKE_CHI_SQUARE_PER_ROW}
        return sorted(found)


def _stretches(scene: Scene, parts: Sequence[Recording]) -> list[Recording]:
    """The middle of a recording, and for each joint that hardly moves there the stretch in which it moves most."""
    middle = parts[(len(parts) - 1) // 2]
    found = [(middle, max(0, len(middle.time) - MISTAKE_EXCERPT_SAMPLES) // 2)]
    for part in parts:
        last = max(0, len(part.time) - MISTAKE_EXCERPT_SAMPLES)
        found += [(part, start) for start in range(0, last + 1, MISTAKE_EXCERPT_SAMPLES // 2)]
    stretches = [_part(part, slice(start, start + MISTAKE_EXCERPT_SAMPLES)) for part, start in found]
    travel = np.stack([np.ptp(np.nan_to_num(own.matrix("q", scene.tree.joint_names)), axis=0) for own in stretches])
    chosen = [0]
    for j in range(travel.shape[1]):
        if travel[chosen, j].max() < MISTAKE_EXCERPT_TRAVEL_SHARE * travel[:, j].max():
            chosen.append(int(np.argmax(travel[:, j])))
    return [stretches[k] for k in dict.fromkeys(chosen)]


def _part(recording: Recording, part: slice) -> Recording:
    columns = {name: values[part] for name, values in recording.columns.items()}
    return replace(recording, time=recording.time[part], columns=columns)


def _nominal(scene: Scene) -> Physics:
    return Model(scene.priors.mean).physics(scene)
