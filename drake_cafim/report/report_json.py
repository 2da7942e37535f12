"""The contents of report.json: a verdict or an estimation as a mapping of plain values."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from drake_cafim.diagnosis.diagnose import Estimate
from drake_cafim.diagnosis.fit.goodness_of_fit import GoodnessOfFit
from drake_cafim.diagnosis.verdict import ChannelNoise, Comparison, Location, NominalParameter, Quality, Verdict

SCHEMA = "drake_cafim.report/1"


def report_of(
    verdict: Verdict | None,
    parameters: Sequence[Mapping[str, Any]],
    fit: Mapping[str, Any] | None,
    files: Mapping[str, str],
    noticed: Estimate | None = None,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """The report as a mapping: of a diagnosis, by its `verdict`; of an estimation, by `parameters` and `fit`.

    `noticed` is the estimation, for its sentence and the remarks on its recordings; `notes` are added to those of
    either. A number that is not finite becomes null, and a note names it.
    """
    return _with_nulls(_report_of(verdict, parameters, fit, files, noticed, notes))


def _report_of(
    verdict: Verdict | None,
    parameters: Sequence[Mapping[str, Any]],
    fit: Mapping[str, Any] | None,
    files: Mapping[str, str],
    noticed: Estimate | None,
    notes: Sequence[str],
) -> dict[str, Any]:
    if verdict is None:
        return {
            "schema": SCHEMA,
            "verdict": None,
            "sentence": str(noticed) if noticed else None,
            "goodness_of_fit": _goodness(noticed.goodness_of_fit) if noticed else None,
            "mismatch": _remaining(noticed.goodness_of_fit) if noticed else None,
            "data_mistakes": list(noticed.data_mistakes) if noticed else [],
            "noise_remarks": list(noticed.noise_remarks) if noticed else [],
            "explanation": [],
            "rivals": [],
            "parameters": list(parameters),
            "fit": fit,
            "noise": noise_entries(noticed.noise) if noticed else {},
            "trace": [],
            "learned": [],
            "notes": [*(noticed.notes if noticed else ()), *notes],
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
            "locations": _locations(verdict.mismatch.locations),
        },
        "data_mistakes": list(verdict.data_mistakes),
        "noise_remarks": list(verdict.noise_remarks),
        "explanation": [
            {
                "effect": accepted.effect.name,
                "at": accepted.effect.at,
                "probability": accepted.probability,
                "parameters": {
                    name: {
                        "value": accepted.effect.stated(name, v.value),
                        "std": v.std,
                        "unit": v.unit,
                        "efficiency": v.efficiency,
                    }
                    for name, v in accepted.values.items()
                },
                "sentence": accepted.sentence,
            }
            | ({} if accepted.cuts is None else {"cuts": accepted.cuts})
            for accepted in verdict.explanation
        ],
        "rivals": [
            {
                **({"effect": rival.effect} if rival.parameter is None else {"parameter": rival.parameter}),
                "at": rival.at,
                "probability": rival.probability,
                "why_alike": rival.why_alike,
            }
            for rival in verdict.rivals
        ],
        "parameters": parameters_of(verdict.parameters),
        "correction": {
            "as_given": verdict.correction.as_given,
            "unknowns": "as given" if verdict.correction.as_given or verdict.correction.unknowns_held else "fitted",
            "left_out": [
                {"effect": left.effect, "at": left.at, "why": left.why} for left in verdict.correction.left_out
            ],
            **({"why_as_given": verdict.correction.unknowns_held} if verdict.correction.unknowns_held else {}),
        },
        "fit": {
            "train": comparison_of(verdict.train),
            "held_out": None if verdict.held_out is None else comparison_of(verdict.held_out),
        },
        "noise": noise_entries(verdict.noise),
        "reduced_chi_square": {"nominal": verdict.reduced_chi_square[0], "corrected": verdict.reduced_chi_square[1]},
        "trace": [record.as_json() for record in verdict.trace],
        "learned": [
            {
                "at": learned.law.at,
                "variables": [term.variables for term in learned.law.terms],
                "words": learned.words,
                "file": learned.law.table,
            }
            for learned in verdict.learned
        ],
        "notes": [*verdict.notes, *notes],
        "next_experiment": verdict.next_experiment,
        "files": dict(files),
    }


def _goodness(goodness: GoodnessOfFit) -> dict[str, Any]:
    return {
        "accepted": goodness.accepted,
        "reduced_chi_square": goodness.reduced_chi_square,
        "p_value": goodness.p_value,
        "rows": goodness.rows,
    }


def _remaining(goodness: GoodnessOfFit) -> dict[str, Any]:
    """The `mismatch` of an estimation: what the fitted model leaves."""
    return {
        "detected": not goodness.accepted,
        "p_value": goodness.p_value,
        "locations": _locations(goodness.locations),
    }


def _locations(locations: Sequence[Location]) -> list[dict[str, Any]]:
    return [
        {
            "kind": location.kind,
            "name": location.name,
            "share": location.share,
            "intervals": [list(i) for i in location.intervals],
            "recording": location.recording,
            "where": location.where,
        }
        for location in locations
    ]


def _with_nulls(report: dict[str, Any]) -> dict[str, Any]:
    """The report with null for numbers that are not finite, and a note for each that no note mentions yet."""
    found: list[str] = []
    plain: dict[str, Any] = _finite(report, "", found)
    noted = " ".join(str(note) for note in plain["notes"])
    plain["notes"] += [f"{path} cannot be computed: no finite number comes out" for path in found if path not in noted]
    return plain


def _finite(part: Any, path: str, found: list[str]) -> Any:
    """A copy of `part`, null for what is not finite; `found` gathers their paths, as "fit.train.nominal.nll"."""
    if isinstance(part, Mapping):
        return {key: _finite(value, f"{path}.{key}".removeprefix("."), found) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [_finite(value, f"{path}.{k}", found) for k, value in enumerate(part)]
    if isinstance(part, float) and not math.isfinite(part):
        found.append(path)
        return None
    return part


def as_text(report: Mapping[str, Any]) -> str:
    """The report as JSON text, the same bytes for the same numbers."""
    return json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def parameters_of(parameters: Sequence[NominalParameter]) -> list[dict[str, Any]]:
    """The `parameters` of a report."""
    return [
        {
            "parameter": parameter.parameter,
            "at": parameter.at,
            "value": parameter.value,
            "std": parameter.std,
            "unit": parameter.unit,
            "efficiency": parameter.efficiency,
        }
        | ({} if parameter.effect is None else {"effect": parameter.effect})
        for parameter in parameters
    ]


def noise_entries(noise: Mapping[str, ChannelNoise]) -> dict[str, dict[str, Any]]:
    """The `noise` of a report: by column the std of one sample, its unit, its correlation time, s, and its origin."""
    return {
        column: {"std": own.std, "unit": own.unit, "correlation_time": own.correlation_time, "stated": own.stated}
        for column, own in noise.items()
    }


def comparison_of(comparison: Comparison) -> dict[str, Any]:
    """The entry `train` or `held_out` of a report's `fit`."""
    return {
        "nominal_as_given": _quality(comparison.nominal_as_given),
        "nominal": _quality(comparison.nominal),
        "corrected": _quality(comparison.corrected),
        **({} if comparison.named is None else {"named": _quality(comparison.named)}),
    }


def _quality(quality: Quality) -> dict[str, Any]:
    return {
        "nll": quality.nll,
        "rmse": dict(quality.rmse) or None,
        "rmse_short": dict(quality.rmse_short),
        "effort": {
            joint: {"rms": effort.rms, "relative": effort.relative, "cutoff": effort.cutoff}
            for joint, effort in quality.effort.items()
        },
        "diverges": dict(quality.diverges),
    }
