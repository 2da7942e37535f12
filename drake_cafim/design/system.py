"""The CA-OED controller: a LeafSystem that plans, once per period, the motion most informative about θ."""

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from drake_cafim.belief import Belief, LawBelief, not_found
from drake_cafim.design.force_belief import ForceBelief
from drake_cafim.design.policies import Policy
from drake_cafim.design.situation import Hypothesis, Situation
from drake_cafim.design.splines import shift
from drake_cafim.information import fisher_information
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.model import PlanningModel, Start
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.typing import Array


@dataclass(frozen=True)
class _Slots:
    """Indices of the discrete state groups of `CaOed`."""

    counters: int  # experiment, step, whether the experiment searches
    robot: int  # measured robot state of the last step
    belief: int  # belief of the last step
    # of each law, one after the other
    gained: int  # information since that belief
    touched: int  # predicted state of the touched object
    tangent: int  # its sensitivity
    # of the decision
    knots: int
    command: int
    plan: int
    information: int
    candidates: int
    milliseconds: int


class CaOed(LeafSystem):
    """Contact-aware optimal experimental design (paper, Eq. 10) in receding horizon.

    .. pydrake_system::

        name: CaOed
        input_ports: [measured_state, belief, force_belief (optional)]
        output_ports: [command, plan, information, candidates, planning_ms]

    Every `model.period` it reads `measured_state` (2 nu,), the end-effector's position m and velocity m/s, and
    `belief` (n + n²,), mean then covariance; decides by `policy`; and holds `command` (nu,) m/s until the next.
    `plan` (H·nu,) and `candidates` (N·H·nu,) are commands, row by row; `information` (n²,) is the plan's expected
    Fisher information, `planning_ms` (1,) the planning time. With a `ForceGuard`, set `force_hypotheses` to its number
    of hypotheses: then there is an input port for its `force_belief`, and plans account for its reductions.

    With several `laws`, planning models by name with `model` the first, `belief` is `LawBelief.vector`; `policy`
    was made for the same laws.

    `model` is the planning model, for your own plant a `DiagramModel`; `policy` comes from `make_policy`; `seed` is
    that of the random numbers; `evaluator` computes the sensitivities, by default the fastest one.

    All state is in the Context, including the random numbers (they follow from seed, experiment and step), so that a
    Context can be copied and replayed.
    """

    def __init__(
        self,
        model: PlanningModel,
        policy: Policy,
        *,
        seed: int = 0,
        evaluator: Evaluator | None = None,
        force_hypotheses: int = 0,
        laws: Mapping[str, PlanningModel] | None = None,
    ) -> None:
        super().__init__()
        self._model, self._policy, self._seed = model, policy, seed
        self._laws = {"": model} if laws is None else dict(laws)
        own = TangentEvaluator(model) if evaluator is None else evaluator
        models = list(self._laws.values())
        self._evaluators = [own if each is model else TangentEvaluator(each) for each in models]
        self._names = [each.parameters.names for each in models]
        sizes_of_laws = [len(names) for names in self._names]
        size, axes = sizes_of_laws[0], len(model.velocity_bounds[0])
        belief_size = len(LawBelief.prior({law: each.parameters for law, each in self._laws.items()}).vector())
        config = policy.config
        self._axes = axes
        self.DeclareVectorInputPort("measured_state", 2 * axes)
        self.DeclareVectorInputPort("belief", belief_size)
        self._hypotheses = force_hypotheses
        if force_hypotheses > 0:
            self.DeclareVectorInputPort("force_belief", ForceBelief.vector_size(force_hypotheses, size))
        # policies compare different numbers of candidates, but the port has a fixed size, see `_padded`
        self._candidate_count = config.candidates
        sizes = _Slots(
            counters=3,
            robot=2 * axes,
            belief=belief_size,
            gained=sum(n**2 for n in sizes_of_laws),
            touched=sum(each.state_size for each in models),
            tangent=sum(each.state_size * n for each, n in zip(models, sizes_of_laws, strict=True)),
            knots=config.knots * axes,
            command=axes,
            plan=config.horizon * axes,
            information=size**2,
            candidates=config.candidates * config.horizon * axes,
            milliseconds=1,
        )
        self._slots = _Slots(**{name: int(self.DeclareDiscreteState(n)) for name, n in vars(sizes).items()})
        for port in ("command", "plan", "information", "candidates"):
            self.DeclareStateOutputPort(port, DiscreteStateIndex(getattr(self._slots, port)))
        self.DeclareStateOutputPort("planning_ms", DiscreteStateIndex(self._slots.milliseconds))
        self.DeclarePeriodicDiscreteUpdateEvent(model.period, 0.0, self._decide)

    def begin_experiment(self, context: Context, experiment: int, *, searching: bool = False) -> None:
        """Reset the plan in `context`, this system's context, and start experiment number `experiment`.

        With `searching`, the policy hears which parameters earlier experiments did not find.
        """
        state: Any = context.get_mutable_discrete_state()
        for index in range(state.num_groups()):
            state.get_mutable_vector(index).SetZero()
        counters: Any = np.array([float(experiment), 0.0, float(searching)])
        state.get_mutable_vector(self._slots.counters).SetFromVector(counters)

    def _decide(self, context: Context, update: DiscreteValues) -> None:
        began = perf_counter()
        read = self._reader(context)
        robot = np.array(self._input(context, 0))
        vector = np.array(self._input(context, 1))
        over_laws = LawBelief.from_vector(tuple(self._laws), self._names, vector)
        belief = over_laws.beliefs[0]
        experiment, step, searching = (int(value) for value in read(self._slots.counters))
        passed = self._advance(read, step, robot, over_laws)
        touched, gained = passed[0]
        knots = read(self._slots.knots).reshape(self._policy.config.knots, self._axes)
        situation = Situation(
            step=step,
            time=step * self._model.period,
            robot_state=robot,
            theta=belief.mean,
            covariance=belief.covariance,
            information=belief.information + gained,
            touched=touched,
            knots=knots,
            forces=self._forces(context),
            hypotheses=_hypotheses(over_laws, passed) if len(self._laws) > 1 else (),
            unfound=self._unfound(over_laws) if searching else (),
        )
        decision = self._policy(situation, np.random.default_rng([self._seed, experiment, step]))
        carried = decision.knots
        if self._policy.shifts:
            carried = shift(decision.knots, self._policy.config.horizon)
        values: dict[str, Any] = {
            "counters": np.array([experiment, step + 1.0, searching]),
            "robot": robot,
            "belief": vector,
            "gained": np.concatenate([each.ravel() for _, each in passed]),
            "touched": np.concatenate([each.state.ravel() for each, _ in passed]),
            "tangent": np.concatenate([each.sensitivity.ravel() for each, _ in passed]),
            "knots": carried,
            "command": decision.command,
            "plan": decision.plan,
            "information": decision.fisher,
            "candidates": self._padded(decision.candidates),
            "milliseconds": np.array([1e3 * (perf_counter() - began)]),
        }
        for name, value in values.items():
            update.get_mutable_vector(getattr(self._slots, name)).SetFromVector(value.ravel())

    def _unfound(self, over_laws: LawBelief) -> tuple[str, ...]:
        parameters = list(self._laws.values())[over_laws.best].parameters
        return not_found(Belief.prior(parameters), over_laws.beliefs[over_laws.best], parameters.sought)

    def _forces(self, context: Context) -> ForceBelief | None:
        if self._hypotheses == 0:
            return None
        return ForceBelief.from_vector(np.array(self._input(context, 2)), self._hypotheses)

    def _advance(self, read: Any, step: int, robot: Array, over_laws: LawBelief) -> list[tuple[Start, Array]]:
        """By law the touched object's present state, and the information gained since the belief last changed.

        A changed belief includes the information gained before, so that the sum restarts at zero.
        """
        last, unchanged = read(self._slots.robot), np.array_equal(read(self._slots.belief), over_laws.vector())
        touched, tangent, gained = (read(getattr(self._slots, name)) for name in ("touched", "tangent", "gained"))
        result = []
        models = self._laws.values()
        for model, evaluator, belief in zip(models, self._evaluators, over_laws.beliefs, strict=True):
            size, nx = len(belief.mean), model.state_size
            own, touched = touched[:nx], touched[nx:]
            slopes, tangent = tangent[: nx * size].reshape(nx, size), tangent[nx * size :]
            so_far, gained = gained[: size**2].reshape(size, size), gained[size**2 :]
            if step == 0:
                motion = model.measured_motion(np.stack([robot, robot])[np.newaxis])
                result.append((model.start(motion[0, 0], belief.mean), np.zeros((size, size))))
                continue
            states = np.stack([last, robot])[np.newaxis]
            passed = evaluator(model.measured_motion(states), belief.mean, Start(own, slopes))
            added = fisher_information(passed.sensitivities, model.noise_std)[0]
            present = Start(passed.states[0, -1], passed.state_sensitivities[0, -1])
            result.append((present, so_far + added if unchanged else np.zeros((size, size))))
        return result

    def _padded(self, candidates: Array) -> Array:
        """The candidates as an array of the port's size: truncated, or padded with copies of the last."""
        short = self._candidate_count - len(candidates)
        if short > 0:
            candidates = np.concatenate([candidates, np.repeat(candidates[-1:], short, axis=0)])
        return candidates[: self._candidate_count]

    def _reader(self, context: Context) -> Any:
        state: Any = context.get_discrete_state()
        return lambda index: np.array(state.get_vector(index).get_value())

    def _input(self, context: Context, index: int) -> Any:
        return self.get_input_port(index).Eval(context)


def _hypotheses(over_laws: LawBelief, passed: list[tuple[Start, Array]]) -> tuple[Hypothesis, ...]:
    """The candidate laws, with the information gained since the belief and the touched object's state under each."""
    columns = zip(over_laws.laws, over_laws.probability.tolist(), over_laws.beliefs, passed, strict=True)
    return tuple(
        Hypothesis(law, probability, belief.mean, belief.covariance, belief.information + gained, touched)
        for law, probability, belief, (touched, gained) in columns
    )
