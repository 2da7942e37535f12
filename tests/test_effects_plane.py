"""An unmodelled plane: its force, the derivatives that fits use, and its detection from forces at the joints."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate

VALUES = {"offset": 0.3, "stiffness": 500.0, "damping": 20.0, "nx": 0.6, "ny": 0.0, "nz": 0.8}


def test_the_plane_pushes_along_its_normal_and_never_pulls() -> None:
    plane = UnmodeledContact("link", VALUES)
    p = np.array([[0.0, 5.0, 0.35], [0.0, 5.0, 0.35], [0.0, 0.0, 0.4], [0.0, 0.0, 0.35]])
    v = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -0.1], [0.0, 0.0, -9.0], [0.0, 0.0, 9.0]])
    depth = 0.3 - 0.8 * 0.35
    expected = [500.0 * depth, 500.0 * depth + 20.0 * 0.08, 0.0, 0.0]
    np.testing.assert_allclose(plane.force(p, v, None, None), np.outer(expected, [0.6, 0.0, 0.8]), atol=1e-12)


def test_a_fit_makes_the_normal_a_unit_vector() -> None:
    effect = UnmodeledContact("link").with_values({**VALUES, "nx": 1.2, "nz": 1.6})
    assert [effect.values[name] for name in ("nx", "ny", "nz")] == pytest.approx([0.6, 0.0, 0.8])


def test_slopes_are_those_of_the_force() -> None:
    plane = UnmodeledContact("link", VALUES)
    rng = np.random.default_rng(3)
    p, v = 0.3 * rng.normal(size=(200, 3)), 0.1 * rng.normal(size=(200, 3))
    slopes = plane.slopes(p, v)
    assert np.any(slopes) and np.any(~np.any(slopes, axis=(1, 2)))
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-7 * (1.0 + abs(plane.vector[k]))
        ahead = plane.with_values(plane.vector + step).force(p, v, None, None)
        behind = plane.with_values(plane.vector - step).force(p, v, None, None)
        np.testing.assert_allclose(slopes[:, :, k], (ahead - behind) / (2.0 * step[k]), rtol=1e-5, atol=1e-3)
    # a longer normal is the same plane
    np.testing.assert_allclose(slopes[:, :, 3:] @ plane.normal, 0.0, atol=1e-9)


@pytest.mark.long
def test_found_by_where_the_forces_point(tmp_path: Path) -> None:
    case = simulate("single:unmodeled_contact", "arm6", 1)
    case.write(tmp_path)
    prepared = prepare(Scene.load(tmp_path / "scenario.yaml"), [recordings.read(tmp_path / "train_1.parquet")])
    problem = WeakProblem.of(prepared.scene, prepared.weak, Model(prepared.scene.priors.mean))
    nominal = unbiased_fit(problem, problem.nominal())
    [truth] = case.truth["effects"]  # type: ignore[misc]
    [found] = screen(problem, nominal, [UnmodeledContact(truth["at"])])
    fitted = unbiased_fit(problem, nominal.model.with_effects([found.effect])).model.effects[0]
    for name in ("offset", "stiffness"):
        assert fitted.values[name] == pytest.approx(truth["parameters"][name][0], rel=0.02)
    assert isinstance(fitted, UnmodeledContact)
    np.testing.assert_allclose(fitted.normal, [truth["parameters"][axis][0] for axis in ("nx", "ny", "nz")], atol=0.01)


def test_an_effect_of_a_contact_that_is_not_there_is_refused(tmp_path: Path) -> None:
    case = simulate("null", "press", 301)
    case.write(tmp_path)
    text = (tmp_path / "scenario.yaml").read_text()
    (tmp_path / "scenario.yaml").write_text(text + "effects:\n- {effect: surface_offset, at: floor, offset: 0.001}\n")
    with pytest.raises(InputError, match=r"surface_offset at floor.*tool/wall"):
        Scene.load(tmp_path / "scenario.yaml")


def test_a_plane_that_is_always_touched_is_none() -> None:
    plane = UnmodeledContact("link", {"offset": 0.2, "stiffness": 1e3, "damping": 1.0, "nx": 0.0, "ny": 0.0, "nz": 1.0})
    height = np.linspace(0.0, 0.4, 100)
    path = np.stack([0.0 * height, 0.0 * height, height], axis=1)
    assert plane.touched_and_left(path)
    assert not plane.touched_and_left(0.4 * path)
