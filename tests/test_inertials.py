"""Unknown inertials of links: physically consistent, refitted with everything, far ones told, put back as they were."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from drake_cafim.diagnosis.diagnose import estimate
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.far_unknowns import distances
from drake_cafim.dynamics.pseudo_inertia import (
    changed,
    inertial_parameters,
    log_cholesky,
    pseudo_inertia,
    pseudo_inertia_of,
    slopes,
)
from drake_cafim.dynamics.tree import Body
from drake_cafim.effects.link import InertialError, Payload, RotorInertia, TreeEffect
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.inertials import PHYSICAL, LinkInertials, distance_together
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scenario.unknown import inertials, vector_of
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.recoveries.models import ARM
from tests.recoveries.rig import recorded, waves

THETA = np.array([0.1, -0.2, 0.15, 0.05, 0.1, -0.3, 0.2, 0.25, -0.1, 0.3])


def _cloud() -> tuple[Body, Array, Array]:
    """A body of twenty points, with their masses and places."""
    rng = np.random.default_rng(0)
    places, masses = rng.normal(size=(20, 3)) * [0.1, 0.05, 0.2] + [0.1, 0.0, 0.3], rng.uniform(0.1, 0.2, 20)
    center = masses @ places / masses.sum()
    apart = places - center
    inertia = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, apart, strict=True))
    return Body("cloud", 0, np.eye(3), np.zeros(3), float(masses.sum()), center, np.asarray(inertia)), masses, places


def test_the_pseudo_inertia_is_the_integral_over_the_mass() -> None:
    body, masses, places = _cloud()
    whole = sum(m * np.outer([*x, 1.0], [*x, 1.0]) for m, x in zip(masses, places, strict=True))
    np.testing.assert_allclose(pseudo_inertia(body), whole, atol=1e-14)
    np.testing.assert_allclose(pseudo_inertia_of(inertial_parameters(whole)), whole, atol=1e-14)


def test_log_cholesky_parameters_are_the_inverse_of_their_change_and_their_slopes_those_of_differences() -> None:
    J = pseudo_inertia(_cloud()[0])
    np.testing.assert_allclose(log_cholesky(changed(J, THETA), J), THETA, atol=1e-12)
    steps = 1e-6 * np.eye(10)
    differences = [(changed(J, THETA + step) - changed(J, THETA - step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(slopes(J, THETA), differences, atol=1e-8)


def test_every_change_is_a_body_that_can_be_and_the_prior_does_not_depend_on_the_frame() -> None:
    body, masses, places = _cloud()
    rng = np.random.default_rng(1)
    for _ in range(50):
        assert np.linalg.eigvalsh(changed(pseudo_inertia(body), rng.normal(size=10)))[0] > 0.0
    # another unit of length: the same relative change
    doubled = sum(m * np.outer([*(2.0 * x), 1.0], [*(2.0 * x), 1.0]) for m, x in zip(masses, places, strict=True))
    scale = np.diag([2.0, 2.0, 2.0, 1.0])
    expected = scale @ changed(pseudo_inertia(body), THETA) @ scale
    np.testing.assert_allclose(changed(np.asarray(doubled), THETA), expected, atol=1e-12)


def test_the_physical_parameters_and_their_slopes() -> None:
    link = LinkInertials(_cloud()[0])
    np.testing.assert_allclose(link.theta(link.physical(THETA)), THETA, atol=1e-10)
    steps = 1e-6 * np.eye(10)
    differences = [(link.physical(THETA + step) - link.physical(THETA - step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(link.slopes(THETA), np.transpose(differences), atol=1e-8)


def test_ten_stds_together_are_as_unlikely_as_their_one_number() -> None:
    assert distance_together(np.zeros(10)) < 0.1
    # the χ² with ten degrees of freedom exceeds 25.19 with probability .005, as |z| does 2.807
    assert distance_together(np.sqrt(25.188 / 10.0) * np.ones(10)) == pytest.approx(2.807, abs=1e-3)
    assert distance_together(1e3 * np.ones(10)) > 100.0


def arm(folder: Path, **more: object) -> Scene:
    folder.mkdir(exist_ok=True)
    (folder / "arm.urdf").write_text(ARM)
    unknown = [{"parameter": "inertials", "body": "all", "std": 0.2}]
    channels = {"q": {"std": 1e-4}, "v": {"std": 2e-3}, "u": {"std": 0.0}}
    raw = {"model": "arm.urdf", "weld": [{"body": "base"}], "channels": channels, "unknown": unknown} | more
    (folder / "arm.yaml").write_text(yaml.safe_dump(raw))
    return Scene.load(folder / "arm.yaml")


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Scene, Array, list[Recording]]:
    """The arm, the arm with all inertials changed by about a tenth, that change, and recordings of the latter."""
    folder = tmp_path_factory.mktemp("arm")
    scene = arm(folder)
    change = 0.5 * scene.priors.std * np.random.default_rng(4).normal(size=30)
    true = scene.corrected(change, [])
    desired = [waves((0.0, 0.3, 0.5), (0.5, 0.4, 0.5), seed) for seed in (1, 2)]
    return scene, true, change, [recorded(true, path, 2.5, seed) for seed, path in enumerate(desired)]


def test_all_stands_for_each_link_that_moves(moved: tuple[Scene, Scene, Array, list[Recording]]) -> None:
    scene = moved[0]
    assert list(inertials(scene.unknown)) == ["l1", "l2", "l3"]
    assert [item.parameter for item in scene.unknown[:10]] == list(PHYSICAL)


def test_the_rows_slopes_are_those_of_differences(moved: tuple[Scene, Scene, Array, list[Recording]]) -> None:
    scene, _, change, recordings = moved
    problem = prepare(scene, recordings[:1]).problem()
    model = Model(change)
    jacobian = problem.jacobian(model)
    for i in (0, 12, 25, 29):
        step = 1e-4 * np.eye(30)[i]
        difference = problem.residual(model.at(change + step)) - problem.residual(model.at(change - step))
        np.testing.assert_allclose(jacobian[:, i], difference / 2e-4, atol=1e-4 * np.abs(jacobian[:, i]).max())


@pytest.mark.parametrize(
    "effect",
    [
        Payload("l3", {"mass": 0.4, "x": 0.1, "y": -0.05, "z": 0.2}),
        RotorInertia("lift", {"inertia": 0.02}),
        InertialError("l2", {"mass": 0.1, "com_x": 0.02}),
    ],
    ids=lambda effect: effect.name,
)
def test_columns_of_inertias_are_those_of_differences(
    effect: TreeEffect, moved: tuple[Scene, Scene, Array, list[Recording]]
) -> None:
    scene, _, change, recordings = moved
    problem = prepare(scene, recordings[:1]).problem()
    model = Model(change, (effect,))
    columns = problem.jacobian(model)[:, 30:]
    assert columns.shape[1] == len(effect.strengths)
    for k, strength in enumerate(effect.strengths):
        step = 1e-3 * strength.typical * np.eye(len(model.vector))[30 + k]
        difference = problem.residual(model.at(model.vector + step)) - problem.residual(model.at(model.vector - step))
        expected = difference / (2e-3 * strength.typical)
        np.testing.assert_allclose(columns[:, k], expected, atol=1e-3 * np.abs(expected).max() + 1e-6)


def test_wrong_inertials_are_estimated_and_written_back(
    moved: tuple[Scene, Scene, Array, list[Recording]], tmp_path: Path
) -> None:
    scene, _, change, recordings = moved
    found = estimate(scene, recordings)
    assert found.goodness_of_fit.accepted, found
    assert not found.far
    names = {(item.parameter, item.at): item for item in found.parameters}
    bare = scene.bare or scene.physics
    truth = LinkInertials(bare.tree.body("l3")).physical(change[20:])
    for (name, unit), value in zip(PHYSICAL.items(), truth, strict=True):
        told = names[name, "l3"]
        assert told.unit == unit and 0.0 < told.std < told.prior_std * (1.0 + 1e-9)
        assert abs(told.value - value) < 4.0 * told.std
    # of the last link, gravity shows the first moment along it, which the model has wrong
    moment = names["mass", "l3"].value * names["com_x", "l3"].value
    nominal, true_moment = LinkInertials(bare.tree.body("l3")).physical(np.zeros(10)), truth[0] * truth[1]
    assert abs(moment - true_moment) < 0.05 * abs(nominal[0] * nominal[1] - true_moment)
    vector = vector_of(scene.unknown, bare, {item.key: item.value for item in found.parameters})
    corrected = scene.corrected(vector, [])
    (tmp_path / "back").mkdir()
    (tmp_path / "back" / "scenario.yaml").write_text(as_yaml(corrected.scenario, corrected.folder, tmp_path / "back"))
    again = Scene.load(tmp_path / "back" / "scenario.yaml")
    np.testing.assert_allclose(
        again.physics.tree.inertial_parameters, corrected.physics.tree.inertial_parameters, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(again.priors.mean, vector, rtol=1e-9)


def test_inertials_farther_than_their_prior_are_far_together(
    moved: tuple[Scene, Scene, Array, list[Recording]],
) -> None:
    scene = moved[0]
    vector = np.zeros(30)
    vector[10:20] = 4.0 * scene.priors.std[10:20]
    distance = distances(scene, Model(vector))
    assert distance[10] > 3.0 and not np.any(np.delete(distance, 10) > 0.1)


@pytest.mark.parametrize(
    ("unknown", "sentence"),
    [
        ([{"parameter": "inertials", "body": "palm", "std": 0.2}], "unknown[0].body is 'palm', which the model lacks"),
        (
            [{"parameter": "inertials", "body": "all", "std": 0.2}, {"parameter": "mass", "body": "l2", "std": 0.2}],
            "unknown[3] is mass of l2 a second time, after unknown[1]",
        ),
        (
            [{"parameter": "inertia", "body": "l2", "std": 0.2}, {"parameter": "inertials", "body": "l2", "std": 0.2}],
            "unknown[1] is inertials of l2, beside unknown[0], of which one is its inertials",
        ),
    ],
)
def test_what_no_inertials_are_is_refused(unknown: object, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        arm(tmp_path / "arm", unknown=unknown)
    assert sentence in str(caught.value)


def test_an_inertial_error_that_no_mass_has_is_refused(tmp_path: Path) -> None:
    error = {"effect": "inertial_error", "at": "l3", "mass": 0.1}
    scene = arm(tmp_path / "arm", effects=[{**error, "ixx": 0.01}])
    effect = InertialError("l3", {"mass": 0.1, "ixx": 0.01})
    assert not effect.contradiction_in(scene.physics.tree)
    assert scene.physics.tree.body("l3").mass == pytest.approx(1.1)
    with pytest.raises(InputError, match="no mass has the inertia of l3"):
        arm(tmp_path / "arm", effects=[{**error, "ixx": -0.5}])
