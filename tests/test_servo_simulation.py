"""Unknowns of position servos by the errors of simulations, where the equations of motion lead astray."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.intervals import doubt_of_settled, standard_deviations, unknowns_std
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.servo_simulation import fit_servos, simulation_error
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

KP, KV, FRICTION, LATE, PERIOD = 12.0, 0.8, 0.3, 0.03, 0.02
MASS, REACH = 0.4, 0.25
"""kg and m, of the link that hangs."""
WIDE = 4.0
"""N m/rad, the prior's standard deviation of kp."""


def test_a_light_axis_that_sticks_and_is_late(tmp_path: Path) -> None:
    """Its equations are satisfied best by a stiffness of a tenth; the scale of all efforts is known to a sixth only."""
    prepared = _prepared(tmp_path, 2e-3, 0.0)
    found = prepared.with_servos_simulated(lambda text: None)
    assert found is not None and found[0].settled is not None
    stiffness, damping = (unknown.prior for unknown in found[0].settled.unknown)
    assert all(unknown.settled for unknown in found[0].settled.unknown)
    # 10 % of kp are as little as inertia shows: the ratio is known, the scale is not
    assert abs(damping.mean / stiffness.mean / (KV / KP) - 1.0) < 0.03
    assert 0.1 * KP < stiffness.std < WIDE and abs(stiffness.mean - KP) < 2.0 * stiffness.std
    by_equations, by_simulation = found[1]
    assert by_simulation < 0.5 * by_equations
    # the search is of what was settled, what is given stays
    assert found[0].problem().scene.priors.mean[0] == stiffness.mean
    assert found[0].scene.priors.mean[0] == prepared.scene.priors.mean[0] == 8.0


@pytest.mark.parametrize("sure", [True, False], ids=["mass known", "mass to a third"])
def test_gravity_fixes_the_scale_as_well_as_the_mass_is_known(tmp_path: Path, sure: bool) -> None:
    prepared = _prepared(tmp_path, 2e-3, 9.81, sure)
    stiffness = fit_servos(prepared.scene, prepared.weak).unknown[0].prior
    assert abs(stiffness.mean - KP) < 2.0 * stiffness.std
    # the true mass is the prior's mean, so that the value is right either way
    assert abs(stiffness.mean / KP - 1.0) < 0.1
    assert (stiffness.std < 0.1 * KP) if sure else (stiffness.std > 0.2 * KP)


def test_servos_whose_equations_hold_are_not_simulated(tmp_path: Path) -> None:
    exact = _prepared(tmp_path, 2e-3, 0.0, friction=0.0, late=0.0)
    assert exact.with_servos_simulated(lambda text: None) is None


def test_errors_of_what_is_right_are_smaller(tmp_path: Path) -> None:
    prepared = _prepared(tmp_path, 2e-2, 0.0, friction=0.0, late=0.0)
    right, wrong = (simulation_error(prepared.scene, prepared.weak, Model(np.array(x))) for x in ([KP, KV], [8.0, 1.2]))
    assert right < 1e-3 < 10.0 * right < wrong


def _prepared(
    folder: Path, inertia: float, gravity: float, sure: bool = True, friction: float = FRICTION, late: float = LATE
) -> Prepared:
    """An axis that sticks, and whose servo gets its commands late; its model knows neither.

    Beside `inertia` about its own centre, kg m², the link has `MASS` at `REACH` under gravity, m/s².
    """
    mass, reach = (MASS, REACH) if gravity else (0.5, 0.0)
    (folder / "pan.urdf").write_text(
        f'<robot name="pan"><link name="base"/><link name="arm"><inertial><origin xyz="{reach} 0 0"/>'
        f'<mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="pan" type="continuous"><parent link="base"/><child link="arm"/>'
        '<axis xyz="0 1 0"/></joint></robot>'
    )
    doubt = "" if sure else f", {{parameter: mass, body: arm, std: {mass / 3}}}"
    (folder / "pan.yaml").write_text(
        f"model: pan.urdf\ngravity: [0, 0, {-gravity}]\nweld: [{{body: base}}]\n"
        "channels: {q: {std: 3.0e-4}, v: {std: 1.0e-2}}\nservo: {kp: 8.0, kv: 1.2}\n"
        f"unknown: [{{parameter: servo_stiffness, joint: pan, std: {WIDE}}},"
        f" {{parameter: servo_damping, joint: pan, std: 0.6}}{doubt}]\n"
    )
    total = inertia + mass * reach**2
    runs = [_recorded(seed, total, mass * reach * gravity, friction, late) for seed in (1, 2)]
    found = prepare(Scene.load(folder / "pan.yaml"), runs)
    assert isinstance(found, Prepared)
    return found


