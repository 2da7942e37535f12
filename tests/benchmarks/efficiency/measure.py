"""Draws of a cell, refitted by the diagnosis' own fit of a given effect; kept in a folder, so that a run resumes."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.likelihood.finish import finish
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search.given_effects import fit_given
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect as Law
from drake_cafim.numerics.computation import NotComputable
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.concealed.robots import Array

from .bound import Bound, bound_of
from .cell import Cell, moved, recorded, scene_of

TOGETHER = 50
"""Draws that are simulated at once where each has a motion of its own."""


@dataclass(frozen=True)
class Draw:
    """One refit: unknowns and strengths (n + k,) with the std that a report would state; None where it failed."""

    number: int
    values: list[float] | None
    std: list[float] | None
    reduced_chi_square: float
    seconds: float
    words: str = ""


def started(cell: Cell) -> Law:
    """The effect with strengths of typical size, from which its fit starts."""
    law = effect_named(cell.effect.name)(cell.effect.at)
    return law.with_values({s.name: s.nominal + s.typical for s in law.strengths})


def refitted(
    cell: Cell, scene: Scene, recordings: Sequence[Recording], number: int, by_likelihood: bool = True
) -> Draw:
    """The given effect fitted to recordings as a diagnosis fits what it has named; `words` say why by rows alone."""
    begun = time.perf_counter()
    try:
        prepared = prepare(scene, recordings)
        assert isinstance(prepared, Prepared)
        problem, found = fit_given(prepared.problem(), Model(scene.priors.mean, (started(cell),)))
        whole = finish(prepared.scene, prepared.weak, found) if by_likelihood else NotComputable("rows were asked for")
        if isinstance(whole, Fit):
            found, std, words = whole, np.sqrt(np.diag(whole.covariance)), ""
        else:
            std, words = standard_deviations(problem, found, scale_of(found)), whole.reason
            std[: len(cell.unknown)] = found.std[: len(cell.unknown)]
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return Draw(number, None, None, float("nan"), time.perf_counter() - begun, f"{type(error).__name__}: {error}")
    taken = time.perf_counter() - begun
    return Draw(number, found.model.vector.tolist(), std.tolist(), found.reduced_chi_square, taken, words)


def measured(
    cell: Cell,
    draws: int,
    out: Path,
    progress: Callable[[str], None] = lambda text: None,
    by_likelihood: bool = True,
) -> tuple[Bound, list[Draw]]:
    """The bound and the first `draws` draws; what `out` holds of this very cell is not done again."""
    own = folder_of(cell, out)
    own.mkdir(parents=True, exist_ok=True)
    clean = None
    if not (own / "bound.json").is_file():
        progress(f"{cell.name}: bound")
        clean = moved(cell)[0]
        bound = bound_of(cell, clean, len(cell.unknown))
        content = {**asdict(bound), "covariance": bound.covariance.tolist()}
        write_text(own / "bound.json", json.dumps(content, indent=1) + "\n")
    content = json.loads((own / "bound.json").read_text())
    bound, done = Bound(np.array(content["covariance"]), content["segments"], content["bend"]), kept(cell, out)
    missing = [number for number in range(draws) if number not in done]
    if missing:
        scene = scene_of(cell, own)
        motions = {} if cell.fed_back else dict.fromkeys(missing, clean or moved(cell)[0])
        for index, number in enumerate(missing):
            if number not in motions:
                batch = tuple(missing[index : index + TOGETHER])
                motions = dict(zip(batch, moved(cell, batch), strict=True))
            progress(f"{cell.name}: draw {number + 1} of {draws}")
            done[number] = refitted(cell, scene, recorded(cell, motions[number], number), number, by_likelihood)
            with (own / "draws.jsonl").open("a") as file:
                file.write(json.dumps(asdict(done[number])) + "\n")
    return bound, [done[number] for number in range(draws)]


def folder_of(cell: Cell, out: Path) -> Path:
    return out / f"{slug(cell)}-{fingerprint(cell)}"


def kept(cell: Cell, out: Path) -> dict[int, Draw]:
    """The draws that `out` holds of this very cell, by number."""
    path = folder_of(cell, out) / "draws.jsonl"
    # a run that was killed may have left half a line
    lines = [line for line in path.read_text().splitlines() if line.endswith("}")] if path.is_file() else []
    return {draw.number: draw for draw in (Draw(**json.loads(line)) for line in lines)}


def slug(cell: Cell) -> str:
    return "_".join("".join(c if c.isalnum() else " " for c in cell.name).split())


def fingerprint(cell: Cell) -> str:
    """Of all that defines the cell, but not of the code that fits it: another code's results go to another folder."""
    parts = {key: value for key, value in cell.__dict__.items() if key != "machine"}
    return hashlib.sha256(repr((cell.machine.__name__, parts)).encode()).hexdigest()[:8]


@dataclass(frozen=True)
class Line:
    """What the table says of a cell; each figure with its 99 % interval."""

    efficiency: float
    efficiency_interval: tuple[float, float]
    honesty: float
    honesty_interval: tuple[float, float]
    bias: float
    """Mean error over the standard error of that mean."""
    failed: int
    seconds: float
    reduced_chi_square: float


def line_of(cell: Cell, bound: Bound, draws: Sequence[Draw]) -> Line:
    """Of the effect's first strength.

    Efficiency is 1/mean((η̂ − η)²) over the bound's information 1/σ²; honesty the root mean square of the stated std
    over the scatter of η̂. Intervals by bootstrap over draws.
    """
    index = len(cell.unknown)
    good = [draw for draw in draws if draw.values is not None and draw.std is not None]
    if len(good) < 2:
        nothing = (float("nan"), float("nan"))
        return Line(0.0, nothing, nothing[0], nothing, nothing[0], len(draws), nothing[0], nothing[0])
    values = np.array([draw.values[index] for draw in good])  # type: ignore[index]
    stated = np.array([draw.std[index] for draw in good])  # type: ignore[index]
    error = values - cell.true[index]
    variance = float(bound.covariance[index, index])

    def efficiency(rows: Array) -> Array:
        return np.asarray(variance / np.mean(error[rows] ** 2, axis=-1))

    def honesty(rows: Array) -> Array:
        # of few draws a sample may hold one alone, again and again
        scatter = np.maximum(np.std(error[rows], axis=-1, ddof=1), 1e-12 * np.max(np.abs(error)))
        return np.asarray(np.sqrt(np.mean(stated[rows] ** 2, axis=-1)) / scatter)

    everything = np.arange(len(good))
    again = np.random.default_rng(0).integers(0, len(good), (4000, len(good)))
    return Line(
        float(efficiency(everything)),
        tuple(np.quantile(efficiency(again), (0.005, 0.995)).tolist()),
        float(honesty(everything)),
        tuple(np.quantile(honesty(again), (0.005, 0.995)).tolist()),
        float(np.mean(error) / (np.std(error, ddof=1) / np.sqrt(len(error)))),
        len(draws) - len(good),
        float(np.median([draw.seconds for draw in good])),
        float(np.mean([draw.reduced_chi_square for draw in good])),
    )
