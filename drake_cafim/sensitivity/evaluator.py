"""The interface of the three evaluators: predicted measurements along a motion and their sensitivities."""

from typing import Literal, Protocol, TypeAlias, get_args

from drake_cafim.errors import InputError
from drake_cafim.sensitivity.model import PlanningModel, Rollout, Start
from drake_cafim.typing import Array

Fisher: TypeAlias = Literal["tangent", "autodiff", "finite-difference"]
FISHER: tuple[str, ...] = get_args(Fisher)


class Evaluator(Protocol):
    """A function that predicts measurements and their sensitivities along given motions."""

    def __call__(self, motion: Array, theta: Array, start: Start) -> Rollout:
        """The rollouts along motion (B, T·substeps + 1, nr) at θ (n,) from `start`."""
        ...


def make_evaluator(name: Fisher, model: PlanningModel) -> Evaluator:
    """The evaluator called `name`. Raises `InputError` that lists the valid names."""
    from drake_cafim.sensitivity.automatic import AutoDiffEvaluator
    from drake_cafim.sensitivity.finite_difference import FiniteDifferenceEvaluator
    from drake_cafim.sensitivity.tangent import TangentEvaluator

    if name == "tangent":
        return TangentEvaluator(model)
    if name == "autodiff":
        return AutoDiffEvaluator(model)
    if name == "finite-difference":
        return FiniteDifferenceEvaluator(model)
    raise InputError(f"--fisher {name!r}: expected one of {', '.join(FISHER)}")
