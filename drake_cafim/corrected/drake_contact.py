"""What Drake's own contact, hydroelastic and point, exerts on a link, as a wrench sensor there feels it."""

from collections.abc import Sequence
from typing import cast

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.reading import array
from drake_cafim.typing import Array


class DrakeContactWrench(LeafSystem):
    """The wrench of all contacts on some bodies of a plant.

    .. pydrake_system::

        name: DrakeContactWrench
        input_ports: [contact_results]
        output_ports: [wrench]

    `wrench` (6,) N m and N is that on `bodies`, which are one link, about the world's origin, moment first.
    """

    def __init__(self, plant: MultibodyPlant, bodies: Sequence[str]) -> None:
        LeafSystem.__init__(self)
        own = [plant.GetBodyByName(name) for name in bodies]
        self._bodies = {int(body.index()) for body in own}
        self._shapes = {shape for body in own for shape in plant.GetCollisionGeometriesForBody(body)}
        self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        results = cast(ContactResults, self.get_input_port().Eval(context))
        total = np.zeros(6)
        for k in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(k)
            surface, F_Ac_W = info.contact_surface(), info.F_Ac_W()
            # F is on the body of geometry M, at the surface's centroid
            sign = float(surface.id_M() in self._shapes) - float(surface.id_N() in self._shapes)
            total += sign * about_origin(surface.centroid(), F_Ac_W.rotational(), F_Ac_W.translational())
        for k in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(k)
            sign = float(int(pair.bodyB_index()) in self._bodies) - float(int(pair.bodyA_index()) in self._bodies)
            total += sign * about_origin(pair.contact_point(), np.zeros(3), pair.contact_force())
        output.SetFromVector(array(total))


def about_origin(p_WC: Array, moment: Array, force: Array) -> Array:
    """(6,) about the world's origin, moment first, of a moment and a force (3,) at C."""
    return np.concatenate([moment + np.cross(p_WC, force), force])
