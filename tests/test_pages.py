"""Every page in a real browser: complete without a network, no error in the console, the slider moves the scene."""

from pathlib import Path

import pytest

from drake_cafim import Scene
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record, stiff_grease
from drake_cafim.report.artifacts import write_artifacts
from tests.browser import open_page

SLIDE = """const loaded = setInterval(() => {{
  const slider = document.querySelector("#transport input");
  if (slider.max < 2) return;  // the motion is not there yet
  clearInterval(loaded);
  slider.value = {seconds};
  slider.dispatchEvent(new Event("input"));
}}, 50);"""


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that a diagnosis left."""
    folder = tmp_path_factory.mktemp("diagnosed")
    scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
    train, held = [record(stiff_grease, 1)], [record(stiff_grease, 3, "held")]
    verdict, outcome = examine(scene, train, held_out=held)
    write_artifacts(folder, verdict, outcome, train, held, ["cafim", "diagnose"])
    return folder


def test_a_page_that_errs_or_asks_is_caught(tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text('<html><head></head><body><img src="http://elsewhere.org/a.png"></body></html>')
    told = " ".join(open_page(page, "console.error('boom'); missing();").complaints)
    for complaint in ("http://elsewhere.org/a.png", "boom", "missing is not defined"):
        assert complaint in told


def test_report(diagnosed: Path) -> None:
    assert (diagnosed / "report.html").stat().st_size < 3_000_000
    assert open_page(diagnosed / "report.html").complaints == []


def test_the_replay_s_slider_moves_the_scene(diagnosed: Path) -> None:
    page = diagnosed / "replay.html"
    early, late = (open_page(page, SLIDE.format(seconds=seconds)) for seconds in (0.2, 2.3))
    assert early.complaints == late.complaints == []
    assert early.picture != late.picture
