"""The replay page: what it holds, and the geometry it is drawn with."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from drake_cafim.diagrams import hefting
from drake_cafim.errors import InputError
from drake_cafim.report.lettering import letter
from drake_cafim.report.panel import changes, facing
from drake_cafim.report.replay import make_meshcat, write_replay
from drake_cafim.report.replay_data import BeliefHistory, Candidates, Forces, Motion, Replay
from drake_cafim.typing import Array
from tests.browser import open_page


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    return make_meshcat()


@pytest.fixture(scope="module")
def diagram(meshcat: Meshcat) -> Diagram:
    return hefting.build_world(hefting.load_config(), {}, "drake", meshcat=meshcat)


@pytest.fixture
def replay(diagram: Diagram) -> Replay:
    plant = diagram.GetSubsystemByName("plant")
    rest = plant.GetPositions(plant.CreateDefaultContext())
    time = np.linspace(0.0, 1.0, 11)
    generator = np.random.default_rng(0)
    return Replay(
        title="a test",
        motion=Motion(time, np.tile(rest, (11, 1))),
        forces=Forces(time, np.zeros((11, 1, 3)), np.ones((11, 1, 3))),
        candidates=Candidates(time[:10], generator.normal(size=(10, 4, 6, 3)), np.zeros(10, dtype=int)),
        beliefs=(
            BeliefHistory("mass", "kg", np.array([0.0, 0.5]), np.array([0.065, 0.05]), np.array([0.03, 0.003]), 0.05),
        ),
    )


def test_page_stands_alone(tmp_path: Path, replay: Replay, diagram: Diagram, meshcat: Meshcat) -> None:
    path = tmp_path / "replay.html"
    write_replay(path, replay, diagram, meshcat)
    page = path.read_text()
    assert 2e6 < len(page) < 8e6
    assert not re.search(r'<(script|link)[^>]*(src|href)="https?://', page)


def test_page_in_a_browser(tmp_path: Path, replay: Replay, diagram: Diagram, meshcat: Meshcat) -> None:
    page = tmp_path / "replay.html"
    write_replay(page, replay, diagram, meshcat)
    assert open_page(page).complaints == []


def test_everything_is_drawn(tmp_path: Path, replay: Replay, diagram: Diagram, meshcat: Meshcat) -> None:
    write_replay(tmp_path / "replay.html", replay, diagram, meshcat)
    for place in ("force0/shaft/bar", "plan0/all", "plan9/chosen", "belief0/page0/hill", "belief0/page1/words"):
        assert meshcat.HasPath(f"/replay/{place}")
    assert meshcat.HasPath("/drake/visualizer") or meshcat.HasPath("/drake/illustration")


def test_only_this_machine_can_reach_it(meshcat: Meshcat) -> None:
    assert meshcat.web_url().startswith("http://localhost:")


def test_motion_of_another_plant_is_refused(tmp_path: Path, replay: Replay, diagram: Diagram, meshcat: Meshcat) -> None:
    wrong = replace(replay, motion=Motion(np.zeros(2), np.zeros((2, 3))))
    with pytest.raises(InputError, match=r"positions of shape \(2, 3\), expected \(2, 30\)"):
        write_replay(tmp_path / "replay.html", wrong, diagram, meshcat)
    assert not (tmp_path / "replay.html").exists()


def area(vertices: Array, faces: Array) -> float:
    a, b, c = (vertices[:, faces[corner]] for corner in range(3))
    first, second = b - a, c - a
    return float(0.5 * np.abs(first[0] * second[1] - first[1] * second[0]).sum())


def test_letters_have_holes_and_height() -> None:
    ring, bar = letter("O", height=1.0, bands=60), letter("I", height=1.0)
    assert ring.vertices[1].max() == pytest.approx(1.0, abs=0.05)
    assert bar.vertices[1].max() == pytest.approx(1.0, abs=0.02)
    box = np.ptp(ring.vertices[0]) * np.ptp(ring.vertices[1])
    assert 0.2 < area(ring.vertices, ring.faces) / box < 0.6  # a filled ellipse would be 0.79
    assert letter(" ", height=1.0).faces.shape == (3, 0)


def test_board_is_square_to_the_look() -> None:
    eye, target = np.array([1.5, -0.3, 0.7]), np.array([0.1, 0.2, 0.2])
    X_WB = facing(np.zeros(3), eye, target)
    np.testing.assert_allclose(
        X_WB.rotation().matrix()[:, 2], (eye - target) / np.linalg.norm(eye - target), atol=1e-12
    )
    assert X_WB.rotation().matrix()[2, 0] == pytest.approx(0.0, abs=1e-12)


def test_changes_are_the_first_flag_and_the_turns() -> None:
    times, flags = np.arange(5.0), np.array([False, False, True, True, False])
    assert list(changes(times, flags)) == [(0.0, False), (2.0, True), (4.0, False)]
