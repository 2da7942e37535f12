"""A strength of which the recordings tell too little; a component that they do not show at all is no argument."""

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import NOTHING_KNOWN
from drake_cafim.diagnosis.search.determined import undetermined
from drake_cafim.effects.link import Payload

PAYLOAD = Payload("link1", {"mass": 0.6, "x": 0.1, "y": 0.0, "z": -0.2})
UNSEEN = float(np.sqrt(NOTHING_KNOWN))


@pytest.mark.parametrize(
    ("std", "told"),
    [
        ([0.1, 0.1, 0.1, 0.1], None),
        # a load beside a horizontal axis may stand anywhere along it
        ([0.1, 0.1, UNSEEN, 0.1], None),
        ([0.21, 0.1, UNSEEN, 0.1], ("mass", 0.21)),
        ([0.1, 1.4, UNSEEN, 0.1], ("x", 1.4)),
        ([UNSEEN, UNSEEN, UNSEEN, UNSEEN], ("mass", UNSEEN)),
    ],
)
def test_what_is_not_determined_is_told_and_what_is_not_seen_is_not(
    std: list[float], told: tuple[str, float] | None
) -> None:
    found = undetermined(PAYLOAD, np.array(std), np.array(std))
    assert (None if found is None else found[:2]) == told
