"""report.html: the verdict as one page that needs no network."""

import re
import shlex
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from drake_cafim.diagnosis.forecast import forecast
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.samples import samples_of
from drake_cafim.diagnosis.search import Outcome
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.verdict import Comparison, Location, NominalParameter, Verdict
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.report import colours, wording
from drake_cafim.report.evidence import evidence_of
from drake_cafim.report.forecast_figure import Contest, forecast_figure, telling_columns
from drake_cafim.report.law_figures import law_picture
from drake_cafim.report.laws import law_of
from drake_cafim.report.missing import residual_maps, row_labels
from drake_cafim.report.next_experiment import next_experiment
from drake_cafim.report.remains_figure import remains_figure
from drake_cafim.report.residual_figure import residual_figure, worst_first
from drake_cafim.report.toss_pictures import ROWS, recordings_of, shown_recording, toss_contest, toss_maps
from drake_cafim.scenario.physics import Physics

TEMPLATE, REPORT = "report.html.j2", "report.json"
SUSPECT = 3.0
"""Prior standard deviations beyond which an unknown is itself a mismatch."""
BADGES = {"none": "nothing missing", "explained": "explained", "unexplained": "not all explained"}


def write_report_page(
    path: Path, verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], command: Sequence[str]
) -> None:
    """Write the page to `path`, whole or not at all; `command` is the line that makes it again."""
    write_text(path, render(verdict, outcome, held_out, command))


def render(verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], command: Sequence[str]) -> str:
    """The page as text, the same bytes for the same verdict."""
    folder = Path(__file__).parent
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    corrected = verdict.corrected.physics
    without = _without(verdict, outcome)
    if isinstance(outcome.problem, TossProblem):
        unknown = np.array([one.value for one in verdict.parameters])
        effects = tuple(one.effect for one in verdict.explanation)
        maps, labels = toss_maps(outcome.problem, Model(unknown), Model(unknown, effects)), list(ROWS)
    else:
        assert isinstance(outcome.problem, WeakProblem)
        maps, labels = residual_maps(outcome.problem, without, corrected), row_labels(outcome.problem)
    shown = worst_first(maps)
    changed = bool(verdict.explanation)
    return environment.get_template(TEMPLATE).render(
        colours=colours,
        wording=wording,
        verdict=verdict,
        sentence=str(verdict),
        headline=_headline(str(verdict)),
        badge="check the recording" if verdict.data_mistakes else BADGES[verdict.kind],
        tone="mistake" if verdict.data_mistakes else verdict.kind,
        changed=changed,
        thrown=isinstance(outcome.problem, TossProblem),
        tiles=_tiles(verdict),
        heat_map=residual_figure(shown, labels, with_after=changed),
        recordings=len(maps),
        recordings_shown=len(shown),
        places=_places(verdict.mismatch.standing),
        effects=_effects(verdict, outcome, without, corrected),
        remains=_remains(verdict, outcome, corrected),
        forecast=_forecast(verdict, outcome, held_out, corrected),
        held_out=held_out,
        tables=_tables(verdict),
        parameters=[_parameter(one) for one in verdict.parameters],
        files=_files(outcome, held_out),
        command=shlex.join(command),
        next_experiment=next_experiment(verdict.next_experiment, _design(verdict)),
        versions=f"drake_cafim {version('drake_cafim')}, Drake {version('drake')}",
    )


def _design(verdict: Verdict) -> str:
    """The command that designs the motion which tells the rivals apart, where there are any."""
    return shlex.join(["cafim", "discriminate", verdict.corrected.name, REPORT]) if verdict.rivals else ""


def _headline(sentence: str) -> Markup:
    """The sentence with what stands in brackets in lighter letters."""
    return Markup(re.sub(r"\([^()]*\)", r'<span class="aside">\g<0></span>', str(escape(sentence))))


def _without(verdict: Verdict, outcome: Outcome) -> Physics:
    """The nominal physics at the unknowns of the verdict."""
    return outcome.problem.scene.physics_at(np.array([one.value for one in verdict.parameters]))


