"""The tutorials run as their reader runs them, and say what they promise."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from drake_cafim.diagrams import tutorials

FOLDER = Path(tutorials.__file__).parent


def run(name: str, *arguments: str, folder: Path) -> str:
    command = [sys.executable, "-m", f"drake_cafim.diagrams.tutorials.{name}", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_own_robot_from_urdf_and_bags_to_a_corrected_simulation(tmp_path: Path) -> None:
    run("stand_in", "robot", folder=tmp_path)
    bags = [f"robot/run_{number}.mcap" for number in (1, 2, 3)]
    said = run("own_robot", "robot/arm.urdf", *bags, folder=tmp_path)
    assert said.startswith("The model lacks joint viscous friction at elbow (coefficient 0.15")
    alone, corrected = (float(number) for number in re.findall(r"off by ([0-9.]+) rad", said))
    assert corrected < 0.002 < 0.1 < alone


def test_own_robot_has_thirty_lines_at_most() -> None:
    code = (FOLDER / "own_robot.py").read_text().split('"""')[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= 30


@pytest.mark.long
def test_own_servo_from_commands_and_positions_to_a_corrected_simulation(tmp_path: Path) -> None:
    run("stand_in_servo", "robot", folder=tmp_path)
    tables = [f"robot/run_{number}.csv" for number in (1, 2, 3)]
    said = run("own_servo", "robot/arm.urdf", *tables, folder=tmp_path)
    told = re.match(r"The model lacks joint coulomb friction at elbow \(torque ([0-9.]+) N m\)\. With that", said)
    assert told is not None and float(told[1]) == pytest.approx(0.4, rel=0.02)
    found = dict(re.findall(r"(servo_\w+ of \w+): ([0-9.]+)", said))
    assert float(found["servo_stiffness of shoulder"]) == pytest.approx(60.0, rel=0.02)
    assert float(found["servo_stiffness of elbow"]) == pytest.approx(25.0, rel=0.02)
    alone, corrected = (float(number) for number in re.findall(r"off by ([0-9.]+) rad", said))
    assert corrected < 0.002 < 0.004 < alone


@pytest.mark.long
def test_own_effect_is_named(tmp_path: Path) -> None:
    said = run("own_effect", folder=tmp_path)
    assert re.match(r"The model lacks joint catch at elbow \(torque 0\.2[45]\d* N m, position 0\.(2|19)", said)


def test_own_diagram_learns(tmp_path: Path) -> None:
    said = run("own_diagram", folder=tmp_path).splitlines()
    first, last = (float(re.findall(r"mass [0-9.]+ ± ([0-9.]+)", line)[0]) for line in (said[0], said[-2]))
    assert last < 0.1 * first


def test_every_tutorial_is_listed_and_tested() -> None:
    names = {path.stem for path in FOLDER.glob("own_*.py")}
    assert names == set(re.findall(r"`(own_\w+)`", tutorials.__doc__ or ""))
    assert names == set(re.findall(r'run\("(own_\w+)"', Path(__file__).read_text()))
