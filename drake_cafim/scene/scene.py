"""The class `Scene`: a scenario's Drake plant, the same physics as arrays, its channels and its unknown parameters."""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_cafim.corrected.corrected_plant import CorrectedPlant
from drake_cafim.corrected.scene import add_scene
from drake_cafim.description.description import ModelStatements, list_names
from drake_cafim.dynamics.contact import SphereContact, WrenchSensor
from drake_cafim.dynamics.tree import Tree, tree_of
from drake_cafim.effects.catalogue import EFFECTS, vocabulary_with
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError, check_type
from drake_cafim.parameters import Parameters
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.holding import (
    check_closures,
    check_mimics,
    explain_missing_joints,
    followed_joints,
    locked_positions,
    notes_on_followers,
    resolve_lock,
)
from drake_cafim.scenario.inertials import ALL, DEFAULT_STD, INERTIALS, each_link
from drake_cafim.scenario.known_effects import known_effects
from drake_cafim.scenario.model_file import MODEL_SUFFIXES, add_plant
from drake_cafim.scenario.model_physics import (
    check_inertias,
    joints_beyond_limits,
    model_effects,
    with_effort_limits,
    with_saturation,
)
from drake_cafim.scenario.names import check_names, naming
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import (
    UNRECORDED,
    Channel,
    EffectEntry,
    Scenario,
    Unknown,
    load,
    parse,
)
from drake_cafim.scenario.servos import servos_of
from drake_cafim.scenario.shape import conform
from drake_cafim.scenario.surfaces import contact_of
from drake_cafim.scenario.unknown import (
    UnknownParameter,
    apply_unknowns,
    entries_at,
    entries_of_stated,
    priors,
    unknown_parameters,
    vector_of,
    with_stated_friction,
    with_unknowns,
)
from drake_cafim.scenario.unknown_effects import effects_of_unknowns
from drake_cafim.scene.address import split_address
from drake_cafim.scene.supported import check_supported, notes_on_unused
from drake_cafim.typing import Array

PHYSICS_CACHED = 128
"""Most physics that a scene keeps, by the values of its unknowns."""
_FORCE = ("fx", "fy", "fz")


