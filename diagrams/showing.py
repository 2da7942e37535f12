"""The replay of a finished run: its motion, recorded or simulated again, with plans, forces and beliefs placed in W."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from drake_cafim.belief import Belief, LawBelief
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.experiment.closed_loop import ExperimentResult, RunResult
from drake_cafim.report.replay_data import BeliefHistory, Camera, Candidates, Captions, Forces, Motion, Replay
from drake_cafim.typing import Array

PAUSE = 0.5  # s, between two experiments


@dataclass(frozen=True)
class View:
    """The view of a scenario: the map from planner coordinates to W, the arrows of forces, the camera and the panel.

    The tool's point T at planner coordinates p is at `origin` + p·`axes` in W (axes (nu, 3), unit rows). Plans are
    drawn from there, shifted by `spread` (3,) m per second ahead: otherwise one-dimensional plans would coincide.
    Arrows show the measured forces along `force_directions` (ny, 3) in W, from T + `force_offset`.
    """

    axes: Array
    origin: Array
    force_directions: Array
    force_offset: Array
    force_scale: float  # m/N
    spread: Array
    camera: Camera
    panel: tuple[float, float, float]
    panel_width: float = 0.7
    stroke: float = 1.0

    def place(self, positions: Array) -> Array:
        """Points (..., 3) m in W of planner coordinates (..., nu) m."""
        return np.asarray(self.origin + positions @ self.axes)


@dataclass(frozen=True)
class Execution:
    """One experiment's motion: times (N,) s, plant positions (N, nq), tool positions (N, nu) m, forces (N, ny) N."""

    time: Array
    positions: Array
    tool: Array
    forces: Array


def execute(diagram: Diagram, context: Context, commands: Array, period: float) -> Execution:
    """Simulates `commands` (T, nu) m/s, each held for `period` s, from `context`, sampled 32 times a second."""
    simulator = Simulator(diagram, context)
    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    parts = max(1, round(32.0 * period))
    port = diagram.GetInputPort("command")
    rows: list[tuple[Array, Array, Array]] = []
    times: list[float] = []
    for index, command in enumerate(commands):
        port.FixValue(context, command)
        for part in range(parts):
            if index or part:
                simulator.AdvanceTo((index + part / parts) * period)
            tool = as_array(diagram.GetOutputPort("measured_state").Eval(context))[: commands.shape[1]]
            force = as_array(diagram.GetOutputPort("true_force").Eval(context))
            rows.append((plant.GetPositions(plant.GetMyContextFromRoot(context)).copy(), tool.copy(), force.copy()))
            times.append((index + part / parts) * period)
    positions, tools, forces = (np.array(column) for column in zip(*rows, strict=True))
    return Execution(np.array(times), positions, tools, forces)


def recorded_execution(experiment: ExperimentResult, positions: int, period: float) -> Execution:
    """The execution from the plant's states that the run recorded; the plant has `positions` generalized positions."""
    recorded, nu = experiment.recorded, experiment.commands.shape[1]
    parts = max(1, round(32.0 * period))
    wanted: Array = period / parts * np.arange(parts * len(experiment.commands), dtype=float)
    rows = np.searchsorted(recorded["time"], wanted - 1e-9)
    return Execution(
        wanted,
        recorded["plant_state"][rows, :positions],
        recorded["measured_state"][rows, :nu],
        recorded["true_force"][rows],
    )


def make_replay(
    result: RunResult,
    diagram: Diagram,
    start_context: Callable[[int], Context],
    view: View,
    *,
    experiments: Sequence[int] | None = None,
) -> Replay:
    """The replay of the experiments with the numbers `experiments`, one after the other; by default of all.

    `diagram` is a world with the truth and seed of the run, not part of another Diagram and, for speed, without a
    Meshcat. The executed commands are simulated in it again, unless the run recorded its plant.
    """
    period = result.task.model.period
    chosen = range(len(result.experiments)) if experiments is None else experiments
    offsets, runs, offset = [], [], 0.0
    for number in chosen:
        run = _execution(result.experiments[number], diagram, start_context, number, period)
        offsets.append(offset)
        runs.append(run)
        offset += float(run.time[-1]) + PAUSE
    time = np.concatenate([start + run.time for start, run in zip(offsets, runs, strict=True)])
    tools = np.concatenate([run.tool for run in runs])
    forces = np.concatenate([run.forces for run in runs])
    arrows = forces[:, :, np.newaxis] * view.force_directions
    points = np.broadcast_to((view.place(tools) + view.force_offset)[:, np.newaxis], arrows.shape)
    plans = [_candidates(result.experiments[number], view, period) for number in chosen]
    return Replay(
        title=f"{result.task.name} — world: {result.world}",
        motion=Motion(time, np.concatenate([run.positions for run in runs])),
        forces=Forces(time, points, arrows, view.force_scale),
        candidates=Candidates(
            np.concatenate([start + plan.time for start, plan in zip(offsets, plans, strict=True)]),
            np.concatenate([plan.paths for plan in plans]),
            np.concatenate([plan.chosen for plan in plans]),
        ),
        beliefs=_beliefs(result, list(chosen), offsets),
        captions=_odds(result, list(chosen), offsets),
        camera=view.camera,
        panel=view.panel,
        panel_width=view.panel_width,
        stroke=view.stroke,
    )


