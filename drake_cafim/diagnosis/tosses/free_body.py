"""The equations of motion of one free body in contact with a plane, over many states at once.

The state is the pose of the body's origin, its velocity and the angular velocity, all in the world; with the mass m,
the centre of mass c from the origin and the inertia I about the origin (Featherstone, Rigid Body Dynamics
Algorithms, 2008, §2.13):

    m v̇ + ω̇ × m c = F − ω × (ω × m c),      m c × v̇ + I ω̇ = τ − ω × I ω

Simulations call this tens of thousands of times for a few dozen bodies: matrix products, not many small operations.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from drake_cafim.contact.change import Touch, surface_axes
from drake_cafim.diagnosis.tosses.compiled_contact import Law, law_of
from drake_cafim.dynamics import rigid_body as rigid
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.free_body_state import Moment, State
from drake_cafim.dynamics.motion import skew
from drake_cafim.dynamics.rotations import crossing, rotation_matrices
from drake_cafim.dynamics.tree import FREE
from drake_cafim.effects.body import AerodynamicDrag, BodyForce, ExternalDisturbance
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class TouchForces:
    """The forces of a contact on E points of B states, world axes.

    `rows` (E,) are the points' states; `lever` (E, 3) m leads to each from its body's origin; `touch` is how it meets
    the plane; `force` N and `moment` N m, (E, 3) each, act on it.
    """

    rows: np.ndarray[Any, np.dtype[np.int64]]
    lever: Array
    touch: Touch
    force: Array
    moment: Array


@dataclass(frozen=True)
class TouchPoints:
    """The K points of a body that may touch the plane of `contact`; without a contact, K = 0.

    A sphere of radius r with its centre c has the point c − r n, n the plane's normal; a corner has r = 0.
    """

    contact: SphereContact | None

    @cached_property
    def _points(self) -> Array:
        """(3, K) m, the spheres' centres, as columns in the body frame."""
        return np.zeros((3, 0)) if self.contact is None else np.ascontiguousarray(self.contact.points.T)

    @cached_property
    def _below(self) -> Array:
        """(3, 1) m, from a sphere's centre to its deepest point, world axes."""
        return np.zeros((3, 1)) if self.contact is None else -self.contact.radius * self.contact.normal[:, None]

    @cached_property
    def _axes(self) -> Array:
        return surface_axes(self.contact.normal) if self.contact is not None else np.eye(3)

    @cached_property
    def _height(self) -> float:
        """m, of the plane along its normal."""
        return 0.0 if self.contact is None else float(self.contact.point @ self.contact.normal)

    @cached_property
    def _reach(self) -> float:
        """m above the plane up to which a change of the contact, such as adhesion, acts."""
        return max((change.reach for change in self.contact.changes), default=0.0) if self.contact else 0.0

    @cached_property
    def count(self) -> int:
        """The number K of points."""
        return int(self._points.shape[1])

    @cached_property
    def memory(self) -> int:
        """The number m of the contact's internal states at each point."""
        return 0 if self.contact is None else self.contact.memory

    @cached_property
    def pulls(self) -> bool:
        """Whether the contact acts before it touches."""
        return self._reach > 0.0

    @cached_property
    def plane(self) -> tuple[Array, Array, Array, float]:
        """As arguments of compiled code: centres (3, K) m, and (3,) m from each to its deepest point; normal, height m.

        The normal is (3,), the height that along it.
        """
        normal = np.zeros(3) if self.contact is None else np.ascontiguousarray(self.contact.normal)
        return self._points, np.ascontiguousarray(self._below[:, 0]), normal, self._height

    @cached_property
    def law(self) -> Law | None:
        """The contact's law as arguments of compiled code; None where that does not know it."""
        return law_of(self.contact)

    def levers(self, R: Array) -> Array:
        """(B, 3, K) m, from the origins of bodies turned by `R` (B, 3, 3) to their points."""
        return np.asarray(R @ self._points + self._below)

    def depths(self, state: State, R: Array | None = None) -> tuple[Array, Array]:
        """Each point's depth d below the plane, (B, K) m, and its rate ḋ, (B, K) m/s."""
        if self.contact is None:
            return np.zeros((len(state), 0)), np.zeros((len(state), 0))
        R = rotation_matrices(state.quaternion) if R is None else R
        deep, sinking = rigid.depths(
            state.numbers, R, self._points, self._below[:, 0], self.contact.normal, self._height
        )
        return np.asarray(deep), np.asarray(sinking)

    def time_to_land(self, state: State, R: Array, mode: Flags, acceleration: Array) -> Array:
        """(B,) s until the first point that does not touch (`mode` (B, K) is False) would, at this `acceleration`."""
        if self.contact is None:
            return np.full(len(state), np.inf)
        found = rigid.time_to_land(
            state.numbers, R, self._points, *self.depths(state, R), mode, acceleration, self.contact.normal
        )
        return np.asarray(found, dtype=float)

    def touch(self, state: State, lever: Array, points: Flags) -> Touch:
        """How points at `lever` (B, 3) from the origins meet the plane; those of `points` (B,) are taken to touch."""
        contact = self.contact
        assert contact is not None
        levers = np.ascontiguousarray(lever)
        held, rate, slip, position = rigid.contact_kinematics(
            state.numbers, levers, points, contact.normal, self._height
        )
        # the deepest point of a sphere stays below its centre, a corner turns with the body
        return Touch(held, rate, slip, position, state.w, self._below.T, self._axes)

    def forces(self, state: State, R: Array, mode: Flags, memory: Array) -> TouchForces | None:
        """The forces on bodies turned by `R` (B, 3, 3), at points that touch (`mode`) or are near enough to be pulled.

        `memory` (B, K, m) are the contact's states. None where there is no such point.
        """
        contact = self.contact
        if contact is None or not (self.pulls or mode.any()):
            return None
        deep = self.depths(state, R)[0] if self.pulls else np.zeros(mode.shape)
        rows, columns, lever = rigid.near_points(R, self._points, self._below[:, 0], deep, mode, self._reach)
        touch = self.touch(state[rows], lever, mode[rows, columns])
        return TouchForces(rows, lever, touch, *contact.force(touch, memory[rows, columns]))

    def damping(self, inverse_inertia: Array, R: Array, forces: TouchForces) -> Array:
        """∂(v̇, ω̇)/∂(v, ω) (B, 6, 6) by what makes contacts stiff: friction near rest, and the damper.

        `inverse_inertia` (6, 6) is that of `FreeBody.inertial`, body axes.
        """
        contact = self.contact
        assert contact is not None
        n, slip = contact.normal, forces.touch.slip
        pushing = forces.force @ n
        speed = np.sqrt((slip * slip).sum(axis=1))
        along = slip / np.maximum(speed, 1e-12)[:, None]
        across, onward = _friction_slopes(contact, np.maximum(pushing, 0.0), speed)
        into = np.where(pushing > 0.0, contact.parameters.damping, 0.0)
        slopes = rigid.velocity_slopes(R, inverse_inertia, forces.rows, forces.lever, along, across, onward, into, n)
        return np.asarray(slopes, dtype=float)


