"""Algorithm 1 of the paper in closed loop: plan an informative contact motion, execute it, estimate, repeat."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, cast

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System
from pydrake.systems.primitives import LogVectorOutput

from drake_cafim.belief import Belief, LawBelief, not_found
from drake_cafim.design.guard_system import ForceGuard
from drake_cafim.design.planner import PlannerConfig, PlannerName
from drake_cafim.design.policies import PolicyName, make_policy
from drake_cafim.design.searching import Searchable, SearchingPolicy
from drake_cafim.design.system import CaOed
from drake_cafim.errors import InputError
from drake_cafim.estimation.problem import make_problem
from drake_cafim.estimation.shooting import SolverReport
from drake_cafim.estimation.system import CaMap, EstimatorName
from drake_cafim.experiment.kept_experiments import KeptExperiments, Logs
from drake_cafim.experiment.kinematic_world import kinematic_world
from drake_cafim.experiment.world import World
from drake_cafim.information import Criterion
from drake_cafim.kept import NOTHING_KEPT, Kept
from drake_cafim.sensitivity.evaluator import Fisher, make_evaluator
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.tasks.point import PointModel
from drake_cafim.tasks.task import Candidate, Task
from drake_cafim.typing import Array

MOST_SEARCHES = 2
"""Experiments, beyond those asked for, that look for what was not found."""


@dataclass(frozen=True)
class Options:
    """Options of a run, with the defaults of `cafim run`."""

    policy: PolicyName = "contact-aware"
    planner: PlannerName = "predictive-sampling"
    criterion: Criterion = "logdet"
    fisher: Fisher = "tangent"
    estimator: EstimatorName = "shooting"
    planner_config: PlannerConfig = field(default_factory=PlannerConfig)
    belief_samples: int = 1  # points of the belief over which a plan's score is averaged; 1: its mode
    # limit the commands so that the true force stays within the task's limit; None: only those of contact-aware that a
    # simulated robot executes, for a task with a limit
    force_guard: bool | None = None
    experiments: int | None = None  # None: the task's own number
    search: bool = True  # for what the experiments did not find, in more of them
    until_std: float | None = None  # stop when every std is below this fraction of its estimate
    seed: int = 0


@dataclass(frozen=True)
class ExperimentResult:
    """One executed experiment: the belief after it, and its signals. Times in s, forces in N.

    time (T+1,), commands (T, nu), robot states (T+1, 2 nu), measured and true forces (T, ny) after each command.
    `fisher` (n, n) is this experiment's information alone, `information` (n, n) that of all so far, without the prior,
    both at the estimate after it. `history` is the belief after
    each estimate within the experiment, with its time. Where several contact laws are candidates, `over_laws` holds the
    belief over each, and all other fields are those of the most probable one. `solver` is the solver's status, and
    `on_bound` names the parameters whose estimate is at a bound. `not_found` are the sought parameters of which all
    data so far have told little, each with the reason; `searching`, whether this experiment looked for such. `recorded`
    holds the world's recorded outputs, (N, size) each, and their `time` (N,), from 0 on.
    """

    belief: Belief
    fisher: Array
    information: Array
    scaled_trace: float
    error_percent: Mapping[str, float]
    behaviour: Mapping[str, Any]
    tracking_error: float
    planning_ms: Array
    time: Array
    commands: Array
    robot_states: Array
    measured_force: Array
    true_force: Array
    plans: Array
    candidates: Array
    history: tuple[tuple[float, LawBelief], ...]
    over_laws: LawBelief
    solver: SolverReport = field(default_factory=lambda: SolverReport(True, 0))
    on_bound: tuple[str, ...] = ()
    not_found: Mapping[str, str] = field(default_factory=dict)
    searching: bool = False
    recorded: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class RunResult:
    """The result of a run: its task, options and prior, and all its experiments."""

    task: Task
    options: Options
    world: str
    prior: Belief
    experiments: tuple[ExperimentResult, ...]

    @property
    def best(self) -> int:
        """The index among the task's candidates of the law that was the most probable one after the last experiment."""
        return self.experiments[-1].over_laws.best if self.experiments else 0

    @property
    def candidate(self) -> Candidate:
        """The most probable law after the last experiment."""
        return self.task.candidates[self.best]

    @property
    def belief(self) -> Belief:
        """The belief after the last experiment; the prior if there was none."""
        return self.experiments[-1].belief if self.experiments else self.prior


