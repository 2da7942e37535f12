"""Writes report.html: the verdict as one page that needs no network."""

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.thresholds import CUTS_SHARE_SURE
from drake_cafim.diagnosis.verdict import Comparison, Location, NominalParameter, Value, Verdict
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.report import colours, wording
from drake_cafim.report.forecast_figure import Forecasts, forecast_figure, telling_columns
from drake_cafim.report.law_figures import law_picture
from drake_cafim.report.laws import law_of
from drake_cafim.report.learned_figure import learned_figure
from drake_cafim.report.next_experiment import next_experiment
from drake_cafim.report.quality_tables import effort_summary, quality_tables
from drake_cafim.report.remains_figure import remains_figure
from drake_cafim.report.residual_figure import residual_figure, worst_first
from drake_cafim.report.why_section import why_section
from drake_cafim.scenario.physics import Physics

TEMPLATE, REPORT = "report.html.j2", "report.json"
SUSPECT = 3.0
"""Prior standard deviations beyond which an unknown is marked as a mismatch; the verdict does not depend on it."""
Picture = TypeVar("Picture")
BADGES = {"none": "nothing missing", "explained": "explained", "unexplained": "not all explained"}


def write_report_page(
    path: Path, verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], command: Sequence[str]
) -> tuple[str, ...]:
    """Write the page to `path`, whole or not at all; `command` is the command line that reproduces it.

    Returns a sentence for each picture that cannot be drawn.
    """
    text, undrawn = page_of(verdict, outcome, held_out, command)
    write_text(path, text)
    return undrawn


def render(verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], command: Sequence[str]) -> str:
    """The page as text, the same bytes for the same verdict."""
    return page_of(verdict, outcome, held_out, command)[0]


@dataclass
class Drawing:
    """Calls drawing functions; `undrawn` gathers a sentence for each picture whose numbers cannot be computed."""

    undrawn: list[str] = field(default_factory=list)

    def __call__(self, what: str, draw: Callable[[], Picture]) -> Picture | None:
        picture = compute(draw)
        if isinstance(picture, NotComputable):
            self.undrawn.append(f"{what} cannot be drawn: {picture.reason}")
            return None
        return picture


def page_of(
    verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], command: Sequence[str]
) -> tuple[str, tuple[str, ...]]:
    """The page as text, and a sentence for each picture that cannot be drawn; the page holds them as well."""
    folder = Path(__file__).parent
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    corrected = verdict.corrected.physics
    without = _nominal_physics(verdict, outcome)
    unknown = outcome.problem.scene.vector_of(verdict.unknown_values)
    pictures, effects = outcome.problem.pictures, tuple(accepted.effect for accepted in verdict.explanation)
    changed, drawn = verdict.changed, Drawing()
    maps = drawn("the map of misfits", lambda: pictures.maps(Model(unknown), Model(unknown, effects))) or []
    shown = worst_first(maps)
    figures = {
        "heat_map": drawn(
            "the map of misfits", lambda: residual_figure(shown, pictures.row_labels, with_after=bool(effects))
        )
        if maps
        else None,
        "effects": _effects(verdict, outcome, without, drawn),
        "learned": [
            {
                "at": learned.law.at,
                "words": learned.words,
                "svg": drawn("a learned law", partial(learned_figure, learned.law, verdict.corrected.tree)),
            }
            for learned in verdict.learned
        ],
        "remains": drawn("what remains", lambda: _remains(verdict, outcome, corrected)) or [],
        "forecast": drawn("the simulation", lambda: _forecast(verdict, outcome, held_out, corrected)),
    }
    text = environment.get_template(TEMPLATE).render(
        colours=colours,
        wording=wording,
        verdict=verdict,
        sentence=str(verdict),
        headline=_headline(str(verdict)),
        badge="check the recording" if verdict.data_mistakes else BADGES[verdict.kind],
        tone="mistake" if verdict.data_mistakes else verdict.kind,
        changed=changed,
        pictures=pictures,
        tiles=_tiles(verdict),
        recordings=len(maps),
        recordings_shown=len(shown),
        places=_places(verdict.mismatch.standing),
        undrawn=tuple(drawn.undrawn),
        **figures,
        held_out=held_out,
        tables=quality_tables(verdict, lambda column: unit_of(verdict, column)),
        parameters=[_parameter(parameter) for parameter in verdict.parameters],
        files=_files(outcome, held_out),
        command=shlex.join(command),
        why=why_section(verdict),
        next_experiment=next_experiment(verdict.next_experiment, _design_command(verdict)),
        versions=f"drake_cafim {version('drake_cafim')}, Drake {version('drake')}",
    )
    return text, tuple(drawn.undrawn)


