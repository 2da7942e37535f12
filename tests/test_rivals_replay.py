"""The page of a motion that tells two explanations apart."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import Scene
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE
from drake_cafim.report.rivals_replay import RivalRun, RivalsReplay, magnified, write_rivals_replay
from tests.browser import open_page

SLIDE = """const loaded = setInterval(() => {{
  const slider = document.querySelector("#transport input");
  if (slider.max < 1.9) return;  // the motion is not there yet
  clearInterval(loaded);
  slider.value = {seconds};
  slider.dispatchEvent(new Event("input"));
}}, 50);
let told = "";
const looking = setInterval(() => {{
  told = [...document.querySelectorAll("#odds b")].map(one => one.textContent).join();
  if (told === {told}) clearInterval(looking);
}}, 50);
setTimeout(() => {{ if (told !== {told}) console.error("tells " + told); }}, 2900);"""


@pytest.fixture
def replay() -> RivalsReplay:
    """A motion of two seconds; where the first holds, it is a thousandth of a radian off at the end."""
    scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
    time = np.linspace(0.0, 2.0, 201)
    q = np.tile(0.5 * np.sin(np.pi * time)[:, None], (1, len(scene.tree.joint_names)))
    known = np.array([0.5, 1.0, 1.5, 2.0])
    runs = (
        RivalRun("bias <here>", q + 5e-4 * time[:, None], known, np.array([-0.7, 1.0, 3.5, 30.0])),
        RivalRun("spring", q, known, np.array([0.0, 0.5, 2.0, 4.0])),
    )
    return RivalsReplay(scene, time, q, runs)


def test_small_departures_are_drawn_larger_and_large_ones_as_they_are(replay: RivalsReplay) -> None:
    small = replay.runs[0].q - replay.q
    times = magnified(replay.scene, replay.q, [small], 1.0)
    assert 100.0 <= times <= 1000.0
    assert magnified(replay.scene, replay.q, [times * small], 1.0) == 1.0
    assert magnified(replay.scene, replay.q, [0.0 * small], 1.0) == 1.0


@pytest.mark.long
def test_the_page_tells_the_odds_at_the_time_that_it_shows(replay: RivalsReplay, tmp_path: Path) -> None:
    page = tmp_path / "replay.html"
    write_rivals_replay(page, replay)
    text = page.read_text()
    assert page.stat().st_size < 3_000_000 and "bias &lt;here&gt;" in text and "bias <here>" not in text
    courses = json.loads(re.search(r"const courses = (\[.*?\]), values", text)[1])  # type: ignore[index]
    assert courses[0] == [[0.0, 0.5, 1.0, 1.5, 2.0], [0.0, -0.7, 1.0, 3.5, 30.0]]
    early = open_page(page, SLIDE.format(seconds=0.6, told=json.dumps("1:2,1:1")))
    late = open_page(page, SLIDE.format(seconds=1.8, told=json.dumps("33:1,7.4:1")))
    assert early.complaints == late.complaints == []
    assert early.picture != late.picture
