"""Which of two searches is believed: the one for few effects, or the one for many, under unknown forces as noise."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import judgement
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.verdict import Kind
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.typing import Array

NOMINAL = Model(np.zeros(0))
FEW = NOMINAL.with_effects((effect_named("joint_coulomb_friction")("elbow"),))
MANY = NOMINAL.with_effects((effect_named("sensor_delay")("v.shoulder"), effect_named("sensor_delay")("v.elbow")))


FRICTION, WORSE = [1.5, 14.1, 4.6, 7.2], [1.5, 14.1, 12.0, 7.2]
SENSORS = [0.18, 0.07, 15.2, 29.8]


@pytest.mark.parametrize(
    ("by_few", "by_many", "kind", "few"),
    [
        pytest.param(FRICTION, SENSORS, "unexplained", True, id="sensors at the cost of forces"),
        pytest.param(WORSE, SENSORS, "unexplained", False, id="both at the cost of forces"),
        pytest.param(FRICTION, SENSORS, "explained", False, id="nothing but small forces remains"),
        pytest.param(FRICTION, [0.18, 0.07, 5.9, 29.8], "unexplained", False, id="nothing made twice as bad"),
        pytest.param(FRICTION, [0.9, 0.8, 1.1, 1.0], "unexplained", False, id="all explained"),
    ],
)
def test_an_explanation_of_some_rows_at_the_cost_of_others(
    by_few: list[float], by_many: list[float], kind: Kind, few: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mean squares of a double pendulum's rows: two that compare positions and velocities, two of its joints' forces.

    Late velocities explained the first two, and with masses half as large as they are the last two were left worse than
    without any effect; friction at both joints, which explains these, had been passed over.
    """
    rows = {NOMINAL.keys: [1.5, 14.1, 5.8, 23.9], FEW.keys: by_few, MANY.keys: by_many}

    def misfit_by_row(_: object, model: Model) -> Array:
        return np.array(rows[model.keys])

    monkeypatch.setattr(judgement, "misfit_by_row", misfit_by_row)
    fits = [cast("Fit", SimpleNamespace(model=model)) for model in (NOMINAL, FEW, MANY)]
    outcome = cast("Outcome", SimpleNamespace(nominal_problem=None, nominal=fits[0], best=fits[1]))
    first = Judgement(outcome, fits[1], "unexplained")
    again = replace(first, best=fits[2], kind=kind)
    assert judgement._explains_little(outcome, again) == few
    preferred = judgement._preference(first, again)
    assert (preferred is not None) == few
    assert preferred is None or "2.621 times as large" in preferred.words
