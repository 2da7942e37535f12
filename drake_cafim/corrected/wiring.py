"""Effects wired around a finalized plant: efforts in, forces on the plant, channels out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, Demultiplexer, Gain, MatrixGain, Multiplexer, PassThrough, ZeroOrderHold

from drake_cafim.corrected.body_forces import BodyForceSystem
from drake_cafim.corrected.brakes import brakes, rest_level
from drake_cafim.corrected.channels import TruePose, TrueWrench
from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.contacts import ContactSystem
from drake_cafim.corrected.drake_contact import DrakeContactWrench
from drake_cafim.corrected.efforts import actuator_system
from drake_cafim.corrected.joint_forces import JointForceSystem
from drake_cafim.corrected.plant import damps, state_selection
from drake_cafim.corrected.reading import array
from drake_cafim.corrected.rotors import rotor_system
from drake_cafim.corrected.sensors import sensor_system
from drake_cafim.corrected.sticking import StickingFriction, grows_with_load
from drake_cafim.dynamics.contact import SphereContact, WrenchSensor
from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics


@dataclass
class Wiring:
    """A plant in a builder whose effects are being connected.

    `clock` says when what effects remember is brought up to date: with a discrete plant's steps.
    """

    builder: DiagramBuilder
    plant: MultibodyPlant
    tree: Tree
    clock: Clock
    state: OutputPort
    forces: list[OutputPort] = field(default_factory=list)
    """Generalized forces (n,) that were added."""
    spatial_forces: list[OutputPort] = field(default_factory=list)

    @classmethod
    def around(cls, builder: DiagramBuilder, plant: MultibodyPlant, tree: Tree, clock: Clock) -> "Wiring":
        """The wiring of the joints of `tree` in the plant."""
        selected = builder.AddNamedSystem("joint state", MatrixGain(state_selection(plant, tree.joint_names)))
        builder.Connect(plant.get_state_output_port(), selected.get_input_port())
        return cls(builder, plant, tree, clock, selected.get_output_port())

    def add_efforts(self, physics: Physics) -> tuple[InputPort, OutputPort, OutputPort]:
        """Where efforts (n,) come in, what is asked of the actuators, and what drives the joints or their rotors."""
        entry = self.builder.AddNamedSystem("effort", PassThrough(len(self.tree.joints)))
        asked = entry.get_output_port()
        return entry.get_input_port(), asked, self.driven(physics, asked)

    def driven(self, physics: Physics, asked: OutputPort) -> OutputPort:
        """What the actuators make of the efforts (n,) that are asked of them."""
        for effect in physics.actuators:
            joint = self.tree.joint_index(effect.at)
            system = self._named(effect, actuator_system(effect, joint, len(self.tree.joints), self.clock))
            self.builder.Connect(asked, system.get_input_port())
            asked = system.get_output_port()
        return asked

    def add_joint_forces(self, physics: Physics, driving: OutputPort) -> None:
        """Joint effects, and the rotors' couplings, which pass the efforts on."""
        n, discrete = len(self.tree.joints), self.plant.time_step() > 0.0
        sticking = [effect for effect in physics.joint_forces if discrete and grows_with_load(effect)]
        for effect in physics.joint_forces:
            if damps(effect) or effect in sticking:
                continue
            level = rest_level(effect) if discrete and brakes(effect) else 0.0
            system = JointForceSystem(effect, self.tree.joint_index(effect.at), n, level)
            self._connect_joint(self._named(effect, system), driving)
            self.forces.append(system.get_output_port())
        for coupling in physics.couplings:
            joint = self.tree.joint_index(coupling.at)
            inertia = self.tree.joints[joint].rotor_inertia
            rotor = rotor_system(coupling, inertia, joint, n, self.clock if discrete else None)
            self._connect_joint(self._named(coupling, rotor), driving)
            driving = rotor.get_output_port()
        self.forces.append(driving)
        if sticking:
            self._add_sticking(sticking, driving)

    def _add_sticking(self, effects: Sequence[JointForce], driving: OutputPort) -> None:
        """Frictions that grow with the load, which ask for all the other forces."""
        others = self._total("joint forces but friction under load")
        joints = [self.tree.joint_index(effect.at) for effect in effects]
        selection = state_selection(self.plant, self.tree.joint_names)
        system = self.builder.AddNamedSystem(
            "friction under load", StickingFriction(effects, joints, self.plant, selection)
        )
        self.builder.Connect(self.plant.get_state_output_port(), system.GetInputPort("plant_state"))
        self.builder.Connect(driving, system.GetInputPort("effort"))
        self.builder.Connect(others, system.GetInputPort("force"))
        self.forces.append(system.get_output_port())

    def _total(self, name: str) -> OutputPort:
        """The sum of the joints' forces so far."""
        total = self.builder.AddNamedSystem(name, Adder(len(self.forces), len(self.tree.joints)))
        for k, force in enumerate(self.forces):
            self.builder.Connect(force, total.get_input_port(k))
        return total.get_output_port()

    def _connect_joint(self, system: LeafSystem, driving: OutputPort) -> None:
        self.builder.Connect(self.state, system.GetInputPort("state"))
        self.builder.Connect(driving, system.GetInputPort("effort"))

    def add_body_forces(self, physics: Physics, at_joints: bool = False) -> None:
        """Body effects; `at_joints`, as what they come to there."""
        for effect in physics.body_forces:
            index = self.plant.GetBodyByName(effect.at).index()
            system = self._named(effect, BodyForceSystem(effect, self.tree, index))
            self.builder.Connect(self.state, system.get_input_port())
            if at_joints:
                self.forces.append(system.GetOutputPort("force"))
            else:
                self.spatial_forces.append(system.GetOutputPort("spatial_forces"))

    def add_contacts(
        self, contacts: Sequence[tuple[SphereContact, SphereContact | None]]
    ) -> list[tuple[int, OutputPort]]:
        """The contacts' wrenches on their links, each with the link's joint.

        Beside each contact stands what of it the plant has by other means, if it has.
        """
        wrenches = []
        for contact, beside in contacts:
            name = self.plant.GetJointByName(self.tree.joints[contact.joint].name).child_body().name()
            index = self.plant.GetBodyByName(name).index()
            system = ContactSystem(contact, self.tree, self.tree.body(name), index, self.clock, beside)
            self.builder.AddNamedSystem(f"contact {contact.name}", system)
            self.builder.Connect(self.state, system.get_input_port())
            self.spatial_forces.append(system.GetOutputPort("spatial_forces"))
            wrenches.append((contact.joint, system.GetOutputPort("wrench")))
        return wrenches

    def add_drake_contacts(self, joints: Iterable[int]) -> list[tuple[int, OutputPort]]:
        """Wrenches of Drake's own contacts on what rides these joints, each with its joint.

        A discrete plant's are those of its last step: a controller may close a loop over them.
        """
        wrenches = []
        for joint in sorted(joints):
            name = self.tree.joints[joint].name
            riding = [body.name for body in self.tree.bodies if body.joint == joint and self._has(body.name)]
            system = self.builder.AddNamedSystem(f"contact at {name}", DrakeContactWrench(self.plant, riding))
            self.builder.Connect(self.plant.get_contact_results_output_port(), system.get_input_port())
            port = system.get_output_port()
            if self.plant.time_step() > 0.0:
                last = self.builder.AddNamedSystem(f"last contact at {name}", ZeroOrderHold(self.clock.period, 6))
                self.builder.Connect(port, last.get_input_port())
                port = last.get_output_port()
            wrenches.append((joint, port))
        return wrenches

    def _has(self, body: str) -> bool:
        """A payload is a body of the tree and none of the plant's."""
        return bool(self.plant.HasBodyNamed(body))

    def take_away(self, effort: OutputPort) -> None:
        """An effort (n,) that the plant gets by other means and that is among the forces is not to act twice."""
        n = len(self.tree.joints)
        opposite = self.builder.AddNamedSystem("effort by other means", Gain(-1.0, n))
        self.builder.Connect(effort, opposite.get_input_port())
        self.forces.append(opposite.get_output_port())

    def close(self) -> None:
        """Connects all forces that were added to the plant."""
        n = len(self.tree.joints)
        total = self._total("joint forces")
        places = state_selection(self.plant, self.tree.joint_names)[n:, self.plant.num_positions() :].T
        spread = self.builder.AddNamedSystem("generalized forces", MatrixGain(array(places)))
        self.builder.Connect(total, spread.get_input_port())
        self.builder.Connect(spread.get_output_port(), self.plant.get_applied_generalized_force_input_port())
        if self.spatial_forces:
            gathered = ExternallyAppliedSpatialForceMultiplexer(len(self.spatial_forces))
            self.builder.AddNamedSystem("spatial forces", gathered)
            for k, port in enumerate(self.spatial_forces):
                self.builder.Connect(port, gathered.get_input_port(k))
            self.builder.Connect(gathered.get_output_port(), self.plant.get_applied_spatial_force_input_port())

    def add_channels(
        self,
        physics: Physics,
        asked: OutputPort,
        sensors: Sequence[WrenchSensor],
        bodies: Sequence[str],
        wrenches: Sequence[tuple[int, OutputPort]],
    ) -> tuple[Mapping[str, OutputPort], tuple[str, ...]]:
        """The measured channels by group, "channels" all of them, and their columns.

        `wrenches` (6,) about the world's origin act on the links of these joints.
        """
        n = len(self.tree.joints)
        halves = self.builder.AddNamedSystem("true q, v", Demultiplexer(2 * n, n))
        self.builder.Connect(self.state, halves.get_input_port())
        true = {"q": halves.get_output_port(0), "v": halves.get_output_port(1), "u": asked}
        names: dict[str, Sequence[str]] = dict.fromkeys(true, self.tree.joint_names)
        for sensor in sensors:
            own = [port for joint, port in wrenches if joint == sensor.joint]
            reading = self.builder.AddNamedSystem(f"true {sensor.name}", TrueWrench(self.tree, sensor, len(own)))
            for port, entry in zip([self.state, *own], range(1 + len(own)), strict=True):
                self.builder.Connect(port, reading.get_input_port(entry))
            true[f"wrench.{sensor.name}"] = reading.get_output_port()
            names[f"wrench.{sensor.name}"] = WRENCH_COMPONENTS
        for name in bodies:
            pose = self.builder.AddNamedSystem(f"true pose of {name}", TruePose(self.tree, self.tree.body(name)))
            self.builder.Connect(self.state, pose.get_input_port())
            true[f"pose.{name}"], names[f"pose.{name}"] = pose.get_output_port(), POSE_COMPONENTS
        columns = {group: tuple(f"{group}.{name}" for name in members) for group, members in names.items()}
        measured = {group: self.sensed(physics, port, columns[group]) for group, port in true.items()}
        known = tuple(column for members in columns.values() for column in members)
        for effect in physics.sensors:
            if not effect.channels(known):
                raise InputError(f"effect {effect.name} at {effect.at}: no such channel; there are: {', '.join(known)}")
        together = self.builder.AddNamedSystem("channels", Multiplexer([len(one) for one in columns.values()]))
        for k, port in enumerate(measured.values()):
            self.builder.Connect(port, together.get_input_port(k))
        return measured | {"channels": together.get_output_port()}, known

    def sensed(self, physics: Physics, true: OutputPort, columns: Sequence[str]) -> OutputPort:
        """A group of channels after the effects on it; each group by itself, for a controller closes loops."""
        for effect in physics.sensors:
            if effect.channels(columns):
                system = self._named(effect, sensor_system(effect, columns, self.clock))
                self.builder.Connect(true, system.get_input_port())
                true = system.get_output_port()
        return true

    def _named(self, effect: Effect, system: LeafSystem) -> LeafSystem:
        """The system in the builder under the effect's name; a second such one gets a number."""
        name, k = f"{effect.name} at {effect.at}", 2
        while self.builder.HasSubsystemNamed(name):
            name, k = f"{effect.name} at {effect.at} ({k})", k + 1
        self.builder.AddNamedSystem(name, system)
        return system
