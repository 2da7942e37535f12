"""Loading of a scenario's model file into a Drake plant."""

import functools
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydrake.geometry import Mesh, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import LoadModelDirectivesFromString, Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PrismaticJoint, RevoluteJoint
from pydrake.systems.framework import DiagramBuilder

from drake_cafim.description.description import Description, ModelStatements, combine_descriptions
from drake_cafim.description.packages import Packages
from drake_cafim.description.parser_log import capture_log
from drake_cafim.description.reading import read_description
from drake_cafim.description.trial import try_apart
from drake_cafim.errors import InputError
from drake_cafim.scenario.directives import EXPECTED, check_directives
from drake_cafim.scenario.packaged import packaged_folder
from drake_cafim.scenario.schema import Scenario
from drake_cafim.typing import Array
from drake_cafim.yaml_file import dump, read_mapping

MODEL_SUFFIXES = (".urdf", ".sdf", ".xml", ".dmd.yaml", ".dmd.yml", ".mjcf")
DIRECTIVES = (".dmd.yaml", ".dmd.yml")
OWN_PACKAGE = "drake_cafim_models"
_WHERE = re.compile(r"^\S*:\d+: warning: ")
"""File and line at the beginning of the parser's warnings: those of a rewritten text and not of the user's file."""


def add_plant(
    scenario: Scenario, folder: Path, builder: DiagramBuilder, time_step: float
) -> tuple[MultibodyPlant, SceneGraph, ModelStatements]:
    """Add the scenario's finalized plant and its scene graph to `builder`; returned with the files' other statements.

    `folder` is where a relative model path starts. Raises `InputError` for what Drake's parser refuses.
    """
    plant: MultibodyPlant
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step)
    statements = add_model(scenario, folder, plant)
    try:
        with capture_log():  # warnings about collision shapes, which are not used here
            plant.Finalize()
    except (Exception, SystemExit) as error:
        if "loops in the system graph" in str(error):
            raise InputError(
                "a link of the model has two parent joints: closed chains are not supported, expected a tree"
            ) from None
        raise InputError(f"the model cannot be finalized: {' '.join(str(error).split())}") from None
    return plant, scene_graph, statements


def add_model(scenario: Scenario, folder: Path, plant: MultibodyPlant) -> ModelStatements:
    """Add the scenario's model, its welds and its gravity to `plant`, which stays unfinalized.

    `folder` is where a relative model path starts. The rotor inertias that the files state are added to the plant; all
    that they state beyond it is returned. Raises `InputError` for what Drake's parser refuses.
    """
    statements = _Model(scenario, folder, plant).add()
    _refuse_equal_names(plant)
    for i, weld in enumerate(scenario.weld):
        if not plant.HasBodyNamed(weld.body):
            names = ", ".join(_body_names(plant))
            raise InputError(f"weld[{i}].body is {weld.body!r}, which the model lacks; it has: {names}")
        held = _joint_to_world(plant, weld.body)
        if held is not None:
            raise InputError(
                f"weld[{i}].body is {weld.body!r}, which joint {held} of the model joins to the world already"
            )
        try:
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(weld.body))
        except RuntimeError as error:
            raise InputError(f"weld[{i}].body is {weld.body!r}: {' '.join(str(error).split())}") from None
    for name, inertia in statements.rotor_inertias.items():
        _add_rotor(plant, name, inertia)
    for k, mesh in enumerate(statements.shown):
        X_BG = RigidTransform(RotationMatrix.ProjectToRotationMatrix(mesh.R), mesh.p)
        scale: Array = np.array(mesh.scale, dtype=float)
        color: Array = np.array(mesh.color, dtype=float)
        shape, body = Mesh(mesh.file, scale), plant.GetBodyByName(mesh.body)
        plant.RegisterVisualGeometry(body, X_BG, shape, f"mesh_{k}", color)
    gravity: Array = np.array(scenario.gravity, dtype=float)
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    return statements