def _recorded(
    seed: int, inertia: float, weight: float, friction: float, late: float, samples: int = 400, parts: int = 100
) -> Recording:
    """The axis under slow and quick commands with pauses, integrated in steps of 0.2 ms; `weight` is N m at q = 0."""
    random = np.random.default_rng(seed)
    time = PERIOD * np.arange(samples)
    rates, phases = 2.0 * np.pi * random.uniform(0.1, 1.5, 4), random.uniform(0.0, 6.0, 4)
    command = 0.2 * np.sum(np.sin(rates * time[:, None] + phases), axis=1)
    command[samples // 2 : samples // 2 + 50] = command[samples // 2]
    q, v, read, h, behind = command[0], 0.0, [], PERIOD / parts, round(late / PERIOD * parts)
    for k in range(samples):
        read.append((q, v))
        for i in range(parts):
            goal = command[max(0, (k * parts + i - behind) // parts)]
            # turning about y by q takes the link's end down by sin q
            effort = KP * (goal - q) + weight * np.cos(q)
            # an implicit step with damping and dry friction
            free = (inertia * v + h * effort) / (inertia + h * KV)
            v = float(np.sign(free) * max(abs(free) - h * friction / (inertia + h * KV), 0.0))
            q += h * v
    positions, velocities = np.array(read).T
    noise: Array = random.normal(size=(2, samples))
    columns = {"q.pan": positions + 3e-4 * noise[0], "v.pan": velocities + 1e-2 * noise[1], "cmd.pan": command}
    return Recording(f"pan {seed}", time, columns)


def test_what_simulations_settled_is_not_known_better_by_the_same_recordings(tmp_path: Path) -> None:
    """The rows are the samples that were simulated, so that they add nothing to what these tell of the servo."""
    prepared = _prepared(tmp_path, 2e-3, 0.0)
    found = prepared.with_servos_simulated(lambda text: None)
    assert found is not None and found[0].settled is not None
    settled = np.array([unknown.prior.std for unknown in found[0].settled.unknown])
    problem = found[0].problem()
    best = unbiased_fit(problem, problem.nominal())
    # as further data the rows would leave a part of it only
    assert np.all(best.std[:2] < 0.7 * settled)
    std = standard_deviations(problem, best, 1.0)
    assert np.all(std[:2] > 0.99 * settled) and np.all(std[:2] < 1.01 * settled)
    assert np.all(unknowns_std(problem.scene, best) > 0.99 * settled)


def test_what_depends_on_settled_values_is_as_uncertain_as_they_are() -> None:
    """Two settled unknowns with correlated slopes beside a strength that follows them: exact for linear rows."""
    random = np.random.default_rng(3)
    J, prior = random.normal(size=(40, 3)) + 0.7 * random.normal(size=(40, 1)), np.array([0.05, 0.3])
    scene = SimpleNamespace(unknown=[SimpleNamespace(settled=True)] * 2, priors=SimpleNamespace(std=prior))
    together = np.linalg.inv(J.T @ J + np.diag([*prior**-2.0, 0.0]))
    fitted = SimpleNamespace(covariance=together, model=SimpleNamespace(vector=np.zeros(3)))
    variance = np.diag(together) + doubt_of_settled(scene, fitted)  # type: ignore[arg-type]
    # the third number fitted to rows with noise and the others drawn from their priors
    own = J[:, 2] / (J[:, 2] @ J[:, 2])
    expected = own @ own + np.sum((own @ J[:, :2] * prior) ** 2)
    assert np.allclose(variance, [*prior**2, expected], rtol=1e-9)
    assert together[2, 2] < 0.95 * expected and np.all(np.diag(together)[:2] < 0.99 * prior**2)


def test_unknowns_that_nothing_settled_have_no_further_doubt(tmp_path: Path) -> None:
    problem = _prepared(tmp_path, 2e-3, 0.0, friction=0.0, late=0.0).problem()
    assert not np.any(doubt_of_settled(problem.scene, unbiased_fit(problem, problem.nominal())))
