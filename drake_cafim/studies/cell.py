"""One run of a study: its options, and the numbers that are stored of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from drake_cafim.belief import Belief
from drake_cafim.design.planner import PlannerName
from drake_cafim.design.policies import PolicyName
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.diagrams.world import WorldKind
from drake_cafim.experiment.closed_loop import ExperimentResult, Options, RunResult, errors, run
from drake_cafim.experiment.kinematic_world import kinematic_world
from drake_cafim.experiment.run_record import describe_combinations
from drake_cafim.experiment.world import World
from drake_cafim.information import Criterion, without_nuisance
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.studies.diagnosed import diagnose_run
from drake_cafim.studies.other_laws import other_laws
from drake_cafim.tasks.as_printed import as_printed
from drake_cafim.tasks.contouring import contouring
from drake_cafim.tasks.hefting import hefting
from drake_cafim.tasks.pinching import pinching
from drake_cafim.tasks.rubbing import rubbing
from drake_cafim.tasks.task import Task

TASKS: Mapping[str, Callable[[], Task]] = {
    "hefting": hefting,
    "rubbing": rubbing,
    "pinching": pinching,
    "contouring": contouring,
}
SCENARIOS = tuple(TASKS)
POINT = "pinching_point"
"""The scenario whose contact parameters have true values in Drake's world."""


@dataclass(frozen=True)
class Cell:
    """All options of a run; equal cells give equal numbers, planning times aside."""

    scenario: str
    seed: int
    policy: PolicyName = "contact-aware"
    planner: PlannerName = "predictive-sampling"
    criterion: Criterion = "logdet"
    prior_scale: float = 1.3  # the prior's mean over the truth
    noise: float = 1.0  # times the task's force noise, in the world and in the model
    world: WorldKind | None = None  # None: the kinematic world
    experiments: int | None = None  # None: the task's own number
    process_noise: float = 0.0  # m/s, added to each command in the kinematic world
    outside: float = 0.0  # m, by which the kinematic world's contact is before the frame that is planned with
    belief_samples: int = 1  # points of the belief over which plans are scored
    force_guard: bool | None = None  # None: as `experiment.Options` has it
    believed: tuple[tuple[str, float], ...] = ()  # numbers of the planner's model that are not the world's
    law: str | None = None  # candidate contact laws: all, one of them, or None for the scenario's own
    place_std: float = 0.0  # m, of the prior of the contact's place, learned as nuisance; 0: known
    tilt_std: float = 0.0  # degrees, of the prior of the angle of the contact's frame; 0: known
    beside: tuple[float, float] | None = None  # m and degrees, by which the kinematic world's contact is off its frame
    as_printed: bool = False  # with the paper's own choices
    diagnosed: bool = False  # the joints are recorded as well, and a diagnosis looks for what its scenario lacks

    @property
    def key(self) -> str:
        """The stem of its file's name, unique among cells."""
        world = "kinematic" if self.world is None else self.world
        parts = [self.scenario, world, self.policy, self.planner, self.criterion, f"prior{self.prior_scale:g}"]
        parts += [f"noise{self.noise:g}", f"of{self.experiments or 'all'}", f"seed{self.seed}"]
        parts += [f"belief{self.belief_samples}"] if self.belief_samples != 1 else []
        parts += ["guarded"] if self.force_guard else []
        # in the kinematic world the guard is off by default, so only other worlds need to say so
        parts += ["unguarded"] if self.force_guard is False and self.world is not None else []
        parts += [f"{name}{value:g}" for name, value in self.believed]
        parts += [f"process{self.process_noise:g}"] if self.process_noise else []
        parts += [f"outside{self.outside:g}"] if self.outside else []
        parts += [f"law-{self.law}"] if self.law else []
        parts += [f"place{self.place_std:g}"] if self.place_std else []
        parts += [f"tilt{self.tilt_std:g}"] if self.tilt_std else []
        parts += ["beside" + "-".join(f"{part:g}" for part in self.beside)] if self.beside else []
        parts += ["as-printed"] if self.as_printed else []
        parts += ["diagnosed"] if self.diagnosed else []
        return "_".join(parts)


def select_varied(results: Mapping[Cell, Any], *names: str) -> dict[Cell, Any]:
    """The results of cells whose fields other than scenario, seed and `names` have their default values."""
    return {
        cell: kept
        for cell, kept in results.items()
        if Cell(cell.scenario, cell.seed, **{name: getattr(cell, name) for name in names}) == cell
    }


