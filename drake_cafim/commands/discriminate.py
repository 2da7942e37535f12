"""`cafim discriminate`: designs the motion that tells rival explanations apart, and simulates it with each as truth."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drake_cafim.commands.inputs import refuse_thrown
from drake_cafim.commands.reports import read_record, read_report, report_file
from drake_cafim.design.planner import PLANNERS, PlannerName
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.discrimination.closed_loop import measured, simulated
from drake_cafim.discrimination.design import Designer, default_effort
from drake_cafim.discrimination.hypotheses import Pair, fitted_unknowns, named_pair, reported_pairs
from drake_cafim.discrimination.motions import Motion, Shape
from drake_cafim.discrimination.outcome import course, odds_along, settled_after
from drake_cafim.discrimination.planned import noise_of, problem_of
from drake_cafim.discrimination.reported_noise import with_reported_noise
from drake_cafim.discrimination.scores import Odds, OddsValue, Soonest
from drake_cafim.errors import InputError
from drake_cafim.numerics.streams import stream
from drake_cafim.output import replacing, write_text
from drake_cafim.recordings import write
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.next_experiment import with_next_experiment
from drake_cafim.report.report_json import as_text, report_of
from drake_cafim.report.rivals_replay import RivalRun, RivalsReplay, write_rivals_replay
from drake_cafim.scene.scene import Scene

TRAJECTORY, REPORT, PAGE, REPLAY = "trajectory.parquet", "report.json", "report.html", "replay.html"
SHORTEST, LONGEST = 0.5, 30.0
"""s of a motion."""
CRITERIA = ("odds", "time")
MOMENTS = 6
"""Number of times along a run at which its odds are reported."""


@dataclass(frozen=True)
class DiscriminateRequest:
    """The arguments of `cafim discriminate`."""

    scenario: str
    report: Path | None = None
    between: tuple[str, ...] = ()
    duration: float = 2.0  # s
    criterion: str = "odds"
    planner: PlannerName = "predictive-sampling"
    seed: int = 0
    replay: bool = True
    packages: tuple[tuple[str, str], ...] = ()

    def check(self) -> None:
        """Raises `InputError` unless there is a report or two explanations, and time to move."""
        if not self.between and self.report is None:
            raise InputError("discriminate: expected a report.json, or --between EFFECT@PLACE EFFECT@PLACE")
        if self.between and len(self.between) != 2:
            raise InputError(f"--between {' '.join(self.between)}: expected two of EFFECT@PLACE")
        for option, value, valid in (("criterion", self.criterion, CRITERIA), ("planner", self.planner, PLANNERS)):
            if value not in valid:
                raise InputError(f"--{option} {value}: expected one of {', '.join(valid)}")
        if not SHORTEST <= self.duration <= LONGEST:
            raise InputError(f"--duration {self.duration}: expected from {SHORTEST} to {LONGEST} s")


def discriminate_command(
    request: DiscriminateRequest, out: Path, progress: Callable[[str], None], *, resume: bool = False
) -> dict[str, Any]:
    """The report with its `next_experiment`, written into `out` after the trajectory and the replay that it names.

    Raises `InputError` for a report without rivals, and for effects or places that the scenario cannot have.
    """
    finished = out / REPORT
    if resume and finished.is_file():
        record = read_record(finished, "what an earlier discrimination left; give --overwrite")
        try:
            in_words(record)
            record["next_experiment"]["file"]
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise InputError(f"{finished}: it is damaged ({error!r}); give --overwrite, or another folder") from None
        return record
    request.check()
    scene = Scene.load(request.scenario, packages=dict(request.packages))
    refuse_thrown(scene, "cafim discriminate")
    scene, report, pairs = _report_and_pairs(request, scene)
    finished.unlink(missing_ok=True)
    random = np.random.default_rng(request.seed)
    shape = Shape.lasting(request.duration)
    designer = Designer.of(scene, shape, default_effort(shape, request.planner))
    pairs = [designer.matched(pair, random) for pair in pairs]
    odds = Odds(tuple(pairs))
    value: OddsValue = odds if request.criterion == "odds" else Soonest(tuple(pairs))
    planned = designer.rehearse(value, designer.design(value, random, progress), random, progress).planned
    with replacing(out / TRAJECTORY) as temporary:
        write(_trajectory(scene, planned), temporary)
    progress("trying it in simulation")
    runs = _Runs(scene, designer, planned, request.seed)
    trials = [_trials(runs, pair) for pair in pairs]
    result = dict(report)
    result["next_experiment"] = {
        "separates": [list(pair.names) for pair in pairs],
        "expected_log_odds": float(designer.rehearsal(odds)([planned])[0]),
        "file": TRAJECTORY,
        "duration": designer.shape.duration,
        "start": dict(zip(scene.tree.joint_names, planned.q[0].tolist(), strict=True)),
        "simulated": [[_outcome(trial, pair) for trial in both] for both, pair in zip(trials, pairs, strict=True)],
    }
    result["files"] = {**result.get("files", {}), "next_experiment": TRAJECTORY}
    if request.replay:
        progress("drawing the replay")
        first, second = (_rival_run(trial, pairs[0]) for trial in trials[0])
        write_rivals_replay(out / REPLAY, RivalsReplay(scene, planned.time, planned.q, (first, second)))
        result["files"]["next_experiment_replay"] = REPLAY
    if request.report is not None:
        _carry_page(report_file(request.report).with_name(PAGE), out / PAGE, result["next_experiment"])
    write_text(finished, as_text(result))
    return result


def _carry_page(source: Path, target: Path, found: dict[str, Any]) -> None:
    """Write the report's page, if it is there, with the experiment in it."""
    if source.is_file():
        write_text(target, with_next_experiment(source.read_text(encoding="utf-8"), found))


