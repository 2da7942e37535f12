"""When hidden states are brought up to date."""

from collections.abc import Callable
from dataclasses import dataclass

from pydrake.systems.framework import Context, DiscreteValues, EventStatus, LeafSystem, State

from drake_cafim.corrected.reading import array
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Clock:
    """Updates every `period` s from 0 on, in step with the plant that the hidden state stands beside.

    A discrete plant with `sampled_outputs`, Drake's default, steps in an unrestricted update, which comes before all
    discrete ones: a hidden state that is to see the plant as it was before the step has to be updated alike.
    """

    period: float
    sampled_outputs: bool = False

    def keep(self, system: LeafSystem, start: Array, update: Callable[[Context], Array]) -> None:
        """Declares discrete state 0 of `system`, which is `start` (m,) and then what `update` says."""

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
