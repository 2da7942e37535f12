"""Parsing of an XML file into elements with their line numbers; prefixes as `drake:` stay part of the names."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder, tostring
from xml.parsers import expat

from drake_cafim.errors import InputError

DEPTH = 200
"""Largest depth to which elements nest: an MJCF's bodies nest as deep as the robot's longest chain of links."""

COUNTS = {"pos": 3, "quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3, "axis": 3, "mass": 1, "rgba": 4}
COUNTS |= {"fullinertia": 6, "diaginertia": 3, "gravity": 3, "scale": 3, "range": 2, "ctrlrange": 2, "forcerange": 2}
"""How many numbers an attribute of an MJCF holds."""
DIRECTIONS = ("axis", "zaxis", "quat", "axisangle", "xyaxes")
"""Attributes whose numbers are not all zero."""


@dataclass
class XmlDocument:
    """The elements of a file and of those that it includes; `lines` is the file and line where each begins."""

    path: Path
    root: Element
    lines: dict[Element, tuple[Path, int]] = field(default_factory=dict)

    def place(self, element: Element) -> str:
        """`file, line n` of the element, for messages."""
        path, line = self.lines.get(element, (self.path, 0))
        return f"{path}, line {line}" if line else str(path)

    def text(self) -> str:
        """The document as XML text."""
        return tostring(self.root, encoding="unicode")


def read_document(path: Path) -> XmlDocument:
    """The document in the file at `path`. Raises `InputError` for a file that cannot be read or is not XML."""
    try:
        return parse_document(path.read_bytes(), path)
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}), expected a model file") from None


def parse_document(content: bytes, path: Path) -> XmlDocument:
    """The document in `content`; namespaces are not resolved, since many files use prefixes that they do not declare.

    `path` is the file's name in messages. Raises `InputError` for content that is not XML.
    """
    builder, parser = TreeBuilder(), expat.ParserCreate()
    lines: dict[Element, tuple[Path, int]] = {}

    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH:
            raise InputError(
                f"{path}: elements nest more than {DEPTH} deep in line {parser.CurrentLineNumber}, expected a robot"
            )
        lines[builder.start(tag, attributes)] = path, parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse_entity(name: str, *_: object) -> None:
        raise InputError(
            f"{path}: it declares the entity {name!r} in line {parser.CurrentLineNumber}, expected a model file "
            "without entities of its own"
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = refuse_entity
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: not readable as XML ({error}), expected a model file") from None
    return XmlDocument(path, builder.close(), lines)


def numbers(element: Element, attribute: str, default: str = "") -> list[float]:
    """The numbers in an attribute, separated by spaces or commas.

    Raises `ValueError`, which names element and attribute, for other text, for NaN, for another count than the
    attribute's, and for a direction or rotation that is zero.
    """
    text = element.get(attribute, default)
    try:
        found = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        found = [math.nan]
    count = COUNTS.get(attribute)
    wrong = any(map(math.isnan, found)) or (bool(found) and count is not None and len(found) != count)
    if wrong or (bool(found) and attribute in DIRECTIONS and not any(found)):
        expected = "a number" if count == 1 else f"{count or 'some'} numbers"
        expected += ", not all of them zero" if attribute in DIRECTIONS else ""
        named = f"{element.get('name')!r}: " if element.get("name") else ""
        raise ValueError(f"<{element.tag}> {named}{attribute} is {text[:60]!r}, expected {expected}")
    return found
