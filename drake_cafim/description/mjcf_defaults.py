"""Expansion of an MJCF's includes and default classes into the elements that they apply to."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from drake_cafim.description.xml_document import XmlDocument, read_document
from drake_cafim.errors import InputError

MAIN = "main"
DEPTH = 20
"""Largest depth of nested includes; deeper ones are taken for a file that includes itself."""


def include_all(document: XmlDocument) -> None:
    """Replace each `<include file>` by that file's elements; it is searched beside the main and the including file.

    Raises `InputError` for a missing file, and for one that includes itself.
    """
    _include(document, document.root, document.path, 0)


def _include(document: XmlDocument, parent: Element, path: Path, depth: int) -> None:
    for child in list(parent):
        if child.tag != "include":
            _include(document, child, path, depth)
            continue
        name = child.get("file", "").replace("\\", "/")  # as written under Windows, and as MuJoCo reads it
        found = next((file for near in (document.path, path) if (file := near.parent / name).is_file()), None)
        if found is None or depth > DEPTH:
            why = "which is not there" if found is None else "which includes itself"
            raise InputError(f"{document.place(child)}: include names {name!r}, {why}")
        included = read_document(found)
        document.lines.update(included.lines)
        _include(document, included.root, found, depth + 1)
        at = list(parent).index(child)
        parent.remove(child)
        for k, element in enumerate(included.root):
            parent.insert(at + k, element)


@dataclass
class Defaults:
    """Default attributes by class and tag; each class inherits those of the class that it is nested in."""

    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=lambda: {MAIN: {}})

    @classmethod
    def of(cls, root: Element) -> "Defaults":
        """The defaults of all `<default>` sections of the file."""
        found = cls()
        for section in root.findall("default"):
            name = section.get("class") or MAIN
            found._take(section, name, found.classes.get(name, found.classes[MAIN]))
        return found

    def _take(self, section: Element, name: str, inherited: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(attributes) for tag, attributes in inherited.items()}
        for element in section:
            if element.tag != "default":
                own[element.tag] = own.get(element.tag, {}) | dict(element.attrib)
        self.classes[name] = own
        for nested in section.findall("default"):
            self._take(nested, nested.get("class", ""), own)

    def write_out(self, element: Element, childclass: str | None, also: tuple[str, ...] = ()) -> None:
        """Add to `element` the defaults of its class, or else of `childclass`, for its tag and for the tags `also`.

        Attributes of the element itself take precedence, then the defaults of its own tag.
        """
        attributes: dict[str, str] = {}
        chosen = self.classes.get(element.attrib.pop("class", "") or childclass or MAIN, self.classes[MAIN])
        for tag in (*also, element.tag):
            attributes |= chosen.get(tag, {})
        attributes.pop("class", None)
        for key, value in attributes.items():
            element.attrib.setdefault(key, value)


def bodies(parent: Element, childclass: str | None = None) -> Iterator[tuple[Element, str | None]]:
    """The bodies within a body or the worldbody, parents first, each with the default class of its elements."""
    for body in parent.findall("body"):
        own = body.get("childclass") or childclass
        yield body, own
        yield from bodies(body, own)
