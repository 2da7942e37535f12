"""Contact friction beyond one constant coefficient: Stribeck, anisotropic, presliding, rolling resistance."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from drake_cafim.contact.change import Touch, recursion
from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact import FRICTION, ContactEffect, ContactLook, pressing
from drake_cafim.effects.effect import Direction, Strength
from drake_cafim.typing import Array

ROLLING_WIDTH = 0.05
"""rad/s, width w of the smoothed sign function tanh(ω/w) of rolling resistance."""


@dataclass(frozen=True)
class ContactStribeckFriction(ContactEffect):
    """μ + (μs − μ) exp(−(vt/vs)²) in place of μ."""

    name: ClassVar[str] = "contact_stribeck_friction"
    needs_plane: ClassVar[bool] = True
    group: ClassVar[str | None] = FRICTION
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("static", "1", 0.3, lower=0.0, upper=20.0),
        Strength("velocity", "m/s", 0.05, lower=1e-4, upper=5.0, amplitude=False),
    )
    difference_step: ClassVar[float] = 1e-3
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2.2"
    formula: ClassVar[str] = "μ + (μ<sub>s</sub> − μ) exp(−(<i>v</i><sub>t</sub>/<i>v</i><sub>s</sub>)²)"
    words: ClassVar[str] = "makes the contact stick more at slow sliding than at fast"
    alike: ClassVar[Mapping[str, str]] = {
        "contact_presliding": "both change friction about reversals: one at low speed, one over a short way",
        "contact_anisotropic_friction": "where one direction is always slow, it is rougher by either name",
        "joint_stribeck_friction": "friction of the axis rises near rest as well; it does not ask for the load",
    }

    def traction(
        self, law: ContactLaw, normal: Array, touch: Touch, parameters: ContactParameters, memory: Array
    ) -> Array:
        speed = np.linalg.norm(touch.slip, axis=1)
        rise = self.values["static"] - parameters.friction
        friction = parameters.friction + rise * np.exp(-((speed / self.values["velocity"]) ** 2))
        return law.tangential_force(normal, touch.slip, replace(parameters, friction=friction))

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        present, speed = float(contact.parameters.friction), _typical_speed(touch)
        for share in (0.06, 0.12, 0.25, 0.5, 1.0):
            shape = {"velocity": share * speed}
            step = Direction({"static": present + 0.01, **shape}, None, 0.01)

            def build(c: Array, shape: Mapping[str, float] = shape) -> ContactStribeckFriction:
                return self.with_values({"static": present + float(c[0]), **shape})

            yield ContactLook((step,), build)


@dataclass(frozen=True)
class ContactAnisotropicFriction(ContactEffect):
    """Two principal coefficients of friction: −λ tanh(|v|/w) (μ₁ e₁ e₁ᵀ + μ₂ e₂ e₂ᵀ) v/|v|.

    e₁ lies at `angle` from the surface's x, in its plane.
    """

    name: ClassVar[str] = "contact_anisotropic_friction"
    needs_plane: ClassVar[bool] = True
    group: ClassVar[str | None] = FRICTION
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("friction_1", "1", 0.3, lower=0.0, upper=20.0),
        Strength("friction_2", "1", 0.3, lower=0.0, upper=20.0),
        Strength("angle", "rad", 0.5, lower=-2.0 * np.pi, upper=2.0 * np.pi, amplitude=False),
    )
    difference_step: ClassVar[float] = 1e-3
    reference: ClassVar[str] = "Goyal, Ruina, Papadopoulos, Wear 143(2), 1991"
    formula: ClassVar[str] = "μ<sub>1</sub>, μ<sub>2</sub> along two axes"
    words: ClassVar[str] = "makes one sliding direction rougher"
    alike: ClassVar[Mapping[str, str]] = {
        "sensor_gain_error": "a rougher direction and a channel that reads too large look alike without the axes",
        "sensor_misalignment": "both put force across the direction of sliding",
        "contact_stribeck_friction": "where one direction is always slow, it is rougher by either name",
    }

    def traction(
        self, law: ContactLaw, normal: Array, touch: Touch, parameters: ContactParameters, memory: Array
    ) -> Array:
        along = touch.slip @ self.tensor(touch.axes)
        speed = np.linalg.norm(touch.slip, axis=1)
        size = np.linalg.norm(along, axis=1)
        friction = np.where(speed > 0.0, size / np.where(speed > 0.0, speed, 1.0), 0.0)
        # apply the isotropic law along the force's direction, at the sliding speed
        turned = along * (speed / np.where(size > 0.0, size, 1.0))[:, None]
        return law.tangential_force(normal, turned, replace(parameters, friction=friction))

    def vanishing(self) -> tuple[Array, Array]:
        """(μ₁ − μ₂) (cos 2φ, sin 2φ), φ the angle of e₁, and its Jacobian.

        Friction that is the same along all axes is not absent, but it is another coefficient, which the contact has.
        """
        mu_1, mu_2, angle = self.vector
        along, rising = np.array([np.cos(2.0 * angle), np.sin(2.0 * angle)]), mu_1 - mu_2
        slopes = np.column_stack([along, -along, 2.0 * rising * np.array([-along[1], along[0]])])
        return rising * along, slopes

    def tensor(self, axes: Array) -> Array:
        """μ₁ e₁ e₁ᵀ + μ₂ e₂ e₂ᵀ (3, 3), world axes."""
        mu_1, mu_2, angle = self.vector
        first = np.cos(angle) * axes[:, 0] + np.sin(angle) * axes[:, 1]
        second = np.cos(angle) * axes[:, 1] - np.sin(angle) * axes[:, 0]
        return np.asarray(mu_1 * np.outer(first, first) + mu_2 * np.outer(second, second))

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        mu = float(contact.parameters.friction)
        parts = [
            np.array([[1.0, 0.0], [0.0, 0.0]]),
            np.array([[0.0, 0.0], [0.0, 1.0]]),
            np.array([[0.0, 1.0], [1.0, 0.0]]),
        ]
        steps = tuple(Direction(_principal(mu * np.eye(2) + 0.01 * part), None, 0.01) for part in parts)

        def build(c: Array) -> ContactAnisotropicFriction:
            found = sum((float(x) * part for x, part in zip(c, parts, strict=True)), mu * np.eye(2))
            return self.with_values(_principal(found))

        yield ContactLook(steps, build)


def _principal(tensor: Array) -> dict[str, float]:
    """The strengths that give a symmetric (2, 2) friction tensor; the larger coefficient first, its angle in [0, π)."""
    values, axes = np.linalg.eigh(tensor)
    angle = float(np.arctan2(axes[1, 1], axes[0, 1])) % np.pi
    return {"friction_1": float(values[1]), "friction_2": float(max(values[0], 0.0)), "angle": angle}


@dataclass(frozen=True)
class ContactPresliding(ContactEffect):
    """Dahl's bristle z: ż = v − |v| z/distance in contact, and the friction is −μ λ z/distance.

    Its memory (9,) is z, the point's position p and the slip velocity from the body's spin at the last update. Over a
    short straight displacement Δ, z → (z − δ) exp(−|Δ|/distance) + δ with δ = distance Δ/|Δ| exactly. Spin does not
    show in p; the displacement that it slides is the mean spin velocity times the interval.
    """

    name: ClassVar[str] = "contact_presliding"
    needs_plane: ClassVar[bool] = True
    group: ClassVar[str | None] = FRICTION
    memory: ClassVar[int] = 9
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("distance", "m", 2e-4, lower=1e-7, upper=0.05),)
    difference_step: ClassVar[float] = 1e-3
    reference: ClassVar[str] = "Dahl, Aerospace Corporation TOR-0158(3107-18)-1, 1968"
    formula: ClassVar[str] = "−μ λ <i>z</i>/<i>d</i>, <i>ż</i> = <i>v</i> − |<i>v</i>| <i>z</i>/<i>d</i>"
    words: ClassVar[str] = "gives elastically before it slides, as bristles do"
    alike: ClassVar[Mapping[str, str]] = {
        "contact_stribeck_friction": "both change friction about reversals: one at low speed, one over a short way",
        "contact_anisotropic_friction": "where one direction reverses more often, it slides less freely",
    }

    def recall(self, time: Array, touch: Touch, at: Touch) -> Array:
        n = touch.axes[:, 2]
        moved = np.diff(touch.position, axis=0, prepend=touch.position[:1])
        moved = moved - (moved @ n)[:, None] * n
        # the spin slides the point over the surface without moving its position
        spinning = 0.5 * (touch.spinning + np.concatenate([touch.spinning[:1], touch.spinning[:-1]]))
        turned = spinning * np.diff(time, prepend=time[0])[:, None]
        kept, added = self._slide(moved + turned)
        inside = pressing(touch)
        z = recursion(np.where(inside, kept, 0.0), np.where(inside[:, None], added, 0.0))
        before = np.concatenate([np.zeros((1, 3)), z[:-1]])
        return np.concatenate([before, at.position - moved - turned, at.spinning], axis=1)

    def ahead(self, memory: Array, touch: Touch, elapsed: Array, left: Array) -> Array:
        n = touch.axes[:, 2]
        moved = touch.position - memory[:, 3:6]
        coming = (touch.slip - touch.spinning) * left[:, None]
        turned = 0.5 * (memory[:, 6:] + touch.spinning) * elapsed[:, None]
        moved = moved - (moved @ n)[:, None] * n + coming + turned
        kept, added = self._slide(moved)
        z = np.where(pressing(touch)[:, None], kept[:, None] * memory[:, :3] + added, 0.0)
        return np.concatenate([z, touch.position + coming, touch.spinning], axis=1)

    def traction(
        self, law: ContactLaw, normal: Array, touch: Touch, parameters: ContactParameters, memory: Array
    ) -> Array:
        n = touch.axes[:, 2]
        moved = touch.position - memory[:, 3:6]
        kept, added = self._slide(moved - (moved @ n)[:, None] * n)
        z = kept[:, None] * memory[:, :3] + added
        return np.asarray(-parameters.friction / self.values["distance"] * normal[:, None] * z)

    def _slide(self, moved: Array) -> tuple[Array, Array]:
        """The factor (N,) and the increment (N, 3) of z over straight displacements (N, 3) m."""
        distance = self.values["distance"]
        way = np.linalg.norm(moved, axis=1)
        lost = -np.expm1(-way / distance)
        share = np.where(way > 1e-12 * distance, lost / np.where(way > 0.0, way, 1.0), 1.0 / distance)
        return 1.0 - lost, distance * share[:, None] * moved

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        for distance in (2e-5, 5e-5, 1.2e-4, 3e-4, 7e-4, 1.7e-3, 4e-3):
            step = Direction({"distance": distance}, None, 1.0)

            # the step is the whole effect: its coefficient is 1 if it is right, and far from 1 if it is something else
            def build(c: Array, distance: float = distance) -> ContactPresliding | None:
                return self.with_values({"distance": distance}) if 0.3 < c[0] < 3.0 else None

            yield ContactLook((step,), build)


@dataclass(frozen=True)
class ContactRollingResistance(ContactEffect):
    """A moment −c λ along the tangential angular velocity."""

    name: ClassVar[str] = "contact_rolling_resistance"
    needs_plane: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("coefficient", "m", 1e-3, lower=0.0),)
    reference: ClassVar[str] = "Johnson, Contact Mechanics, 1985, ch. 9"
    formula: ClassVar[str] = "−<i>c</i> λ against the rolling"
    words: ClassVar[str] = "resists rolling in proportion to the normal force"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "at a revolute joint both turn their sign with the motion; one asks for the load"
    }

    def moment(self, normal: Array, touch: Touch) -> Array:
        size = np.linalg.norm(touch.spin, axis=1)
        share = np.tanh(size / ROLLING_WIDTH) / np.maximum(size, 1e-9)
        return np.asarray(-self.values["coefficient"] * (normal * share)[:, None] * touch.spin)

    def looks(self, contact: SphereContact, touch: Touch) -> Iterator[ContactLook]:
        if np.any(np.abs(touch.spin[pressing(touch)]) > 0.0):
            yield self.single("coefficient", 1e-4, {})


def _typical_speed(touch: Touch) -> float:
    """The root mean square of the sliding speed in contact, m/s, at least 1 mm/s."""
    square = np.sum(touch.slip**2, axis=1)[pressing(touch)]
    return max(float(np.sqrt(np.mean(square))), 1e-3) if len(square) else 1e-3