def in_words(result: dict[str, Any]) -> str:
    """The summary for a terminal: the expected odds after the motion, and the odds along its simulated runs."""
    found = result["next_experiment"]
    lines = [f"{first} or {second}" for first, second in found["separates"]]
    odds = _odds(found["expected_log_odds"])
    lines.append(f"expected odds for the true explanation after {found['duration']:.2f} s: {odds}")
    for pair in found["simulated"]:
        for run in pair:
            when = run["settled_after"]
            settled = "20:1 is not reached" if when is None else f"20:1 after {when:.2f} s"
            steps = ", ".join(f"{_odds(log_odds)} at {time:.2f} s" for time, log_odds in run["odds"])
            lines.append(f"if {run['truth']} is true, the odds for it are {steps}; {settled}")
    return "\n".join(lines)


def _odds(log_odds: float) -> str:
    """e^`log_odds` as odds."""
    ratio = 10.0 ** (abs(log_odds) / np.log(10.0)) if abs(log_odds) < 13.8 else None
    shown = f"{ratio:.3g}" if ratio is not None else f"10^{abs(log_odds) / np.log(10.0):.0f}"
    return f"{shown}:1" if log_odds >= 0.0 else f"1:{shown}"


def _report_and_pairs(request: DiscriminateRequest, scene: Scene) -> tuple[Scene, dict[str, Any], list[Pair]]:
    """The scene with the noise that the report gives, the report, and the pairs of explanations to tell apart."""
    if request.report is None:
        first, second = request.between
        return scene, report_of(None, (), None, {}), [named_pair(scene, first, second)]
    path = report_file(request.report)
    report = read_report(path, str(path))
    scene = with_reported_noise(scene, report.get("noise") or {})
    if request.between:
        first, second = request.between
        return scene, report, [named_pair(scene, first, second, fitted_unknowns(scene, report, str(path)))]
    return scene, report, reported_pairs(scene, report, str(path))


def _trajectory(scene: Scene, planned: Motion) -> Recording:
    """q, v and u of every joint against time."""
    names = scene.tree.joint_names
    matrices = (("q", planned.q), ("v", planned.v), ("u", planned.u))
    columns = {f"{kind}.{joint}": values[:, j] for kind, values in matrices for j, joint in enumerate(names)}
    return Recording(TRAJECTORY, planned.time, columns)


@dataclass(frozen=True)
class _Runs:
    """Simulated runs of one motion."""

    scene: Scene
    designer: Designer
    planned: Motion
    seed: int

    def run(self, truth: Model) -> Motion:
        """The simulated motion with `truth` as the robot's physics."""
        return simulated(truth.physics(self.scene), self.scene.physics, self.designer.limits, self.planned)

    def problem(self, truth: Model, run: Motion, number: int) -> WeakProblem:
        """The whitened rows of the run's recording, with measurement noise."""
        random = stream("trial noise", self.seed, number)
        noisy = measured(self.scene, truth.physics(self.scene), run, noise_of(self.scene), random, TRAJECTORY)
        return problem_of(self.scene, [noisy])


@dataclass(frozen=True)
class _Trial:
    """A run in which the explanation `name` is true; `sign` times the pair's ln odds are those for it."""

    name: str
    sign: float
    run: Motion
    problem: WeakProblem


def _trials(runs: _Runs, pair: Pair) -> tuple[_Trial, _Trial]:
    first, second = (runs.run(truth) for truth in (pair.first, pair.second))
    return (
        _Trial(pair.names[0], 1.0, first, runs.problem(pair.first, first, 0)),
        _Trial(pair.names[1], -1.0, second, runs.problem(pair.second, second, 1)),
    )


def _outcome(trial: _Trial, pair: Pair) -> dict[str, Any]:
    """The odds for the true explanation at `MOMENTS` times of the run, and the time after which they exceed 20:1."""
    time = trial.problem.runs[0].weak.samples.time
    along = course(trial.problem, pair, np.linspace(0.0, time[-1] - time[0], MOMENTS + 1)[1:].tolist())
    when = settled_after(trial.problem, pair, trial.sign)
    odds = [[float(t), float(trial.sign * x)] for t, x in zip(along.time, along.log_odds, strict=True)]
    return {"truth": trial.name, "odds": odds, "settled_after": when if np.isfinite(when) else None}


def _rival_run(trial: _Trial, pair: Pair) -> RivalRun:
    along = odds_along(trial.problem, pair)
    return RivalRun(trial.name, trial.run.q, along.time, trial.sign * along.log_odds)
