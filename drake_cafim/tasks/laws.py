"""Priors and true values of one contact law's parameters from those of another, equal at rest under a working force."""

from dataclasses import dataclass

from drake_cafim.contact.pressure import modulus_for
from drake_cafim.parameters import Parameter, Parameters


@dataclass(frozen=True)
class QuasiStatic:
    """A contact at rest under `force` N: every law is given its stiffness there, and damps there as the others do.

    `radius` m is that of the sphere, `half_extent` m that of a compliant box under it (0: the sphere is compliant).
    """

    force: float
    radius: float
    half_extent: float = 0.0

    def values(self, law: str, stiffness: float, damping: float) -> dict[str, float]:
        """The law's own parameters for a `stiffness` K N/m and a `damping` C N s/m under the force F.

        Force at depth F / K is F; and C ḋ = F c ḋ for the laws that have a dissipation c.
        """
        if law in ("kelvin_voigt", "paper"):
            return {"stiffness": stiffness, "damping": damping}
        dissipation = damping / self.force
        if law == "hunt_crossley":
            return {"stiffness": stiffness, "dissipation": dissipation}
        modulus = modulus_for(self.force, stiffness, self.radius, self.half_extent)
        return {"modulus": modulus, "dissipation": dissipation}

    def priors(self, law: str, stiffness: Parameter, damping: Parameter) -> tuple[Parameter, Parameter]:
        """Priors of the law's parameters, from those of stiffness and damping.

        Means by `values`; the modulus grows with the square of the stiffness, so that its relative std is twice that of
        the stiffness.
        """
        first, second = self.values(law, stiffness.mean, damping.mean)
        per_damping = 1.0 if second == "damping" else 1.0 / self.force
        loss = Parameter(
            second,
            per_damping * damping.mean,
            std=per_damping * damping.std,
            lower=per_damping * damping.lower,
            upper=per_damping * damping.upper,
            unit="N s/m" if second == "damping" else "s/m",
            nuisance=damping.nuisance,
        )
        if first == "stiffness":
            return stiffness, loss
        mean = modulus_for(self.force, stiffness.mean, self.radius, self.half_extent)
        std = 2.0 * mean * stiffness.std / stiffness.mean
        modulus = Parameter(
            "modulus", mean, std=std, lower=0.01 * mean, upper=30.0 * mean, unit="Pa", nuisance=stiffness.nuisance
        )
        return modulus, loss


def stiffness_and_damping(parameters: Parameters, rest: QuasiStatic) -> tuple[Parameter, Parameter]:
    """The priors of stiffness and damping among `parameters`; of a dissipation c the damping is F c."""
    by_name = {parameter.name: parameter for parameter in parameters}
    stiffness, loss = by_name["stiffness"], by_name.get("damping")
    if loss is None:
        given = by_name["dissipation"]
        numbers = {name: rest.force * getattr(given, name) for name in ("mean", "std", "lower", "upper")}
        loss = Parameter("damping", **numbers, unit="N s/m", nuisance=given.nuisance)
    return stiffness, loss
