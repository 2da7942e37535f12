"""Fits of a gap in a joint: past the impacts that stop a fit, between the gaps that are tried."""

from pathlib import Path

import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.fitting import fit, unbiased_fit
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.effects.coupling import JointBacklash
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.concealed_case import written


@pytest.mark.long
@pytest.mark.parametrize("times", [2.0, pytest.param(3.5, marks=pytest.mark.long)])
def test_a_gap_is_found_past_the_impacts_that_stop_a_fit(times: float, tmp_path: Path) -> None:
    """From 3.5 times the gap, the flanks of the fit that stops are a hundred times too stiff, and undamped."""
    case = simulate("single:joint_backlash", "arm2", 5)
    case.write(tmp_path)
    prepared = prepare(Scene.load(tmp_path / "scenario.yaml"), [recordings.read(tmp_path / "train_1.parquet")])
    assert isinstance(prepared, Prepared)
    [effect] = case.truth["effects"]
    values = {name: value for name, (value, _) in effect["parameters"].items()}
    problem, gap = prepared.problem(), values["gap"]
    nominal = unbiased_fit(problem, problem.nominal()).model
    start = nominal.with_effects([JointBacklash(effect["at"], {**values, "gap": times * gap})])
    stopped = fit(problem, start)
    found = fit_shapes(problem, stopped)
    assert stopped.model.effects[0].values["gap"] > 1.3 * gap
    assert found.model.effects[0].values["gap"] == pytest.approx(gap, rel=0.02)
    assert found.chi_square < stopped.chi_square - 10.0


@pytest.mark.long
def test_impacts_at_other_times_are_no_echo(tmp_path: Path) -> None:
    """Of a gap in quantised recordings: more noise moves each impact, which is nothing that slopes share with rows."""
    case = simulate("single:joint_backlash", "arm2", 0xB3D9A28268B5389034F0A16A0564BA09)
    scene, read = written(case, tmp_path)
    problem = prepare(scene, read).problem()
    [effect] = case.truth["effects"]
    values = {name: value for name, (value, _) in effect["parameters"].items()}
    nominal = unbiased_fit(problem, problem.nominal()).model
    found = unbiased_fit(problem, nominal.with_effects([JointBacklash(effect["at"], values)]))
    assert not found.echo
    assert found.model.effects[0].values["gap"] == pytest.approx(values["gap"], rel=0.02)


def test_a_gap_between_those_that_are_tried_is_seen(tmp_path: Path) -> None:
    """Of one that a slow motion crosses a few times, a gap a third off is worse than none."""
    scene, read = written(simulate("single:joint_backlash", "arm3", 0x5B4E6BEE27FD3877245773903B9B7C9), tmp_path)
    prepared = prepare(scene, read)
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    [look] = screen(problem, unbiased_fit(problem, problem.nominal()), [JointBacklash("j1", {})])
    assert look.gain > 300.0
    assert look.effect.values["gap"] == pytest.approx(0.0205, rel=0.1)
