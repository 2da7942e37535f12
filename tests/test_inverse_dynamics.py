"""Residuals of inverse dynamics, and simulations that leave a joint's range."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import Recording, Scene
from drake_cafim.diagnosis.predict.forecast import divergence, forecasts, root_mean_square
from drake_cafim.diagnosis.predict.inverse_dynamics import CUTOFF, effort_residuals
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.catalogue import effect_named

INERTIA, WEIGHT, FRICTION, LIMIT = 0.5, 4.905, 0.3, 1.2
"""kg m², N m at a level link, N m of Coulomb friction, and rad to either side."""
URDF = f"""<robot name="pendulum"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.25" iyy="0.25" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-{LIMIT}" upper="{LIMIT}" effort="100" velocity="100"/></joint></robot>"""


def _recorded(folder: Path) -> tuple[Scene, WeakForm]:
    """A pendulum with Coulomb friction that its model lacks, over 15 s without noise."""
    path = folder / "pendulum.urdf"
    path.write_text(URDF)
    scene = Scene.from_model(str(path), channels={"q": 1e-5, "v": 1e-4, "u": 0.0}, weld=["base"])
    t = np.arange(0.0, 15.0, 0.002)
    rate = 2.0 * np.pi * 0.7
    q, v, a = 0.8 * np.sin(rate * t), 0.8 * rate * np.cos(rate * t), -0.8 * rate**2 * np.sin(rate * t)
    middle = 0.001  # s: an effort is held, and so is right in the middle
    ahead = [signal + middle * slope for signal, slope in ((q, v), (v, a), (a, -(rate**2) * v))]
    u = INERTIA * ahead[2] + WEIGHT * np.sin(ahead[0]) + FRICTION * np.tanh(ahead[1] / 0.005)
    columns = {"q.pivot": q, "v.pivot": v, "u.pivot": u}
    prepared = prepare(scene, [Recording("swing", t, columns)])
    return prepared.scene, prepared.weak[0]


def test_inverse_dynamics_misses_what_the_model_lacks(tmp_path: Path) -> None:
    scene, weak = _recorded(tmp_path)
    friction = effect_named("joint_coulomb_friction")("pivot", {"torque": FRICTION})
    lacking = effort_residuals([weak], scene.physics)["pivot"]
    complete = effort_residuals([weak], scene.physics.with_effects([friction]))["pivot"]
    assert lacking.cutoff == CUTOFF
    # a square wave loses what lies above the cutoff
    assert lacking.rms == pytest.approx(FRICTION, rel=0.05)
    effort = np.sqrt(np.mean(weak.samples.u[:, 0] ** 2))
    assert lacking.relative == pytest.approx(lacking.rms / effort, rel=0.05)
    assert complete.rms < 0.03 * FRICTION


def test_the_cutoff_is_both_sides_own(tmp_path: Path) -> None:
    scene, weak = _recorded(tmp_path)
    slow = effort_residuals([weak], scene.physics, 1.0)["pivot"]
    assert slow.cutoff == 1.0
    # of the square wave at 0.7 Hz the first harmonic is left, with 4/π of its height
    assert slow.rms == pytest.approx(FRICTION * 4.0 / np.pi / np.sqrt(2.0), rel=0.1)


def test_a_recording_too_short_for_the_filter_has_no_effort_residual(tmp_path: Path) -> None:
    scene, weak = _recorded(tmp_path)
    assert effort_residuals([weak], scene.physics, 0.5) == {}  # 12 periods are 24 s


def test_a_simulation_that_leaves_a_joints_range_counts_until_then(tmp_path: Path) -> None:
    scene, weak = _recorded(tmp_path)
    assert divergence(forecasts([weak], scene.physics)) == {}
    bias = effect_named("actuator_bias")("pivot", {"torque": 60.0})
    simulated = forecasts([weak], scene.physics.with_effects([bias]))
    errors, seconds = root_mean_square(simulated), divergence(simulated)
    # 60 N m push 0.5 kg m² over at most 2 rad in no more than √(2·2·0.5/60) s, but for the motion that is there
    assert 0.05 < seconds["pivot"] < 0.2
    assert errors["q.pivot"] < 2.0 * LIMIT
    assert np.max(np.abs(simulated[0].predicted["q.pivot"])) <= LIMIT
    assert not np.all(simulated[0].counted)
