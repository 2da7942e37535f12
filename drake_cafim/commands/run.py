"""`cafim run`: carries out a scenario's experiments, and writes run.json, recordings, a replay and figures."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydrake.systems.framework import Diagram

from drake_cafim.commands.reports import read_record
from drake_cafim.commands.run_diagnosis import FOLDER, diagnose_run
from drake_cafim.design.planner import PLANNERS
from drake_cafim.design.policies import POLICIES, make_policy
from drake_cafim.diagrams.catalogue import Stage, joint_names, stage_of
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.diagrams.showing import make_replay
from drake_cafim.diagrams.world import WorldKind, check_kind, start_context
from drake_cafim.errors import InputError
from drake_cafim.estimation.system import ESTIMATORS
from drake_cafim.experiment import closed_loop as experiment
from drake_cafim.experiment.closed_loop import ExperimentResult, Options, RunResult
from drake_cafim.experiment.joint_recording import recordings_of
from drake_cafim.experiment.run_record import run_record
from drake_cafim.experiment.world import World
from drake_cafim.information import Criterion
from drake_cafim.interruption import pass_on_interruption
from drake_cafim.kept import Kept
from drake_cafim.output import replacing, write_text
from drake_cafim.recordings import write
from drake_cafim.report.replay import make_meshcat, write_replay
from drake_cafim.report.run_figures import error_figure, information_figure
from drake_cafim.scenario.model_file import MODEL_SUFFIXES
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.scene.scene import Scene
from drake_cafim.sensitivity.evaluator import Fisher
from drake_cafim.tasks.as_printed import as_printed
from drake_cafim.tasks.task import Task

KEPT = "experiments"
"""Folder of what a run has finished, until all of it is."""
FILES = {"replay": "replay.html", "figures": ["error.svg", "information.svg"]}
Progress = Callable[[str], None]


@dataclass(frozen=True)
class RunRequest:
    """The arguments of `cafim run`."""

    scenario: str
    world: WorldKind = "drake"
    options: Options = field(default_factory=Options)
    prior_scale: float = 1.3  # the prior's mean as a multiple of the truth
    concealed: tuple[Concealed, ...] = ()
    as_printed: bool = False  # with the paper's own choices, see `tasks/as_printed.py`
    place_std: float = 0.0  # m, of the contact's place about the planned one; 0: it is where it is planned
    tilt_std: float = 0.0  # degrees, of the contact's frame about the planned one; 0: it is as planned
    bias_std: float = 0.0  # N, of the force sensor's bias; 0: it is tared
    drift_std: float = 0.0  # N/s, of its drift from the start of each experiment on; 0: it does not drift
    law: str | None = None  # `all`, one of the laws, or None: all in world `drake`, the scenario's own in `model`
    diagnosed: bool = True  # whether the run ends with the diagnosis of its own recordings

    @property
    def candidates(self) -> str | None:
        """The contact laws that the run takes into account: `all`, one of them, or None for the scenario's own."""
        if self.as_printed:
            return None
        return "all" if self.law is None and self.world == "drake" else self.law

    @property
    def chosen(self) -> Options:
        """The options of the run; as printed, with the trace, without a force guard and without a search."""
        if not self.as_printed:
            return self.options
        return replace(self.options, criterion="trace", force_guard=False, search=False)


