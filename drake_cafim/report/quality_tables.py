"""Tables of the prediction errors of three models: as given, with the unknowns fitted, and with the effects too."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from drake_cafim.diagnosis.verdict import Comparison, Quality, Verdict
from drake_cafim.report import wording

UNREPORTED = "–"


def quality_tables(verdict: Verdict, unit_of: Callable[[str], str]) -> list[dict[str, Any]]:
    """Tables for the recordings held out, if any, and for those fitted to; `unit_of` gives a column's unit."""
    sets = [("held out (nothing was chosen or fitted on them)", verdict.held_out), ("fitted to", verdict.train)]
    return [_table(title, comparison, unit_of) for title, comparison in sets if comparison is not None]


def effort_summary(comparison: Comparison, changed: bool) -> tuple[str, float] | None:
    """The median over joints of the relative effort residual, nominal (→ corrected), and its cutoff in Hz."""
    models = [comparison.nominal, comparison.corrected][: 1 + changed]
    relative = [[e.relative for e in model.effort.values() if e.relative is not None] for model in models]
    if not all(relative):
        return None
    cutoff = next(iter(comparison.nominal.effort.values())).cutoff
    return " → ".join(wording.rounded(float(np.median(values)), 2) for values in relative), cutoff


def _table(title: str, comparison: Comparison, unit_of: Callable[[str], str]) -> dict[str, Any]:
    models = (comparison.nominal_as_given, comparison.nominal, comparison.corrected)
    return {
        "title": title,
        "long": _errors(models, [model.rmse for model in models], unit_of, with_divergence=True),
        "short": _errors(models, [model.rmse_short for model in models], unit_of, with_divergence=False),
        "effort": _efforts(models),
        "cutoff": wording.rounded(next((e.cutoff for model in models for e in model.effort.values()), 0.0), 3),
        "likelihood": [wording.figure(model.nll, 4) for model in models],
    }


def _errors(
    models: Sequence[Quality],
    errors: Sequence[Mapping[str, float]],
    unit_of: Callable[[str], str],
    *,
    with_divergence: bool,
) -> list[dict[str, Any]]:
    """A row for each column; where a simulation diverged, its cell says after how many seconds."""
    rows = []
    for column in dict.fromkeys(column for error in errors for column in error):
        joint = column.partition(".")[2]
        values = [error.get(column, np.nan) for error in errors]
        cells = [wording.figure(value) for value in values]
        diverges = [model.diverges.get(joint) if with_divergence else None for model in models]
        cells = [
            cell if seconds is None else f"{cell}, diverges after {wording.rounded(seconds, 2)} s"
            for cell, seconds in zip(cells, diverges, strict=True)
        ]
        comparable = diverges[1] is None and diverges[2] is None
        factor = _factor(values[1], values[2]) if comparable else ""
        rows.append({"column": column, "unit": unit_of(column), "cells": cells, "factor": factor})
    return rows


def _efforts(models: Sequence[Quality]) -> list[dict[str, Any]]:
    """A row for each joint: the relative residual of inverse dynamics under each model."""
    rows = []
    for joint in dict.fromkeys(joint for model in models for joint in model.effort):
        relative = [model.effort[joint].relative if joint in model.effort else None for model in models]
        cells = [UNREPORTED if value is None else wording.rounded(value, 2) for value in relative]
        factor = _factor(relative[1] or 0.0, relative[2] or 0.0)
        rows.append({"column": joint, "unit": "", "cells": cells, "factor": factor})
    return rows


def _factor(nominal: float, corrected: float) -> str:
    if not (corrected > 0.0 and nominal > 0.0):
        return ""
    ratio = nominal / corrected
    if 0.95 < ratio < 1.05:
        return "the same"
    return f"{wording.rounded(ratio, 2)} × smaller" if ratio > 1.0 else f"{wording.rounded(1.0 / ratio, 2)} × larger"
