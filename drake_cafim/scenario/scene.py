"""A Scene: a scenario's Drake plant, the same physics as arrays, its channels and its unknowns."""

from collections.abc import Mapping, Sequence
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
from drake_cafim.dynamics.contact import SphereContact, WrenchSensor
from drake_cafim.dynamics.tree import Tree, tree_of
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.catalogue import EFFECTS, effect_named, vocabulary_with
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameters
from drake_cafim.scenario.model_file import MODEL_SUFFIXES, add_plant
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import Channel, EffectEntry, Scenario, Weld, load
from drake_cafim.scenario.surfaces import contact_of
from drake_cafim.scenario.unknown import UnknownParameter, applied, priors, unknown_parameters
from drake_cafim.typing import Array

DIAGRAMS = Path(__file__).parents[1] / "diagrams"
PHYSICS_KEPT = 128
_FORCE = ("fx", "fy", "fz")


@dataclass(frozen=True)
class Scene:
    """What a diagnosis knows before it sees a recording: a robot as its model has it, its sensors and its unknowns.

    `Scene.load("scenario.yaml")` reads a scenario, a model file or a packaged name; `Scene.from_model("arm.urdf",
    channels={"q": 2e-4})` needs no scenario. A scene is never changed: what seems to, gives another.

    - `name` stands in messages; `scenario` is what the file says, its relative paths starting at `folder`.
    - `diagram`, `plant` and `scene_graph` are Drake's own, built and finalized, of the model without any effect.
    - `tree` is the same robot as arrays; `physics` all that acts in it: unknowns at their prior means, and `effects:`
      of the scenario.
    - `unknown`: the parameters that may simply be wrong, and their `priors`.
    - `wrench_sensors`: where wrenches are measured.
    - `vocabulary`: the effects that are looked for and that `effects:` may name.
    - `nominal_contacts`: the scenario's contacts before any effect.
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

    @classmethod
    def load(cls, address: str | Path, *, effects: Sequence[type[Effect]] = ()) -> "Scene":
        """The scene of a packaged scenario's name, a scenario file or a model file.

        `effects` are effect classes of one's own, beside the catalogue's: `effects:` in the file may name them.
        Raises `InputError` for anything in it that cannot be used.
        """
        path = resolve(str(address))
        scenario = Scenario(model=path.name) if str(path).endswith(MODEL_SUFFIXES) else load(path)
        return cls.build(scenario, path.parent, str(address), effects=effects)

    @classmethod
    def from_model(
        cls, model: str | Path, *, channels: Mapping[str, float] | None = None, weld: Sequence[str] = ()
    ) -> "Scene":
        """The scene of a model file (.urdf, .sdf, .xml, .dmd.yaml).

        `channels` are stds of one sample, SI, by kind ("q") or column ("q.elbow"); `weld` names bodies fixed to the
        world. Raises `InputError` for a model that cannot be read.
        """
        path = Path(model)
        scenario = Scenario(
            model=path.name,
            channels={name: Channel(std={"all": std}) for name, std in (channels or {}).items()},
            weld=[Weld(body) for body in weld],
        )
        return cls.build(scenario, path.parent, str(model))

    @classmethod
    def build(cls, scenario: Scenario, folder: Path, name: str, *, effects: Sequence[type[Effect]] = ()) -> "Scene":
        """The scene of a scenario whose relative paths start at `folder`; `name` stands in messages."""
        builder = DiagramBuilder()
        plant, scene_graph = add_plant(scenario, folder, builder, time_step=0.0)
        diagram = builder.Build()
        _check_standing(plant, name)
        tree = tree_of(plant, scenario.lock)
        physics = Physics(tree, np.array(scenario.gravity, dtype=float))
        vocabulary = vocabulary_with(effects)
        scene = cls(name, scenario, diagram, plant, scene_graph, tree, physics, (), (), folder, vocabulary)
        return scene.facing(np.zeros(len(tree.joints)))

    def facing(self, q: Array) -> "Scene":
        """The scene whose contact planes are the faces that stand before the robot at positions `q` (n,)."""
        contacts = tuple(
            contact_of(pair, self.plant, self.scene_graph, self.tree, q, self.name) for pair in self.scenario.contact
        )
        physics = Physics(self.tree, np.array(self.scenario.gravity, dtype=float), contacts)
        unknown = unknown_parameters(self.scenario.unknown, physics, self.name)
        physics = applied(unknown, physics, priors(unknown).mean)
        physics = physics.with_effects(self._known_effects())
        sensors = self._sensors()
        return replace(self, physics=physics, unknown=unknown, wrench_sensors=sensors, nominal_contacts=contacts)

    def knowing(self, effects: Sequence[type[Effect]]) -> "Scene":
        """The scene whose vocabulary has these effect classes too. Raises `InputError` for a name that is taken."""
        return replace(self, vocabulary=vocabulary_with(effects, self.vocabulary))

    @property
    def priors(self) -> Parameters:
        """Priors of the unknowns."""
        return priors(self.unknown)

    def physics_at(self, vector: Array) -> Physics:
        """The physics with the unknowns at `vector` (n,); the last ones are kept, since searches come back to them."""
        known, key = self._physics_known, vector.tobytes()
        found = known.get(key)
        if found is None:
            if len(known) >= PHYSICS_KEPT:
                known.clear()
            found = known[key] = applied(self.unknown, self.physics, vector)
        return found

    @cached_property
    def _physics_known(self) -> dict[bytes, Physics]:
        return {}

    def add_to(
        self,
        builder: DiagramBuilder,
        plant_config: MultibodyPlantConfig | None = None,
        *,
        contact: Literal["scenario", "drake"] = "scenario",
        period: float = 1e-3,
    ) -> CorrectedPlant:
        """The scene's plant with its effects around it, added to `builder`, and the ports for a controller.

        `plant_config` is Drake's own and defaults to Drake's own: a discrete plant of 1 ms; `time_step` 0 makes it
        continuous, and `period` s is then between updates of what delays and contacts remember. `contact` "scenario"
        has the contacts under `contact:`, by their own laws, and no other; "drake" has all of Drake's, point and
        hydroelastic, and of the scenario's only what effects add to them. The plant is finalized. Raises `InputError`
        for what the plant's solver or time step cannot simulate.
        """
        return add_scene(self, builder, plant_config, contact, period)

    def corrected(self, unknown: Array, effects: Sequence[Effect]) -> "Scene":
        """The scene with its unknowns at `unknown` (n,) and `effects` added to the scenario's own."""
        physics = self.physics_at(unknown).with_effects(effects)
        scenario = replace(
            self.scenario,
            unknown=[
                replace(entry, mean=float(value)) for entry, value in zip(self.scenario.unknown, unknown, strict=True)
            ],
            effects=[*self.scenario.effects, *(_entry(effect) for effect in effects)],
        )
        return replace(self, scenario=scenario, physics=physics)

    def std(self, column: str) -> float | None:
        """The noise of one sample of a recording's column, SI; None where the scenario does not say."""
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
        """The scenario's entry for a recording's column: its own before that of its kind."""
        kind = column.split(".")[0]
        own = column.rsplit(".", 1)[0] if kind in ("wrench", "pose") else column
        return self.scenario.channels.get(own) or self.scenario.channels.get(kind)

    def _known_effects(self) -> list[Effect]:
        effects: list[Effect] = []
        for entry in self.scenario.effects:
            kind = effect_named(entry.effect, self.vocabulary)
            if issubclass(kind, ExternalDisturbance):
                if len(entry.interval) != 2:
                    raise InputError(f"{self.name}: {entry.effect} at {entry.at} has no `interval: [start, stop]`")
                start, stop = entry.interval
                effects.append(kind(entry.at, {**entry.parameters, "start": start, "stop": stop}, entry.recording))
            else:
                effects.append(kind(entry.at, entry.parameters))
        return effects

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
    """The effect as an entry of `effects:`."""
    values = {name: float(value) for name, value in effect.values.items()}
    if isinstance(effect, ExternalDisturbance):
        interval = [values.pop("start"), values.pop("stop")]
        return EffectEntry(effect.name, effect.at, values, interval, effect.recording)
    return EffectEntry(effect.name, effect.at, values)


def _check_standing(plant: MultibodyPlant, name: str) -> None:
    """Raises `InputError` for a robot, a body with joints, that nothing holds."""
    free = plant.GetFloatingBaseBodies()
    for body in [plant.get_body(index) for index in free]:
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(body.model_instance())]
        if any(joint.num_velocities() > 0 and joint.child_body().index() not in free for joint in joints):
            raise InputError(
                f"{name}: nothing holds {body.name()}, on which the joints stand; expected it under "
                f"`weld: [{{body: {body.name()}}}]` of a scenario"
            )


def resolve(address: str) -> Path:
    """The file behind a packaged scenario's name or a path.

    Raises `InputError` that lists the packaged names when there is neither.
    """
    packaged = sorted(path.stem for path in DIAGRAMS.glob("*.yaml"))
    if address in packaged:
        return DIAGRAMS / f"{address}.yaml"
    path = Path(address)
    if not path.is_file():
        names = ", ".join(packaged) or "none"
        raise InputError(f"{address}: there is no such file and no packaged scenario of that name (there are: {names})")
    return path
