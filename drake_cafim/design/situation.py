"""Input and output of a policy: the situation of an experiment, and the decision."""

from dataclasses import dataclass

from drake_cafim.design.force_belief import ForceBelief
from drake_cafim.sensitivity.model import Start
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Hypothesis:
    """One of several contact laws that the touched object may have, by name, its `probability` and its own numbers.

    `theta`, `covariance`, `information` and `touched` are as in `Situation`, for the parameters of this law's model.
    """

    law: str
    probability: float
    theta: Array
    covariance: Array
    information: Array
    touched: Start


@dataclass(frozen=True)
class Situation:
    """The state of an experiment at the beginning of a period.

    `robot_state` (2 nu,) as measured; `theta` (n,) the present estimate and `covariance` (n, n) of its belief;
    `information` P (n, n), of the prior and all data so far, including those after the estimate; `touched`, the
    predicted state of the touched object; `knots` (K, nu), the last plan shifted to the present (zero at the start);
    `forces`, the force guard's belief, if there is a guard; `hypotheses`, where several contact laws are candidates:
    `theta` and the like are then those of the law that the scenario names; `unfound`, in an experiment that searches,
    the parameters of which the data so far have told little.
    """

    step: int
    time: float
    robot_state: Array
    theta: Array
    covariance: Array
    information: Array
    touched: Start
    knots: Array
    forces: ForceBelief | None = None
    hypotheses: tuple[Hypothesis, ...] = ()
    unfound: tuple[str, ...] = ()


@dataclass(frozen=True)
class Decision:
    """`command` (nu,) m/s to hold for a period, the `plan` (H, nu) that it starts, and the `knots` (K, nu) of the plan.

    `fisher` (n, n) is the plan's expected Fisher information; `candidates` (N, H, nu) are the compared plans.
    """

    command: Array
    plan: Array
    knots: Array
    fisher: Array
    candidates: Array
