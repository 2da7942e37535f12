"""The benchmark of confusable pairs, without its designs."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.discrimination.design import Designer
from drake_cafim.discrimination.hypotheses import parsed
from tests.benchmarks.confusable import GROUPS, Group, random_motion, sized
from tests.benchmarks.discrimination import POLICIES, STRENGTHS, UNKNOWNS, line, summary


@pytest.mark.parametrize("group", GROUPS, ids=lambda pair: pair.slug)
def test_every_explanation_shows_on_its_machine(group: Group, tmp_path: Path) -> None:
    designer = Designer.of(group.scene(tmp_path), group.shape)
    scene = designer.scene
    problem = designer.problem(random_motion(designer, np.random.default_rng(0)))
    nominal = problem.residual(problem.nominal())[: problem.rows]
    for word in group.explanations:
        large = Model(scene.priors.mean, (sized(parsed(scene, word), 3.0, scene),))
        assert float(np.linalg.norm(problem.residual(large)[: problem.rows] - nominal)) > 5.0, word


def test_a_group_takes_as_long_as_its_longest_explanation() -> None:
    times = {policy: [[1.0, 2.0, 9.0], [3.0, 1.0, 1.0]] for policy in POLICIES}
    times["random"] = [[9.0, 9.0, 9.0], [9.0, 9.0, 9.0]]
    times[UNKNOWNS] = [[4.0, 5.0, 6.0], [1.0, 1.0, 1.0]]
    times[STRENGTHS] = [[4.0, 4.0, 4.0], [1.0, 1.0, 1.0]]
    result = {"group": "one, other", "times": times}
    medians = {"designed": 3.0, UNKNOWNS: 5.0, STRENGTHS: 4.0, "random": 9.0, "ever new": 3.0}
    assert summary(result) == medians
    assert line(result).split(maxsplit=2)[2].split() == (
        ["3.00", "5.00", "(0.60", "holds)", "4.00", "(0.75", "does", "not)", "9.00", "(0.33", "holds)", "1.00"]
    )
