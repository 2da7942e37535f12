"""Changes of an XML file that leave every other byte as it was: comments, spaces, prefixes without a namespace."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from drake_cafim.errors import InputError


@dataclass(eq=False)
class Node:
    """An element: its `tag`, its children, and where its text stands in the file; `get` and `find` as ElementTree's."""

    tag: str
    attributes: dict[str, str]
    parent: "Node | None"
    opening: str
    """The text of the start tag."""
    start: int
    stop: int
    """The bytes of the start tag, from `start` to before `stop`; `closing` is where the end tag begins."""
    closing: int = 0
    children: list["Node"] = field(default_factory=list)
    content: str | None = None
    """A new text of the element, in place of the old one."""
    first: list[str] = field(default_factory=list)
    """New elements before the others, as XML."""
    last: list[str] = field(default_factory=list)
    """New elements after the others."""

    def get(self, name: str, default: str = "") -> str:
        return self.attributes.get(name, default)

    def findall(self, path: str) -> list["Node"]:
        """The elements at `path`, tags with slashes."""
        found = [self]
        for tag in path.split("/"):
            found = [child for node in found for child in node.children if child.tag == tag]
        return found

    def find(self, path: str) -> "Node | None":
        return next(iter(self.findall(path)), None)

    def iter(self, tag: str) -> Iterator["Node"]:
        """This element and those below it that have the tag."""
        if self.tag == tag:
            yield self
        for child in self.children:
            yield from child.iter(tag)

    @property
    def empty(self) -> bool:
        """Whether it is written as <tag/>."""
        return self.opening.endswith("/>")

    def set(self, name: str, value: str) -> None:
        """Give an attribute this value, in its place where the element has it."""
        self.attributes[name] = value
        written = f"{name}={quoteattr(value)}"
        pattern = re.compile(rf"(?<=\s){re.escape(name)}\s*=\s*(\"[^\"]*\"|'[^']*')")
        if pattern.search(self.opening):
            self.opening = pattern.sub(lambda _: written, self.opening, count=1)
        else:
            end = 2 if self.empty else 1
            self.opening = f"{self.opening[:-end].rstrip()} {written}{self.opening[-end:]}"

    def remove(self, name: str) -> None:
        """Remove an attribute, where the element has it."""
        self.attributes.pop(name, None)
        self.opening = re.sub(rf"\s+{re.escape(name)}\s*=\s*(\"[^\"]*\"|'[^']*')", "", self.opening, count=1)


@dataclass
class XmlText:
    """A file's bytes and its elements."""

    path: Path
    source: bytes
    root: Node

    def text_of(self, node: Node) -> str:
        """The element's text, without children."""
        return "" if node.empty else self.source[node.stop : node.closing].decode("utf-8").split("<")[0].strip()

    def written(self) -> bytes:
        """The file with the changes."""
        pieces: list[tuple[int, int, str]] = []
        for node in _all(self.root):
            more = [*node.first, *node.last]
            opening = node.opening
            if node.empty and (more or node.content is not None):
                inside = escape(node.content or "") + "".join(self._placed(node, xml) for xml in more)
                end = f"</{node.tag}>"
                pieces.append(
                    (node.start, node.stop, f"{opening[:-2].rstrip()}>{inside}{self._under(node, more)}{end}")
                )
                continue
            pieces.append((node.start, node.stop, opening + "".join(self._placed(node, xml) for xml in node.first)))
            if node.content is not None:
                pieces.append((node.stop, node.closing, escape(node.content)))
            if node.last:
                at = node.stop + len(self.source[node.stop : node.closing].rstrip())
                pieces.append((at, at, "".join(self._placed(node, xml) for xml in node.last)))
        result, position = b"", 0
        for start, stop, text in sorted(pieces, key=lambda piece: piece[:2]):
            result += self.source[position:start] + text.encode("utf-8")
            position = stop
        return result + self.source[position:]

    def _indent(self, node: Node) -> str:
        """The spaces before the element, where it begins its line."""
        line = self.source[: node.start].rsplit(b"\n", 1)[-1].decode("utf-8")
        return line if not line.strip() else ""

    def _placed(self, node: Node, xml: str) -> str:
        return f"\n{self._indent(node)}  {xml}"

    def _under(self, node: Node, more: list[str]) -> str:
        return f"\n{self._indent(node)}" if more else ""


def read_xml_text(path: Path) -> XmlText:
    """The file's elements. Raises `InputError` for a file that cannot be read, is not XML, or not UTF-8."""
    try:
        source = path.read_bytes()
        source.decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}), expected a model file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: its text is not UTF-8, expected that for an export") from None
    return XmlText(path, source, _root(source, path))


def _root(source: bytes, path: Path) -> Node:
    parser = expat.ParserCreate()
    stack: list[Node] = []
    roots: list[Node] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        stop = _end_of_tag(source, at)
        node = Node(tag, dict(attributes), stack[-1] if stack else None, source[at:stop].decode("utf-8"), at, stop)
        (stack[-1].children if stack else roots).append(node)
        stack.append(node)

    def end(tag: str) -> None:
        node = stack.pop()
        node.closing = node.stop if node.empty else parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(source, True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: not readable as XML ({error}), expected a model file") from None
    return roots[0]


def _end_of_tag(source: bytes, at: int) -> int:
    """The position after the `>` of the start tag at `at`; a `>` within quotes does not end it."""
    quote = 0
    for position in range(at, len(source)):
        byte = source[position]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in (0x22, 0x27):
            quote = byte
        elif byte == 0x3E:
            return position + 1
    return len(source)


def _all(node: Node) -> Iterator[Node]:
    yield node
    for child in node.children:
        yield from _all(child)


def number(value: float) -> str:
    """The shortest text from which the number is read again."""
    return repr(float(value))


def numbers(values: "list[float] | tuple[float, ...]") -> str:
    """Numbers with spaces between them."""
    return " ".join(number(value) for value in values)
