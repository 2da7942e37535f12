"""Contacts that a simulation holds over its step: what recordings say of them, and the noise that they leave."""

import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.given_effects import fit_given
from drake_cafim.diagnosis.whitening.contact_step import contact_step_covariance
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.diagrams.catalogue import joint_names, stage_of
from drake_cafim.experiment import closed_loop
from drake_cafim.experiment.closed_loop import Options
from drake_cafim.experiment.joint_recording import recordings_of
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import DIAGRAMS, resolve
from drake_cafim.scene.scene import Scene


@pytest.fixture(scope="module")
def pinched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Recording]:
    """A ball pinched in Drake, recorded without noise; and the scene with the noise and with the law that it has."""
    raw: dict[str, Any] = yaml.safe_load((DIAGRAMS / "pinching.yaml").read_text())
    (contact,) = raw["contact"]
    for given in ("stiffness", "damping"):
        del contact[given]
    contact |= {"law": "hydroelastic", "modulus": 50930.0, "dissipation": 2.5}
    raw["unknown"] = [
        {"parameter": name, "contact": contact["bodies"], "mean": contact[name], "std": 0.2 * contact[name]}
        for name in ("modulus", "dissipation")
    ]
    folder = tmp_path_factory.mktemp("pinching")

    def scene(name: str) -> Scene:
        path: Path = folder / name
        path.write_text(yaml.safe_dump(raw))
        return Scene.load(path)

    noisy = scene("noisy.yaml")
    raw["channels"] |= {"q": {"std": 1e-12}, "v": {"std": 1e-12}, "u": {"std": 0.0}}
    stage = stage_of(load(resolve("pinching")), "pinching")
    world = stage.world("drake", 1)
    task = replace(stage.task, robot_start=np.array([0.019, 0.0]), experiments=1)
    result = closed_loop.run(task, Options(seed=1), world)
    return noisy, recordings_of(result, scene("quiet.yaml"), joint_names(world.system), world)[0]


@pytest.mark.long
def test_positions_and_velocities_are_of_one_motion_under_held_contact(pinched: tuple[Scene, Recording]) -> None:
    scene, recording = pinched
    prepared = prepare(scene, [recording])
    problem, fitted = fit_given(prepared.problem(), Model(prepared.scene.priors.mean))
    ((_, whitened),) = by_run(problem, fitted.residual[: problem.rows])
    # without noise; as if the plant's velocity were not linear over a step it is .4
    assert np.sqrt(np.mean(whitened[:, 0] ** 2)) < 0.05


def test_a_force_is_in_doubt_by_what_it_changes_in_a_sample(pinched: tuple[Scene, Recording]) -> None:
    scene, recording = pinched
    prepared = prepare(scene, [recording])
    weak, physics = prepared.problem().runs[0].weak, scene.physics
    (contact,) = physics.contacts
    moving = weak.motion(physics)
    force, _ = contact.force(contact.touch(moving))
    assert np.abs(force[:, 0]).max() > 2.0
    # a sample later the same law would have pushed the jaw by so much more, along x
    later = np.asarray(weak.samples.windows.value @ np.gradient(force[:, 0]))
    covariance = contact_step_covariance(weak, physics)
    std = np.sqrt(covariance.diagonal()).reshape(-1, weak.rows_per_window)
    np.testing.assert_allclose(std[:, weak.dynamic.start], np.abs(later), atol=1e-9)
    # alike for as long as a window: neighbours, a quarter of a window apart, are so to three quarters
    dense = covariance.toarray()[weak.dynamic.start :: weak.rows_per_window, weak.dynamic.start :: weak.rows_per_window]
    np.testing.assert_allclose(np.diag(dense, 1), 0.75 * later[1:] * later[:-1], atol=1e-9)
    whitened = whitening(weak, physics)[0].covariance.diagonal
    assert np.all(whitened >= covariance.diagonal())


def test_a_law_of_its_own_width_leaves_no_such_doubt(pinched: tuple[Scene, Recording]) -> None:
    scene = Scene.load("pinching")
    weak = prepare(scene, [pinched[1]]).problem().runs[0].weak
    assert contact_step_covariance(weak, scene.physics).nnz == 0


def test_where_no_contact_is_drakes_memory_does_not_grow_with_the_square_of_the_windows(
    pinched: tuple[Scene, Recording],
) -> None:
    scene = Scene.load("pinching")
    weak = prepare(scene, [pinched[1]]).problem().runs[0].weak
    tracemalloc.start()
    contact_step_covariance(weak, scene.physics)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 8 * len(weak.samples.windows) ** 2
