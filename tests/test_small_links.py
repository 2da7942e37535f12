"""A rotor a thousand times heavier than its link: found, and no comparison of position and velocity blames a sensor."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.thresholds import MASS_MATRIX_STD
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

WRIST = """<robot name="wrist"><link name="base"/><link name="flange"><inertial><origin xyz="0 0 0.01"/>
<mass value="0.2"/><inertia ixx="2e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="roll" type="revolute"><parent link="base"/><child link="flange"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="50" velocity="20"/></joint></robot>"""
LINK, ROTOR, STEP, FINE = 2e-4, 0.4, 0.002, 10
STD = {"q": 1e-4, "v": 2e-3, "u": 0.0}
RAMPED = f"""
model: wrist.urdf
weld: [{{body: base}}]
channels: {{q: {{std: {STD["q"]}}}, v: {{std: {STD["v"]}}}, u: {{std: 0.0, hold: first_order}}}}
"""


def turned(seed: int, viscous: float, coulomb: float, ramped: bool = False) -> Recording:
    """5 s of the wrist with its rotor and friction under a PD controller, integrated ten times as fine as sampled.

    If `ramped`, the effort rises linearly within an interval, and reaches what the controller asked for at its end.
    """
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(2500)
    wanted = 0.6 * np.sin(np.pi * time) + 0.2 * np.sin(2.6 * np.pi * time + seed)
    rate = 0.6 * np.pi * np.cos(np.pi * time) + 0.52 * np.pi * np.cos(2.6 * np.pi * time + seed)
    q, v, u = np.zeros(len(time)), np.zeros(len(time)), np.zeros(len(time))
    q[0], v[0] = wanted[0], rate[0]
    for k in range(len(time)):
        asked = 40.0 * (wanted[k] - q[k]) + 6.0 * (rate[k] - v[k])
        if not ramped:
            u[k] = asked
        if k + 1 == len(time):
            break
        if ramped:
            u[k + 1] = asked
        x, w, h = q[k], v[k], STEP / FINE
        for i in range(FINE):
            effort = u[k] + (i + 0.5) / FINE * (u[k + 1] - u[k]) if ramped else u[k]
            # at the middle of the step: at its start, viscous h/2 would be missing from the inertia, ten of its stds
            middle = w + 0.5 * h * (effort - viscous * w - coulomb * np.tanh(w / 0.02)) / (ROTOR + LINK)
            a = (effort - viscous * middle - coulomb * np.tanh(middle / 0.02)) / (ROTOR + LINK)
            x, w = x + h * w + 0.5 * h**2 * a, w + h * a
        q[k + 1], v[k + 1] = x, w
    noisy = {"q.roll": q + rng.normal(0.0, STD["q"], len(q)), "v.roll": v + rng.normal(0.0, STD["v"], len(v))}
    return Recording(f"run {seed}", time, noisy | {"u.roll": u})


@pytest.fixture(scope="module")
def wrist(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path: Path = tmp_path_factory.mktemp("wrist") / "wrist.urdf"
    path.write_text(WRIST)
    return Scene.from_model(path, channels=STD, weld=["base"])


@pytest.mark.long
def test_the_rotor_is_found_and_nothing_else_is_blamed(wrist: Scene) -> None:
    verdict = diagnose(wrist, [turned(seed, 0.5, 0.3) for seed in (1, 2)])
    found = {accepted.effect.name: accepted for accepted in verdict.explanation}
    assert verdict.kind == "explained", str(verdict)
    assert set(found) == {"rotor_inertia", "joint_viscous_friction", "joint_coulomb_friction"}
    inertia = found["rotor_inertia"].values["inertia"]
    assert inertia.std is not None and abs(inertia.value - ROTOR) < 4.0 * inertia.std < 0.01
    assert found["joint_viscous_friction"].values["coefficient"].value == pytest.approx(0.5, rel=0.02)


def test_held_efforts_need_no_inertia_to_compare_position_and_velocity(wrist: Scene) -> None:
    [run] = prepare(wrist, [turned(1, 0.0, 0.0)]).problem().runs
    kinematic = run.weak.residual(wrist.physics)[:, 0]
    # between steps of a held effort velocities are linear, and their integral is exact whatever the mobility
    assert np.max(np.abs(kinematic) / np.sqrt(run.covariance[:, 0, 0])) < 4.0
    assert not np.any(run.weak.terms(wrist.physics).driven.steps(wrist.physics))


def test_no_kinematic_row_exceeds_what_an_uncertain_inertia_allows(tmp_path: Path) -> None:
    (tmp_path / "wrist.urdf").write_text(WRIST)
    (tmp_path / "scenario.yaml").write_text(RAMPED)
    scene = Scene.load(tmp_path / "scenario.yaml")
    [run] = prepare(scene, [turned(1, 0.0, 0.0, ramped=True)]).problem().runs
    physics = scene.physics
    kinematic = run.weak.residual(physics)[:, 0]
    std = np.sqrt(run.covariance[:, 0, 0])
    assert np.max(np.abs(kinematic) / std) < 1.5 / MASS_MATRIX_STD
    # without that noise they would be off by a hundred, and by a thousand at 125 Hz
    steps = run.weak.terms(physics).driven.steps(physics)[:, 0]
    bare = np.sqrt(std**2 - (MASS_MATRIX_STD * steps) ** 2)
    assert np.max(np.abs(kinematic) / bare) > 30.0
