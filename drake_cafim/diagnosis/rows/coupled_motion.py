"""The motion of joints whose velocities relax together between samples, estimated for all joints at once.

Where viscous friction is stiff beside the inertias of joints that move each other, M⁻¹ D h is not small and not
diagonal: what one joint's velocity is off takes another joint along within a sample interval, so that joint by joint
neither can be followed. About a motion (q̄, v̄) that was estimated before, all joints together obey

    q̇ = v,    M v̇ = f̄ − D v − G (v − v̄) + K (q − q̄) + w,

D the viscous friction, f̄ all other forces along (q̄, v̄), linear in time within an interval beside a constant, G and K
the slopes of these, and w forces that no model knows, held over each interval, of variances S/h. The densities S are
the likeliest ones: each step multiplies them by what the samples ask for over what they would ask for under S alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.rows.trajectory import DIFFUSE, LONGEST_PAUSE, ChannelNoise, Trajectory
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import LAW_ACCURACY
from drake_cafim.dynamics.motion import motion
from drake_cafim.effects.joint import DRY_FRICTION, FAINT, SLIP_VELOCITY, doubt_at_rest
from drake_cafim.numerics.kalman import Smoothed, StateSpace
from drake_cafim.numerics.relaxation import Relaxation
from drake_cafim.scenario.physics import FreeResponse, Physics
from drake_cafim.typing import Array

STEPS = 6
"""Times that the densities of the unknown forces are improved in each pass."""
MOST_CHANGE = 1e3
"""Largest factor by which one of them changes a density."""
LEAST_SHARE = 1e-6
"""Least density, over that of forces within the model's accuracy."""


def relax_together(weak: WeakForm, physics: Physics) -> bool:
    """Whether viscous friction couples joints within the sample intervals of the recording of `weak`.

    A force that changes linearly over an interval h, where it relaxes by λ, shows an inertia that is (λ h)²/12 too
    large; here λ is that of one joint by another, an element of D^{1/2} M⁻¹ D^{1/2} beside the diagonal.
    """
    terms = weak.terms(physics)
    damping = damping_of(physics)
    if terms.servos or physics.couplings or np.count_nonzero(damping) < 2:
        return False
    mobility = terms.mobility.of(physics)
    rates = np.sqrt(damping)[:, None] * mobility * np.sqrt(damping) * float(np.median(np.diff(weak.samples.time)))
    beside = rates[:, ~np.eye(len(damping), dtype=bool)]
    return bool(np.max(np.mean(beside**2, axis=0)) > 12.0 * LAW_ACCURACY)


def damping_of(physics: Physics) -> Array:
    """(n,) the coefficients of viscous friction at the joints, of the model and of effects, N m s/rad or N s/m."""
    total = np.array(physics.dampings, dtype=float)
    for effect in physics.joint_forces:
        total[physics.tree.joint_index(effect.at)] += effect.damping or 0.0
    return total