@dataclass(frozen=True)
class FreeBody:
    """The floating body of `physics`: its inertia, and the forces on it."""

    physics: Physics

    @cached_property
    def inertial(self) -> tuple[float, Array, Array, Array]:
        """Mass, centre of mass (3,), inertia (3, 3) about the origin, and the inverse (6, 6) of all; body axes.

        Where the inertia is singular, as of a mass that a fit has brought to zero, the inverse is NaN: such a body's
        flight is no number, and a fit refuses the step.
        """
        masses, centers, inertias = self.physics.tree.lumps
        m, c = float(masses[FREE]), centers[FREE]
        C = skew(c)
        about_origin: Array = inertias[FREE] - m * C @ C
        spatial = np.zeros((6, 6))
        spatial[:3, :3], spatial[:3, 3:] = m * np.eye(3), -m * C
        spatial[3:, :3], spatial[3:, 3:] = m * C, about_origin
        try:
            inverse = np.asarray(np.linalg.inv(spatial), dtype=float)
        except np.linalg.LinAlgError:
            inverse = np.full((6, 6), np.nan)
        return m, c, about_origin, inverse

    @cached_property
    def contact(self) -> SphereContact | None:
        """The body's contact; a toss has at most one."""
        return self.physics.contacts[0] if self.physics.contacts else None

    @cached_property
    def touch_points(self) -> TouchPoints:
        """The points that may touch, and the forces of the contact on them."""
        return TouchPoints(self.contact)

    @cached_property
    def plain(self) -> bool:
        """Whether compiled code knows every force on the body."""
        kinds = [type(effect) for effect in self.physics.body_forces]
        known = set(kinds) <= {AerodynamicDrag, ExternalDisturbance} and kinds.count(AerodynamicDrag) < 2
        return self.touch_points.law is not None and known

    @cached_property
    def drag(self) -> tuple[float, Array]:
        """The coefficient, N s²/m², of a `plain` body's drag, and the point on it (3,) m at which it acts."""
        for effect in self.physics.body_forces:
            if effect.episode is None:
                return float(effect.values["coefficient"]), self._place(effect)
        return 0.0, np.zeros(3)

    def pushes(self, names: tuple[str, ...]) -> tuple[Array, Array, np.ndarray[Any, np.dtype[np.int64]], Array]:
        """The P pulses of force on a `plain` body.

        Their peaks (P, 3) N, start and stop (P, 2) s, the index (P,) of their recording among `names`, −1 for all, and
        the points on the body (P, 3) m at which they act.
        """
        brief = [
            (effect, effect.episode.recording) for effect in self.physics.body_forces if effect.episode is not None
        ]
        found = [effect for effect, recording in brief if recording is None or recording in names]
        values = np.array([[effect.values[name] for name in ("x", "y", "z", "start", "stop")] for effect in found])
        values = values.reshape(-1, 5)
        whose = [-1 if own is None else names.index(own) for _, own in brief if own is None or own in names]
        places = np.array([self._place(effect) for effect in found]).reshape(-1, 3)
        return values[:, :3].copy(), values[:, 3:].copy(), np.array(whose, dtype=np.int64), places

    def _place(self, effect: BodyForce) -> Array:
        """(3,) m, the point at which a force acts, in the body frame."""
        body = self.physics.tree.body(effect.at)
        return np.asarray(body.p_JB + body.R_JB @ effect.point(body))

    def acceleration(self, state: State, mode: Flags, memory: Array, moment: Moment) -> Array:
        """(B, 6): v̇ then ω̇ in the world, the points of `mode` (B, K) touching; `memory` is (B, K, m)."""
        R = rotation_matrices(state.quaternion)
        return self.acceleration_under(state, R, self.touch_points.forces(state, R, mode, memory), moment)

    def acceleration_under(self, state: State, R: Array, forces: TouchForces | None, moment: Moment) -> Array:
        """`acceleration` of bodies turned by `R` (B, 3, 3) under the contact's `forces`."""
        wrench = np.zeros((len(state), 2, 3))
        if forces is not None:
            rigid.add_forces(wrench, forces.rows, forces.lever, forces.force, forces.moment)
        for effect in self.physics.body_forces:
            self._disturb(wrench, effect, state, R, moment)
        return np.asarray(rigid.acceleration(state.numbers, R, wrench, *self.inertial, self.physics.gravity))

    def _disturb(self, wrench: Array, effect: BodyForce, state: State, R: Array, moment: Moment) -> None:
        lever = R @ self._place(effect)
        recording = effect.episode.recording if effect.episode is not None else None
        v = state.v + (crossing(state.w) @ lever[:, :, None])[:, :, 0]
        force = effect.force(state.p + lever, v, moment.time, recording)
        if recording is not None:
            force = force * np.array([name == recording for name in moment.names])[moment.recording, None]
        wrench[:, 0] += force
        wrench[:, 1] += (crossing(lever) @ force[:, :, None])[:, :, 0]

    def damping(self, R: Array, forces: TouchForces) -> Array:
        """∂(v̇, ω̇)/∂(v, ω) (B, 6, 6) of the contact's friction near rest and of its damper."""
        return self.touch_points.damping(self.inertial[3], R, forces)


def _friction_slopes(contact: SphereContact, pushing: Array, speed: Array) -> tuple[Array, Array]:
    """Derivatives of friction by slip across and along its direction, N s/m."""
    friction = pushing * contact.parameters.friction
    if contact.parameters.slip_velocity is not None:
        ratio = np.maximum(speed / contact.parameters.slip_velocity, 1e-6)
        level = np.tanh(ratio)
        width = contact.parameters.slip_velocity
        return friction * level / (ratio * width), friction * (1.0 - level**2) / width
    resistance = float(contact.parameters.resistance or 0.0)
    rubbing = resistance * speed > friction
    return np.where(rubbing, friction / np.maximum(speed, 1e-12), resistance), np.where(rubbing, 0.0, resistance)
