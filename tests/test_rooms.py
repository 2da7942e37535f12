"""The rooms of the package: what the figure in the README shows, and how large a room, a file and a class may be."""

import ast
from collections import Counter
from pathlib import Path

import pytest

import drake_cafim
from drake_cafim.effects.catalogue import EFFECTS
from tests.rooms import floors, imports, svg, upward

PACKAGE = Path(drake_cafim.__file__).parent
DIAGNOSIS = sorted((PACKAGE / "diagnosis").rglob("*.py"))
PICTURES = PACKAGE.parent / "diagrams" / "pictures"
MOST_FILES, MOST_LINES, MOST_METHODS = 25, 400, 20


def test_no_arrow_leads_back_up() -> None:
    edges = imports(PACKAGE)
    assert ("diagnosis.search", "diagnosis.fit") in edges and ("corrected", "scenario") in edges
    assert upward(edges) == []


def test_a_circle_is_seen() -> None:
    edges = {("a", "b"): 3, ("b", "a"): 1, ("b", "c"): 1}
    assert upward(edges) == [("b", "a")]
    assert floors(edges) == {"a": 2, "b": 1, "c": 0}
    assert 'stroke="#c2281c"' in svg(edges, "two that import each other")


def test_the_figures_show_before_and_after() -> None:
    before, after = ((PICTURES / name).read_text() for name in ("rooms_before.svg", "rooms.svg"))
    assert "#c2281c" in before and "#c2281c" not in after
    assert all(f">{name.replace('diagnosis.', '')}</text>" in after for name in floors(imports(PACKAGE)))


@pytest.mark.parametrize("path", DIAGNOSIS, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_file_and_no_class_of_the_diagnosis_grows_too_large(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= MOST_LINES
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef):
            methods = [member.name for member in node.body if isinstance(member, ast.FunctionDef)]
            assert len(methods) <= MOST_METHODS, f"{node.name}: {len(methods)}"


def test_no_room_of_the_diagnosis_grows_too_large() -> None:
    rooms = Counter(path.parent for path in DIAGNOSIS)
    assert max(rooms.values()) <= MOST_FILES, rooms.most_common(1)


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_nobody_asks_what_class_an_effect_or_a_problem_is_of(path: Path) -> None:
    """Outside their rooms: rooms that treat kinds differently have an answer a kind, `effects.kinds.ByKind`."""
    if path.relative_to(PACKAGE).parts[0] in ("effects", "diagrams"):
        return
    tree = ast.parse(path.read_text())
    effects = {
        leaf.asname or leaf.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("drake_cafim.effects.")
        for leaf in node.names
    } | {"WeakProblem", "TossProblem", "Prepared", "PreparedTosses"}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in ("isinstance", "issubclass")
        ):
            asked = {leaf.id for leaf in ast.walk(node.args[1]) if isinstance(leaf, ast.Name)}
            assert not asked & effects, f"line {node.lineno}: {', '.join(asked & effects)}"
        if isinstance(node, ast.Compare):
            sides = [leaf for leaf in ast.walk(node) if isinstance(leaf, ast.Call) and isinstance(leaf.func, ast.Name)]
            types = any(leaf.func.id == "type" for leaf in sides if isinstance(leaf.func, ast.Name))
            asked = {leaf.id for leaf in ast.walk(node) if isinstance(leaf, ast.Name)}
            assert not (types and asked & effects), f"line {node.lineno}: {', '.join(asked & effects)}"


@pytest.mark.parametrize("room", ["diagnosis", "report", "scene", "corrected", "discrimination", "commands"])
def test_nobody_asks_for_an_effect_by_its_name(room: str) -> None:
    """A comparison with a name is a question for the class: a subclass, or an effect of one's own, has another one."""
    names = {effect.name for effect in EFFECTS}
    for path in sorted((PACKAGE / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Compare):
                asked = {leaf.value for leaf in ast.walk(node) if isinstance(leaf, ast.Constant)} & names
                assert not asked, f"{path.relative_to(PACKAGE)}, line {node.lineno}: {', '.join(asked)}"


@pytest.mark.parametrize("folder", ["drake_cafim", "diagrams", "tests"])
def test_no_variable_is_called_one(folder: str) -> None:
    """A name says what it holds; "one" says that there are several."""
    for path in sorted((PACKAGE.parent / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            named = node.id if isinstance(node, ast.Name) else node.arg if isinstance(node, ast.arg) else ""
            assert named != "one", f"{path.relative_to(PACKAGE.parent)}"
