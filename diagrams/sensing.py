"""Sensors of the worlds as Drake systems: the tool's motion, the contact force, and measurement noise."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.common.value import Value
from pydrake.math import RigidTransform_
from pydrake.multibody.math import SpatialVelocity_
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.numerics.streams import stream
from drake_cafim.typing import Array


def contacts_of(results: ContactResults, plant: MultibodyPlant, body: BodyIndex) -> tuple[int, int]:
    """The numbers of hydroelastic and of point contacts of `body`."""
    geometries = set(plant.GetCollisionGeometriesForBody(plant.get_body(body)))
    surfaces = [
        results.hydroelastic_contact_info(i).contact_surface() for i in range(results.num_hydroelastic_contacts())
    ]
    pairs = [results.point_pair_contact_info(i) for i in range(results.num_point_pair_contacts())]
    return (
        sum(surface.id_M() in geometries or surface.id_N() in geometries for surface in surfaces),
        sum(body in (pair.bodyA_index(), pair.bodyB_index()) for pair in pairs),
    )


def contact_force_on(results: ContactResults, plant: MultibodyPlant, body: BodyIndex) -> Array:
    """The sum (3,) N in W of the contact forces, hydroelastic and point, on `body`."""
    geometries = set(plant.GetCollisionGeometriesForBody(plant.get_body(body)))
    total = np.zeros(3)
    for index in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(index)
        surface = info.contact_surface()
        if surface.id_M() in geometries:
            total += info.F_Ac_W().translational()
        elif surface.id_N() in geometries:
            total -= info.F_Ac_W().translational()
    for index in range(results.num_point_pair_contacts()):
        pair = results.point_pair_contact_info(index)
        if pair.bodyB_index() == body:
            total += pair.contact_force()
        elif pair.bodyA_index() == body:
            total -= pair.contact_force()
    return total


class ContactForce(LeafSystem):
    """Components of the contact force on one body along fixed world directions.

    .. pydrake_system::

        name: ContactForce
        input_ports: [contact_results]
        output_ports: [force, contacts]

    `force` (ny,) N is `directions` (ny, 3), rows in W, times the total contact force on `body`; `contacts` (2,)
    counts its hydroelastic and its point contacts.
    """

    def __init__(self, *, plant: MultibodyPlant, body: BodyIndex, directions: Array) -> None:
        LeafSystem.__init__(self)
        self._plant, self._body, self._directions = plant, body, np.asarray(directions, dtype=float)
        self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareVectorOutputPort("force", len(self._directions), self._calc_force)
        self.DeclareVectorOutputPort("contacts", 2, self._calc_contacts)

    def _calc_contacts(self, context: Context, output: BasicVector) -> None:
        results = cast(ContactResults, self.get_input_port().Eval(context))
        output.SetFromVector(as_array(contacts_of(results, self._plant, self._body)))

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        results = cast(ContactResults, self.get_input_port().Eval(context))
        force = contact_force_on(results, self._plant, self._body)
        output.SetFromVector(as_array(self._directions @ force))


@TemplateSystem.define("ToolState_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def ToolState_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """Position and velocity of a point of one body along fixed world directions.

        .. pydrake_system::

            name: ToolState
            input_ports: [body_poses, body_spatial_velocities]
            output_ports: [tool_state]

        `tool_state` (2 nu,) is the position m (nu,) of the point T of `body` B in the plan's coordinates, measured
        from `origin` (3,) in W along `axes` (nu, 3), then its velocity m/s (nu,).
        """

        def _construct(
            self, *, body: BodyIndex, p_BT: Array, axes: Array, origin: Array | None = None, converter: Any = None
        ) -> None:
            LeafSystem_[T].__init__(self, converter)
            self._body, self._p_BT = int(body), np.asarray(p_BT, dtype=float)
            self._axes = np.asarray(axes, dtype=float)
            self._origin = np.zeros(3) if origin is None else np.asarray(origin, dtype=float)
            self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform_[T]]]())
            self.DeclareAbstractInputPort("body_spatial_velocities", Value[list[SpatialVelocity_[T]]]())
            self.DeclareVectorOutputPort("tool_state", 2 * len(self._axes), self._calc_state)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(
                self,
                body=BodyIndex(other._body),
                p_BT=other._p_BT,
                axes=other._axes,
                origin=other._origin,
                converter=converter,
            )

        def _calc_state(self, context: Any, output: Any) -> None:
            X_WB: Any = self.get_input_port(0).Eval(context)[self._body]
            V_WB: Any = self.get_input_port(1).Eval(context)[self._body]
            p_BT_W = X_WB.rotation().multiply(self._p_BT)
            position = X_WB.translation() + p_BT_W - self._origin
            velocity = V_WB.Shift(p_BT_W).translational()
            output.SetFromVector(np.concatenate([self._axes @ position, self._axes @ velocity]))

    return Impl


ToolState = ToolState_[float]


class SensorNoise(LeafSystem):
    """A signal with independent Gaussian noise added, one draw a sampling period.

    .. pydrake_system::

        name: SensorNoise
        input_ports: [true]
        output_ports: [measured]

    The draw is a function of the seed, numeric parameter 0 (the number of the experiment) and the sample's index, so
    that a copied or replayed Context, or one that is evaluated twice, gives the same noise.
    """

    def __init__(self, *, std: Sequence[float], period: float, seed: int) -> None:
        LeafSystem.__init__(self)
        self._std, self._period, self._seed = np.asarray(std, dtype=float), period, seed
        self.DeclareVectorInputPort("true", len(self._std))
        self.DeclareNumericParameter(BasicVector(as_array([0.0])))
        self.DeclareVectorOutputPort("measured", len(self._std), self._calc_measured)

    def _calc_measured(self, context: Context, output: BasicVector) -> None:
        experiment = round(float(context.get_numeric_parameter(0).CopyToVector()[0]))
        sample = round(context.get_time() / self._period)
        generator = stream("force noise", self._seed, experiment, sample)
        true = np.asarray(self.get_input_port().Eval(context))
        output.SetFromVector(as_array(true + self._std * generator.standard_normal(len(self._std))))
