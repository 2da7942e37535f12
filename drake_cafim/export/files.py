"""The exported files: the model with its values, and a scenario that says of the rest."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from drake_cafim.description.packages import Packages
from drake_cafim.errors import InputError
from drake_cafim.export.mjcf import MjcfText, addresses_of, set_addresses, write_mjcf
from drake_cafim.export.sdf import write_sdf
from drake_cafim.export.urdf import write_urdf
from drake_cafim.export.values import READ_BACK, Form, values_of
from drake_cafim.export.xml_text import XmlText, read_xml_text
from drake_cafim.output import replacing, write_text
from drake_cafim.scenario.model_file import OWN_PACKAGE
from drake_cafim.scenario.packaged import packaged_folder
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scenario.schema import Scenario
from drake_cafim.scene.scene import Scene

ROOTS: Mapping[str, Form] = {"robot": "urdf", "sdf": "sdf", "mujoco": "mjcf"}
SCENARIO = "scenario.exported.yaml"


@dataclass(frozen=True)
class Exported:
    """The written model file, the other files of the model, and the scenario for what the model does not hold.

    `written` and `lost` are sentences: what the file now holds, and what it cannot.
    """

    model: Path
    others: tuple[Path, ...]
    scenario: Path
    written: tuple[str, ...]
    lost: tuple[str, ...]


def export(scene: Scene, form: Form, out: Path) -> Exported:
    """Write the scene's values into a copy of its model file, in the folder `out`, which may be the file's own.

    Every byte that does not state a changed value stays, addresses of meshes aside where `out` is another folder.
    Raises `InputError` where the model is of another format, or not one file.
    """
    source = model_of(scene)
    found = ROOTS.get(read_xml_text(source).root.tag)
    if found != form:
        raise InputError(
            f"--to {form}: the model {source} is {found or 'of no known format'}; values go back into their own "
            f"file, expected --to {found}"
        )
    values = values_of(scene, form)
    edited: dict[Path, XmlText]
    if form == "mjcf":
        mjcf = MjcfText.read(source)
        lost = write_mjcf(mjcf, values)
        edited = mjcf.files
        _move_mjcf(mjcf, source, out)
    else:
        file = read_xml_text(source)
        lost = (write_urdf if form == "urdf" else write_sdf)(file, values)
        edited = {source: file}
        _move_addresses(file, out)
    targets = {path: _target(path, source, out) for path in edited}
    for path, file in edited.items():
        if targets[path].resolve() == path.resolve():
            raise InputError(f"--out {out}: {path} itself would be replaced, expected another folder")
        with replacing(targets[path]) as temporary:
            temporary.write_bytes(file.written())
    model = targets[source]
    scenario = out / SCENARIO
    write_text(scenario, as_yaml(_rest(scene, model, out, form), out, out))
    written = [*(effect.sentence(scene.tree) for effect in values.held), *_unknowns(scene)]
    others = tuple(path for key, path in targets.items() if key != source)
    return Exported(model, others, scenario, tuple(written), (*values.lost, *lost))


def model_of(scene: Scene) -> Path:
    """The scene's model file. Raises `InputError` for directives."""
    model = scene.scenario.model
    if not model or model.endswith((".dmd.yaml", ".dmd.yml")):
        raise InputError(f"{scene.name}: its model is Drake's directives, expected one file of a model to write into")
    if model.startswith(("package://", "model://")):
        given = {name: (scene.folder / place).resolve() for name, place in scene.scenario.packages.items()}
        packages = Packages({OWN_PACKAGE: packaged_folder("models"), **given})
        return packages.require_file(model, scene.folder / "scenario")
    return scene.folder / model


def _target(path: Path, source: Path, out: Path) -> Path:
    """Where a file of the model goes: beside the model as it was, or under its name alone."""
    inside = os.path.relpath(path.resolve(), source.resolve().parent)
    return out / (path.name if inside.startswith("..") else inside)


def _move_mjcf(mjcf: MjcfText, source: Path, out: Path) -> None:
    """Let the copy's meshes, textures and includes be found from `out`."""
    if any(mjcf.main.root.iter("asset")) or len(mjcf.files) > 1:
        folders = {
            name: os.path.relpath((source.parent / folder).resolve(), out.resolve())
            for name, folder in addresses_of(mjcf).items()
        }
        set_addresses(mjcf, folders)
    for path, file in mjcf.files.items():
        for node in file.root.iter("include"):
            for folder in (source.parent, path.parent):
                included = folder / node.get("file")
                if included.is_file():
                    inside = _target(included, source, out).relative_to(out).as_posix()
                    if inside != node.get("file"):
                        node.set("file", inside)
                    break


def _move_addresses(file: XmlText, out: Path) -> None:
    """Let relative addresses of meshes in a URDF or SDFormat file be found from `out`."""
    for node in file.root.iter("mesh"):
        address = node.get("filename")
        if address and "://" not in address and not os.path.isabs(address):
            node.set("filename", os.path.relpath(os.path.realpath(file.path.parent / address), out.resolve()))
    for node in file.root.iter("uri"):
        address = file.text_of(node)
        if address and "://" not in address and not os.path.isabs(address):
            node.content = os.path.relpath(os.path.realpath(file.path.parent / address), out.resolve())


def _rest(scene: Scene, model: Path, out: Path, form: Form) -> Scenario:
    """The scenario of the exported model: without the effects that the file now holds, its priors about the values."""
    held = {effect.key for effect in values_of(scene, form).held if effect.name in READ_BACK}
    scenario = scene.scenario
    kept = [entry for entry in scenario.effects if (entry.effect, entry.at) not in held]
    unknown = [
        replace(entry, mean=None, log_cholesky=[]) if entry.body or entry.joint else entry
        for entry in scenario.unknown
        if entry.effect is None or (entry.effect, entry.at) not in held
    ]
    packages = {name: str((scene.folder / place).resolve()) for name, place in scenario.packages.items()}
    return replace(scenario, model=os.path.relpath(model, out), effects=kept, unknown=unknown, packages=packages)


def _unknowns(scene: Scene) -> list[str]:
    changed = [f"inertials of {entry.body}" for entry in scene.scenario.unknown if entry.log_cholesky]
    return changed + [
        f"{unknown.parameter} of {unknown.at}, {unknown.prior.mean:.6g} {unknown.prior.unit}".removesuffix(" 1")
        for unknown in scene.unknown
        if unknown.kind in ("body", "joint") and unknown.parameter not in ("length", "width", "height", "radius")
    ]
