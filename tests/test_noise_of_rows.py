"""The noise that is expected of the rows, against more of the same noise in the samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import prepare
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.samples import noisier
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.scenario.scene import Scene
from tests.concealed.make import simulate

DOSE = 0.1
"""Of the noise, so that nothing bends."""


@pytest.mark.parametrize(
    ("kind", "rig", "seed"),
    [("null", "press", 0x887801BB6C1B7D7B9EA22237E1168899), ("null", "press", 1), ("null", "arm2", 1)],
)
def test_rows_are_as_noisy_as_expected(kind: str, rig: str, seed: int, tmp_path: Path) -> None:
    """Friction turns its sign within a few standard deviations of a velocity: there it matters what smoothing leaves."""
    simulate(kind, rig, seed).write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / "train_1.parquet")])
    rubbing = [JointCoulombFriction(name, {"torque": 2.0, "slip_velocity": 0.005}) for name in scene.tree.joint_names]
    model = Model(scene.priors.mean, () if rig == "press" else tuple(rubbing))
    problem = WeakProblem.of(scene, prepared.weak, model)
    physics, run = model.physics(scene), problem.runs[0]
    samples, quiet = run.weak.samples, run.weak.residual(physics)
    changes = []
    for draw in range(4):
        more = noisier(samples, np.random.default_rng(draw))
        q, v, u = (
            now + DOSE * (loud - now) for now, loud in ((samples.q, more.q), (samples.v, more.v), (samples.u, more.u))
        )
        wrenches = tuple(now + DOSE * (loud - now) for now, loud in zip(samples.wrenches, more.wrenches, strict=True))
        louder = WeakForm(replace(samples, q=q, v=v, u=u, wrenches=wrenches), run.weak.sensors)
        changes.append(run.whitened(louder.residual(physics) - quiet).reshape(run.shape) / DOSE)
    squares = np.mean(np.square(changes), axis=(0, 1))
    assert np.all((squares > 0.8) & (squares < 1.25)), squares