def _execution(
    experiment: ExperimentResult,
    diagram: Diagram,
    start_context: Callable[[int], Context],
    number: int,
    period: float,
) -> Execution:
    if "plant_state" not in experiment.recorded:
        return execute(diagram, start_context(number), experiment.commands, period)
    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return recorded_execution(experiment, plant.num_positions(), period)


def _candidates(experiment: ExperimentResult, view: View, period: float) -> Candidates:
    """The paths of the tool under each candidate's commands, with perfect tracking."""
    steps, nu = experiment.commands.shape
    plans = experiment.plans.reshape(steps, 1, -1, nu)
    commands = experiment.candidates.reshape(steps, -1, plans.shape[2], nu)
    moved = period * np.cumsum(commands, axis=2)
    moved = np.concatenate([np.zeros_like(moved[:, :, :1]), moved], axis=2)
    start = experiment.robot_states[:steps, np.newaxis, np.newaxis, :nu]
    ahead = period * np.arange(moved.shape[2])
    paths = view.place(start + moved) + ahead[:, np.newaxis] * view.spread
    chosen = np.argmin(np.abs(commands - plans).sum(axis=(2, 3)), axis=1)
    return Candidates(experiment.time[:steps], paths, chosen)


def _beliefs(result: RunResult, numbers: Sequence[int], offsets: Sequence[float]) -> tuple[BeliefHistory, ...]:
    """The belief over each parameter before, during and after each shown experiment.

    Of several contact laws, the belief under the one that is the most probable at the end.
    """
    candidate, best = result.candidate, result.best
    prior = Belief.prior(candidate.model.parameters)
    states = [prior, *(experiment.over_laws.beliefs[best] for experiment in result.experiments)]
    rows: list[tuple[float, Array, Array]] = []
    for number, offset in zip(numbers, offsets, strict=True):
        experiment = result.experiments[number]
        rows.append((offset, states[number].mean, states[number].std))
        then = [(offset + time, over_laws.beliefs[best]) for time, over_laws in experiment.history]
        rows += [(time, belief.mean, belief.std) for time, belief in then]
        after = states[number + 1]
        rows.append((offset + float(experiment.time[-1]), after.mean, after.std))
    times = np.array([row[0] for row in rows])
    means, stds = (np.array([row[column] for row in rows]) for column in (1, 2))
    return tuple(
        BeliefHistory(
            parameter.name,
            _unit(parameter.unit),
            times,
            means[:, index],
            stds[:, index],
            candidate.truth[parameter.name],
        )
        for index, parameter in enumerate(candidate.model.parameters.free)
        if not parameter.nuisance
    )


def _odds(result: RunResult, numbers: Sequence[int], offsets: Sequence[float]) -> Captions | None:
    """The probabilities of the contact laws before, during and after each shown experiment; None for a single law."""
    if not result.task.others:
        return None
    first = LawBelief.prior({each.law: each.model.parameters for each in result.task.candidates})
    states = [first, *(experiment.over_laws for experiment in result.experiments)]
    rows: list[tuple[float, LawBelief]] = []
    for number, offset in zip(numbers, offsets, strict=True):
        experiment = result.experiments[number]
        rows += [(offset, states[number])]
        rows += [(offset + time, over_laws) for time, over_laws in experiment.history]
        rows += [(offset + float(experiment.time[-1]), states[number + 1])]
    return Captions(np.array([time for time, _ in rows]), tuple(_law_words(over_laws) for _, over_laws in rows))


def _law_words(over_laws: LawBelief) -> str:
    shares = sorted(zip(over_laws.probability.tolist(), over_laws.laws, strict=True), reverse=True)
    return "law: " + ", ".join(f"{law} {100.0 * share:.0f} %" for share, law in shares[:2] if share >= 0.005)


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit
