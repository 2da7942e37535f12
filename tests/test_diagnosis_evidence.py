"""What counts as evidence beside other things that are missing."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from drake_cafim.diagnosis.evidence import repeated
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.typing import Array

RUNS: Any = SimpleNamespace(runs=[SimpleNamespace(name=name, shape=(2, 1)) for name in "abcd"], rows=8)


def _fit(rows: Array, *effects: object) -> Any:
    return SimpleNamespace(residual=rows, model=SimpleNamespace(effects=effects))


def test_a_push_counts_in_the_recording_that_it_is_in() -> None:
    before = _fit(np.full(8, 10.0))
    better_in_b = np.full(8, 10.1)
    better_in_b[2:4] = 1.0
    push = ExternalDisturbance("link2", {}, "b")
    assert repeated(RUNS, before, _fit(better_in_b, push))
    assert not repeated(RUNS, before, _fit(better_in_b, ExternalDisturbance("link2", {}, "c")))
    assert not repeated(RUNS, before, _fit(better_in_b, JointViscousFriction("elbow")))
    assert not repeated(RUNS, before, _fit(better_in_b, push, JointViscousFriction("elbow")))