def _tiles(verdict: Verdict) -> list[dict[str, str]]:
    """The few figures that say how much the verdict is worth."""
    before, after = verdict.reduced_chi_square
    changed = bool(verdict.explanation)
    fit = wording.rounded(before) + (f" → {wording.rounded(after)}" if changed else "")
    tiles = [{"figure": fit, "what": "mean square misfit, 1 is what noise alone gives"}]
    comparison = verdict.held_out or verdict.train
    column = _telling_column(comparison)
    if column is not None:
        values = [comparison.nominal.rmse[column], comparison.corrected.rmse[column]][: 1 + changed]
        where = "recordings held out" if verdict.held_out else "the recordings"
        figure = wording.with_prefix(values, unit_of(verdict, column))
        tiles.append({"figure": figure, "what": f"error of a 1 s simulation in {column}, on {where}"})
    p = wording.p_value(verdict.mismatch.p_value)
    tiles.append({"figure": f"p {p}", "what": "probability that noise alone does so, for all that was looked at"})
    return tiles


def _telling_column(comparison: Comparison) -> str | None:
    """The position that gains most by the effects, or another column where no position does."""
    gain = {c: comparison.nominal.rmse[c] / max(comparison.corrected.rmse[c], 1e-300) for c in comparison.nominal.rmse}
    positions = {c: g for c, g in gain.items() if c.startswith("q.")}
    if not gain:
        return None
    if positions and (max(positions.values()) > 1.2 or max(gain.values()) < 1.2):
        return max(positions, key=lambda c: positions[c])
    return max(gain, key=lambda c: gain[c])


def unit_of(verdict: Verdict, column: str) -> str:
    """The unit of a recording's column."""
    kind, _, name = column.partition(".")
    if kind in ("wrench", "pose"):
        last = name.rsplit(".", 1)[-1]
        force, torque = ("N", "N m") if kind == "wrench" else ("m", "rad" if last == "rotation" else "1")
        return force if last in ("fx", "fy", "fz", "x", "y", "z") else torque
    tree = verdict.corrected.tree
    joint = tree.joints[tree.joint_index(name)]
    return {"v": f"{joint.position_unit}/s", "u": joint.effort_unit}.get(kind, joint.position_unit)


def _places(locations: Sequence[Location]) -> list[dict[str, Any]]:
    """Locations by place, the shares of their recordings added up."""
    kinds = {"environment": "the world around it"}
    places: dict[tuple[str, str], dict[str, Any]] = {}
    for one in locations:
        new = {"name": one.name, "kind": kinds.get(one.kind, one.kind), "share": 0.0, "seconds": 0.0, "where": []}
        place = places.setdefault((one.kind, one.name), {**new, "recordings": 0})
        place["share"] += one.share
        place["seconds"] += sum(stop - start for start, stop in one.intervals)
        place["recordings"] += 1
        if one.where and one.where not in place["where"]:
            place["where"].append(one.where)
    return sorted(places.values(), key=lambda place: -place["share"])


def _effects(verdict: Verdict, outcome: Outcome, without: Physics, corrected: Physics) -> list[dict[str, Any]]:
    """Each accepted effect with its law, its strengths and the picture of the law over the data."""
    everything = [one.effect for one in verdict.explanation]
    effects = []
    for one in verdict.explanation:
        others = without.with_effects([effect for effect in everything if effect is not one.effect])
        law = law_of(one.effect)
        effects.append(
            {
                "name": wording.spoken(one.effect.name),
                "identifier": one.effect.name,
                "at": one.effect.at,
                "law": law,
                "probability": wording.probability(one.probability),
                "strengths": [
                    {
                        "name": wording.spoken(name),
                        "value": wording.with_interval(value.value, value.std),
                        "unit": _unit(verdict, one.effect, value.unit),
                    }
                    for name, value in one.values.items()
                ],
                "picture": law_picture(evidence_of(one.effect, outcome.problem, others, corrected))
                if isinstance(outcome.problem, WeakProblem)
                else None,
                "reference": one.effect.reference,
            }
        )
    return effects


