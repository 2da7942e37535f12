"""Reading of a model file of any format: URDF, SDFormat or MJCF."""

from pathlib import Path

from drake_cafim.description.description import Description
from drake_cafim.description.mjcf import mjcf_description
from drake_cafim.description.packages import Packages
from drake_cafim.description.sdf import sdf_description
from drake_cafim.description.urdf import urdf_description
from drake_cafim.description.xml_document import read_document
from drake_cafim.errors import InputError


def read_description(path: Path, packages: Packages) -> Description:
    """The description in a URDF, SDFormat or MJCF file, by its root element. Raises `InputError` for other files."""
    document = read_document(path)
    kinds = {"robot": urdf_description, "sdf": sdf_description, "mujoco": mjcf_description}
    read = kinds.get(document.root.tag)
    if read is None:
        raise InputError(f"{path}: its root is <{document.root.tag}>, expected one of <robot>, <sdf>, <mujoco>")
    return read(document, packages)
