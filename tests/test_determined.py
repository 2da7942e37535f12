"""A strength of which the recordings tell too little; a component that they do not show at all is no argument."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import NOTHING_KNOWN, unbiased_fit
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.determined import descend, undetermined
from drake_cafim.effects.friction import JointStribeckFriction
from drake_cafim.effects.link import Payload
from tests import two_links

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


def test_a_law_descends_to_the_simpler_one_where_a_strength_is_not_determined(tmp_path: Path) -> None:
    """Beside a force that nobody knows, a fast motion tells the Coulomb friction, and nothing of a static torque."""
    friction = 0.5
    read = two_links.recording("run", 1, friction=(friction, 0.0), noise=(2e-4, 2e-2, 0.2))
    prepared = prepare(
        two_links.scene(tmp_path, "channels: {q: {std: 2.0e-4}, v: {std: 2.0e-2}, u: {std: 0.2}}"), [read]
    )
    problem = prepared.problem()
    stribeck = JointStribeckFriction("shoulder", {"coulomb": friction, "static": friction, "velocity": 0.05})
    found = unbiased_fit(problem, problem.nominal().with_effects([stribeck]))
    simpler, [descent] = descend(problem, found, problem.hypotheses())
    assert descent.effect.name == "joint_stribeck_friction" and "static" in descent.reason
    [law] = simpler.model.effects
    assert descent.law is not None and law.key == descent.law.key == ("joint_coulomb_friction", "shoulder")
    assert law.values["torque"] == pytest.approx(friction, abs=0.03)
    # one that is determined stays
    assert descend(problem, simpler, problem.hypotheses()) == (simpler, [])
