"""The class `Task`: a planning model, the true parameters, the robot's start, and the number of experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Candidate:
    """A contact law that the touched object may have: the planning model with it, and the true parameters under it.

    `truth` is by name of those of the model's parameters that are no nuisance; where the world's contact has no true
    value of a parameter, its value at rest under the working force.
    """

    law: str
    model: PlanningModel
    truth: Mapping[str, float]

    @property
    def theta(self) -> Array:
        """The true parameters that are no nuisance, (k,)."""
        parameters = self.model.parameters
        return np.array([self.truth[name] for name in np.array(parameters.names)[parameters.sought]])


@dataclass(frozen=True)
class Task:
    """One of the paper's scenarios, or your own.

    `robot_start` is (2 nu,): position m and velocity m/s in the planner's coordinates. An experiment lasts
    `periods` planning steps; an estimate is made every `estimate_every` of them, or at the end only (0). Where the
    contact law is in doubt, `others` are the candidates beside the model's own law, `law`.
    """

    name: str
    model: PlanningModel
    truth: Mapping[str, float]
    robot_start: Array
    periods: int
    experiments: int
    estimate_every: int = 0
    law: str = ""
    others: tuple[Candidate, ...] = ()

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The model's own law, then the others."""
        return (Candidate(self.law, self.model, self.truth), *self.others)

    def with_law(self, law: str) -> "Task":
        """The task with one of its candidates alone; `InputError` for a law that is none of them."""
        for candidate in self.candidates:
            if candidate.law == law:
                return replace(self, model=candidate.model, truth=candidate.truth, law=law, others=())
        valid = ", ".join(["all", *(candidate.law for candidate in self.candidates if candidate.law)])
        raise InputError(f"--law {law}: {self.name} has the laws {valid}")

    def with_unknown_place(self, std: float) -> "Task":
        """The task with the place of the contact unknown, too: offsets with priors of `std` m, as nuisance.

        Raises `InputError` for a model without a place, such as a ball in a palm.
        """
        if not getattr(self.model, "offsets", ()):
            raise InputError(f"--place-std: {self.name} has no place of contact that could be off, expected 0")
        others = tuple(replace(other, model=_with_offsets(other.model, std)) for other in self.others)
        return replace(self, model=_with_offsets(self.model, std), others=others)

    @property
    def theta(self) -> Array:
        """The true parameters, (n,); of a nuisance parameter its prior's mean."""
        return self.model.parameters.vector(self.truth)

    def with_prior_mean(self, scale: float | Array) -> "Task":
        """The task with the prior's mean at `scale` times the truth: one factor, or one for each parameter."""
        means = np.asarray(scale) * self.theta
        items = [
            parameter
            if parameter.nuisance
            else replace(parameter, mean=float(np.clip(mean, parameter.lower, parameter.upper)))
            for parameter, mean in zip(self.model.parameters.free, means, strict=True)
        ]
        # every packaged model is a dataclass with a field `parameters`
        return replace(self, model=replace(self.model, parameters=Parameters.of(items)))  # type: ignore[type-var]


def _with_offsets(model: PlanningModel, std: float) -> PlanningModel:
    """The model with the offsets that it can have (`offsets`) among its parameters."""
    names = getattr(model, "offsets", ())
    added = [Parameter(name, 0.0, std, lower=-6.0 * std, upper=6.0 * std, unit="m", nuisance=True) for name in names]
    given = [parameter for parameter in model.parameters if parameter.name not in names]
    # every packaged model is a dataclass with a field `parameters`
    changed: PlanningModel = replace(model, parameters=Parameters.of([*given, *added]))  # type: ignore[type-var]
    return changed