def run(
    task: Task,
    options: Options | None = None,
    world: World | None = None,
    progress: Callable[[int, ExperimentResult], None] | None = None,
    kept: Kept = NOTHING_KEPT,
) -> RunResult:
    """Run Algorithm 1 on `task` in `world`, by default the kinematic one.

    It ends after the task's number of experiments, or `options.experiments`, or when all stds are below
    `options.until_std` times the estimates. Where something was not found by then, up to `MOST_SEARCHES` experiments of
    a planning policy search for it, if the model knows where (`Searchable`). `progress` is called after each experiment
    with its number, from 0. Experiments of the same task, options and world that are `kept` are read, not repeated.
    """
    options = Options() if options is None else options
    world = kinematic_world(task, seed=options.seed) if world is None else world
    options = replace(options, force_guard=_uses_guard(task, options, world))
    loop = _Loop(task, options, world, kept)
    prior = Belief.prior(task.model.parameters)
    results: list[ExperimentResult] = []
    total = task.experiments if options.experiments is None else options.experiments
    for number in range(total):
        results.append(loop.execute(number))
        if progress is not None:
            progress(number, results[-1])
        if options.until_std is not None and _is_confident(results[-1].belief, options.until_std):
            break
    while loop.searches and len(results) < total + MOST_SEARCHES and results[-1].not_found:
        results.append(loop.execute(len(results), searching=True))
        if progress is not None:
            progress(len(results) - 1, results[-1])
    return RunResult(task, options, world.name, prior, tuple(results))


def _is_confident(belief: Belief, fraction: float) -> bool:
    return bool((belief.std <= fraction * np.abs(belief.mean)).all())


def force_limit(task: Task) -> float:
    """The force limit N of the task's model; `InputError` for a model without one."""
    limit = getattr(task.model, "force_limit", None)
    if limit is None:
        raise InputError(f"--force-guard: {task.name} has no force_limit, expected a scenario whose task has")
    return float(limit)


def guarded_model(given: PlanningModel) -> PlanningModel:
    """The model for planning with a force guard: not above its careful speed, since the guard would limit it."""
    model: Any = given
    if not isinstance(model, PointModel):
        return given
    return cast(PlanningModel, replace(model, speed_limit=min(model.speed_limit, model.careful_speed)))


def _uses_guard(task: Task, options: Options, world: World) -> bool:
    if options.force_guard is not None:
        return options.force_guard
    executed = options.policy == "contact-aware" and isinstance(world.system, Diagram)
    # the guard assumes a fixed environment, and forces along the axes of the commands: so it is with a PointModel
    return executed and isinstance(task.model, PointModel) and getattr(task.model, "force_limit", None) is not None


def _add_guard(builder: DiagramBuilder, task: Task, options: Options) -> ForceGuard | None:
    if not options.force_guard:
        return None
    guard = ForceGuard(guarded_model(task.model), force_limit(task))
    builder.AddNamedSystem("guard", guard)
    return guard


