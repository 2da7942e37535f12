"""The joint reference for a commanded tool velocity, limited in acceleration and to the workspace."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.movers import Mover
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.typing import Array


@dataclass
class TrackingConfig:
    """How the robot's reference follows a commanded velocity."""

    period: float = 0.005  # s, of the updates; a fraction of the planner's
    ramp: float = 0.05  # s, over which a new command is reached, linearly
    # m/s², the most by which the velocity changes, in each coordinate; beyond it the wrist of the arm with a hand
    # saturates (12 N m)
    acceleration: float = 15.0
    delay: float = 0.0005  # s, of the update after the planner's, so that it reads the command of this moment


@dataclass(frozen=True)
class Reference:
    """A joint reference: positions, velocities, accelerations, each (n,)."""

    q: Array
    v: Array
    a: Array

    def after(self, elapsed: float) -> "Reference":
        """The reference `elapsed` s later at constant acceleration."""
        q = self.q + elapsed * self.v + 0.5 * elapsed**2 * self.a
        return Reference(q=q, v=self.v + elapsed * self.a, a=self.a)


@TemplateSystem.define("VelocityTracking_", T_list=[float, AutoDiffXd])  # type: ignore[untyped-decorator]
def VelocityTracking_(T: Any) -> Any:
    class Impl(LeafSystem_[T]):  # type: ignore[misc]
        """Joint reference that moves the tool of a `Mover` with the commanded velocity.

        .. pydrake_system::

            name: VelocityTracking
            input_ports: [command]
            output_ports: [desired_state, desired_acceleration]

        `command` (nu,) m/s is cut at the `workspace` and smoothed by `config`. Discrete state: q, v, a (n,) each,
        which hold from the last update on at constant acceleration; the tool's velocity (nu,) at the end of that
        period, at the last command, and the command; the number of updates.

        The reference depends on the commands alone, not on the robot. In AutoDiffXd both are constants: it has no
        derivatives.
        """

        def _construct(
            self,
            *,
            mover: Mover,
            command_period: float,
            workspace: Workspace,
            config: TrackingConfig,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter)
            self._mover, self._workspace, self._config = mover, workspace, config
            self._command_period = command_period
            self._steps_per_command = round(command_period / config.period)
            n, nu = len(mover.q_start), mover.coordinates
            self._slices = np.split(np.arange(3 * n + 3 * nu + 1), np.cumsum([n, n, n, nu, nu, nu]))
            self.DeclareDiscreteState(as_array(np.concatenate([mover.q_start, np.zeros(2 * n + 3 * nu + 1)])))
            self.DeclareVectorInputPort("command", nu)
            # without these sources Drake would assume direct feedthrough, and the loop through the plant be algebraic
            sources = {self.xd_ticket(), self.time_ticket()}
            self.DeclareVectorOutputPort("desired_state", 2 * n, self._calc_desired_state, sources)
            self.DeclareVectorOutputPort("desired_acceleration", n, self._calc_desired_acceleration, sources)
            self.DeclarePeriodicDiscreteUpdateEvent(config.period, config.delay, self._update)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(
                self,
                mover=other._mover,
                command_period=other._command_period,
                workspace=other._workspace,
                config=other._config,
                converter=converter,
            )

        def _update(self, context: Any, values: Any) -> None:
            state = _plain(context.get_discrete_state_vector().CopyToVector())
            now, before, target, count = (state[part] for part in self._slices[3:])
            period, tick = self._config.period, round(float(count[0]))
            begin = self._reference(state).after(period if tick > 0 else 0.0)
            if tick % self._steps_per_command == 0:
                before, target = now, self._cut_command(context, begin.q, now)
            share = min(1.0, (tick % self._steps_per_command + 1) * period / self._config.ramp)
            most = self._config.acceleration * period
            now = now + np.clip(before + share * (target - before) - now, -most, most)
            acceleration = (self._mover.joint_velocity(begin.q, now) - begin.v) / period
            values.set_value(
                as_array(np.concatenate([begin.q, begin.v, acceleration, now, before, target, [tick + 1.0]]))
            )

        def _cut_command(self, context: Any, q: Array, velocity: Array) -> Array:
            return self._workspace.allowed(
                _plain(self.get_input_port().Eval(context)),
                self._mover.position(q),
                velocity,
                period=self._command_period,
                ramp=self._config.ramp,
            )

        def _reference(self, state: Array) -> Reference:
            q, v, a = (state[part] for part in self._slices[:3])
            return Reference(q=q, v=v, a=a)

        def _now(self, context: Any) -> Reference:
            state = _plain(context.get_discrete_state_vector().CopyToVector())
            last = max(float(state[self._slices[-1]][0]) - 1.0, 0.0) * self._config.period
            return self._reference(state).after(float(_plain([context.get_time()])[0]) - last)

        def _calc_desired_state(self, context: Any, output: Any) -> None:
            reference = self._now(context)
            output.SetFromVector(as_array(np.concatenate([reference.q, reference.v])))

        def _calc_desired_acceleration(self, context: Any, output: Any) -> None:
            output.SetFromVector(self._now(context).a)

    return Impl


VelocityTracking = VelocityTracking_[float]


def _plain(values: Any) -> Array:
    """Numbers or AutoDiffXd values (k,) as numbers, without their derivatives."""
    plain = np.asarray(values)
    return as_array(ExtractValue(plain).ravel() if plain.dtype == object else plain)