def measure(cell: Cell) -> dict[str, Any]:
    """Carry out the run of `cell`; returns the numbers that are stored in its file."""
    task, world = _task_and_world(cell)
    options = Options(
        policy=cell.policy,
        planner=cell.planner,
        criterion="trace" if cell.as_printed else cell.criterion,
        seed=cell.seed,
        experiments=cell.experiments,
        belief_samples=cell.belief_samples,
        force_guard=False if cell.as_printed else cell.force_guard,
        search=not cell.as_printed,
    )
    result = run(task, options, world)
    kept = {} if cell.scenario != POINT else {"laws": other_laws(result)}
    if cell.diagnosed:
        kept["diagnosis"] = diagnose_run(result, cell.scenario, world)
    return {
        **kept,
        "parameters": list(task.model.parameters.names),
        "prior_error": list(errors(result.prior, task.candidates[0]).values()),
        "period": task.model.period,
        "experiments": [_stored_numbers(result, experiment) for experiment in result.experiments],
    }


def _task_and_world(cell: Cell) -> tuple[Task, World]:
    kinematic = cell.world is None and cell.scenario in TASKS
    stage = None if kinematic else stage_of(load(resolve(cell.scenario)), cell.scenario)
    task = TASKS[cell.scenario]() if stage is None else stage.task
    task = task.with_prior_mean(cell.prior_scale)
    if stage is not None:
        task = stage.with_laws(task, cell.law)
    elif cell.law is not None:
        task = stage_of(load(resolve(cell.scenario)), cell.scenario).with_laws(task, cell.law)
    if cell.noise != 1.0:
        # every packaged model has a field force_std
        noisy: Any = task.model
        task = replace(task, model=replace(noisy, force_std=cell.noise * noisy.force_std))
    true, model = task, cast(Any, task.model)
    task = replace(task, model=replace(model, **dict(cell.believed)))
    task = as_printed(task) if cell.as_printed else task
    task = task.with_unknown_place(cell.place_std, float(np.deg2rad(cell.tilt_std)))
    true = true if cell.beside is None else true.with_frame(cell.beside[0], float(np.deg2rad(cell.beside[1])))
    if stage is None or cell.world is None:
        return task, kinematic_world(
            _with_contact_outside(true, cell.outside), seed=cell.seed, process_std=cell.process_noise
        )
    world = stage.world(cell.world, cell.seed)
    if cell.diagnosed:
        return task, world
    # what happens between two samples of the planner counts as well: contacts, and the largest force
    return task, replace(world, recorded=("true_force",) if cell.world == "model" else ("true_force", "contacts"))


def _with_contact_outside(task: Task, outside: float) -> Task:
    """The task with the radius of the tip or ball enlarged by `outside` m; unchanged where the model has none."""
    model: Any = task.model
    for radius in ("tip_radius", "ball_radius"):
        if outside and hasattr(model, radius):
            return replace(task, model=replace(model, **{radius: getattr(model, radius) + outside}))
    return task


def _stored_numbers(result: RunResult, experiment: ExperimentResult) -> dict[str, Any]:
    candidate = result.task.candidates[experiment.over_laws.best]
    sought, theta, belief = candidate.model.parameters.sought, candidate.theta, experiment.belief
    prior = Belief.prior(candidate.model.parameters)
    counted, _ = without_nuisance(experiment.fisher, prior.information, sought)
    eigenvalues = np.linalg.eigvalsh(counted / np.outer(1.0 / theta, 1.0 / theta))
    laws = {}
    if len(experiment.over_laws.laws) > 1:
        weight = experiment.over_laws.log_weight - experiment.over_laws.log_weight.max()
        laws = {"law": candidate.law, "log_odds": dict(zip(experiment.over_laws.laws, weight.tolist(), strict=True))}
    return {
        **laws,
        "errors": dict(experiment.error_percent),
        "error": list(experiment.error_percent.values()),
        "inside": (np.abs(belief.mean[sought] - theta) <= 1.96 * belief.std[sought]).tolist(),
        "std": (100.0 * belief.std[sought] / theta).tolist(),
        "information": experiment.scaled_trace,
        **describe_combinations(prior, belief, experiment.information),
        "condition": float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0 else None,
        "behaviour": dict(experiment.behaviour),
        "tracking_error": experiment.tracking_error,
        "planning_ms": float(np.median(experiment.planning_ms)),
        "hydroelastic": _hydroelastic(experiment),
    }


def _hydroelastic(experiment: ExperimentResult) -> float | None:
    """The fraction of the plant's steps in contact at which the contact is hydroelastic; None without a contact."""
    contacts = experiment.recorded.get("contacts", np.zeros((0, 2)))
    touching = contacts[contacts.sum(axis=1) > 0]
    return float((touching[:, 0] > 0).mean()) if len(touching) else None