class _Loop:
    """World, CA-OED and CA-MAP in one Diagram, run one experiment at a time."""

    def __init__(self, task: Task, options: Options, world: World, kept: Kept) -> None:
        self.task, self.world = task, world
        model = task.model
        # behind a guard, plans are made at its careful speed under every law
        careful = [guarded_model(each.model) if options.force_guard else each.model for each in task.candidates]
        laws = {each.law: each.model for each in task.candidates}
        planned = dict(zip(laws, careful, strict=True))
        automatic = world.automatic if options.fisher == "autodiff" else None
        evaluate = partial(make_evaluator, options.fisher) if automatic is None else automatic
        policy = make_policy(
            options.policy,
            careful[0],
            planner=options.planner,
            criterion=options.criterion,
            evaluate=evaluate,
            config=options.planner_config,
            belief_samples=options.belief_samples,
            force_limit=force_limit(task) if options.force_guard else None,
            laws=planned,
        )
        planning = options.policy in ("contact-aware", "finite-difference")
        self.searches = options.search and planning and isinstance(model, Searchable)
        if self.searches:
            policy = SearchingPolicy(careful[0], policy)
        builder = DiagramBuilder()
        self.plant: System = builder.AddNamedSystem("world", world.system)
        self.guard = _add_guard(builder, task, options)
        self.design = CaOed(
            model,
            policy,
            seed=options.seed,
            evaluator=evaluate(model),
            force_hypotheses=0 if self.guard is None else self.guard.hypotheses,
            laws=laws,
        )
        builder.AddNamedSystem("design", self.design)
        total = task.experiments if options.experiments is None else options.experiments
        self.estimator = CaMap(
            model,
            periods=task.periods,
            experiments=total + (MOST_SEARCHES if self.searches else 0),
            estimate_every=task.estimate_every,
            laws=laws,
            method=options.estimator,
        )
        builder.AddNamedSystem("estimator", self.estimator)
        state, force = (self.plant.GetOutputPort(name) for name in ("measured_state", "measured_force"))
        builder.Connect(state, self.design.GetInputPort("measured_state"))
        builder.Connect(state, self.estimator.GetInputPort("measured_state"))
        builder.Connect(force, self.estimator.GetInputPort("measured_force"))
        builder.Connect(self.estimator.GetOutputPort("belief"), self.design.GetInputPort("belief"))
        command = self.design.GetOutputPort("command")
        if self.guard is not None:
            builder.Connect(command, self.guard.GetInputPort("command"))
            builder.Connect(state, self.guard.GetInputPort("measured_state"))
            builder.Connect(force, self.guard.GetInputPort("measured_force"))
            builder.Connect(self.guard.GetOutputPort("force_belief"), self.design.GetInputPort("force_belief"))
            command = self.guard.GetOutputPort("command")
        builder.Connect(command, self.plant.GetInputPort("command"))
        sources = {
            "state": state,
            "measured": force,
            "true": self.plant.GetOutputPort("true_force"),
            "belief": self.estimator.GetOutputPort("belief"),
            "command": command,
            **{name: self.design.GetOutputPort(name) for name in ("plan", "candidates", "planning_ms")},
        }
        self.recorders = {
            name: LogVectorOutput(self.plant.GetOutputPort(name), builder, world.recording_period)
            for name in world.recorded
        }
        self.sinks = {name: LogVectorOutput(port, builder, model.period) for name, port in sources.items()}
        self.kept = KeptExperiments(kept, [self.estimator, *([] if self.guard is None else [self.guard])])
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)

    def execute(self, number: int, *, searching: bool = False) -> ExperimentResult:
        """Run experiment `number` from the start state, or read it where it is kept.

        The estimator keeps the data of the experiments before. With `searching` it looks for what these did not find.
        """
        root = self.simulator.get_mutable_context()
        logs = self.kept.read(number, root)
        if logs is None:
            logs = self._carry_out(root, number, searching)
            self.kept.write(number, root, logs)
        return replace(self._result(root, *logs), searching=searching)

    def _carry_out(self, root: Context, number: int, searching: bool) -> Logs:
        root.SetTime(0.0)
        start: Context = self.world.start_context(number)
        self.plant.GetMyMutableContextFromRoot(root).SetStateAndParametersFrom(start)
        self.design.begin_experiment(self.design.GetMyMutableContextFromRoot(root), number, searching=searching)
        estimating = self.estimator.GetMyMutableContextFromRoot(root)
        self.estimator.begin_experiment(estimating, number, searching=searching)
        if self.guard is not None and number == 0:  # its force belief carries over to the following experiments
            belief = self.estimator.law_belief(estimating).beliefs[0]  # the guard has the scenario's own law
            self.guard.begin(self.guard.GetMyMutableContextFromRoot(root), belief)
        logs: dict[str, Any] = {name: sink.FindMutableLog(root) for name, sink in self.sinks.items()}
        recorders: dict[str, Any] = {name: sink.FindMutableLog(root) for name, sink in self.recorders.items()}
        for log in (*logs.values(), *recorders.values()):
            log.Clear()
        self.simulator.Initialize()
        # a quarter period past the end, so that the updates at the end, the last sample and estimate, take place
        self.simulator.AdvanceTo((self.task.periods + 0.25) * self.task.model.period)
        rows = {name: self._rows(log) for name, log in logs.items()}
        recorded = {name: np.array(log.data().T) for name, log in recorders.items()}
        if recorders:
            recorded["time"] = np.array(next(iter(recorders.values())).sample_times())
        return rows, recorded

    def _rows(self, log: Any) -> Array:
        """The log's samples at the ends of the periods, (T+1, size), each taken before the updates of that instant.

        Hence the command of a period is in the row of the period's end.
        """
        data = np.array(log.data().T)
        expected = self.task.periods + 1
        assert len(data) == expected, f"{len(data)} samples logged, expected {expected}"
        return data

    def _result(self, root: Context, rows: Mapping[str, Array], recorded: Mapping[str, Array]) -> ExperimentResult:
        task = self.task
        context = self.estimator.GetMyContextFromRoot(root)
        over_laws = self.estimator.law_belief(context)
        candidate, belief = task.candidates[over_laws.best], over_laws.beliefs[over_laws.best]
        model = candidate.model
        solver, on_bound = self.estimator.solver(context)
        problem = make_problem(model, TangentEvaluator(model), self.estimator.data(context))
        informations = problem.fisher(belief.mean)
        fisher = informations[-1]
        states, commands = rows["state"], rows["command"][1:]
        motion = model.measured_motion(states[np.newaxis])[0, :: model.substeps]
        axes = commands.shape[1]
        return ExperimentResult(
            belief=belief,
            fisher=fisher,
            information=informations.sum(axis=0),
            scaled_trace=float(np.trace(np.diag(model.parameters.std**2) @ fisher)),
            error_percent=errors(belief, candidate),
            behaviour={**model.behaviour(motion, rows["true"][1:]), **_largest_force(recorded)},
            tracking_error=float(np.abs(states[1:, axes : 2 * axes] - commands).max()),
            planning_ms=rows["planning_ms"][1:, 0],
            time=np.asarray(np.arange(task.periods + 1) * model.period, dtype=float),
            commands=commands,
            robot_states=states,
            measured_force=rows["measured"][1:],
            true_force=rows["true"][1:],
            plans=rows["plan"][1:],
            candidates=rows["candidates"][1:],
            history=self._history(np.concatenate([rows["belief"][1:], [over_laws.vector()]])),
            over_laws=over_laws,
            solver=solver,
            on_bound=on_bound,
            not_found=reasons_not_found(model, belief),
            recorded=recorded,
        )

    def _history(self, beliefs: Array) -> tuple[tuple[float, LawBelief], ...]:
        """Time and belief after each estimate within the experiment; row k of `beliefs` is that after step k."""
        task = self.task
        if task.estimate_every == 0:
            return ()
        laws = tuple(each.law for each in task.candidates)
        names, result = [each.model.parameters.names for each in task.candidates], []
        for step in range(1, len(beliefs)):
            if step % task.estimate_every == 0 or step == task.periods:
                result.append((step * task.model.period, LawBelief.from_vector(laws, names, beliefs[step])))
        return tuple(result)