@dataclass(frozen=True)
class Scene:
    """A robot's model, its sensors, its unknown parameters and its known effects: what is given before a recording.

    `Scene.load("scenario.yaml")` reads a scenario, a model file or a packaged name; `Scene.from_model("arm.urdf",
    channels={"q": 2e-4})` needs no scenario. A scene is immutable; methods that change something return another scene.

    - `name` is used in messages; `scenario` holds the file's contents, its relative paths starting at `folder`.
    - `diagram`, `plant` and `scene_graph` are Drake's, built and finalized, of the model without any effect.
    - `tree` is the same robot as arrays; `physics` the forces in it, with the unknowns at their prior means and the
      effects of the model's files and of the scenario.
    - `unknown`: the parameters under `unknown:`, with their `priors`.
    - `wrench_sensors`: the frames in which wrenches are measured.
    - `vocabulary`: the effects that a diagnosis looks for and that `effects:` may name.
    - `nominal_contacts`: the scenario's contacts before any effect.
    - `stated`: what the model's files state beyond what Drake's parser reads.
    - `limited`: the joints whose commands exceed the model's effort limits in the recordings, so that the limits act.
    - `bare`: the physics before any effect; `of_model`: the effects that the model's files state; `known`: those of
      the scenario, with the values that it states; those that only `unknown:` names are at their prior means.
    """

    name: str
    scenario: Scenario
    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph
    tree: Tree
    physics: Physics
    unknown: tuple[UnknownParameter, ...]
    wrench_sensors: tuple[WrenchSensor, ...]
    folder: Path = field(default_factory=Path)
    vocabulary: tuple[type[Effect], ...] = EFFECTS
    nominal_contacts: tuple[SphereContact, ...] = ()
    stated: ModelStatements = field(default_factory=ModelStatements)
    limited: tuple[str, ...] = ()
    bare: Physics | None = None
    of_model: tuple[Effect, ...] = ()
    known: tuple[Effect, ...] = ()

    @classmethod
    def load(
        cls, address: str | Path, *, effects: Sequence[type[Effect]] = (), packages: Mapping[str, str] | None = None
    ) -> "Scene":
        """The scene of a packaged scenario's name, a scenario file or a model file.

        `effects` are your own effect classes, beside the catalogue's: `effects:` in the file may name them.
        `packages` are folders of packages by name, beside those under `packages:`. Raises `InputError` that names the
        file and the key for contents that cannot be used.
        """
        path, part = split_address(str(address))
        alone = str(path).endswith(MODEL_SUFFIXES)
        scenario = Scenario(model=path.name) if alone else load(path, part)
        check_type("packages", packages or {}, Mapping, "folders by package name")
        places = {name: str(place) for name, place in (packages or {}).items()}
        places = conform(places, dict[str, str], f"{address}: ", "packages")
        given = {name: os.path.realpath(place) for name, place in places.items()}
        scenario = replace(scenario, packages={**scenario.packages, **given})
        scene = cls.build(scenario, path.parent, str(address), effects=effects)
        return scene.with_uncertain_inertials() if alone else scene

    @classmethod
    def from_model(
        cls, model: str | Path, *, channels: Mapping[str, float] | None = None, weld: Sequence[str] = ()
    ) -> "Scene":
        """The scene of a model file (.urdf, .sdf, .xml, .dmd.yaml).

        `channels` are the stds of one sample, SI, by kind ("q") or column ("q.elbow"); `weld` names the bodies that are
        fixed to the world. Raises `InputError` for a model that cannot be read.
        """
        check_type("model", model, (str, Path), "the name of a model file")
        check_type("channels", channels or {}, Mapping, "standard deviations by channel")
        check_type("weld", weld, (list, tuple), "a list of bodies")
        path = Path(model)
        noise = {
            name: {"std": std.item() if isinstance(std, np.generic) else std} for name, std in (channels or {}).items()
        }
        scenario = parse({"model": path.name, "channels": noise, "weld": [{"body": body} for body in weld]}, str(model))
        return cls.build(scenario, path.parent, str(model))

    @classmethod
    def build(cls, scenario: Scenario, folder: Path, name: str, *, effects: Sequence[type[Effect]] = ()) -> "Scene":
        """The scene of a scenario whose relative paths start at `folder`; `name` is used in messages."""
        builder = DiagramBuilder()
        with naming(name):
            plant, scene_graph, statements = add_plant(scenario, folder, builder, time_step=0.0)
            diagram = builder.Build()
            check_supported(plant, name)
            scenario = replace(scenario, lock=resolve_lock(scenario.lock, plant, statements))
            tree = tree_of(plant, locked_positions(scenario.lock), followed_joints(statements))
            tree = with_effort_limits(tree, statements, scenario.unlimited)
            statements = replace(statements, notes=(*statements.notes, *notes_on_followers(tree)))
            if scenario.lock != UNRECORDED:
                check_mimics(tree, statements)
                check_inertias(tree, statements, scenario.model or name)
            check_names(scenario, plant, tree)
            statements = replace(statements, notes=(*statements.notes, *notes_on_unused(scenario)))
        physics = Physics(tree, np.array(scenario.gravity, dtype=float))
        vocabulary = vocabulary_with(effects)
        scene = cls(
            name, scenario, diagram, plant, scene_graph, tree, physics, (), (), folder, vocabulary, stated=statements
        )
        return scene.with_surfaces_at(np.zeros(len(tree.joints)))

    def with_uncertain_inertials(self, std: float = DEFAULT_STD) -> "Scene":
        """The scene with the inertials of all moving links unknown, with the relative `std`; a note says so.

        A thrown body stays as it is: its poses do not show its mass.
        """
        links = [] if self.tree.floating else each_link([Unknown(INERTIALS, std, body=ALL)], self.tree)
        if not links:
            return self
        scenario = replace(self.scenario, unknown=[*self.scenario.unknown, *links])
        note = f"no scenario states how well the inertials of the links are known: their relative std is {std:g}"
        stated = replace(self.stated, notes=(*self.stated.notes, note))
        return replace(self, scenario=scenario, stated=stated).with_surfaces_at(np.zeros(len(self.tree.joints)))

    def with_stated_unknown(self, friction: bool = True, rotors: Collection[str] = ()) -> "Scene":
        """The scene with all `friction` that the model's files state, and `rotors`, unknown with stds as large."""
        new = entries_of_stated(self.tree, self.of_model, self.unknown, friction, rotors)
        more = unknown_parameters(new, self.bare or self.physics, self.known, self.name, self.of_model)
        unknown = [*self.scenario.unknown, *new]
        scene = replace(self, scenario=replace(self.scenario, unknown=unknown), unknown=(*self.unknown, *more))
        return replace(scene, physics=scene.physics_at(scene.priors.mean))

    def with_surfaces_at(self, q: Array) -> "Scene":
        """The scene with the contact plane of each fixed box at the face nearest to the robot at positions `q` (n,)."""
        contacts = tuple(
            contact_of(pair, self.plant, self.scene_graph, self.tree, q, self.name) for pair in self.scenario.contact
        )
        servos = servos_of(self.scenario.servo, self.stated.servos, self.tree, self.joint_names, self.name)
        bare = Physics(self.tree, np.array(self.scenario.gravity, dtype=float), contacts, servos=servos)
        sensors = [name for name in self.scenario.channels if name.startswith(("wrench.", "pose."))]
        of_model = tuple(model_effects(self.stated, self.tree, self.vocabulary))
        stated = known_effects(
            self.scenario.effects, bare, self.vocabulary, sensors, self.name, self.folder, self.known
        )
        other = effects_of_unknowns(self.scenario.unknown, stated, bare, self.vocabulary, sensors, self.name)
        scenario = replace(
            self.scenario,
            effects=[*self.scenario.effects, *map(_entry, other)],
            unknown=each_link(self.scenario.unknown, bare.tree),
        )
        known = (*stated, *other)
        unknown = unknown_parameters(scenario.unknown, bare, known, self.name, of_model)
        scene = replace(
            self,
            scenario=scenario,
            bare=bare,
            of_model=of_model,
            known=known,
            unknown=unknown,
            nominal_contacts=contacts,
        )
        return replace(scene, physics=scene.physics_at(priors(unknown).mean), wrench_sensors=self._sensors())

    def for_recordings(self, recordings: Sequence[Recording]) -> "Scene":
        """The scene for these recordings: `lock: unrecorded` locks the joints that they have no column of.

        Where commands (`u` with std 0) exceed a joint's effort limit, the limit acts. Raises `InputError` for a joint
        without a column that the scenario does not lock, and for a chain of joints that a constraint closes.
        """
        names = self.tree.joint_names
        if self.tree.floating or not names:
            return self
        lacking = {
            name: recording for recording in recordings for name in names if f"q.{name}" not in recording.columns
        }
        if not lacking:
            check_closures(self.tree, self.stated, self.name)
            return self._with_limits_that_act(recordings)
        if self.scenario.lock == UNRECORDED and len(lacking) < len(names):
            scenario = replace(self.scenario, lock=list(lacking))
            held = Scene.build(scenario, self.folder, self.name, effects=self.vocabulary)
            return held.for_recordings(recordings)
        raise InputError(explain_missing_joints(next(iter(lacking.values())), tuple(lacking)))

    def _with_limits_that_act(self, recordings: Sequence[Recording]) -> "Scene":
        """The scene in which effort limits act that recorded commands exceed; measured efforts only get a note.

        A measured effort did act, so that a limit below it is a mistake of the model.
        """
        beyond = joints_beyond_limits(self.tree, recordings)
        limited = tuple(name for name in beyond if self.std(f"u.{name}") == 0.0)
        served = tuple(
            servo.joint
            for servo in self.stated.servos
            if servo.joint in self.tree.joint_names
            and self.tree.joints[self.tree.joint_index(servo.joint)].effort_limit < np.inf
            and any(f"cmd.{servo.joint}" in recording.columns for recording in recordings)
            and not any(f"u.{servo.joint}" in recording.columns for recording in recordings)
        )
        measured = [name for name in beyond if name not in limited]
        notes = []
        if measured:
            notes.append(f"measured efforts exceed the model's limits, which are ignored ({list_names(measured)})")
        if served:
            notes.append(f"the model's servos act up to the efforts that it states ({list_names(served)})")
        limited = (*limited, *served)
        if not (notes or limited):
            return self
        stated = replace(self.stated, notes=(*self.stated.notes, *notes))
        return replace(self, limited=limited, stated=stated).with_surfaces_at(np.zeros(len(self.tree.joints)))

    def with_effect_classes(self, effects: Sequence[type[Effect]]) -> "Scene":
        """The scene whose vocabulary includes these effect classes. Raises `InputError` for a name already in use."""
        return replace(self, vocabulary=vocabulary_with(effects, self.vocabulary))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of all joints of the model, locked ones included."""
        return tuple(self.plant.get_joint(i).name() for i in self.plant.GetJointIndices())

    @property
    def priors(self) -> Parameters:
        """The priors of the unknown parameters."""
        return priors(self.unknown)

    def vector_of(self, values: Mapping[tuple[str, str, str | None], float]) -> Array:
        """The vector (n,) of the unknowns by the `values` that a report states, by parameter, place and effect.

        Of a link's inertials a report states the physical parameters.
        """
        return vector_of(self.unknown, self.bare or self.physics, values)

    def physics_at(self, vector: Array) -> Physics:
        """The physics with the unknowns at `vector` (n,); cached, since a search returns to the same values."""
        cached, key = self._physics_cache, vector.tobytes()
        found = cached.get(key)
        if found is None:
            if len(cached) >= PHYSICS_CACHED:
                cached.clear()
            of_model = with_stated_friction(self.unknown, self.of_model, vector)
            effects = (*of_model, *with_unknowns(self.unknown, self.known, vector))
            physics = apply_unknowns(self.unknown, self.bare or self.physics, vector).with_effects(effects)
            found = cached[key] = with_saturation(physics, self.limited)
        return found

    @cached_property
    def _physics_cache(self) -> dict[bytes, Physics]:
        return {}

    def add_to(
        self,
        builder: DiagramBuilder,
        plant_config: MultibodyPlantConfig | None = None,
        *,
        contact: Literal["scenario", "drake"] = "scenario",
        period: float = 1e-3,
    ) -> CorrectedPlant:
        """Add the scene's finalized plant and systems for its effects to `builder`; returns them and their ports.

        `plant_config` is Drake's, by default a discrete plant of 1 ms; with `time_step` 0 the plant is continuous, and
        delays and internal states of contacts are updated every `period` s. With `contact` "scenario" the contacts
        under `contact:` act by their own laws, and no others; with "drake" all of Drake's act, point and hydroelastic,
        and of the scenario's only what effects add to them. Raises `InputError` for effects that the plant's solver or
        time step cannot simulate.
        """
        return add_scene(self, builder, plant_config, contact, period)

    def corrected(self, unknown: Array, effects: Sequence[Effect]) -> "Scene":
        """The scene with its unknowns at `unknown` (n,) and `effects` added to the scenario's own."""
        physics = self.physics_at(unknown).with_effects(effects)
        known = with_unknowns(self.unknown, self.known, unknown)
        entries = [
            _entry(effect) if effect != before else entry
            for entry, before, effect in zip(self.scenario.effects, self.known, known, strict=True)
        ]
        scenario = replace(
            self.scenario,
            unknown=entries_at(self.scenario.unknown, unknown),
            effects=[*entries, *(_entry(effect) for effect in effects)],
        )
        return replace(self, scenario=scenario, physics=physics, known=(*known, *effects))

    def std(self, column: str) -> float | None:
        """The noise std of one sample of a recording's column, SI; None where the scenario does not state it."""
        channel = self.channel(column)
        if channel is None or not channel.std:
            return None
        kind, last = column.split(".")[0], column.rsplit(".", 1)[-1]
        if kind == "wrench":
            return channel.std.get("force" if last in _FORCE else "torque")
        if kind == "pose":
            return channel.std.get("position" if last in "xyz" else "rotation")
        return channel.std.get("all")

    def channel(self, column: str) -> Channel | None:
        """The scenario's entry for a recording's column, or else that for its kind; None without either."""
        kind = column.split(".")[0]
        own = column.rsplit(".", 1)[0] if kind in ("wrench", "pose") else column
        return self.scenario.channels.get(own) or self.scenario.channels.get(kind)

    def _sensors(self) -> tuple[WrenchSensor, ...]:
        sensors = []
        for key, channel in self.scenario.channels.items():
            if not key.startswith("wrench."):
                continue
            body = self.tree.body(channel.body)
            X_BF = np.eye(4)
            if channel.frame and channel.frame != channel.body:
                if not self.plant.HasFrameNamed(channel.frame):
                    raise InputError(
                        f"{self.name}: channels.{key} names the frame {channel.frame!r}, which the model lacks"
                    )
                frame = self.plant.GetFrameByName(channel.frame)
                X_BF = np.array(frame.GetFixedPoseInBodyFrame().GetAsMatrix4())
            R_JS, p_JS = body.R_JB @ X_BF[:3, :3], body.p_JB + body.R_JB @ X_BF[:3, 3]
            sensors.append(WrenchSensor(key.removeprefix("wrench."), body.joint, R_JS, p_JS))
        return tuple(sensors)


def _entry(effect: Effect) -> EffectEntry:
    """The entry of `effects:` that states the effect."""
    values = {name: float(value) for name, value in effect.values.items()}
    law = next((str(s.named(values.pop(s.name))) for s in effect.shapes if s.names and s.name in values), None)
    if (episode := effect.episode) is not None:
        interval = [values.pop("start"), values.pop("stop")]
        return EffectEntry(effect.name, effect.at, values, interval, episode.recording)
    return EffectEntry(effect.name, effect.at, values, law=law, table=effect.table or None)