@dataclass(frozen=True)
class CoupledMotion:
    """How `physics` moves all joints from sample to sample about the motion `about`, the recording's being `weak`.

    `by_contact` (2, N, n) are the slopes of contacts' forces by each joint's own position and velocity.
    """

    weak: WeakForm
    physics: Physics
    about: Trajectory
    by_contact: Array

    def state_space(self, q: Array, v: Array, noises: Sequence[Sequence[ChannelNoise]]) -> StateSpace:
        """The model of the samples `q`, `v` (N, n) less the motion `about`; `noises` of each joint's q and v."""
        N, n = q.shape
        channels = [noise for of_kind in noises for noise in of_kind]
        m = 2 * n + sum(noise.process.states for noise in channels if noise.process)
        seen, start = np.eye(2 * n, m), np.zeros((m, m))
        steps, fresh, entering = np.zeros((N - 1, m, m)), np.zeros((N - 1, m, m)), np.zeros((N - 1, m, n))
        rise, (advance, entering[:, : 2 * n]) = np.zeros((N - 1, m)), self._linear
        steps[:, : 2 * n, : 2 * n], rise[:, : 2 * n] = advance, self._missed
        variance = np.stack([noise.variance for noise in channels], axis=1)
        scale = np.min(variance, axis=0) + np.array([noise.std**2 for noise in channels])
        scale = np.where(np.isfinite(scale), scale, np.concatenate([np.ones(n), 1e4 * scale[:n]]))
        start[range(2 * n), range(2 * n)] = DIFFUSE * scale
        first = 2 * n
        for k, noise in enumerate(channels):
            if noise.process is not None:
                own = slice(first, first + noise.process.states)
                seen[k, own] = noise.std * noise.process.output
                steps[:, own, own], fresh[:, own, own] = noise.process.transition, noise.process.fresh
                start[own, own], first = noise.process.lasting, own.stop
        read = np.concatenate([q - self.about.q, v - self.about.v], axis=1)
        anew = np.append(True, self._h > LONGEST_PAUSE * np.median(self._h))
        return StateSpace(read, variance, seen, np.eye(2 * n, m), steps, rise, entering, fresh, start, anew)

    def likeliest(self, space: StateSpace, density: Array) -> tuple[Trajectory, Array]:
        """The smoothed motion under the likeliest densities of unknown forces, (n,), found from `density` on."""
        held = self.held_at_rest
        least = LEAST_SHARE * density
        for _ in range(STEPS):
            found = space.smooth(density / self._h[:, None] + held)
            asked, expected = (np.sum(part / self._h[:, None], axis=0) for part in (found.asked, found.expected))
            change = np.clip(asked / np.maximum(expected, 1e-300), 1.0 / MOST_CHANGE, MOST_CHANGE)
            density = np.maximum(density * change, least)
        return self._trajectory(space.smooth(density / self._h[:, None] + held), density), density

    def _trajectory(self, found: Smoothed, density: Array) -> Trajectory:
        n = len(density)
        q, v = found.mean[:, :n] + self.about.q, found.mean[:, n:] + self.about.v
        surprise = np.full(n, found.cost / n)
        return Trajectory(q, v, found.std[:, :n], found.std[:, n:], density, surprise)

    @cached_property
    def _h(self) -> Array:
        """(N − 1,) s, the sample intervals."""
        return np.diff(self.weak.samples.time)

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """(N, n) slopes of the laws by each joint's own position, and by its velocity beyond viscous friction."""
        _, by_q, by_v = self.physics.applied_along_motion(self.weak.terms(self.physics).joints)
        beyond = np.minimum(by_v + damping_of(self.physics) + self.by_contact[1], 0.0)
        return by_q + self.by_contact[0], np.minimum(beyond, -self._at_rest[1])

    @cached_property
    def _at_rest(self) -> tuple[Array, Array]:
        """(N, n) how far dry friction near rest may differ from its law, N m or N; and its force over the velocity.

        About a velocity that is not known yet, the slope of friction says too little of how it changes: with its force
        over the velocity in its place the motion converges, as that is no less than the slopes up to rest are.
        """
        joints = self.weak.terms(self.physics).joints
        doubt, secant = np.zeros((2, len(self.weak.samples.time), len(joints)))
        for effect in self.physics.joint_forces:
            if effect.group == DRY_FRICTION:
                j = self.physics.tree.joint_index(effect.at)
                size, share = doubt_at_rest(effect, joints[j])
                near = share > 0.0
                speed = np.maximum(np.abs(joints[j].v), FAINT * SLIP_VELOCITY.nominal)
                secant[:, j] += np.where(near, size * (1.0 - share) / speed, 0.0)
                if SLIP_VELOCITY.name not in effect.values:
                    doubt[:, j] = np.hypot(doubt[:, j], size * share)
        return doubt, secant

    @property
    def held_at_rest(self) -> Array:
        """(N − 1, n) variances of the forces over each interval by which dry friction may differ from its law."""
        doubt = self._at_rest[0] ** 2
        return np.asarray(0.5 * (doubt[:-1] + doubt[1:]))

    @cached_property
    def _mobility(self) -> Array:
        return self._halfway[0]

    @cached_property
    def _forces(self) -> tuple[Array, Array]:
        """(N − 1, n) all forces but viscous friction at the begin of each sample interval, and at its end."""
        weak, physics, samples = self.weak, self.physics, self.weak.samples
        terms = weak.terms(physics)
        moving = replace(terms.moving, tree=physics.tree)
        law = physics.applied_at_joints(terms.joints)[0]
        law = law + damping_of(physics) * np.stack([joint.v for joint in terms.joints], axis=1)
        if physics.contacts:
            law = law + moving.project(physics.contact_wrenches(moving, weak.contact_memory(physics)))
        if physics.body_forces:
            law = law + moving.project(physics.body_wrenches(moving, samples.time, samples.recording.name))
        law = law - self._at_samples.bias
        # an effort within an interval is taken as linear, of the right mean and moment
        mean, aside = weak.mean_effort(physics)[:-1], 6.0 * self._effort_moments / self._h[:, None] ** 2
        return law[:-1] + mean - aside, law[1:] + mean + aside

    @cached_property
    def _effort_moments(self) -> Array:
        """(N − 1, n) ∫ (t − t̄) u dt of the efforts over each sample interval, t̄ its middle."""
        driven = self.weak.terms(self.physics).driven
        efforts = [driven.effort(self.physics, j) for j in range(self.weak.joints)]
        return np.stack([self.weak.samples.windows.moments(it.times, it.values, it.ramped) for it in efforts], axis=1)

    def bend(self, found: Trajectory) -> Array:
        """(N − 1, n) the change of an acceleration linear over each interval that bends `found` as much as it does.

        Less what the efforts alone do with nothing that relaxes, of which the rows know.
        """
        h = self._h[:, None]
        whole = 0.5 * h * (found.v[1:] + found.v[:-1]) - np.diff(found.q, axis=0)
        by_efforts = _times(self._at_samples.mobility[:-1], self._effort_moments)
        return np.asarray(np.where(h > LONGEST_PAUSE * np.median(h), 0.0, 12.0 / h**2 * (whole - by_efforts)))

    @cached_property
    def _at_samples(self) -> FreeResponse:
        return self.physics.free_response(replace(self.weak.terms(self.physics).moving, tree=self.physics.tree))

    @property
    def own_mobility(self) -> Array:
        """(n,) of each joint, the mean over time."""
        return np.asarray(np.mean(np.diagonal(self._at_samples.mobility, axis1=1, axis2=2), axis=0))

    @cached_property
    def _halfway(self) -> tuple[Array, Array]:
        """M⁻¹ (N − 1, n, n) halfway between samples; and (N − 1, n) the bias force there beyond the ends' mean."""
        q, v, h = self.about.q, self.about.v, self._h[:, None]
        # what relaxes within an interval does not bend the way through it
        middle = 0.5 * (q[:-1] + q[1:]) - 0.125 * h * np.diff(v, axis=0)
        mean = 0.5 * (v[:-1] + v[1:])
        response = self.physics.free_response(motion(self.physics.tree, middle, mean))
        ends = self._at_samples.bias
        return response.mobility, response.bias - 0.5 * (ends[:-1] + ends[1:])

    @cached_property
    def _between(self) -> tuple[Array, Array]:
        """(N − 1, n) K and −G, means over each sample interval."""
        by_q, by_v = (0.5 * (slope[:-1] + slope[1:]) for slope in self._slopes)
        return by_q, by_v

    @cached_property
    def _relaxing(self) -> Relaxation:
        return Relaxation.of(self._mobility, damping_of(self.physics) - self._between[1], self._h)

    @cached_property
    def _missed(self) -> Array:
        """(N − 1, 2 n) where the joints come from each sample of `about`, less where it is at the next one."""
        q, v, h, relaxing = self.about.q, self.about.v, self._h[:, None], self._relaxing
        after, before = self._forces
        # forces are linear in time about velocities that are
        after, before = after - self._between[1] * v[:-1], before - self._between[1] * v[1:]
        begin = _times(self._mobility, after - 2.0 / 3.0 * self._halfway[1])
        change = _times(self._mobility, before - after)
        rise = _times(relaxing.left, v[:-1]) + h * (_times(relaxing.first, begin) + _times(relaxing.second, change))
        way = _times(relaxing.first, v[:-1]) + h * (_times(relaxing.second, begin) + _times(relaxing.third, change))
        return np.concatenate([q[:-1] + h * way - q[1:], rise - v[1:]], axis=1)

    @cached_property
    def _linear(self) -> tuple[Array, Array]:
        """(N − 1, 2 n, 2 n) how a deviation from `about` goes on, and (N − 1, 2 n, n) what held unit forces add."""
        h, mobility, relaxing = self._h[:, None, None], self._mobility, self._relaxing
        entering = np.concatenate([h**2 * (relaxing.second @ mobility), h * (relaxing.first @ mobility)], axis=1)
        unit = np.broadcast_to(np.eye(mobility.shape[1]), mobility.shape)
        pulled = h * (relaxing.first @ (mobility * self._between[0][:, None, :]))
        steps = np.block([[unit, h * relaxing.first], [pulled, relaxing.left]])
        return steps, entering


def _times(matrices: Array, values: Array) -> Array:
    """(K, n) `matrices` (K, n, n) times `values` (K, n)."""
    return np.asarray(np.einsum("kij,kj->ki", matrices, values), dtype=float)
