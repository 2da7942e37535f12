"""The interface of a world to the closed loop: a Drake system with named ports, and its start state."""

from collections.abc import Callable
from dataclasses import dataclass

from pydrake.systems.framework import Context, System

from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.model import PlanningModel


@dataclass(frozen=True)
class World:
    """A simulated robot and environment in which experiments are executed.

    `system` has input `command` (nu,) m/s, held for a period, and outputs `measured_state` (2 nu,), position m
    and velocity m/s; `measured_force` (ny,) N with the sensor's noise; `true_force` (ny,) N without.
    `start_context` returns a Context of the system in its start state for experiment number k, from 0, which
    determines the noise. The output ports `recorded` are also logged every `recording_period` s. `touching` is the body
    of the scenario's model on which the recorded `contact_wrench` acts, `tracked` that of the recorded `tracked_pose`.
    """

    name: str
    system: System
    start_context: Callable[[int], Context]
    recorded: tuple[str, ...] = ()
    recording_period: float = 0.0
    touching: str = ""
    tracked: str = ""
    automatic: Callable[[PlanningModel], Evaluator] | None = None
    """Sensitivities by AutoDiffXd through the world's own robot; None: through the planning model's Diagram alone."""
