"""What is not supported: small models and scenarios that meet it, and what they are answered."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

INERTIAL = """<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def link(name: str, more: str = "") -> str:
    return f'<link name="{name}">{INERTIAL}{more}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>'
        f'<limit lower="-1" upper="1" effort="9" velocity="9"/>{more}</joint>'
    )


def urdf(*parts: str) -> str:
    return f'<robot name="r">{"".join(parts)}</robot>'


def mjcf(more: str) -> str:
    """Two links beside each other."""
    body = '<body name="{0}"><joint name="{0}_joint" axis="0 1 0"/><geom size=".1" mass="1"/></body>'
    return f'<mujoco model="m"><worldbody>{body.format("left")}{body.format("right")}</worldbody>{more}</mujoco>'


HELD = "weld: [{body: a}]"
ONE = urdf(link("a"), link("b"), joint("j", "a", "b"))
TWO = (link("a"), link("b"), link("c"), joint("j1", "a", "b"))
CYLINDER = '<collision><geometry><cylinder radius="0.1" length="0.2"/></geometry></collision>'
BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
GROUND = "ground: {}, stiffness: 1000.0, friction: 0.3, slip_velocity: 0.01"
CONNECTED = '<equality><connect body1="left" body2="right" anchor="0 0 1"/></equality>'
WOUND = '<tendon><fixed name="cable"><joint joint="left_joint" coef="1"/></fixed></tendon>'


@dataclass(frozen=True)
class Limit:
    """Something that is not supported, with a model and a scenario that have it.

    `noted` says that the model is taken without it, and that the report has a note.
    """

    what: str
    model: str
    scenario: str = HELD
    suffix: str = "urdf"
    noted: bool = False


LIMITS = (
    Limit("A floating base with joints", urdf(link("trunk"), link("leg"), joint("hip", "trunk", "leg")), ""),
    Limit("Joints of more than one axis", urdf(link("a"), link("b"), joint("j", "a", "b", "planar"))),
    Limit("Closed chains, by links", urdf(*TWO, joint("j2", "a", "c"), joint("j3", "b", "c"))),
    Limit("Closed chains, by a constraint of an MJCF, once recordings are given", mjcf(CONNECTED), "", "xml"),
    Limit(
        "A joint that follows one that moves and carries a joint that follows none",
        urdf(*TWO, joint("j2", "b", "c", more='<mimic joint="j1"/>'), link("d"), joint("j3", "c", "d")),
    ),
    Limit("Tendons", mjcf(WOUND), "", "xml", noted=True),
    Limit(
        "Contacts of other shapes",
        urdf(link("a"), link("b", CYLINDER), joint("j", "a", "b")),
        f"{HELD}\ncontact: [{{bodies: [b, ground], {GROUND}}}]",
    ),
)


def answer(limit: Limit) -> str:
    """The error's sentence, or the note, without the folder; empty where nothing is said."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / f"robot.{limit.suffix}").write_text(limit.model, encoding="utf-8")
        (folder / "robot.yaml").write_text(f"model: robot.{limit.suffix}\n{limit.scenario}\n", encoding="utf-8")
        return _said(lambda: _notes(Scene.load(folder / "robot.yaml"))).replace(f"{scratch}/", "")


def _said(attempt: Callable[[], str]) -> str:
    try:
        return attempt()
    except InputError as error:
        return str(error)


def _notes(scene: Scene) -> str:
    """The notes of a diagnosis of the scene."""
    time = np.linspace(0.0, 0.07, 8)
    columns = {f"{kind}.{name}": np.zeros(8) for kind in "qu" for name in scene.tree.joint_names}
    return "; ".join(scene.for_recordings([Recording("run.csv", time, columns)]).stated.notes)
