"""Unknown random forces: the estimate of their strength, and the effects that are found beside them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.unknown_force import force_density
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.judgement import judge
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.recordings.recording import Recording
from tests.concealed.make import simulate
from tests.concealed_case import written

FRICTION_SHAKEN, CONTACT_SHAKEN = 0xBC0AB4C908B26B5A7C5B95B49992FB47, 0x874F9EC31879AA739C764031741DB642
"""Seeds of worlds with unknown forces at the joints."""
DENSITY = 2e-4
"""(N m)² s: 0.06 N m over 60 ms."""


def _shaken(recording: Recording, joint: str, seed: int) -> Recording:
    """A recording whose efforts at `joint` leave out a white part of what acted there."""
    std = float(np.sqrt(DENSITY / np.median(np.diff(recording.time))))
    hidden = std * np.random.default_rng(seed).standard_normal(len(recording.time))
    return replace(recording, columns={**recording.columns, f"u.{joint}": recording[f"u.{joint}"] - hidden})


def _problem(folder: Path, shaken: bool) -> tuple[WeakProblem, str]:
    scene, read = written(simulate("null", "arm2", 11), folder)
    joint = scene.tree.joint_names[0]
    if shaken:
        read = [_shaken(recording, joint, seed) for seed, recording in enumerate(read)]
    problem = prepare(scene, read).problem()
    assert isinstance(problem, WeakProblem)
    return problem, joint


def test_the_density_is_the_one_that_was_hidden(tmp_path: Path) -> None:
    problem, joint = _problem(tmp_path, shaken=True)
    nominal = unbiased_fit(problem, problem.nominal())
    density = force_density(problem, nominal.model)
    # of some 600 windows, whose squares are known to a twentieth
    assert density[0] == pytest.approx(DENSITY, rel=0.15)
    # a mass that was fitted as if nothing were hidden leaves a force of 6e-4 of it there
    assert density[1] < 5e-5 * DENSITY
    assert not leaves_noise(problem, nominal, 0.01)
    own = problem.with_unknown_force(density, nominal.model)
    assert leaves_noise(own, unbiased_fit(own, nominal.model), 0.01)
    [remark] = own.force_remarks
    assert joint in remark and "0.12 s" in remark


def test_where_nothing_shakes_there_is_none(tmp_path: Path) -> None:
    problem, _ = _problem(tmp_path, shaken=False)
    nominal = unbiased_fit(problem, problem.nominal())
    density = force_density(problem, nominal.model)
    assert np.all(density < 0.02 * DENSITY)
    assert problem.with_unknown_force(density, nominal.model).force_remarks == ()


@pytest.mark.long
def test_an_effect_is_told_from_the_forces_beside_it(tmp_path: Path) -> None:
    """Of an arm whose joints are shaken by less than a ten-thousandth of their efforts."""
    scene, read = written(simulate("single:joint_viscous_friction", "arm7", FRICTION_SHAKEN), tmp_path)
    verdict = diagnose(scene, read[:1])
    assert verdict.kind == "explained"
    assert [(accepted.effect.name, accepted.effect.at) for accepted in verdict.explanation] == [
        ("joint_viscous_friction", "joint_7")
    ]
    # a model need not be righter than that, so these forces are no news
    assert not any("unknown random forces" in remark for remark in verdict.noise_remarks)


@pytest.mark.long
def test_a_force_alone_is_no_effect(tmp_path: Path) -> None:
    problem, _ = _problem(tmp_path, shaken=True)
    found = judge(problem, Settings(), lambda text: None)
    assert found.kind == "unexplained" and not found.best.model.effects


@pytest.mark.long
def test_a_contact_is_found_beside_forces(tmp_path: Path) -> None:
    """Of an arm with unknown random efforts."""
    case = simulate("single:unmodeled_contact", "arm3", CONTACT_SHAKEN)
    scene, read = written(case, tmp_path)
    verdict = diagnose(scene, read)
    assert verdict.kind == "explained"
    [effect] = case.truth["effects"]
    [found] = verdict.explanation
    assert (found.effect.name, found.effect.at) == (effect["effect"], effect["at"])
