"""What a world is to the closed loop: a Drake system with named ports, and a fresh start for each experiment."""

from collections.abc import Callable
from dataclasses import dataclass

from pydrake.systems.framework import Context, System


@dataclass(frozen=True)
class World:
    """Where experiments are executed.

    `system` has input `command` (nu,) m/s, held for a period, and outputs `measured_state` (2 nu,), position m
    and velocity m/s; `measured_force` (ny,) N with the sensor's noise; `true_force` (ny,) N without.
    `start_context` gives a Context of the system in its start state for experiment number k, from 0; the
    number chooses the noise. The output ports `recorded` are also logged every `recording_period` s.
    """

    name: str
    system: System
    start_context: Callable[[int], Context]
    recorded: tuple[str, ...] = ()
    recording_period: float = 0.0
