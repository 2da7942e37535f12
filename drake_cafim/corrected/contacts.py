"""A scenario's contact, with effects on it, as a Drake system with spatial forces as output."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.body_forces import applied, motion_at
from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.motion import Motion
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.typing import Array


def changed_contacts(
    contacts: Sequence[SphereContact], nominal: Sequence[SphereContact]
) -> list[tuple[SphereContact, SphereContact]]:
    """Pairs (contact with its effects, the same contact without them) of those contacts that effects change."""
    pairs = []
    for after, before in zip(contacts, nominal, strict=True):
        before = replace(before, parameters=after.parameters)
        moved = not all(map(np.array_equal, after.place, before.place))
        if after.changes or moved or after.law != before.law:
            pairs.append((after, before))
    return pairs


class ContactSystem(LeafSystem):
    """The force of a sphere's contact with a plane, including the changes by effects and their memory.

    .. pydrake_system::

        name: ContactSystem
        input_ports: [state]
        output_ports: [spatial_forces, wrench]

    `state` (2n,) positions then velocities of the joints of `tree`, or (13,) of a floating one;
    connect `spatial_forces`, which acts on `link`, to the plant's applied_spatial_force. `wrench` (6,) is the wrench on
    the link about the world's origin, moment N m first. With `beside`, a contact that the plant already has, the
    outputs are the difference from that contact.
    If the contact has a memory (m,), discrete state 0 (1 + m,) is the time s of its last update, then the memory; the
    time is NaN before the first update.
    """

    def __init__(
        self,
        contact: SphereContact,
        tree: Tree,
        link: Body,
        index: BodyIndex,
        clock: Clock,
        beside: SphereContact | None = None,
    ) -> None:
        LeafSystem.__init__(self)
        self.contact, self._beside, self._tree = contact, beside, tree
        self._link, self._index = link, index
        self.DeclareVectorInputPort("state", tree.state_size)
        allocate: Any = Value[list[ExternallyAppliedSpatialForce]]
        self.DeclareAbstractOutputPort("spatial_forces", allocate, self._calc_applied)
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)
        if contact.memory:
            clock.keep(self, np.full(1 + contact.memory, np.nan), self._update_memory)

    def _moving(self, context: Context) -> Motion:
        return motion_at(self._tree, read(self.get_input_port(), context))

    def _memory(self, context: Context, moving: Motion) -> Array:
        """The contact's memory (1, m) at the context's time."""
        touch = self.contact.touch(moving)
        if not self.contact.memory:
            return np.zeros((1, 0))
        state = discrete_state(context)
        if not np.isfinite(state[0]):
            return self.contact.recall(np.zeros(1), touch, touch)
        return self.contact.ahead(state[None, 1:], touch, np.array([context.get_time() - state[0]]), np.zeros(1))

    def _update_memory(self, context: Context) -> Array:
        memory = self._memory(context, self._moving(context))
        return array(np.concatenate([[context.get_time()], memory[0]]))

    def _wrench(self, context: Context, moving: Motion) -> Array:
        wrench = self.contact.wrench(moving, self._memory(context, moving))[0]
        return wrench if self._beside is None else np.asarray(wrench - self._beside.wrench(moving)[0])

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(array(self._wrench(context, self._moving(context))))

    def _calc_applied(self, context: Any, output: Any) -> None:
        moving = self._moving(context)
        wrench = self._wrench(context, moving)
        p_WBo = moving.point(self._link.joint, self._link.p_JB)[0][0]
        moment = wrench[:3] - np.cross(p_WBo, wrench[3:])
        output.set_value([applied(self._index, np.zeros(3), moment, wrench[3:])])