def run_command(request: RunRequest, out: Path, progress: Progress, *, resume: bool = False) -> dict[str, Any]:
    """The contents of run.json, written into `out` after all files that it names.

    With `resume`, a finished run.json is read instead, and one that was ended goes on with the next experiment. Raises
    `InputError` for a scenario that has no world, options that are not valid, and an `out` of another run.
    """
    finished, asked = out / "run.json", json.loads(json.dumps(asdict(request)))
    if resume and finished.is_file():
        record = read_record(finished, "the run.json of an earlier run; give --overwrite")
        try:
            table(record)
            differing = _differing(record.get("request", asked), asked)
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise InputError(f"{finished}: it is damaged ({error!r}); give --overwrite, or another folder") from None
        if differing:
            raise InputError(
                f"--out {out}: it holds a run with {differing}, expected the same command with --resume; give "
                "--overwrite, or another folder"
            )
        # what was kept for it remains where it was killed after its last file
        Kept(out / KEPT).close()
        return record
    check_request(request)
    _clear(out)
    stage = load_stage(request.scenario)
    task = planned_task(stage, request)
    scenario = repr(load(resolve(request.scenario)))
    about = {"request": asked, "version": version("drake_cafim"), "scenario": scenario}
    kept = Kept.open(out / KEPT, about, resume)
    progress("building the world")
    world = stage.world(request.world, request.options.seed, request.concealed)
    total = task.experiments if request.options.experiments is None else request.options.experiments
    progress(f"experiment 1 of {total}")
    try:
        result = experiment.run(
            task, request.chosen, world, lambda number, done: _show_progress(progress, number, total, done), kept
        )
    except RuntimeError as error:
        pass_on_interruption()
        if not request.concealed:
            raise
        addresses = ", ".join(effect.address for effect in request.concealed)
        raise InputError(
            f"{addresses}: Drake cannot simulate a world with it, expected a milder one ({error})"
        ) from None
    recordings = _write_recordings(request, result, world, out)
    progress("drawing")
    write_text(out / "error.svg", error_figure(result))
    write_text(out / "information.svg", information_figure(result))
    progress("writing the replay")
    _write_replay(request, stage, result, out / "replay.html")
    record = run_record(result, recordings, FILES)
    if request.candidates == "all" and not task.others:
        record["laws_note"] = f"no other contact law is a candidate: {stage.undecided}"
    record["as_printed"] = request.as_printed
    record["concealed"] = [
        {"effect": effect.effect, "at": effect.at, **effect.parameters} for effect in request.concealed
    ]
    record["request"] = asked
    if request.diagnosed:
        record["diagnosis"] = diagnose_run(request.scenario, out, recordings, progress)
    write_text(finished, json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    kept.close()
    return record


def _differing(made: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """The first argument of the request that a run was `made` by that is not as `asked`, with both values."""
    before, now = ({**each, **each["options"]} for each in (made, asked))
    names = [name for name in now if name != "options" and before.get(name) != now[name]]
    return f"{names[0]} {before.get(names[0])} instead of {now[names[0]]}" if names else ""


def planned_task(stage: Stage, request: RunRequest) -> Task:
    """The task with the prior, the candidate laws and the doubt about its place that the request asks for."""
    task = stage.with_laws(stage.task.with_prior_mean(request.prior_scale), request.candidates)
    task = as_printed(task) if request.as_printed else task
    task = task.with_unknown_place(request.place_std, float(np.deg2rad(request.tilt_std)))
    return task.with_unknown_sensor(request.bias_std, request.drift_std)


def load_stage(address: str) -> Stage:
    """The stage of a packaged scenario's name or a scenario file; `InputError` for a bare model."""
    path = resolve(address)
    if str(path).endswith(MODEL_SUFFIXES):
        raise InputError(f"{address}: found a model file, expected a scenario with the section diagram, as hefting has")
    return stage_of(load(path), address)


def parse_concealed(words: Sequence[str]) -> tuple[Concealed, ...]:
    """`EFFECT@PLACE parameter=value ...`, any number of times, as effects.

    Raises `InputError` for a word that is neither, or a value that is no number.
    """
    found: list[tuple[str, str, dict[str, float]]] = []
    for word in words:
        name, equals, number = word.partition("=")
        effect, at, place = word.partition("@")
        if not equals and at and effect and place:
            found.append((effect, place, {}))
        elif equals and found and name in found[-1][2]:
            raise InputError(f"--conceal {word}: {name} is given twice, expected it once")
        elif equals and found:
            found[-1][2][name] = _number(name, number)
        else:
            raise InputError(f"--conceal {word}: expected EFFECT@PLACE followed by parameter=value")
    return tuple(Concealed(effect, place, parameters) for effect, place, parameters in found)


def table(record: dict[str, Any]) -> str:
    """The summary of run.json for a terminal, one line per experiment."""
    truth = ", ".join(f"{name} {value:g}" for name, value in record["truth"].items())
    lines = [
        f"{record['scenario']}, world {record['world']}, {record['policy']}, seed {record['seed']}; truth: {truth}"
    ]
    for number, row in enumerate(record["experiments"], start=1):
        known = ", ".join(
            f"{name} {value:.4g} ± {row['std'][name]:.2g} ({row['error_percent'][name]:+.1f} %)"
            for name, value in row["estimate"].items()
            if name in row["error_percent"]
        )
        lines.append(
            f"{number:2d}  {_law_words(row)}{known};  contact {100 * row['contact_fraction']:.0f} %, "
            f"reversals {row['reversals']}, largest force {row['max_force']:.1f} N, "
            f"planning {row['planning_ms']['median']:.1f} ms"
        )
        lines += ["    it searched for what the experiments before had not found"] if row.get("searching") else []
        lines += _solver_remarks(row.get("solver", {}))
    note = record.get("laws_note")
    last = record["experiments"][-1]
    lines += [f"    {reason}" for reason in last.get("not_found", {}).values()]
    lines += [*_unidentified(last), *([f"    {note}"] if note else [])]
    return "\n".join([*lines, *([record["diagnosis"]["sentence"]] if "diagnosis" in record else [])])


def _law_words(row: dict[str, Any]) -> str:
    """The most probable contact law with its odds, for the table; nothing where there is only one."""
    if "laws" not in row:
        return ""
    odds = row["laws"][row["law"]]
    return f"{row['law']} {_odds(odds)}, "


def _odds(odds: float) -> str:
    """Odds as `20 : 1`; above 10 000, as more than that."""
    return "> 10000 : 1" if odds > 1e4 else f"{odds:.3g} : 1"


def _solver_remarks(solver: dict[str, Any]) -> list[str]:
    """The estimator's message where it did not converge, and the parameters whose estimates are on their bounds."""
    said = [] if solver.get("solved", True) else [f"    the estimate: {solver['message']}"]
    on_bound = ", ".join(solver.get("on_bound", []))
    return [*said, *([f"    the estimate of {on_bound} stands at a bound of its range"] if on_bound else [])]


def _unidentified(row: dict[str, Any]) -> list[str]:
    """Where the measurements do not determine all unknowns, a line with the combinations that they do determine."""
    known = [c for c in row.get("combinations", []) if c["identified"]]
    if len(known) == len(row["estimate"]) or "combinations" not in row:
        return []
    if all(c["text"] in row["estimate"] for c in known):  # the others were not found, and that is said
        return []
    products = " and ".join(f"{c['text']}, to {c['std_percent']:.2g} %" for c in known) or "nothing"
    unknowns = ", ".join(row["estimate"])
    return [
        f"    only this is known: {products}; these measurements cannot tell {unknowns} apart, the rest is the prior"
    ]


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--conceal {name}={text}: expected a number") from None


def check_request(request: RunRequest) -> None:
    """Raises `InputError` for a scenario that cannot be run and for options that are not valid."""
    load_stage(request.scenario)
    options = request.options
    if request.as_printed and request.law is not None:
        raise InputError(f"--as-printed --law {request.law}: the paper's law comes with --as-printed, expected one")
    check_kind(request.world)
    stage = load_stage(request.scenario)
    if not 0.0 <= request.place_std < 0.1:
        raise InputError(f"--place-std {request.place_std}: expected a number of metres from 0 to 0.1")
    if not 0.0 <= request.tilt_std < 20.0:
        raise InputError(f"--tilt-std {request.tilt_std}: expected a number of degrees from 0 to 20")
    for option, std in (("--bias-std", request.bias_std), ("--drift-std", request.drift_std)):
        if not 0.0 <= std < 100.0:
            raise InputError(f"{option} {std}: expected a number of N, or N/s, from 0 to 100")
    if not request.prior_scale > 0:
        raise InputError(f"--prior-scale {request.prior_scale}: expected a positive number")
    planned_task(stage, request)
    choices: tuple[tuple[str, str, Sequence[str]], ...] = (
        ("policy", options.policy, POLICIES),
        ("planner", options.planner, PLANNERS),
        ("criterion", options.criterion, _names(Criterion)),
        ("fisher", options.fisher, _names(Fisher)),
        ("estimator", options.estimator, ESTIMATORS),
    )
    for option, value, valid in choices:
        if value not in valid:
            raise InputError(f"--{option} {value}: expected one of {', '.join(valid)}")
    if options.belief_samples != 1:
        model = load_stage(request.scenario).task.model
        make_policy(options.policy, model, belief_samples=options.belief_samples)
    if options.force_guard:
        experiment.force_limit(load_stage(request.scenario).task)
    if options.experiments is not None and options.experiments < 1:
        raise InputError(f"--experiments {options.experiments}: expected at least 1")
    if options.until_std is not None and not options.until_std > 0:
        raise InputError(f"--until-std {options.until_std}: expected a positive fraction of the estimate")


def _names(literal: Any) -> tuple[str, ...]:
    return tuple(str(name) for name in get_args(literal))


def _clear(out: Path) -> None:
    """Delete an older run's files, so that none can be taken for this run's."""
    for path in (out / "run.json", out / "replay.html", *out.glob("experiment_*.parquet"), *out.glob("*.svg")):
        path.unlink(missing_ok=True)
    shutil.rmtree(out / FOLDER, ignore_errors=True)


def _show_progress(progress: Progress, number: int, total: int, result: ExperimentResult) -> None:
    known = ", ".join(f"{name} {error:+.1f} %" for name, error in result.error_percent.items())
    after = f"experiment {number + 2} of {total}" if number + 1 < total else "done"
    progress(f"{after}; error after {number + 1}: {known}")


def _write_recordings(request: RunRequest, result: RunResult, world: World, out: Path) -> list[str]:
    assert isinstance(world.system, Diagram)
    scene, joints = Scene.load(request.scenario), joint_names(world.system)
    recordings = recordings_of(result, scene, joints, world)
    for recording in recordings:
        with replacing(out / recording.name) as temporary:
            write(recording, temporary)
    return [recording.name for recording in recordings]


def _write_replay(request: RunRequest, stage: Stage, result: RunResult, path: Path) -> None:
    """Write the replay of the first and the last experiment; with all of them it would be long, and the file large."""
    meshcat = make_meshcat()
    diagram = stage.diagram(request.world, request.options.seed, concealed=request.concealed, meshcat=meshcat)
    shown = sorted({0, len(result.experiments) - 1})
    replay = make_replay(result, diagram, lambda number: start_context(diagram, number), stage.view, experiments=shown)
    write_replay(path, replay, diagram, meshcat)
