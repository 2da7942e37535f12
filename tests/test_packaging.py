"""The wheel holds the whole package, and works in an empty environment outside the tree."""

import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(out), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    (path,) = out.glob("*.whl")
    return path


def test_wheel_has_every_module_and_every_file_of_the_tree(wheel: Path) -> None:
    suffixes = {".py", ".typed", ".yaml", ".xml", ".urdf", ".sdf", ".html", ".css", ".js", ".j2"}
    expected = set()
    for top, inside in (
        ("drake_cafim", "drake_cafim"),
        ("diagrams", "drake_cafim/diagrams"),
        ("models", "drake_cafim/models"),
    ):
        for path in (ROOT / top).rglob("*"):
            relative = path.relative_to(ROOT / top)
            linked = top == "drake_cafim" and relative.parts[0] in ("diagrams", "models")
            if path.is_file() and path.suffix in suffixes and "__pycache__" not in path.parts and not linked:
                expected.add(f"{inside}/{relative}")
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert expected - names == set()
    assert not any(name.startswith(("diagrams/", "models/", "tests/")) for name in names)


def test_wheel_runs_outside_the_tree(wheel: Path, tmp_path: Path) -> None:
    # without a pip of its own, and nothing compiled that is not used: that would take most of the time
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / "bin" / "python"
    install = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--quiet",
        "--no-compile",
        "--constraint",
        str(ROOT / "constraints.txt"),
        str(wheel),
    ]
    subprocess.run(install, check=True)
    script = (
        "from pydrake.multibody.parsing import Parser\n"
        "from pydrake.multibody.plant import MultibodyPlant\n"
        "from drake_cafim.models import add_to_package_map\n"
        "import drake_cafim\n"
        "assert 'site-packages' in drake_cafim.__file__, drake_cafim.__file__\n"
        "plant = MultibodyPlant(0.0)\n"
        "parser = Parser(plant)\n"
        "add_to_package_map(parser)\n"
        "parser.AddModelsFromUrl('package://drake_cafim_models/arm7.urdf')\n"
        "plant.Finalize()\n"
        "assert plant.num_actuators() == 7\n"
    )
    subprocess.run([str(python), "-I", "-c", script], check=True, cwd=tmp_path)
    subprocess.run([str(tmp_path / "env" / "bin" / "cafim"), "--help"], check=True, cwd=tmp_path, capture_output=True)
