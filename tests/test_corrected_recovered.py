"""Each effect, simulated by Drake, is named from its own recording, and the corrected scene reproduces it in Drake."""

from pathlib import Path

import pytest

from drake_cafim.effects.catalogue import EFFECTS
from tests.recoveries.cases import CASES, Case
from tests.recoveries.recovery import recovered, sentences


def test_the_whole_vocabulary_is_tried() -> None:
    assert sorted(case.name for case in CASES) == sorted(effect.name for effect in EFFECTS)
    assert len(CASES) == 49


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_found_in_its_own_recording(case: Case, tmp_path: Path) -> None:
    assert not sentences(recovered(case, tmp_path))