def errors(belief: Belief, candidate: Candidate) -> dict[str, float]:
    """By name 100 (estimate − truth) / truth of the parameters that are no nuisance."""
    found = {}
    for name, mean in zip(belief.names, belief.mean.tolist(), strict=True):
        if name in candidate.truth:
            found[name] = 100.0 * (mean - candidate.truth[name]) / candidate.truth[name]
    return found


def reasons_not_found(model: PlanningModel, belief: Belief) -> dict[str, str]:
    """By name the sought parameters of which the data have told little, each with a sentence that says how little."""
    prior, found = Belief.prior(model.parameters), {}
    units = {parameter.name: parameter.unit for parameter in model.parameters.free}
    for name in not_found(prior, belief, model.parameters.sought):
        index = belief.names.index(name)
        low, high = np.clip(belief.interval()[index], *(bound[index] for bound in model.parameters.bounds))
        share = 100.0 * belief.std[index] / prior.std[index]
        unit = "" if units[name] == "1" else f" {units[name]}"
        found[name] = (
            f"{name} was not found: what was felt says only that it is between {low:.3g} and {high:.3g}{unit}, "
            f"{share:.0f} % of the prior's std"
        )
    return found


def _largest_force(recorded: Mapping[str, Array]) -> dict[str, float]:
    """The largest force N over all steps of the world, if it records them; it may occur between two samples."""
    forces = recorded.get("true_force")
    return {} if forces is None else {"max_force": float(np.sqrt((forces**2).sum(axis=1)).max())}
