"""Rows each over its own standard deviation: what is left at one place is not that of another."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.without_effects import residual_without, share_of_excess, share_removed
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.search_under_unknown_force import geometric_misfit
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.typing import Array
from tests.concealed.make import simulate
from tests.concealed_case import written

PUSHED, RUBBED = 1.0, 0.03
"""N m at the elbow, back and forth, which nobody knows, and of the shoulder's dry friction, which is fitted."""


@pytest.fixture(scope="module")
def explained(tmp_path_factory: pytest.TempPathFactory) -> tuple[WeakProblem, Fit]:
    """Rows of two joints of which one has an effect that is fitted, and the other one that is not."""
    scene, read = written(simulate("null", "arm2", 12), tmp_path_factory.mktemp("apart"))
    shoulder, elbow = scene.tree.joint_names[:2]
    parts = []
    for part in read:
        pushed = part[f"u.{elbow}"] + PUSHED * np.sign(np.sin(40.0 * part.time))
        rubbed = part[f"u.{shoulder}"] + RUBBED * np.sign(part[f"v.{shoulder}"])
        parts.append(replace(part, columns={**part.columns, f"u.{elbow}": pushed, f"u.{shoulder}": rubbed}))
    problem = prepare(scene, parts).problem()
    assert isinstance(problem, WeakProblem)
    own = problem.rewhitened(problem.nominal())
    friction = effect_named("joint_coulomb_friction")(shoulder, {"torque": 0.1})
    return own, fit(own, own.nominal().with_effects([friction]))


def test_what_is_left_at_a_joint_does_not_spread_to_its_sensors(explained: tuple[WeakProblem, Fit]) -> None:
    own, found = explained
    rows = own.rows_of(found.model)

    def mean_squares(values: Array) -> Array:
        return np.asarray(np.mean(np.concatenate([z for _, z in by_run(own, values)]) ** 2, axis=0))

    whitened, apart = mean_squares(rows), mean_squares(own.apart(rows))
    # nothing is wrong with the sensors, whose rows come first
    sensors = slice(0, own.runs[0].weak.kinematic_rows)
    assert np.all(whitened[sensors] > 50.0)
    assert np.all(apart[sensors] < 1.3)
    assert apart[-1] > 1e4


def test_an_effect_removes_its_share_whatever_is_left_at_another_joint(explained: tuple[WeakProblem, Fit]) -> None:
    own, found = explained
    [friction] = found.model.effects
    assert share_removed(own, found.residual, residual_without(found, friction)) > 0.85


def test_one_joints_misfit_counts_once(explained: tuple[WeakProblem, Fit]) -> None:
    """Of four kinds of rows one has a mean square of some 1e5, which a geometric mean takes to 18."""
    assert geometric_misfit(*explained) < 50.0


def test_noise_of_the_channels_is_no_excess_that_an_effect_has_to_explain() -> None:
    rng, rows = np.random.default_rng(3), 2000
    z, acts = rng.standard_normal((2, rows))
    for noise, share in ((1.0, 1.0), (0.1, 0.09 / 0.99)):
        problem: Any = SimpleNamespace(
            rows=rows,
            runs=[SimpleNamespace(shape=(rows, 1))],
            apart=lambda values: values,
            noise_share=np.full(rows, noise),
        )
        # an effect of .3 of what is left, that is noise or else unknown forces
        assert share_of_excess(problem, z, z + 0.3 * acts) == pytest.approx(share, abs=0.1)
        assert share_of_excess(problem, z, z) == 0.0


def test_the_share_is_that_of_the_rows_of_which_an_effect_removes_most() -> None:
    left, had = np.array([[1.0, 5.0], [-1.0, -5.0]]), np.array([[1.1, 7.0], [-1.1, -7.0]])
    problem: Any = SimpleNamespace(
        rows=4, runs=[SimpleNamespace(shape=(2, 2))], apart=lambda values: values, noise_share=np.ones(4)
    )
    # of the first kind, which is noise beside, the effect explains all, and hardly acts there
    assert share_of_excess(problem, left.ravel(), had.ravel()) == pytest.approx(48.0 / 96.0)


def test_what_is_not_noise_of_the_channels_is_that_of_unknown_forces(explained: tuple[WeakProblem, Fit]) -> None:
    own, _ = explained
    assert np.all(own.noise_share == 1.0)
    forced = own.with_unknown_force(np.array([1e-4, 0.0]), own.under)
    physics = own.under.physics(own.scene)
    noise = np.concatenate([whitening(run.weak, physics)[0].std for run in forced.runs])
    std = np.concatenate([run.whiten.std for run in forced.runs])
    np.testing.assert_allclose(forced.noise_share, (noise / std) ** 2, rtol=1e-6)
    assert np.min(forced.noise_share) < 0.5
