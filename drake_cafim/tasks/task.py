"""The class `Task`: a planning model, the true parameters, the robot's start, and the number of experiments."""

from collections.abc import Mapping, Sequence
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

    def with_unknown_place(self, std: float, tilt_std: float = 0.0) -> "Task":
        """The task with the frame of the contact unknown, too, as nuisance: offsets and tilt with priors of these stds.

        `std` in m, `tilt_std` in rad; 0 leaves them out. Raises `InputError` for a model without a place, such as a
        ball in a palm, and for one whose forces do not depend on a tilt to first order, such as a ball between jaws.
        """
        if std and not getattr(self.model, "offsets", ()):
            raise InputError(f"--place-std: {self.name} has no place of contact that could be off, expected 0")
        if tilt_std and not getattr(self.model, "tilts", ()):
            raise InputError(
                f"--tilt-std: in {self.name} a tilt changes the measured force at most by its cosine, expected 0"
            )
        offset, tilt = ("offsets", 0.0, std, "m"), ("tilts", 0.0, tilt_std, "rad")
        others = tuple(replace(other, model=_with_nuisance(other.model, offset, tilt)) for other in self.others)
        return replace(self, model=_with_nuisance(self.model, offset, tilt), others=others)

    def with_unknown_sensor(self, bias_std: float, drift_std: float) -> "Task":
        """The task whose force sensor has a bias and a drift as nuisance, with priors of these stds, N and N/s.

        0 leaves them out. The bias is the same in all experiments, the drift counts from the start of each. Raises
        `InputError` for a model without them.
        """
        if (bias_std or drift_std) and not getattr(self.model, "sensor_errors", ()):
            raise InputError(f"--bias-std, --drift-std: {self.name} takes its force sensor as tared, expected 0")
        return self.with_sensor(0.0, 0.0, bias_std, drift_std)

    def with_sensor(self, bias: float, drift: float, bias_std: float = 1.0, drift_std: float = 1.0) -> "Task":
        """The task whose force sensor is off by `bias` N and `drift` N/s; for a world, whose numbers are known."""
        names = getattr(self.model, "sensor_errors", ())
        both = (("bias", bias, bias_std, "N"), ("drift", drift, drift_std, "N/s"))
        new = [_nuisance(name, mean, std, unit) for name, mean, std, unit in both if std and name in names]
        return replace(self, model=_with_parameters(self.model, new))

    def with_frame(self, offset: float, tilt: float) -> "Task":
        """The task whose contact is beside its planned frame: by `offset` m along each axis, turned by `tilt` rad.

        For a world: the numbers are known. What the model cannot have, as a tilt between jaws, is left out.
        """
        changed = _with_nuisance(self.model, ("offsets", offset, 1.0, "m"), ("tilts", tilt, 1.0, "rad"))
        return replace(self, model=changed)

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


def _with_nuisance(model: PlanningModel, *kinds: tuple[str, float, float, str]) -> PlanningModel:
    """The model with the nuisance parameters that its properties `kinds` name: each with mean, std (0: none), unit."""
    found = [(name, mean, std, unit) for which, mean, std, unit in kinds if std for name in getattr(model, which, ())]
    return _with_parameters(model, [_nuisance(*each) for each in found])


def _nuisance(name: str, mean: float, std: float, unit: str) -> Parameter:
    return Parameter(name, mean, std, lower=mean - 6.0 * std, upper=mean + 6.0 * std, unit=unit, nuisance=True)


def _with_parameters(model: PlanningModel, new: Sequence[Parameter]) -> PlanningModel:
    """The model with these parameters, which replace those of the same name."""
    given = [parameter for parameter in model.parameters if parameter.name not in {each.name for each in new}]
    # every packaged model is a dataclass with a field `parameters`
    changed: PlanningModel = replace(model, parameters=Parameters.of([*given, *new]))  # type: ignore[type-var]
    return changed
