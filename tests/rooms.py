"""The graph of imports between the rooms of a checkout, as data and as an SVG.

    python -m tests.rooms drake_cafim diagrams/pictures/rooms.svg [TITLE]

draws the package that stands at the path: one box a room, each below all that it imports from; red are arrows that
go back up, as between rooms that import each other. With `--before COMMIT` the package is that of a commit.
"""

import ast
import subprocess
import sys
import tarfile
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path

Edges = Mapping[tuple[str, str], int]
"""How many imports lead from a room to another."""
ROOT = "drake_cafim"
SUBROOMS = "diagnosis"
"""A room whose own rooms stand on their own."""
APART = ("diagrams", "models", "__init__", "__main__", "typing", "errors", "output", "yaml_file")
"""Not drawn: examples that may know everything, and leaves that everything may know."""


def room(module: str, rooms_of_one: bool = True) -> str | None:
    """The room of a module, as "effects" or "diagnosis.fit"; None for what is not drawn.

    A file of the diagnosis that stands in none of its rooms is one itself, or else, not `rooms_of_one`, in the hall.
    """
    parts = module.split(".")[1:]
    if not parts or parts[0] in APART:
        return None
    if parts[0] == SUBROOMS and len(parts) > (1 if rooms_of_one else 2):
        return ".".join(parts[:2])
    return parts[0]


def imports(package: Path) -> Edges:
    """The imports between the rooms of a package."""
    edges: Counter[tuple[str, str]] = Counter()
    few = len(list((package / SUBROOMS).glob("*.py"))) < 8
    for path in sorted(package.rglob("*.py")):
        module = ".".join((ROOT, *path.relative_to(package).with_suffix("").parts))
        here = room(module.removesuffix(".__init__"), few)
        for name in _imported(ast.parse(path.read_text())):
            there = room(name, few)
            if here is not None and there is not None and here != there:
                edges[here, there] += 1
    return edges


def _imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.module.split(".")[0] == ROOT:
            # of a room itself, the names are its files
            whole = node.module.count(".") < 2
            yield from (f"{node.module}.{leaf.name}" for leaf in node.names) if whole else (node.module,)


def floors(edges: Edges) -> dict[str, int]:
    """How high each room stands: above all that it imports from; arrows that close a circle do not count."""
    below: dict[str, set[str]] = {name: set() for edge in edges for name in edge}
    for here, there in edges:
        if (there, here) not in edges or edges[here, there] > edges[there, here]:
            below[here].add(there)
    found: dict[str, int] = {}

    def height(name: str, above: tuple[str, ...] = ()) -> int:
        if name not in found:
            under = [lower for lower in below[name] if lower not in above]
            found[name] = 1 + max((height(lower, (*above, name)) for lower in under), default=-1)
        return found[name]

    for name in sorted(below):
        height(name)
    return found


def upward(edges: Edges) -> list[tuple[str, str]]:
    """The arrows that lead to a room that stands no lower: circles of rooms."""
    level = floors(edges)
    return sorted((here, there) for here, there in edges if level[there] >= level[here])


WIDTH, HEIGHT, ACROSS, DOWN = 112, 24, 128, 62


def svg(edges: Edges, title: str) -> str:
    """The graph, the highest rooms on top."""
    level = floors(edges)
    top = max(level.values())
    rows = [sorted(name for name, own in level.items() if own == k) for k in range(top, -1, -1)]
    widest = max(len(row) for row in rows)
    places = {
        name: (20 + (widest - len(row)) * ACROSS / 2 + i * ACROSS, 44 + r * DOWN)
        for r, row in enumerate(rows)
        for i, name in enumerate(row)
    }
    wrong = set(upward(edges))
    size = (40 + widest * ACROSS, 60 + len(rows) * DOWN)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="12">',
        f'<rect width="{size[0]}" height="{size[1]}" fill="#ffffff"/>',
        f'<text x="20" y="24" font-size="15" fill="#222222">{title}</text>',
    ]
    for here, there in sorted(edges, key=lambda edge: edge in wrong):
        (x, y), (u, w) = places[here], places[there]
        start, end = (x + WIDTH / 2, y + HEIGHT), (u + WIDTH / 2, w)
        if (here, there) in wrong:
            start, end = (x + WIDTH / 2, y), (u + WIDTH / 2, w + HEIGHT)
        middle = 0.5 * (start[1] + end[1])
        colour, width = ("#c2281c", 2.2) if (here, there) in wrong else ("#7a8794", 0.7)
        look = f'stroke="{colour}" stroke-width="{width}"'
        parts.append(
            f'<path d="M{start[0]:.0f} {start[1]:.0f} C{start[0]:.0f} {middle:.0f} {end[0]:.0f} {middle:.0f} '
            f'{end[0]:.0f} {end[1]:.0f}" fill="none" {look} opacity="0.75"/>'
        )
    for name, (x, y) in sorted(places.items()):
        fill = "#dcebf7" if name.startswith(SUBROOMS) else "#f2f2ee"
        box = f'width="{WIDTH}" height="{HEIGHT}" rx="4" fill="{fill}" stroke="#555"'
        parts.append(f'<rect x="{x:.0f}" y="{y:.0f}" {box}/>')
        label = name.replace(f"{SUBROOMS}.", "")
        parts.append(f'<text x="{x + WIDTH / 2:.0f}" y="{y + 16:.0f}" text-anchor="middle">{label}</text>')
    return "\n".join([*parts, "</svg>", ""])


def checked_out(commit: str, folder: Path) -> Path:
    """The package as it was at a commit."""
    archive = subprocess.run(["git", "archive", commit, ROOT], check=True, capture_output=True).stdout
    with tarfile.open(fileobj=BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")
    return folder / ROOT


def main(arguments: list[str]) -> None:
    """See the module's first lines."""
    commit = arguments[arguments.index("--before") + 1] if "--before" in arguments else None
    plain = [argument for argument in arguments if argument not in ("--before", commit)]
    with tempfile.TemporaryDirectory() as folder:
        package = checked_out(commit, Path(folder)) if commit else Path(plain[0])
        edges = imports(package)
    Path(plain[1]).write_text(svg(edges, plain[2] if len(plain) > 2 else "rooms and what they import"))


if __name__ == "__main__":
    main(sys.argv[1:])
