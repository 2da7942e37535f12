"""A contact law: normal and tangential force, with derivatives with respect to every argument."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_cafim.contact.normal import (
    NORMAL_LAWS,
    NormalForce,
    NormalLaw,
    Scalars,
    normal_force,
    normal_force_derivatives,
)
from drake_cafim.contact.pressure import field_numbers
from drake_cafim.contact.tangential import (
    TangentialForce,
    resistance_force,
    resistance_force_derivatives,
    slip_force,
    slip_force_derivatives,
)
from drake_cafim.errors import InputError
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ContactParameters:
    """The parameters of a contact; each a float, or an array that broadcasts over samples.

    At most one of `slip_velocity` and `resistance` is given; with neither, or friction 0, there is no friction.
    """

    stiffness: Scalars = 0.0  # N/m, of all but hydroelastic
    damping: Scalars = 0.0  # N s/m, of paper and kelvin_voigt
    dissipation: Scalars = 0.0  # s/m, of hunt_crossley and hydroelastic
    modulus: Scalars = 0.0  # Pa, of hydroelastic, as all that follows up to friction
    radius: Scalars = 0.0  # m, of the sphere or tip
    half_extent: Scalars = 0.0  # m, half the smallest extent of a compliant box under a rigid tip; 0: the tip is soft
    resolution: float = 0.0  # m, Drake's resolution hint for the sphere's mesh; 0: the exact sphere
    friction: Scalars = 0.0  # 1
    slip_velocity: Scalars | None = None  # m/s
    resistance: Scalars | None = None  # N s/m

    def __post_init__(self) -> None:
        if self.slip_velocity is not None and self.resistance is not None:
            raise InputError("contact: slip_velocity and resistance are both given, expected one of them")

    def of_normal(self, law: NormalLaw) -> dict[str, Any]:
        """The arguments of `normal_force` for `law`."""
        if law != "hydroelastic":
            return {"stiffness": self.stiffness, "damping": self.damping, "dissipation": self.dissipation}
        P, narrowing, deficit = field_numbers(self.modulus, self.radius, self.half_extent, self.resolution)
        return {"stiffness": P, "dissipation": self.dissipation, "narrowing": narrowing, "deficit": deficit}


@dataclass(frozen=True)
class ContactDerivatives:
    """Forces and their derivatives, by name of the argument.

    `normal[name]` is (...,) but for "tangential_velocity", which the normal force does not depend on;
    `tangential[name]` is (..., m), and (..., m, m) for "tangential_velocity". Names: penetration, rate,
    tangential_velocity, stiffness, damping, dissipation, modulus, friction, slip_velocity or resistance.
    """

    normal_force: Array
    tangential_force: Array
    normal: Mapping[str, Array]
    tangential: Mapping[str, Array]


@dataclass(frozen=True)
class ContactLaw:
    """A law by name (one of `NORMAL_LAWS`); its parameters are arguments of the methods.

    Samples are the leading axes: penetration (...,) m, rate (...,) m/s, tangential velocity (..., m) m/s with m = 1,
    2 or 3. Forces act on the body that moves with that velocity; the normal force points away from the other body.
    Raises `InputError` for an unknown name.
    """

    normal: NormalLaw = "kelvin_voigt"
    smoothing: float = 0.0  # N, rounds the kink at zero normal force

    def __post_init__(self) -> None:
        if self.normal not in NORMAL_LAWS:
            raise InputError(f"contact law {self.normal!r}: expected one of {', '.join(NORMAL_LAWS)}")

    def normal_force(
        self, penetration: Array, rate: Array, parameters: ContactParameters, added: Scalars = 0.0
    ) -> Array:
        """λ_n (...,) in N; `added` N is added to it before it is clipped at zero."""
        return normal_force(
            self.normal,
            penetration,
            rate,
            **parameters.of_normal(self.normal),
            smoothing=self.smoothing,
            added=added,
        )

    def tangential_force(self, normal: Array, tangential_velocity: Array, parameters: ContactParameters) -> Array:
        """λ_t (..., m) in N for the normal force λ_n (...,)."""
        if parameters.slip_velocity is not None:
            return slip_force(
                normal,
                tangential_velocity,
                friction=parameters.friction,
                slip_velocity=parameters.slip_velocity,
            )
        if parameters.resistance is not None:
            return resistance_force(
                normal, tangential_velocity, friction=parameters.friction, resistance=parameters.resistance
            )
        return np.asarray(0.0 * tangential_velocity)

    def derivatives(
        self, penetration: Array, rate: Array, tangential_velocity: Array, parameters: ContactParameters
    ) -> ContactDerivatives:
        """Both forces with their analytic derivatives in the samples and in the parameters."""
        numbers = parameters.of_normal(self.normal)
        normal = normal_force_derivatives(self.normal, penetration, rate, **numbers, smoothing=self.smoothing)
        by_name = _normal_by_name(normal)
        if self.normal == "hydroelastic":
            by_pressure, nothing = by_name["stiffness"], np.zeros_like(normal.force)
            by_name |= {"modulus": by_pressure * _per_modulus(parameters), "stiffness": nothing}
        tangential, width = self._tangential(normal.force, tangential_velocity, parameters)
        through_normal = {name: tangential.wrt_normal * slope[..., np.newaxis] for name, slope in by_name.items()}
        direct = {"tangential_velocity": tangential.wrt_velocity, "friction": tangential.wrt_friction}
        if width is not None:
            direct[width] = tangential.wrt_width
        return ContactDerivatives(
            normal_force=normal.force,
            tangential_force=tangential.force,
            normal=by_name,
            tangential=through_normal | direct,
        )

    def _tangential(
        self, normal: Array, velocity: Array, parameters: ContactParameters
    ) -> tuple[TangentialForce, str | None]:
        if parameters.slip_velocity is not None:
            slip = slip_force_derivatives(
                normal, velocity, friction=parameters.friction, slip_velocity=parameters.slip_velocity
            )
            return slip, "slip_velocity"
        if parameters.resistance is not None:
            resistance = resistance_force_derivatives(
                normal, velocity, friction=parameters.friction, resistance=parameters.resistance
            )
            return resistance, "resistance"
        zero = np.zeros_like(velocity)
        square = np.zeros((*velocity.shape, velocity.shape[-1]))
        return TangentialForce(zero, zero, square, zero, zero), None


def _per_modulus(parameters: ContactParameters) -> Scalars:
    """∂P/∂E of the law `hydroelastic`, P its coefficient of d²."""
    return field_numbers(1.0, parameters.radius, parameters.half_extent, parameters.resolution)[0]


def _normal_by_name(normal: NormalForce) -> dict[str, Array]:
    return {
        "penetration": normal.wrt_penetration,
        "rate": normal.wrt_rate,
        "stiffness": normal.wrt_stiffness,
        "damping": normal.wrt_damping,
        "dissipation": normal.wrt_dissipation,
        "modulus": np.zeros_like(normal.force),
    }
