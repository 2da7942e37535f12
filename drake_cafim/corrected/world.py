"""Effects of a robot that is part of a larger plant, with its own controller."""

from dataclasses import dataclass

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort

from drake_cafim.corrected.brakes import connect_brakes
from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.contacts import changed_contacts
from drake_cafim.corrected.plant import change_plant
from drake_cafim.corrected.wiring import Wiring
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.tree import Tree
from drake_cafim.scenario.physics import Physics


@dataclass(frozen=True)
class AffectedRobot:
    """A robot in the plant of a larger world: its `nominal` tree, and its `physics` with effects.

    Call `prepare` before the plant is finalized, then `connect` and `measured`. The plant is discrete, of second order
    (see `second_order`), and gets its efforts by its actuation port: actuator effects are applied as the difference
    from that effort.
    """

    nominal: Tree
    physics: Physics
    contacts: tuple[SphereContact, ...] = ()
    """The contacts of `physics` without effects, which the plant already has."""

    @property
    def untouched(self) -> bool:
        """Whether there are no effects on joints, bodies, contacts, actuators or couplings."""
        physics = self.physics
        changed = physics.joint_forces or physics.actuators or physics.couplings or physics.body_forces
        return not (changed or changed_contacts(physics.contacts, self.contacts))

    def prepare(self, plant: MultibodyPlant) -> None:
        """Applies the changes of inertia, gravity and damping and adds brakes; before the plant is finalized."""
        change_plant(plant, self.nominal, self.physics)

    def connect(
        self, builder: DiagramBuilder, plant: MultibodyPlant, effort: OutputPort
    ) -> list[tuple[int, OutputPort]]:
        """Connects the effects' forces to the finalized plant, whose actuation port gets the `effort` (n,).

        Returns the wrenches (6,) about the world's origin that contact effects add, each with its link's joint index.
        """
        connect_brakes(builder, plant)
        wiring = Wiring.at_midpoints(builder, plant, self.physics.tree, _clock(plant))
        if self.untouched:
            wiring.close()
            return []
        wiring.add_joint_forces(self.physics, wiring.driven(self.physics, effort))
        wiring.add_body_forces(self.physics, at_joints=True)
        wiring.take_away(effort)
        wrenches = wiring.add_contacts(changed_contacts(self.physics.contacts, self.contacts))
        wiring.close()
        return wrenches

    def measured(self, builder: DiagramBuilder, plant: MultibodyPlant, state: OutputPort) -> OutputPort:
        """The joints' `state` (2n,), positions then velocities, after the sensor effects."""
        columns = [f"{kind}.{name}" for kind in "qv" for name in self.nominal.joint_names]
        wiring = Wiring(builder, plant, self.physics.tree, _clock(plant), state)
        return wiring.sensed(self.physics, state, columns)


def _clock(plant: MultibodyPlant) -> Clock:
    return Clock(plant.time_step(), plant.has_sampled_output_ports())