def _design_command(verdict: Verdict) -> str:
    """The command that designs the motion which tells the rivals apart, where there are any."""
    return shlex.join(["cafim", "discriminate", verdict.corrected.name, REPORT]) if verdict.rivals else ""


def _headline(sentence: str) -> Markup:
    """The sentence as HTML, with what is in brackets in a lighter colour."""
    return Markup(re.sub(r"\([^()]*\)", r'<span class="aside">\g<0></span>', str(escape(sentence))))


def _nominal_physics(verdict: Verdict, outcome: Outcome) -> Physics:
    """The physics without the accepted effects, at the fitted values of the unknowns."""
    scene = outcome.problem.scene
    return scene.physics_at(scene.vector_of(verdict.unknown_values))


def _tiles(verdict: Verdict) -> list[dict[str, str]]:
    """The figures at the top of the page: χ², simulation error, residual of inverse dynamics, p-value."""
    before, after = verdict.reduced_chi_square
    changed = verdict.changed
    fit = wording.rounded(before) + (f" → {wording.rounded(after)}" if changed else "")
    tiles = [{"figure": fit, "what": "mean square misfit in units of the noise variance; noise alone gives 1"}]
    comparison = verdict.held_out or verdict.train
    column = _telling_column(comparison)
    if column is not None:
        values = [comparison.nominal.rmse[column], comparison.corrected.rmse[column]][: 1 + changed]
        where = "recordings held out" if verdict.held_out else "the recordings"
        figure = wording.with_prefix(values, unit_of(verdict, column))
        tiles.append({"figure": figure, "what": f"error of a 1 s simulation in {column}, on {where}"})
    effort = effort_summary(comparison, changed)
    if effort is not None:
        below = f"below {wording.rounded(effort[1], 3)} Hz, median of joints"
        what = f"residual of inverse dynamics over the rms of the effort ({below})"
        tiles.append({"figure": effort[0], "what": what})
    p = wording.p_value(verdict.mismatch.p_value)
    tiles.append(
        {
            "figure": f"p {p}",
            "what": "probability of so large a misfit by noise alone, corrected for the number of hypotheses",
        }
    )
    return tiles


def _telling_column(comparison: Comparison) -> str | None:
    """The position whose error the effects reduce most, or another column where no position gains 20 %."""
    before, after = comparison.nominal.rmse, comparison.corrected.rmse
    known = [c for c in before if np.isfinite([before[c], after.get(c, np.nan)]).all()]
    gain = {c: before[c] / max(after[c], 1e-300) for c in known}
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
    """The locations by place, with shares and durations summed over the recordings; the largest share first."""
    places: dict[tuple[str, str], dict[str, Any]] = {}
    for location in locations:
        new = {"name": location.name, "kind": location.kind, "share": 0.0, "seconds": 0.0, "where": []}
        place = places.setdefault((location.kind, location.name), {**new, "recordings": 0})
        place["share"] += location.share
        place["seconds"] += sum(stop - start for start, stop in location.intervals)
        place["recordings"] += 1
        if location.where and location.where not in place["where"]:
            place["where"].append(location.where)
    return sorted(places.values(), key=lambda place: -place["share"])


def _effects(verdict: Verdict, outcome: Outcome, without: Physics, drawn: Drawing) -> list[dict[str, Any]]:
    """Each accepted effect with its law, its parameters and the figure of the law over the data.

    That is of all effects that are named, in the corrected scene or not, and of no learned law: these have figures of
    their own.
    """
    everything = [accepted.effect for accepted in verdict.explanation]
    named, effects = without.with_effects(everything), []
    for accepted in verdict.explanation:
        others = without.with_effects([effect for effect in everything if effect is not accepted.effect])
        law, pictures = law_of(accepted.effect, verdict.corrected.tree), outcome.problem.pictures
        evidence = drawn(
            f"the data of {accepted.effect.name}", partial(pictures.evidence, accepted.effect, others, named)
        )
        picture = None
        if evidence is not None:
            picture = drawn(f"the law of {accepted.effect.name}", partial(law_picture, evidence))
        effects.append(
            {
                "name": wording.spoken(accepted.effect.name),
                "identifier": accepted.effect.name,
                "at": accepted.effect.at,
                "law": law,
                "probability": wording.probability(accepted.probability),
                "cuts": None if accepted.cuts is None else f"{100.0 * accepted.cuts:.0f} %",
                "absent": next(
                    (left.why for left in verdict.correction.left_out if left.key == accepted.effect.key), ""
                ),
                "unsure": accepted.cuts is not None and accepted.cuts < CUTS_SHARE_SURE,
                "strengths": [
                    {
                        "name": wording.spoken(name),
                        "value": _shown(accepted.effect, name, value),
                        "unit": _unit(verdict, accepted.effect, value.unit),
                        "efficiency": wording.as_well(value.efficiency),
                    }
                    for name, value in accepted.values.items()
                ],
                "picture": picture,
                "reference": accepted.effect.reference,
            }
        )
    return effects


