"""The covariance that is computed for the whitened rows, against the spread of rows with simulated noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.samples import add_noise
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.kinked_law_noise import beyond_slope
from drake_cafim.diagnosis.whitening.noise_jacobian import POSITION_STEP
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.sensor import SensorGainError, SensorMisalignment
from drake_cafim.effects.surface import SurfaceOffset
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed.make import simulate

DOSE = 0.1
"""Of the noise, so that nothing bends."""


@pytest.mark.parametrize(
    ("kind", "rig", "seed"),
    [("null", "press", 0x887801BB6C1B7D7B9EA22237E1168899), ("null", "press", 1), ("null", "arm2", 1)],
)
def test_rows_are_as_noisy_as_expected(kind: str, rig: str, seed: int, tmp_path: Path) -> None:
    """Friction that turns its sign at a speed that is little more than its noise: what smoothing leaves matters."""
    simulate(kind, rig, seed).write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / "train_1.parquet")])
    rubbing = [JointCoulombFriction(name, {"torque": 2.0, "slip_velocity": 0.005}) for name in scene.tree.joint_names]
    model = Model(scene.priors.mean, () if rig == "press" else tuple(rubbing))
    squares = _louder(WeakProblem.of(scene, prepared.weak, model), model.physics(scene))
    assert np.all((squares > 0.8) & (squares < 1.25)), squares


def test_noise_that_a_contact_hands_on_is_written_as_its_sensor_writes(tmp_path: Path) -> None:
    """A sensor that doubles, and is turned, doubles and turns what is predicted from noisy positions, too."""
    simulate("null", "press", 1).write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / "train_1.parquet")])
    turned = SensorMisalignment("wrench.wrist", {"roll": 0.3, "pitch": -0.4, "yaw": 0.2})
    model = Model(scene.priors.mean, (SensorGainError("wrench.wrist.fy", {"gain": 2.0}), turned))
    squares = _louder(WeakProblem.of(scene, prepared.weak, model), model.physics(scene))
    assert np.all((squares > 0.8) & (squares < 1.25)), squares


def _louder(problem: WeakProblem, physics: Physics) -> Array:
    """(r,) mean squares of what a little more noise in the samples adds to the whitened rows of a window."""
    run = problem.runs[0]
    samples, quiet = run.weak.samples, run.weak.residual(physics)
    changes = []
    for draw in range(4):
        more = add_noise(samples, np.random.default_rng(draw))
        q, v, u = (
            now + DOSE * (loud - now) for now, loud in ((samples.q, more.q), (samples.v, more.v), (samples.u, more.u))
        )
        wrenches = tuple(now + DOSE * (loud - now) for now, loud in zip(samples.wrenches, more.wrenches, strict=True))
        louder = WeakForm(replace(samples, q=q, v=v, u=u, wrenches=wrenches), run.weak.sensors)
        changes.append(run.whitened(louder.residual(physics) - quiet).reshape(run.shape) / DOSE)
    return np.asarray(np.mean(np.square(changes), axis=(0, 1)))


@pytest.mark.parametrize("seed", [2, 5])
def test_a_sample_that_may_or_may_not_touch_is_no_evidence(seed: int, tmp_path: Path) -> None:
    """A surface that moves by less than the noise of a depth may take the whole jump of a contact that damps with it.

    Without that, rows would move by 16 and 13 standard deviations.
    """
    simulate("null", "press", seed).write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    [weak] = prepare(scene, [recordings.read(tmp_path / "train_1.parquet")]).weak
    physics = Model(scene.priors.mean).physics(scene)
    touch = physics.contacts[0].touch(weak.motion(physics))
    hardest = int(np.argmax(touch.rate))

    def standing(above: float) -> Model:
        """With the surface so high that the sample is `above` (m) deep in it."""
        offset = above - touch.penetration[hardest]
        return Model(scene.priors.mean, (SurfaceOffset("wall", {"offset": offset}),))

    # farther than the step of the noise's slopes, and still within the noise
    deeper = 1.5 * POSITION_STEP
    problem = WeakProblem.of(scene, [weak], standing(deeper))
    change = problem.rows_of(standing(deeper)) - problem.rows_of(standing(-deeper))
    assert 1.0 < np.max(np.abs(change)) < 3.0


def test_rows_are_as_noisy_as_expected_where_friction_jumps(tmp_path: Path) -> None:
    """A sign that turns within the noise of its velocity, against the sign of the same motion without that noise."""
    simulate("null", "arm2", 1).write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / "train_1.parquet")])
    rubbing = [JointCoulombFriction(name, {"torque": 20.0, "slip_velocity": 5e-4}) for name in scene.tree.joint_names]
    model = Model(scene.priors.mean, tuple(rubbing))
    problem = WeakProblem.of(scene, prepared.weak, model)
    physics, run = model.physics(scene), problem.runs[0]
    samples = run.weak.samples
    exact = tuple(replace(kink, std=np.zeros_like(kink.std)) for kink in samples.kinked_v)
    known = WeakForm(replace(samples, kinked_v=exact), run.weak.sensors).residual(physics)
    changes = []
    for draw in range(24):
        louder = WeakForm(add_noise(samples, np.random.default_rng(draw)), run.weak.sensors)
        changes.append(run.whitened(louder.residual(physics) - known).reshape(run.shape))
    squares = np.mean(np.square(changes), axis=(0, 1))
    # jumps are few and large; by slopes alone the second joint's rows are 5.3 times as noisy as expected
    assert np.all((squares > 0.8) & (squares < 1.4)), squares


@pytest.mark.parametrize("width", [1e-4, 0.01, 0.05])
def test_what_a_sign_scatters_beyond_its_mean_slope(width: float) -> None:
    """Against draws of the error."""
    rng, std = np.random.default_rng(3), 0.01
    v = np.linspace(-0.03, 0.03, 13)
    error = std * rng.normal(size=(200_000, 1))
    forces = np.tanh((v + error) / width)
    slope = np.mean(forces * error, axis=0) / std**2
    expected = np.std(forces - slope * error, axis=0)
    found = beyond_slope(lambda off: np.tanh((v + off) / width), np.full_like(v, std))
    assert np.allclose(found, expected, atol=0.07)
