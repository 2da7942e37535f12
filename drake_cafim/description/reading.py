"""Reading of a model file of any format: URDF, SDFormat or MJCF."""

from pathlib import Path

import numpy as np

from drake_cafim.description.description import Description
from drake_cafim.description.mjcf import mjcf_description
from drake_cafim.description.packages import Packages
from drake_cafim.description.sdf import sdf_description
from drake_cafim.description.urdf import urdf_description
from drake_cafim.description.xml_document import read_document
from drake_cafim.errors import InputError

UNREADABLE = (ValueError, IndexError, KeyError, OverflowError, ZeroDivisionError, np.linalg.LinAlgError)
"""What the conversion of attributes to numbers, vectors and rotations raises where these are wrong."""


def read_description(path: Path, packages: Packages) -> Description:
    """The description in a URDF, SDFormat or MJCF file, by its root element.

    Raises `InputError` for other files, and for one that holds something else where numbers are expected.
    """
    document = read_document(path)
    kinds = {"robot": urdf_description, "sdf": sdf_description, "mujoco": mjcf_description}
    read = kinds.get(document.root.tag)
    if read is None:
        raise InputError(f"{path}: its root is <{document.root.tag}>, expected one of <robot>, <sdf>, <mujoco>")
    try:
        return read(document, packages)
    except UNREADABLE as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: not readable as a model: {why}") from error
