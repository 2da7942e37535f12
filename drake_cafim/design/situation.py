"""What a policy knows when it decides, and what it decides."""

from dataclasses import dataclass

from drake_cafim.design.force_belief import ForceBelief
from drake_cafim.sensitivity.model import Start
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Situation:
    """A moment of an experiment.

    `robot_state` (2 nu,) as measured; `theta` (n,) the present estimate and `covariance` (n, n) its belief's;
    `information` P (n, n), the prior's and that of all data so far, those since the estimate included; `touched`,
    the predicted state of what is touched; `knots` (K, nu), the last plan already shifted to now (zero at the start);
    `forces`, what a force guard believes of them, if commands pass through one.
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


@dataclass(frozen=True)
class Decision:
    """`command` (nu,) m/s to hold for a period, the `plan` (H, nu) it begins, and the `knots` (K, nu) of the plan.

    `fisher` (n, n) is the information that the plan promises; `candidates` (N, H, nu) what else was weighed.
    """

    command: Array
    plan: Array
    knots: Array
    fisher: Array
    candidates: Array