def _shown(effect: Effect, name: str, value: Value) -> str:
    """A parameter's value as the page prints it: with its interval, or the name of a choice that has one."""
    stated = effect.stated(name, value.value)
    return stated if isinstance(stated, str) else wording.with_interval(stated, value.std)


def _unit(verdict: Verdict, effect: Effect, unit: str) -> str:
    if effect.place is Place.CHANNEL and unit.startswith("unit of the channel"):
        return unit_of(verdict, effect.at) + unit.removeprefix("unit of the channel")
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def _remains(verdict: Verdict, outcome: Outcome, corrected: Physics) -> list[dict[str, str]]:
    """Figures of the residual at the two places of largest share, for an unexplained verdict."""
    if verdict.kind != "unexplained":
        return []
    names = list(dict.fromkeys(place["name"] for place in _places(verdict.mismatch.standing)))
    left = [(name, outcome.problem.pictures.remains(corrected, name)) for name in names[:2]]
    return [{"name": name, "svg": remains_figure(remains, name)} for name, remains in left if remains is not None]


def _forecast(
    verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], corrected: Physics
) -> dict[str, Any] | None:
    """The figure of simulations over 1 s, on the first held-out recording, else on the first one fitted to."""
    comparison = verdict.held_out if held_out and verdict.held_out is not None else verdict.train
    if not comparison.nominal.rmse:
        return None
    pictures = outcome.problem.pictures
    recording = held_out[0] if comparison is verdict.held_out else pictures.recordings[0]
    nominal = pictures.forecast(recording, outcome.nominal.model.physics(outcome.problem.scene))
    if len(nominal.time) == 0:
        raise FloatingPointError(f"{wording.short(recording.name)} is too short")
    forecasts = Forecasts(nominal, pictures.forecast(recording, corrected) if verdict.changed else None)
    corrected_quality = comparison.corrected if verdict.changed else None
    columns = telling_columns(comparison.nominal, corrected_quality, forecasts.nominal.measured, 3)
    units = {column: unit_of(verdict, column) for column in columns}
    return {
        "svg": forecast_figure(forecasts, columns, units),
        "recording": wording.short(recording.name),
        "channels": len(comparison.nominal.rmse),
        "shown": len(columns),
    }


def _files(outcome: Outcome, held_out: Sequence[Recording]) -> list[str]:
    """A line for each recording: its name, samples, duration, sampling interval, and whether it was held out."""
    fitted = outcome.problem.pictures.recordings
    lines = []
    for recording, use in [
        *((recording, "") for recording in fitted),
        *((recording, "; held out") for recording in held_out),
    ]:
        step = (
            f", every {wording.rounded(1e3 * float(np.median(np.diff(recording.time))))} ms"
            if len(recording) > 1
            else ""
        )
        lines.append(
            f"{recording.name}: {len(recording)} samples over {wording.rounded(recording.duration)} s{step}{use}"
        )
    return lines


def _parameter(unknown: NominalParameter) -> dict[str, Any]:
    shift = (unknown.value - unknown.prior_mean) / unknown.prior_std if unknown.prior_std > 0.0 else 0.0
    return {
        "name": wording.spoken(unknown.parameter) + (f" of {wording.spoken(unknown.effect)}" if unknown.effect else ""),
        "at": unknown.at,
        "value": wording.with_interval(unknown.value, unknown.std),
        "prior": wording.with_interval(unknown.prior_mean, unknown.prior_std),
        "unit": "" if unknown.unit == "1" else unknown.unit,
        "shift": f"{shift:+.1f}".replace("-", "−"),
        "suspect": unknown.distance > SUSPECT,
        "efficiency": wording.as_well(unknown.efficiency),
    }
