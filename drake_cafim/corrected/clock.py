"""The update schedule of the effects' discrete states."""

from collections.abc import Callable
from dataclasses import dataclass

from pydrake.systems.framework import Context, DiscreteValues, EventStatus, LeafSystem, State

from drake_cafim.corrected.reading import array
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Clock:
    """Periodic updates every `period` s from t = 0, synchronous with the discrete plant.

    A discrete plant with `sampled_outputs`, Drake's default, steps in an unrestricted update, and Drake does those
    before all discrete updates: a state that must see the plant before its step needs an unrestricted update as well.
    """

    period: float
    sampled_outputs: bool = False

    def keep(self, system: LeafSystem, start: Array, update: Callable[[Context], Array]) -> None:
        """Declares discrete state 0 of `system`: initially `start` (m,), then `update(context)` every `period` s."""

        def discrete(context: Context, values: DiscreteValues) -> None:
            values.set_value(0, array(update(context)))

        def unrestricted(context: Context, state: State) -> EventStatus:
            state.get_mutable_discrete_state(0).SetFromVector(array(update(context)))
            return EventStatus.Succeeded()

        system.DeclareDiscreteState(array(start))
        if self.sampled_outputs:
            system.DeclarePeriodicUnrestrictedUpdateEvent(self.period, 0.0, unrestricted)
        else:
            system.DeclarePeriodicDiscreteUpdateEvent(self.period, 0.0, discrete)