def _joint_to_world(plant: MultibodyPlant, body: str) -> str | None:
    """The joint between the world and a body; None where there is none."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    both = [(joint.name(), {joint.parent_body().name(), joint.child_body().name()}) for joint in joints]
    return next((name for name, bodies in both if bodies == {"world", body}), None)


def _add_rotor(plant: MultibodyPlant, name: str, inertia: float) -> None:
    """Add an actuator with the reflected rotor `inertia`, kg m² (kg), to a joint."""
    joint = plant.GetJointByName(name)
    if isinstance(joint, RevoluteJoint | PrismaticJoint):
        plant.AddJointActuator(name, joint).set_default_rotor_inertia(inertia)


def _refuse_equal_names(plant: MultibodyPlant) -> None:
    """Raises `InputError` for two bodies or joints of one name in different models, as of two equal arms."""
    models = [ModelInstanceIndex(i) for i in range(plant.num_model_instances())]
    bodies = [(plant.get_body(i).name(), model) for model in models for i in plant.GetBodyIndices(model)]
    joints = [(plant.get_joint(i).name(), model) for model in models for i in plant.GetJointIndices(model)]
    for kind, found in (("body", bodies), ("joint", joints)):
        known: dict[str, str] = {}
        for name, index in found:
            model = plant.GetModelInstanceName(index)
            if name in known:
                raise InputError(
                    f"the {kind} {name!r} is in the models {known[name]} and {model}; expected names that differ, "
                    "since columns and scenarios have nothing else to tell them by"
                )
            known[name] = model


def _body_names(plant: MultibodyPlant) -> list[str]:
    """The names of all bodies except the world."""
    instances = [ModelInstanceIndex(i) for i in range(2, plant.num_model_instances())]
    return [plant.get_body(i).name() for instance in instances for i in plant.GetBodyIndices(instance)]


class _Model:
    """Parses a scenario's model into a plant."""

    def __init__(self, scenario: Scenario, folder: Path, plant: MultibodyPlant) -> None:
        self._scenario, self._folder = scenario, folder
        given = {name: Path(os.path.realpath(folder / place)) for name, place in scenario.packages.items()}
        self._packages = Packages({OWN_PACKAGE: packaged_folder("models"), **given})
        self._parser = Parser(plant)
        self._parser.SetAutoRenaming(False)
        for name, place in self._packages.given.items():
            if not os.path.isdir(place):
                raise InputError(f"packages: {name} is {place}, which is no folder")
            self._parser.package_map().Add(name, place)

    def add(self) -> ModelStatements:
        """Parse the model into the plant and return what its files state beyond it."""
        scenario = self._scenario
        if scenario.directives:
            return self._add_directives(scenario.directives, "directives", self._folder / "directives")
        path = self._file(scenario.model, self._folder / "scenario")
        if str(path).endswith(DIRECTIVES):
            return self._add_directives(read_mapping(path, EXPECTED).get("directives"), str(path), path)
        description = _described(path, self._packages)
        _survive(description.text, description.form, str(path))
        with capture_log() as warnings, _as_input_error(str(path)):
            self._parser.AddModelsFromString(description.text, description.form)
        return combine_descriptions([description], _in_words(warnings, path))

    def _file(self, address: str, near: Path) -> Path:
        if address.startswith(("package://", "model://")):
            return self._packages.require_file(address, near)
        path = near.parent / address
        if not os.path.isfile(path):
            raise InputError(f"{path}: there is no such model file, expected one of {', '.join(MODEL_SUFFIXES)}")
        return path

    def _add_directives(self, directives: Any, source: str, near: Path) -> ModelStatements:
        """Parse Drake's model directives; model files in them are read as descriptions first, as a single one is."""
        written = deepcopy(check_directives(directives, source, near, self._packages))
        found, warnings = list[Description](), list[str]()
        with TemporaryDirectory() as scratch:
            for k, directive in enumerate(written):
                entry = directive.get("add_model")
                if entry is None or not self._ours(entry["file"]):
                    continue
                path = self._file(entry["file"].removeprefix("file://"), near)
                found.append(_described(path, self._packages))
                plain = Path(scratch) / f"{k}_{path.stem}.{found[-1].form}"
                _survive(found[-1].text, found[-1].form, str(path))
                plain.write_text(found[-1].text, encoding="utf-8")
                entry["file"] = f"file://{plain}"
            text = dump({"directives": written})
            with capture_log() as lines, _as_input_error(source):
                ProcessModelDirectives(LoadModelDirectivesFromString(text), self._parser)
            warnings += [line.replace(f"{scratch}/", "") for line in lines]
        return combine_descriptions(found, _in_words(warnings, Path(source)))

    def _ours(self, address: str) -> bool:
        """Whether the file is read as a description: not directives, nor a file of a package that only Drake knows."""
        name = re.match(r"(?:package|model)://([^/]+)/", address)
        known = name is None or self._packages.find(name.group(1), self._folder / "scenario") is not None
        return known and not address.endswith(DIRECTIVES)


@functools.lru_cache(maxsize=64)
def _survive(text: str, form: str, source: str) -> None:
    """Raises `InputError`, which names `source`, for a model that ends the process when Drake reads or finalizes it."""

    def read() -> None:
        plant: MultibodyPlant
        plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
        with capture_log():
            Parser(plant).AddModelsFromString(text, form)
            plant.Finalize()

    try_apart(read, source)


def _described(path: Path, packages: Packages) -> Description:
    """The file's description. Raises `InputError` for a force between bodies that our equations of motion lack."""
    description = read_description(path, packages)
    if "linear_bushing_rpy" in description.text:
        raise InputError(f"{path}: drake:linear_bushing_rpy is not supported, expected forces at joints only")
    return description


@contextmanager
def _as_input_error(source: str) -> Iterator[None]:
    """Turn exceptions of Drake's parser into an `InputError` of one sentence.

    C++ throws what Python has as IndexError or MemoryError, too; a failed assertion is a `SystemExit`.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        raise InputError(f"{source}: Drake's parser refuses it: {' '.join(str(error).split())}") from None


def _in_words(warnings: list[str], path: Path) -> list[str]:
    """The parser's warnings as notes, each once, with the file's name."""
    plain = dict.fromkeys(_WHERE.sub("", line) for line in warnings)
    return [f"{path.name}: {line}" for line in plain]
