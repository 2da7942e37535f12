"""A look at each part of long recordings: how far its residual exceeds noise, and what it tells of each hypothesis."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.columns import whitened
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.long.parts import Parts
from drake_cafim.diagnosis.preparation import Prepared
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError
from drake_cafim.kept import NOTHING_KEPT, Kept
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.parallel.forked import map_forked
from drake_cafim.typing import Array

Progress = Callable[[str], None]
MOST_INFORMED = 128
"""Parts whose information is computed, evenly spread where there are more: few of them are searched."""


@dataclass(frozen=True)
class Seen:
    """What a look at part `number` shows, its unknowns and strengths fitted to it alone.

    `excess` (r,) is the mean square less 1 of each row of a window; `p_value` that of the residual being noise;
    `information` by hypothesis its Fisher information, that of the fitted parameters taken out, in units of its typical
    strength.
    """

    number: int
    samples: int
    excess: Array
    p_value: float
    information: dict[Key, float]
    """Empty where it was not computed."""


def scan(
    parts: Parts,
    prepared: Prepared,
    model: Model,
    progress: Progress = lambda text: None,
    jobs: int = 1,
    kept: Kept = NOTHING_KEPT,
) -> tuple[list[Seen], list[str]]:
    """A look at each part under `model`, refitted to it, by `jobs` processes; a note on each that cannot be used.

    Looks that are `kept` are not repeated.
    """
    found, notes = [], []
    known = {number: kept.read(f"look_{number}", _from_json) for number in range(len(parts))}
    new = [number for number, seen in known.items() if seen is None]
    informed = {round(at) for at in np.linspace(0, len(parts) - 1, min(len(parts), MOST_INFORMED))}
    looks = map_forked(
        lambda index: compute(lambda: _look(parts, prepared, model, new[index], new[index] in informed)), len(new), jobs
    )
    for number, before in known.items():
        seen = before or next(looks)
        if isinstance(seen, NotComputable):
            seen = seen.reason
        if before is None:
            kept.write(f"look_{number}", seen if isinstance(seen, str) else _as_json(seen))
        progress(f"looked at part {number + 1} of {len(parts)}")
        if isinstance(seen, Seen):
            found.append(seen)
        else:
            notes.append(f"{parts.words([number])}: left out, {seen}")
    return found, notes


def _as_json(seen: Seen) -> dict[str, Any]:
    information = [[*key, value] for key, value in seen.information.items()]
    return {name: getattr(seen, name) for name in ("number", "samples", "p_value")} | {
        "excess": seen.excess.tolist(),
        "information": information,
    }


def _from_json(raw: Any) -> Seen | str:
    if isinstance(raw, str):
        return raw
    information = {(effect, at): float(value) for effect, at, value in raw["information"]}
    return Seen(raw["number"], raw["samples"], np.array(raw["excess"], dtype=float), raw["p_value"], information)


def _look(parts: Parts, prepared: Prepared, model: Model, number: int, informed: bool) -> Seen | str:
    try:
        form = prepared.laid_out(parts.read(number))
    except InputError as error:
        return str(error)
    problem = WeakProblem.of(prepared.scene, [form], model)
    fitted = unbiased_fit(problem, model)
    rows = fitted.residual[: problem.rows].reshape(problem.runs[0].shape)
    return Seen(
        number,
        len(form.samples.time),
        np.mean(rows**2, axis=0) - 1.0,
        adequacy(problem, fitted.residual, fitted.strengths).p_value,
        dict(_informations(problem, fitted)) if informed else {},
    )


def is_scanned(effect: Effect) -> bool:
    """Whether an effect enters the rows linearly and all the time, so that one look tells its information."""
    return not effect.brief and all(strength.amplitude for strength in effect.strengths)


def _informations(problem: WeakProblem, fitted: Fit) -> list[tuple[Key, float]]:
    basis = np.linalg.qr(fitted.jacobian)[0][: problem.rows] if fitted.jacobian.shape[1] else None
    found = []
    for effect in problem.hypotheses():
        if effect.key in fitted.model.keys or not is_scanned(effect):
            continue
        look = next(iter(problem.looks(fitted, effect).found), None)
        if look is None:
            continue
        columns = whitened(look[0])
        left = columns if basis is None else columns - basis @ (basis.T @ columns)
        size = float(np.sum(left**2))
        found.append((effect.key, size if np.isfinite(size) else 0.0))
    return found
