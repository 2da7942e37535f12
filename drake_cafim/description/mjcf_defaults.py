"""Expansion of an MJCF's includes and default classes into the elements that they apply to."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from drake_cafim.description.xml_document import XmlDocument, read_document
from drake_cafim.errors import InputError

MAIN = "main"
MOST_FILES = 1000
"""Largest number of included files, those that are included several times counted as often."""


def include_all(document: XmlDocument) -> None:
    """Replace each `<include file>` by that file's elements; it is searched beside the main and the including file.

    Raises `InputError` for a missing file, for one that includes itself, and for more than `MOST_FILES`.
    """
    _include(document, document.root, (document.path.resolve(),), [])


def _include(document: XmlDocument, parent: Element, above: Sequence[Path], included: list[Path]) -> None:
    """Expand what is below `parent`, an element of the last file of `above`, which includes the next one each."""
    for child in list(parent):
        if child.tag != "include":
            _include(document, child, above, included)
            continue
        path = _included_file(document, child, above)
        included.append(path)
        if len(included) > MOST_FILES:
            raise InputError(f"{document.place(child)}: more than {MOST_FILES} files are included, expected fewer")
        found = read_document(path)
        document.lines.update(found.lines)
        _include(document, found.root, (*above, path), included)
        at = list(parent).index(child)
        parent.remove(child)
        for k, element in enumerate(found.root):
            parent.insert(at + k, element)


def _included_file(document: XmlDocument, include: Element, above: Sequence[Path]) -> Path:
    name = include.get("file", "").replace("\\", "/")  # as written under Windows, and as MuJoCo reads it
    files = [Path(os.path.realpath(near.parent / name)) for near in (document.path, above[-1])]
    found = next((file for file in files if os.path.isfile(file)), None)
    if found is None or found in above:
        why = "which is not there" if found is None else "which includes itself"
        raise InputError(f"{document.place(include)}: include names {name!r}, {why}")
    return found


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
