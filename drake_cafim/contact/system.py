"""Contact laws as Drake systems, for float and AutoDiffXd: a law without geometry, and a force on a plant's bodies."""

from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RigidTransform_
from pydrake.multibody.math import SpatialForce_, SpatialVelocity_
from pydrake.multibody.plant import ExternallyAppliedSpatialForce_
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.contact.normal import NormalLaw

PARAMETER_NAMES = ("stiffness", "damping", "dissipation", "friction", "width", "modulus")
"""Elements of numeric parameter 0 of both systems; `width` is the slip velocity or the resistance."""


def _parameters(values: Any, width: str | None, given: ContactParameters) -> ContactParameters:
    """`given` with the numbers of numeric parameter 0."""
    stiffness, damping, dissipation, friction, breadth, modulus = values
    known: dict[str, Any] = {} if width is None else {width: breadth}
    return replace(
        given,
        stiffness=stiffness,
        damping=damping,
        dissipation=dissipation,
        friction=friction,
        modulus=modulus,
        **known,
    )


def _defaults(parameters: ContactParameters) -> tuple[Any, str | None]:
    width = None
    breadth: Any = 1.0
    if parameters.slip_velocity is not None:
        width, breadth = "slip_velocity", parameters.slip_velocity
    elif parameters.resistance is not None:
        width, breadth = "resistance", parameters.resistance
    given = parameters
    values = [given.stiffness, given.damping, given.dissipation, given.friction, breadth, given.modulus]
    return np.array(values, dtype=float), width


@TemplateSystem.define("ContactLawSystem_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def ContactLawSystem_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """A contact law without geometry.

        .. pydrake_system::

            name: ContactLawSystem
            input_ports: [contact_kinematics]
            output_ports: [contact_force]

        `contact_kinematics` is (2 + m,): penetration m, rate m/s, tangential velocity m/s; `contact_force`
        is (1 + m,): normal and tangential force, N. Numeric parameter 0 holds `PARAMETER_NAMES`.
        """

        def _construct(
            self,
            normal: NormalLaw,
            parameters: ContactParameters,
            tangential_size: int = 2,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter)
            self.law = ContactLaw(normal)
            self.given = parameters
            self.defaults, self.width = _defaults(parameters)
            self.tangential_size = tangential_size
            self.DeclareNumericParameter(BasicVector_[T](self.defaults))
            self.DeclareVectorInputPort("contact_kinematics", 2 + tangential_size)
            self.DeclareVectorOutputPort("contact_force", 1 + tangential_size, self._calc_force)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.law.normal, other.given, other.tangential_size, converter=converter)

        def _calc_force(self, context: Any, output: Any) -> None:
            kinematics = np.asarray(self.get_input_port(0).Eval(context))
            parameters = _parameters(context.get_numeric_parameter(0).CopyToVector(), self.width, self.given)
            normal = self.law.normal_force(kinematics[0], kinematics[1], parameters)
            tangential = self.law.tangential_force(normal, kinematics[2:], parameters)
            output.SetFromVector(np.concatenate([normal.reshape(1), tangential]))

    return Impl


@TemplateSystem.define("SphereContact_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def SphereContact_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """The force between a sphere on body B and a half-space on body A of a MultibodyPlant.

        .. pydrake_system::

            name: SphereContact
            input_ports: [body_poses, body_spatial_velocities]
            output_ports: [spatial_forces, contact_force]

        Connect the plant's ports of these names, and `spatial_forces` to its applied_spatial_force.
        `contact_force` is (3,) N, world axes, exerted on B. The half-space is z ≤ 0 of the frame P at pose
        `X_AP` in A; the sphere of `radius` m has its centre at `p_BoBs_B`. Numeric parameter 0 holds
        `PARAMETER_NAMES`, so AutoDiffXd gives derivatives with respect to them.
        """

        def _construct(
            self,
            normal: NormalLaw,
            parameters: ContactParameters,
            *,
            sphere_body: int,
            plane_body: int,
            radius: float,
            p_BoBs_B: Any = (0.0, 0.0, 0.0),
            X_AP: RigidTransform | None = None,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter)
            self.law = ContactLaw(normal)
            self.given = parameters
            self.defaults, self.width = _defaults(parameters)
            self.places: dict[str, Any] = {
                "sphere_body": sphere_body,
                "plane_body": plane_body,
                "radius": radius,
                "p_BoBs_B": np.asarray(p_BoBs_B, dtype=float),
                "X_AP": RigidTransform() if X_AP is None else X_AP,
            }
            self.DeclareNumericParameter(BasicVector_[T](self.defaults))
            self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform_[T]]]())
            self.DeclareAbstractInputPort("body_spatial_velocities", Value[list[SpatialVelocity_[T]]]())
            self.DeclareAbstractOutputPort(
                "spatial_forces", lambda: Value[list[ExternallyAppliedSpatialForce_[T]]](), self._calc_applied
            )
            self.DeclareVectorOutputPort("contact_force", 3, self._calc_force)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.law.normal, other.given, **other.places, converter=converter)

        def _evaluate(self, context: Any) -> tuple[Any, Any]:
            """Force on B (3,) in W and the contact point (3,) in W."""
            poses = self.get_input_port(0).Eval(context)
            velocities = self.get_input_port(1).Eval(context)
            place = self.places
            X_WB, X_WA = poses[place["sphere_body"]], poses[place["plane_body"]]
            V_WB, V_WA = velocities[place["sphere_body"]], velocities[place["plane_body"]]
            X_AP = place["X_AP"]
            normal_W = X_WA.rotation().matrix() @ X_AP.rotation().matrix()[:, 2]
            p_WP = X_WA.multiply(X_AP.translation().reshape(3, 1)).ravel()
            p_WS = X_WB.multiply(place["p_BoBs_B"].reshape(3, 1)).ravel()
            height = (p_WS - p_WP) @ normal_W
            # the force acts at the sphere's deepest point, as Drake's point contact with a rigid half-space
            p_WC = p_WS - place["radius"] * normal_W
            v_WBc = V_WB.translational() + np.cross(V_WB.rotational(), p_WC - X_WB.translation())
            v_WAc = V_WA.translational() + np.cross(V_WA.rotational(), p_WC - X_WA.translation())
            v_AB = v_WBc - v_WAc
            approach = -(v_AB @ normal_W)
            slide = v_AB + approach * normal_W
            parameters = _parameters(context.get_numeric_parameter(0).CopyToVector(), self.width, self.given)
            penetration = np.asarray(place["radius"] - height)
            force = self.law.normal_force(penetration, np.asarray(approach), parameters)
            friction = self.law.tangential_force(force, slide, parameters)
            return force * normal_W + friction, p_WC

        def _calc_force(self, context: Any, output: Any) -> None:
            output.SetFromVector(self._evaluate(context)[0])

        def _calc_applied(self, context: Any, output: Any) -> None:
            f_W, p_WC = self._evaluate(context)
            poses = self.get_input_port(0).Eval(context)
            applied = []
            for body, sign in ((self.places["sphere_body"], 1.0), (self.places["plane_body"], -1.0)):
                force = ExternallyAppliedSpatialForce_[T]()
                force.body_index = body
                X_WB = poses[body]
                force.p_BoBq_B = X_WB.inverse().multiply(p_WC.reshape(3, 1)).ravel()
                force.F_Bq_W = SpatialForce_[T](tau=np.zeros(3), f=sign * f_W)
                applied.append(force)
            output.set_value(applied)

    return Impl


ContactLawSystem = ContactLawSystem_[None]
SphereContact = SphereContact_[None]
