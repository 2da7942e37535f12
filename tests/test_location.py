"""Location of missing physics: a push is located to within its own length before any effect is named."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.excess import Excess, count_blocks, significant_blocks
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.parametrize import long_after


@pytest.mark.parametrize("seed", long_after(1, [12, 2, 6, 7, 9]))
def test_a_push_is_located_in_time(seed: int, tmp_path: Path) -> None:
    """Pushes that stand far above the noise, one of them at the very end."""
    case = simulate("single:external_disturbance", "arm3", seed)
    case.write(tmp_path)
    [effect] = case.truth["effects"]
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / effect["recording"])])
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    true = case.truth["nominal_parameters_true"]
    unknown = np.array([true[f"{parameter.parameter}.{parameter.at}"] for parameter in scene.unknown])
    locations = problem.locate(Model(unknown))
    begun, ended = effect["interval"]
    overlaps = [
        max(0.0, min(stop, ended) - max(start, begun)) / (max(stop, ended) - min(start, begun))
        for location in locations
        for start, stop in location.intervals
    ]
    assert max(overlaps) >= 0.7


@pytest.mark.parametrize("shape", [(61,), (61, 6)])
def test_what_stands_out_at_the_very_end_is_seen(shape: tuple[int, ...]) -> None:
    """Of joints, whose rows are looked at one by one, and of throws, whose six rows are looked at together."""
    squares = np.random.default_rng(1).standard_normal(shape) ** 2
    blocks = count_blocks(len(squares))
    assert list(significant_blocks(squares, blocks)) == []
    squares[-3:] += 20.0
    (last,) = significant_blocks(squares, blocks)
    assert (last.start, min(last.stop, 61)) == (53, 61)


def test_a_recording_of_few_windows_stands_out_by_its_excess_only() -> None:
    squares = np.random.default_rng(1).standard_normal(4) ** 2
    assert list(significant_blocks(squares, count_blocks(4))) == []
    assert len(list(significant_blocks(squares + 20.0, count_blocks(4)))) == 1


def test_places_are_ordered_by_their_share_of_the_excess() -> None:
    weak, strong, faint, quiet = (("joint", name) for name in ("weak", "strong", "faint", "quiet"))
    excess = Excess.at([weak, strong, faint, quiet])
    for place, level in ((weak, 3.0), (strong, 6.0), (faint, 1.001), (quiet, 0.5)):
        excess.add(place, np.full(100, level))
        excess.show(place, "a", [(0.0, 1.0)])
    excess.show(strong, "b", [(3.0, 4.0), (1.0, 2.0), (2.0, 3.0)])
    found = excess.locations(["a", "b"], lambda place: f"while {place[1]}")
    # 500.1 and 200 of 700.1 beyond what noise gives; the faint one holds less than a hundredth of that
    assert [(push.name, push.recording, push.intervals) for push in found] == [
        ("strong", "a", ((0.0, 1.0),)),
        ("strong", "b", ((1.0, 4.0),)),
        ("weak", "a", ((0.0, 1.0),)),
    ]
    assert [push.share for push in found] == pytest.approx([250.0 / 700.1, 250.0 / 700.1, 200.0 / 700.1])
