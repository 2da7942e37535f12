"""The wrench of Drake's own contacts (hydroelastic and point) on a link, as a wrench sensor there measures it."""

from collections.abc import Sequence
from typing import cast

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.reading import array
from drake_cafim.typing import Array


class DrakeContactWrench(LeafSystem):
    """The sum of the wrenches of all Drake contacts on some bodies of a plant.

    .. pydrake_system::

        name: DrakeContactWrench
        input_ports: [contact_results]
        output_ports: [wrench]

    `wrench` (6,) N m and N acts on `bodies`, which form one link, about the world's origin, moment first.
    """

    def __init__(self, plant: MultibodyPlant, bodies: Sequence[str]) -> None:
        LeafSystem.__init__(self)
        link = [plant.GetBodyByName(name) for name in bodies]
        self._bodies = {int(body.index()) for body in link}
        self._shapes = {shape for body in link for shape in plant.GetCollisionGeometriesForBody(body)}
        self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        results = cast(ContactResults, self.get_input_port().Eval(context))
        total = np.zeros(6)
        for k in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(k)
            surface, F_Ac_W = info.contact_surface(), info.F_Ac_W()
            # Drake gives F on the body of geometry M, at the surface's centroid; the opposite acts on N's body
            sign = float(surface.id_M() in self._shapes) - float(surface.id_N() in self._shapes)
            total += sign * about_origin(surface.centroid(), F_Ac_W.rotational(), F_Ac_W.translational())
        for k in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(k)
            sign = float(int(pair.bodyB_index()) in self._bodies) - float(int(pair.bodyA_index()) in self._bodies)
            total += sign * about_origin(pair.contact_point(), np.zeros(3), pair.contact_force())
        output.SetFromVector(array(total))


def about_origin(p_WC: Array, moment: Array, force: Array) -> Array:
    """The wrench (6,) about the world's origin, moment first, of a moment and a force (3,) at `p_WC`."""
    return np.concatenate([moment + np.cross(p_WC, force), force])
