"""Evidence for an effect while other physics is missing too."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.evidence import gain_over_residual, share_improved, shows_difference
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
    while_it_lasts = {"start": 0.0, "stop": 1.0}
    push = ExternalDisturbance("link2", while_it_lasts, "b")
    assert share_improved(RUNS, before, _fit(better_in_b, push)) == 1.0
    assert share_improved(RUNS, before, _fit(better_in_b, ExternalDisturbance("link2", while_it_lasts, "c"))) == 0.0


@pytest.mark.parametrize(("change", "share"), [(4.0, 0.25), (0.1, 1.0)])
def test_recordings_that_do_not_show_an_effect_say_nothing_of_whether_it_helps(change: float, share: float) -> None:
    """It helps in one of four; in the others it is worse by `change` standard deviations of what is left there."""
    before, after = np.full(8, 10.0), np.full(8, 10.0 + 10.0 * change)
    after[2:4] = 1.0
    push, friction = ExternalDisturbance("link2", {"start": 0.0, "stop": 1.0}, "b"), JointViscousFriction("elbow")
    for effects in ((friction,), (push, friction)):
        assert share_improved(RUNS, _fit(before), _fit(after, *effects)) == share


def test_where_no_recording_shows_a_difference_all_count() -> None:
    before, after = np.full(8, 10.0), np.full(8, 10.1)
    after[2:4] = 9.9
    assert share_improved(RUNS, _fit(before), _fit(after, JointViscousFriction("elbow"))) == 0.25


def test_a_difference_shows_by_the_stated_noise_where_less_is_left() -> None:
    """A residual of a hundredth of the noise, and a change of as much."""
    small = np.full(100, 0.01)
    assert not shows_difference(small, 2.0 * small) and shows_difference(small, small + 2.0)


@pytest.mark.parametrize("elsewhere", [1.0, 1000.0])
def test_what_is_missing_elsewhere_weighs_no_gain(elsewhere: float) -> None:
    """Four recordings of two samples and two channels: the first one's χ² falls from 128 to 8, the other's stays."""
    runs: Any = SimpleNamespace(runs=[SimpleNamespace(shape=(2, 2))] * 4, rows=16)

    def fit(first: float, prior: float) -> Any:
        rows = np.tile([first, elsewhere], 8)
        return SimpleNamespace(residual=rows, chi_square=float(rows @ rows) + prior)

    assert gain_over_residual(runs, fit(4.0, 0.0), fit(1.0, 3.0)) == pytest.approx(120.0 - 3.0)
    assert gain_over_residual(runs, fit(8.0, 0.0), fit(2.0, 0.0)) == pytest.approx((512.0 - 32.0) / 4.0)
