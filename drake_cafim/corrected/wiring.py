"""Connects the systems of effects with a finalized plant: efforts in, forces on the plant, channels out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import (
    Adder,
    Demultiplexer,
    Gain,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Saturation,
    ZeroOrderHold,
)

from drake_cafim.corrected.body_forces import BodyForceSystem
from drake_cafim.corrected.brakes import brake_levels, grows_with_load
from drake_cafim.corrected.channels import TruePose, TrueWrench
from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.contacts import ContactSystem
from drake_cafim.corrected.drake_contact import DrakeContactWrench
from drake_cafim.corrected.efforts import actuator_system
from drake_cafim.corrected.joint_forces import JointForceSystem
from drake_cafim.corrected.plant import free_state_selection, state_selection
from drake_cafim.corrected.reading import array
from drake_cafim.corrected.rotors import rotor_system
from drake_cafim.corrected.second_order import MidpointCorrection, MidpointState
from drake_cafim.corrected.sensors import sensor_system
from drake_cafim.corrected.servos import CommandSystem, ServoSystem
from drake_cafim.corrected.sticking import StickingFriction
from drake_cafim.dynamics.contact import SphereContact, WrenchSensor
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.surroundings import SystemPlace
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics


@dataclass
class Wiring:
    """A plant in a builder, and the ports of the effects' systems that are collected for it.

    `clock` is the update schedule of the effects' discrete states, synchronous with a discrete plant's steps.
    """

    builder: DiagramBuilder
    plant: MultibodyPlant
    tree: Tree
    clock: Clock
    state: OutputPort
    forces: list[OutputPort] = field(default_factory=list)
    """Ports of generalized forces (n,), summed in `close`."""
    spatial_forces: list[OutputPort] = field(default_factory=list)
    midpoint: OutputPort | None = None
    """The joints' state on which forces depend, where its velocities are those half a step after `state`."""

    @classmethod
    def around(cls, builder: DiagramBuilder, plant: MultibodyPlant, tree: Tree, clock: Clock) -> "Wiring":
        """A wiring for `tree` in the plant, with a system that selects the state of its joints or of what floats."""
        if tree.floating:
            selected = builder.AddNamedSystem(
                "body state", MatrixGain(free_state_selection(plant, tree.free_body.name))
            )
        else:
            selected = builder.AddNamedSystem("joint state", MatrixGain(state_selection(plant, tree.joint_names)))
        builder.Connect(plant.get_state_output_port(), selected.get_input_port())
        return cls(builder, plant, tree, clock, selected.get_output_port())

    @classmethod
    def at_midpoints(cls, builder: DiagramBuilder, plant: MultibodyPlant, tree: Tree, clock: Clock) -> "Wiring":
        """A wiring for a discrete plant whose steps are of second order; forces depend on `MidpointState`."""
        wiring = cls.around(builder, plant, tree, clock)
        nq, nv = plant.num_positions(), plant.num_velocities()
        selection = state_selection(plant, tree.joint_names)
        places = array(selection[len(tree.joints) :, nq:].T)
        midpoint = builder.AddNamedSystem("midpoint state", MidpointState(nq, nv, clock))
        correction = builder.AddNamedSystem("midpoint correction", MidpointCorrection(plant, places))
        selected = builder.AddNamedSystem("midpoint joint state", MatrixGain(selection))
        builder.Connect(plant.get_state_output_port(), midpoint.get_input_port())
        builder.Connect(plant.get_state_output_port(), correction.GetInputPort("plant_state"))
        for system in (correction, selected):
            builder.Connect(midpoint.get_output_port(), system.get_input_port(system.num_input_ports() - 1))
        wiring.midpoint, wiring.forces = selected.get_output_port(), [correction.get_output_port()]
        return wiring

    def add_efforts(self, physics: Physics) -> tuple[dict[str, InputPort], OutputPort, OutputPort]:
        """Ports, each (n,): inputs, the efforts that are asked for, and the efforts on joints or their rotors.

        The input "effort" is of commanded efforts; with position servos there are "command", "gain" and "supply", too.
        """
        if physics.servos:
            entries, asked = self._add_servos(physics)
            return entries, asked, self.driven(physics, self._within_limits(asked))
        entry = self.builder.AddNamedSystem("effort", PassThrough(len(self.tree.joints)))
        asked = entry.get_output_port()
        return {"effort": entry.get_input_port()}, asked, self.driven(physics, self._within_limits(asked))

    def _add_servos(self, physics: Physics) -> tuple[dict[str, InputPort], OutputPort]:
        """Adds the position servos, and the systems of effects on their commands; returns their ports."""
        n, names = len(self.tree.joints), self.tree.joint_names
        servos = [physics.servo_at(servo.joint) for servo in physics.servos]
        system = self.builder.AddNamedSystem("position servos", ServoSystem(servos, names))
        halves = self.builder.AddNamedSystem("q, v for the servos", Demultiplexer(2 * n, n))
        self.builder.Connect(self.state, halves.get_input_port())
        seen = replace(physics, sensors=tuple(effect for effect in physics.sensors if not effect.late))
        columns = [f"q.{name}" for name in names]
        self.builder.Connect(self.sensed(seen, halves.get_output_port(0), columns), system.GetInputPort("read"))
        self.builder.Connect(halves.get_output_port(1), system.GetInputPort("v"))
        entries = {name: system.GetInputPort(name) for name in ("effort", "command", "gain", "supply")}
        for effect in reversed(physics.servo_effects):
            if effect.remembers:
                joint = self.tree.joint_index(effect.at)
                made = self._build(effect) or CommandSystem(effect, joint, n, self.clock)
                follower = self._add(effect, made)
                self.builder.Connect(follower.get_output_port(), entries["command"])
                entries["command"] = follower.get_input_port()
        return entries, system.get_output_port()

    def _within_limits(self, asked: OutputPort) -> OutputPort:
        """The efforts (n,) clipped to the model's limits; a limit of 0 means that none is stated."""
        limits = array([joint.effort_limit or np.inf for joint in self.tree.joints])
        if not np.any(np.isfinite(limits)):
            return asked
        system = self.builder.AddNamedSystem("effort limits", Saturation(-limits, limits))
        self.builder.Connect(asked, system.get_input_port())
        return system.get_output_port()

    def driven(self, physics: Physics, asked: OutputPort) -> OutputPort:
        """The acting efforts (n,): the commands `asked` after all actuator effects in series."""
        for effect in physics.actuators:
            joint = self.tree.joint_index(effect.at)
            made = self._build(effect) or actuator_system(effect, joint, len(self.tree.joints), self.clock)
            system = self._add(effect, made)
            self.builder.Connect(asked, system.get_input_port())
            asked = system.get_output_port()
        return asked

    def add_joint_forces(self, physics: Physics, driving: OutputPort) -> None:
        """Adds the systems of joint forces and of couplings, which replace the effort by the coupling's torque."""
        n, discrete = len(self.tree.joints), self.plant.time_step() > 0.0
        sticking = [effect for effect in physics.joint_forces if discrete and grows_with_load(effect)]
        levels = brake_levels(physics.joint_forces) if discrete else [0.0] * len(physics.joint_forces)
        for effect, level in zip(physics.joint_forces, levels, strict=True):
            if effect.damping is not None or effect in sticking:
                continue
            index = self.tree.joint_index(effect.at)
            system = self._build(effect) or JointForceSystem(effect, index, n, level, self.clock)
            self._connect_joint(self._add(effect, system), self.midpoint or self.state, driving)
            self.forces.append(system.get_output_port())
        for coupling in physics.couplings:
            joint = self.tree.joint_index(coupling.at)
            inertia = self.tree.joints[joint].rotor_inertia
            rotor = self._build(coupling) or rotor_system(coupling, inertia, joint, n, self.clock if discrete else None)
            self._connect_joint(self._add(coupling, rotor), self.state, driving)  # it steps as the link does
            driving = rotor.get_output_port()
        self.forces.append(driving)
        if sticking:
            self._add_sticking(sticking, driving)

    def _add_sticking(self, effects: Sequence[JointForce], driving: OutputPort) -> None:
        """Adds the friction laws that grow with the load; they need the sum of all other forces."""
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
        """The sum (n,) of the generalized forces added so far."""
        total = self.builder.AddNamedSystem(name, Adder(len(self.forces), len(self.tree.joints)))
        for k, force in enumerate(self.forces):
            self.builder.Connect(force, total.get_input_port(k))
        return total.get_output_port()

    def _connect_joint(self, system: LeafSystem, state: OutputPort, driving: OutputPort) -> None:
        self.builder.Connect(state, system.GetInputPort("state"))
        self.builder.Connect(driving, system.GetInputPort("effort"))

    def add_body_forces(self, physics: Physics, at_joints: bool = False) -> None:
        """Adds the systems of body forces; with `at_joints`, connects their generalized instead of spatial forces."""
        for effect in physics.body_forces:
            index = self.plant.GetBodyByName(effect.at).index()
            system = self._add(effect, self._build(effect) or BodyForceSystem(effect, self.tree, index))
            self.builder.Connect(self.midpoint or self.state, system.get_input_port())
            if at_joints:
                self.forces.append(system.GetOutputPort("force"))
            else:
                self.spatial_forces.append(system.GetOutputPort("spatial_forces"))

    def add_contacts(
        self, contacts: Sequence[tuple[SphereContact, SphereContact | None]]
    ) -> list[tuple[int, OutputPort]]:
        """Adds the systems of contacts; returns the wrenches (6,) on their links, each with the link's joint index.

        Each contact is paired with the contact that the plant already has in its place, or None; only the difference
        is applied.
        """
        wrenches = []
        for contact, beside in contacts:
            link = self._link(contact.joint)
            index = self.plant.GetBodyByName(link.name).index()
            several = contact.by_point()
            besides = [None] * len(several) if beside is None else beside.by_point()
            for k, (single, other) in enumerate(zip(several, besides, strict=True)):
                system = ContactSystem(single, self.tree, link, index, self.clock, other)
                point = f", point {k}" if len(several) > 1 else ""
                self.builder.AddNamedSystem(f"contact {contact.name}{point}", system)
                self.builder.Connect(self.midpoint or self.state, system.get_input_port())
                self.spatial_forces.append(system.GetOutputPort("spatial_forces"))
                wrenches.append((contact.joint, system.GetOutputPort("wrench")))
        return wrenches

    def _link(self, joint: int) -> Body:
        """The body that the joint with this index moves, or the one that floats."""
        if self.tree.floating:
            return self.tree.free_body
        return self.tree.body(self.plant.GetJointByName(self.tree.moving[joint].name).child_body().name())

    def add_drake_contacts(self, joints: Iterable[int]) -> list[tuple[int, OutputPort]]:
        """The wrenches (6,) of Drake's contacts on the bodies fixed to these joints, each with its joint index.

        A discrete plant's wrenches are delayed by a step, since a controller may close a loop over them.
        """
        wrenches = []
        for joint in sorted(joints):
            name = self.tree.moving[joint].name
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
        """Whether the plant has the body: a payload is a body of the tree only."""
        return bool(self.plant.HasBodyNamed(body))

    def take_away(self, effort: OutputPort) -> None:
        """Subtracts an effort (n,) that the plant also gets by its actuation port, so that it does not act twice."""
        n = len(self.tree.joints)
        opposite = self.builder.AddNamedSystem("effort by other means", Gain(-1.0, n))
        self.builder.Connect(effort, opposite.get_input_port())
        self.forces.append(opposite.get_output_port())

    def close(self) -> None:
        """Connects the sums of all added forces to the plant's force ports; to be called last."""
        n = len(self.tree.joints)
        if n:
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
        """The ports of the measured channels by group, with "channels" for all, and the names of the columns.

        `wrenches` (6,) about the world's origin act on the links of the joints with these indices. Raises `InputError`
        for a sensor effect on a channel that does not exist.
        """
        n = len(self.tree.joints)
        true: dict[str, OutputPort] = {}
        if n:
            halves = self.builder.AddNamedSystem("true q, v", Demultiplexer(2 * n, n))
            self.builder.Connect(self.state, halves.get_input_port())
            true = {"q": halves.get_output_port(0), "v": halves.get_output_port(1), "u": asked}
        names: dict[str, Sequence[str]] = dict.fromkeys(true, self.tree.joint_names)
        for sensor in sensors:
            acting = [port for joint, port in wrenches if joint == sensor.joint]
            reading = self.builder.AddNamedSystem(f"true {sensor.name}", TrueWrench(self.tree, sensor, len(acting)))
            for port, entry in zip([self.state, *acting], range(1 + len(acting)), strict=True):
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
        together = self.builder.AddNamedSystem("channels", Multiplexer([len(group) for group in columns.values()]))
        for k, port in enumerate(measured.values()):
            self.builder.Connect(port, together.get_input_port(k))
        return measured | {"channels": together.get_output_port()}, known

    def sensed(self, physics: Physics, true: OutputPort, columns: Sequence[str]) -> OutputPort:
        """A group of channels after the sensor effects on it; by group, to avoid algebraic loops over a controller."""
        for effect in physics.sensors:
            if effect.channels(columns):
                system = self._add(effect, self._build(effect, columns) or sensor_system(effect, columns, self.clock))
                self.builder.Connect(true, system.get_input_port())
                true = system.get_output_port()
        return true

    def _build(self, effect: Effect, columns: Sequence[str] = ()) -> LeafSystem | None:
        """The custom system of an effect's class; None where it uses the default of its kind."""
        found: LeafSystem | None = effect.system(SystemPlace(self.tree, self.clock.period, columns))
        return found

    def _add(self, effect: Effect, system: LeafSystem) -> LeafSystem:
        """Adds the system to the builder under the effect's name, with a number if the name is taken."""
        name, k = f"{effect.name} at {effect.at}", 2
        while self.builder.HasSubsystemNamed(name):
            name, k = f"{effect.name} at {effect.at} ({k})", k + 1
        self.builder.AddNamedSystem(name, system)
        return system
