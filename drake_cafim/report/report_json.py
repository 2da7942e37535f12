"""report.json: the verdict as the contract of the command line writes it."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from drake_cafim.diagnosis.verdict import Comparison, NominalParameter, Quality, Verdict

SCHEMA = "drake_cafim.report/1"


def report_of(
    verdict: Verdict | None,
    parameters: Sequence[Mapping[str, Any]],
    fit: Mapping[str, Any] | None,
    files: Mapping[str, str],
) -> dict[str, Any]:
    """The report as a mapping; an estimation has no verdict, a diagnosis brings its own parameters and fit."""
    if verdict is None:
        return {
            "schema": SCHEMA,
            "verdict": None,
            "mismatch": None,
            "data_mistakes": [],
            "explanation": [],
            "rivals": [],
            "parameters": list(parameters),
            "fit": fit,
            "next_experiment": None,
            "files": dict(files),
        }
    return {
        "schema": SCHEMA,
        "verdict": verdict.kind,
        "sentence": str(verdict),
        "mismatch": {
            "detected": verdict.mismatch.detected,
            "p_value": verdict.mismatch.p_value,
            "locations": [
                {
                    "kind": one.kind,
                    "name": one.name,
                    "share": one.share,
                    "intervals": [list(i) for i in one.intervals],
                    "recording": one.recording,
                    "where": one.where,
                }
                for one in verdict.mismatch.locations
            ],
        },
        "data_mistakes": [*verdict.data_mistakes, *verdict.noise_remarks],
        "explanation": [
            {
                "effect": one.effect.name,
                "at": one.effect.at,
                "probability": one.probability,
                "parameters": {
                    name: {"value": v.value, "std": v.std, "unit": v.unit} for name, v in one.values.items()
                },
                "sentence": one.sentence,
            }
            for one in verdict.explanation
        ],
        "rivals": [
            {"effect": one.effect, "at": one.at, "probability": one.probability, "why_alike": one.why_alike}
            for one in verdict.rivals
        ],
        "parameters": parameters_of(verdict.parameters),
        "fit": {
            "train": comparison_of(verdict.train),
            "held_out": None if verdict.held_out is None else comparison_of(verdict.held_out),
        },
        "reduced_chi_square": {"nominal": verdict.reduced_chi_square[0], "corrected": verdict.reduced_chi_square[1]},
        "notes": list(verdict.notes),
        "next_experiment": verdict.next_experiment,
        "files": dict(files),
    }


def as_text(report: Mapping[str, Any]) -> str:
    """The report as JSON text, the same bytes for the same numbers."""
    return json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def parameters_of(parameters: Sequence[NominalParameter]) -> list[dict[str, Any]]:
    """The `parameters` of a report."""
    return [
        {"parameter": one.parameter, "at": one.at, "value": one.value, "std": one.std, "unit": one.unit}
        for one in parameters
    ]


def comparison_of(comparison: Comparison) -> dict[str, Any]:
    """One set's part of the `fit` of a report."""
    return {
        "nominal_as_given": _quality(comparison.nominal_as_given),
        "nominal": _quality(comparison.nominal),
        "corrected": _quality(comparison.corrected),
    }


def _quality(quality: Quality) -> dict[str, Any]:
    return {"nll": quality.nll, "rmse": dict(quality.rmse)}
