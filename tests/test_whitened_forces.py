"""Forces at joints are whitened together, and those that come again are not whitened again."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.whitening import joint_forces as module
from drake_cafim.diagnosis.whitening.joint_forces import WhitenedForces
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.actuator import ActuatorLag
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.typing import Array
from tests import two_links


def _problem(folder: Path) -> WeakProblem:
    recordings = [two_links.recording("short", 1, duration=1.0), two_links.recording("long", 2, duration=2.0)]
    problem = prepare(two_links.scene(folder), recordings).problem()
    assert isinstance(problem, WeakProblem)
    return problem


def test_each_force_has_the_rows_that_it_has_alone(tmp_path: Path) -> None:
    problem, rng = _problem(tmp_path), np.random.default_rng(0)
    asked = [
        (joint, [rng.standard_normal((run.shape[0], width)) for run in problem.runs])
        for joint, width in ((0, 1), (1, 3), (0, 2))
    ]
    # one again, and one at another joint
    asked += [asked[0], (1, asked[0][1])]
    together = WhitenedForces().of(problem.runs, asked)
    for (joint, parts), found in zip(asked, together, strict=True):
        expected = []
        for run, part in zip(problem.runs, parts, strict=True):
            rows = np.zeros((*run.shape, part.shape[1]))
            rows[:, run.weak.dynamic.start + joint] = part
            expected.append(run.whitened(rows))
        assert np.allclose(found, np.concatenate(expected), rtol=1e-9, atol=1e-12)


def test_only_what_has_changed_is_whitened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A law that is linear in its strengths has the same slopes whatever these are."""
    problem, widths = _problem(tmp_path), list[int]()
    whitened = module._whitened

    def counting(run: Run, at: int, forces: list[module.Forces]) -> Array:
        widths.append(sum(parts[at].shape[1] for _, parts in forces))
        return whitened(run, at, forces)

    monkeypatch.setattr(module, "_whitened", counting)
    drag, rub = JointViscousFriction("elbow", {"coefficient": 0.1}), JointCoulombFriction("shoulder", {"torque": 0.2})
    model = Model(np.ones(1), (drag, rub))
    first = problem.jacobian(model)
    assert widths == [2] * len(problem.runs)
    widths.clear()
    moved = model.at(model.vector * np.array([1.0, 1.3, 1.2]))
    assert np.array_equal(problem.jacobian(moved), first)
    assert not widths
    problem.forget()
    assert np.array_equal(problem.jacobian(model), first) and len(widths) == len(problem.runs)


def test_beside_an_unknown_initial_state_they_are_marginalised(tmp_path: Path) -> None:
    problem = _problem(tmp_path)
    drag, lag = JointViscousFriction("elbow", {"coefficient": 0.1}), ActuatorLag("elbow", {"time_constant": 0.02})
    model = Model(np.ones(1), (drag, lag))
    alone = problem.jacobian(Model(np.ones(1), (drag,)))
    together = problem.jacobian(model)
    assert np.allclose(together[:, 1:2], problem.effect_columns(model, 0), rtol=1e-12, atol=0.0)
    assert not np.allclose(together[:, 1], alone[:, 1], rtol=1e-6)


def test_few_forces_are_kept(tmp_path: Path) -> None:
    problem, kept = _problem(tmp_path), WhitenedForces()
    for value in range(module.KEPT + 3):
        kept.of(problem.runs, [(0, [np.full((run.shape[0], 1), float(value)) for run in problem.runs])])
    assert len(kept.known) == module.KEPT
