"""The CA-MAP estimator as a LeafSystem that stores measurements and updates the belief."""

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from pydrake.systems.framework import Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from drake_cafim.belief import Belief, LawBelief
from drake_cafim.errors import InputError
from drake_cafim.estimation.evidence import log_evidence
from drake_cafim.estimation.joint import refine_jointly
from drake_cafim.estimation.problem import Data, make_problem
from drake_cafim.estimation.shooting import MapEstimate, ShootingConfig, SolverReport, solve
from drake_cafim.estimation.support import with_moments
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.typing import Array

EstimatorName: TypeAlias = Literal["shooting", "joint"]
ESTIMATORS: tuple[str, ...] = get_args(EstimatorName)


class CaMap(LeafSystem):
    """Contact-aware maximum a-posteriori estimation (paper, Eq. 7 and 11).

    .. pydrake_system::

        name: CaMap
        input_ports: [measured_state, measured_force]
        output_ports: [belief]

    Every `model.period` it stores a sample of `measured_state` (2 nu,), position m and velocity m/s, and of
    `measured_force` (ny,), the model's measurement. The belief (n + n²,), mean then covariance, is updated after every
    `estimate_every` periods, or only at the end of an experiment of `periods` (0).

    With several `laws`, planning models by name that predict the same measurements, it keeps a belief over each law's
    parameters and the laws' probabilities, from the evidence of each; `belief` is then `LawBelief.vector`.

    `method` is `shooting`, over the parameters alone, or `joint`, which then solves for parameters and contact forces
    together (paper, Def. 4). After each experiment, and while one searches, a belief that rests on no contact has the
    mean and covariance of the posterior, see `estimation/support.py`.

    `model` predicts the measurements, for your own plant a `DiagramModel`; `config` holds the settings of the search;
    `evaluator` computes the sensitivities, by default the `TangentEvaluator`. All samples and the belief are in the
    Context, with room for `experiments` experiments; a further one raises `InputError`.
    """

    def __init__(
        self,
        model: PlanningModel,
        *,
        periods: int,
        experiments: int,
        estimate_every: int = 0,
        config: ShootingConfig | None = None,
        evaluator: Evaluator | None = None,
        laws: Mapping[str, PlanningModel] | None = None,
        method: EstimatorName = "shooting",
    ) -> None:
        super().__init__()
        self._model, self._config = model, config
        self._evaluator = TangentEvaluator(model) if evaluator is None else evaluator
        self._laws = {"": model} if laws is None else dict(laws)
        self._method = method
        self._every = estimate_every
        self._axes, self._readings = len(model.velocity_bounds[0]), len(model.noise_std)
        self._shape = (experiments, periods + 1, 2 * self._axes + self._readings)
        self._prior = LawBelief.prior({law: each.parameters for law, each in self._laws.items()})
        self.DeclareVectorInputPort("measured_state", 2 * self._axes)
        self.DeclareVectorInputPort("measured_force", self._readings)
        self._counters = int(self.DeclareDiscreteState(3))  # experiment, samples of it, whether it searches
        self._samples = int(self.DeclareDiscreteState(int(np.prod(self._shape))))
        belief: Any = self._prior.vector()
        self._belief = int(self.DeclareDiscreteState(belief))
        self._solver = int(self.DeclareDiscreteState(self._solver_size * len(self._laws)))
        self.DeclareStateOutputPort("belief", DiscreteStateIndex(self._belief))
        self.DeclarePeriodicDiscreteUpdateEvent(model.period, 0.0, self._sample)

    @property
    def _solver_size(self) -> int:
        """Numbers kept of each law's solver: solved, status, and which parameters are on a bound."""
        return 2 + max(len(names) for names in self._prior.names)

    def begin_experiment(self, context: Context, experiment: int, *, searching: bool = False) -> None:
        """Begin experiment number `experiment`, from 0, in `context` (this system's own); all samples are kept."""
        if experiment >= self._shape[0]:
            raise InputError(f"CaMap: experiment {experiment + 1} of a system made for {self._shape[0]}")
        counters: Any = np.array([float(experiment), 0.0, float(searching)])
        state: Any = context.get_mutable_discrete_state()
        state.get_mutable_vector(self._counters).SetFromVector(counters)

    def data(self, context: Context) -> list[Data]:
        """The data of the experiments so far in `context` (this system's own); the last may be unfinished."""
        state: Any = context.get_discrete_state()
        samples = np.array(state.get_vector(self._samples).get_value()).reshape(self._shape)
        experiment, count, _ = (int(v) for v in state.get_vector(self._counters).get_value())
        lengths = [self._shape[1]] * experiment + [min(count, self._shape[1])]
        return [self._unpack(samples[i, :length]) for i, length in enumerate(lengths) if length > 1]

    def belief(self, context: Context) -> Belief:
        """The belief over the most probable law's parameters in `context` (this system's own)."""
        over_laws = self.law_belief(context)
        return over_laws.beliefs[over_laws.best]

    def law_belief(self, context: Context) -> LawBelief:
        """The belief over the laws and their parameters in `context` (this system's own)."""
        state: Any = context.get_discrete_state()
        vector = np.array(state.get_vector(self._belief).get_value())
        return LawBelief.from_vector(self._prior.laws, self._prior.names, vector)

    def solver(self, context: Context) -> tuple[SolverReport, tuple[str, ...]]:
        """The solver's status for the last belief in `context` (this system's own), and the parameters at a bound.

        Of several laws, those of the most probable one.
        """
        state: Any = context.get_discrete_state()
        best = self.law_belief(context).best
        rows = np.array(state.get_vector(self._solver).get_value()).reshape(len(self._laws), -1)
        solved, status, *bound = rows[best].tolist()
        on_bound = tuple(name for name, there in zip(self._prior.names[best], bound, strict=False) if there)
        return SolverReport(bool(solved), int(status), self._method == "joint"), on_bound

    def _unpack(self, rows: Any) -> Data:
        return Data(rows[:, : 2 * self._axes], rows[1:, 2 * self._axes :])

    def _sample(self, context: Context, update: DiscreteValues) -> None:
        state: Any = context.get_discrete_state()
        experiment, count, searching = (int(v) for v in state.get_vector(self._counters).get_value())
        if count >= self._shape[1]:
            return
        samples = np.array(state.get_vector(self._samples).get_value()).reshape(self._shape)
        inputs: list[Any] = [self.get_input_port(index).Eval(context) for index in range(2)]
        samples[experiment, count] = np.concatenate(inputs)
        written: Any = update
        written.get_mutable_vector(self._samples).SetFromVector(samples.ravel())
        written.get_mutable_vector(self._counters).SetFromVector(np.array([experiment, count + 1.0, searching]))
        if self._due(count):
            lengths = [self._shape[1]] * experiment + [count + 1]
            data = [self._unpack(samples[i, :length]) for i, length in enumerate(lengths)]
            belief, status = self._estimate(data, doubting=bool(searching) or count == self._shape[1] - 1)
            written.get_mutable_vector(self._belief).SetFromVector(belief.vector())
            written.get_mutable_vector(self._solver).SetFromVector(status)

    def _estimate(self, data: list[Data], *, doubting: bool) -> tuple[LawBelief, Array]:
        """The belief over the laws after all `data`, and the numbers of each law's solver, one law after the other."""
        beliefs, weights = [], []
        status = np.zeros((len(self._laws), self._solver_size))
        for row, (model, prior) in zip(status, zip(self._laws.values(), self._prior.beliefs, strict=True), strict=True):
            evaluator = self._evaluator if model is self._model else TangentEvaluator(model)
            problem = make_problem(model, evaluator, data, prior)
            estimate = solve(problem, self._config)
            if self._method == "joint":
                estimate = refine_jointly(problem, estimate)
            beliefs.append(with_moments(problem, estimate).belief if doubting else estimate.belief)
            weights.append(log_evidence(problem, estimate) if len(self._laws) > 1 else 0.0)
            _fill_status(row, estimate)
        return LawBelief(self._prior.laws, tuple(beliefs), np.array(weights)), status.ravel()

    def _due(self, count: int) -> bool:
        """Whether an estimate is due at sample number `count`, from 0."""
        if count == self._shape[1] - 1:
            return True
        return self._every > 0 and count > 0 and count % self._every == 0


def _fill_status(row: Array, estimate: MapEstimate) -> None:
    """Fills `row` with whether the solver succeeded, its status, and which parameters are on a bound."""
    names = estimate.belief.names
    row[:2] = float(estimate.solved), float(estimate.solver.status)
    row[2 : 2 + len(names)] = [float(name in estimate.on_bound) for name in names]