def _unit(verdict: Verdict, effect: Effect, unit: str) -> str:
    if effect.place is Place.CHANNEL and unit.startswith("unit of the channel"):
        return unit_of(verdict, effect.at) + unit.removeprefix("unit of the channel")
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def _remains(verdict: Verdict, outcome: Outcome, corrected: Physics) -> list[dict[str, str]]:
    """What is left at the places where most of it is, for a verdict that leaves something."""
    if verdict.kind != "unexplained" or not isinstance(outcome.problem, WeakProblem):
        return []
    names = list(dict.fromkeys(one["name"] for one in _places(verdict.mismatch.standing)))
    figures = [(name, remains_figure(outcome.problem, corrected, name)) for name in names[:2]]
    return [{"name": name, "svg": svg} for name, svg in figures if svg is not None]


def _forecast(
    verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], corrected: Physics
) -> dict[str, Any] | None:
    """The picture of simulations of a second each, on the first held-out recording or else the first one fitted to."""
    comparison = verdict.held_out if held_out and verdict.held_out is not None else verdict.train
    if not comparison.nominal.rmse:
        return None
    if isinstance(outcome.problem, TossProblem):
        recording = shown_recording(outcome.problem, held_out)
        contest = toss_contest(outcome.problem, verdict, outcome.nominal.model, recording)
    else:
        assert isinstance(outcome.problem, WeakProblem)
        scene, weak = outcome.problem.scene, outcome.problem.runs[0].weak
        if comparison is verdict.held_out:
            weak = WeakForm(samples_of(scene, held_out[0], weak.samples.std), scene.wrench_sensors)
        recording = weak.samples.recording
        nominal = forecast(weak, outcome.nominal.model.physics(scene))
        contest = Contest(nominal, forecast(weak, corrected) if verdict.explanation else None)
    corrected_quality = comparison.corrected if verdict.explanation else None
    columns = telling_columns(comparison.nominal, corrected_quality, contest.nominal.measured, 3)
    units = {column: unit_of(verdict, column) for column in columns}
    return {
        "svg": forecast_figure(contest, columns, units),
        "recording": wording.short(recording.name),
        "channels": len(comparison.nominal.rmse),
        "shown": len(columns),
    }


def _tables(verdict: Verdict) -> list[dict[str, Any]]:
    """Errors of 1 s simulations and the likelihood, on what was held out and on what was fitted to."""
    sets = [("held out: nothing was chosen or fitted on these", verdict.held_out), ("fitted to", verdict.train)]
    tables = []
    for title, comparison in sets:
        if comparison is None:
            continue
        given, nominal, corrected = comparison.nominal_as_given, comparison.nominal, comparison.corrected
        rows = [
            {
                "column": column,
                "unit": unit_of(verdict, column),
                "errors": [wording.rounded(one.rmse[column]) for one in (given, nominal, corrected)],
                "factor": _factor(nominal.rmse[column], corrected.rmse[column]),
            }
            for column in nominal.rmse
        ]
        likelihood = [wording.rounded(one.nll, 4) for one in (given, nominal, corrected)]
        tables.append({"title": title, "rows": rows, "likelihood": likelihood})
    return tables


def _factor(nominal: float, corrected: float) -> str:
    if corrected <= 0.0 or nominal <= 0.0:
        return ""
    ratio = nominal / corrected
    if 0.95 < ratio < 1.05:
        return "the same"
    return f"{wording.rounded(ratio, 2)} × smaller" if ratio > 1.0 else f"{wording.rounded(1.0 / ratio, 2)} × larger"


def _files(outcome: Outcome, held_out: Sequence[Recording]) -> list[str]:
    """What each recording is, in words."""
    fitted = recordings_of(outcome)
    told = []
    for one, use in [*((one, "") for one in fitted), *((one, "; held out") for one in held_out)]:
        step = f", every {wording.rounded(1e3 * float(np.median(np.diff(one.time))))} ms" if len(one) > 1 else ""
        told.append(f"{one.name}: {len(one)} samples over {wording.rounded(one.duration)} s{step}{use}")
    return told


def _parameter(one: NominalParameter) -> dict[str, Any]:
    shift = (one.value - one.prior_mean) / one.prior_std if one.prior_std > 0.0 else 0.0
    return {
        "name": wording.spoken(one.parameter),
        "at": one.at,
        "value": wording.with_interval(one.value, one.std),
        "prior": wording.with_interval(one.prior_mean, one.prior_std),
        "unit": "" if one.unit == "1" else one.unit,
        "shift": f"{shift:+.1f}".replace("-", "−"),
        "suspect": abs(shift) > SUSPECT,
    }
