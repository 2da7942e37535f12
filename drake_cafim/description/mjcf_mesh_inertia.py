"""Mass and inertia that an MJCF leaves to its meshes, as MuJoCo computes them where it is installed."""

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from drake_cafim.errors import InputError
from drake_cafim.typing import Array


class MeshInertias:
    """What the bodies of the MJCF at `path` weigh; the file is compiled once, and only if that is asked."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write(self, body: Element, place: str) -> None:
        """Give `body` the `<inertial>` that its geometries have; errors begin with its `place`.

        Raises `InputError` where MuJoCo is not installed or cannot read the file, and for a body without a name.
        """
        try:
            mass, p_BBcm, quaternion, moments = self._of(body.get("name", ""))
        except ImportError:
            raise InputError(
                f"{place} weighs what its mesh does; expected an <inertial>, or MuJoCo, which computes that "
                "(`pip install mujoco`)"
            ) from None
        except KeyError:
            raise InputError(
                f"{place} weighs what its mesh does, which MuJoCo tells of bodies with a name; expected a name or an "
                "<inertial>"
            ) from None
        except ValueError as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{place} weighs what its mesh does, which MuJoCo does not tell ({reason}); expected an <inertial>"
            ) from None
        for given in body.findall("inertial"):
            body.remove(given)
        values: dict[str, Iterable[float]] = {"mass": [mass], "pos": p_BBcm, "quat": quaternion, "diaginertia": moments}
        SubElement(body, "inertial", {key: " ".join(repr(float(x)) for x in value) for key, value in values.items()})

    def _of(self, name: str) -> tuple[float, Array, Array, Array]:
        """Mass, kg, centre of mass (3,) m, and axes (4,) and principal moments (3,) kg m² about it."""
        body = self._compiled.body(name)
        return float(body.mass[0]), body.ipos, body.iquat, body.inertia

    @cached_property
    def _compiled(self) -> Any:
        import mujoco  # optional: few files need it

        return mujoco.MjModel.from_xml_path(str(self._path))
