"""What servos with unknown parameters lack, by errors of simulations, where the equations of motion lead astray."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.intervals import doubt_of_settled, standard_deviations, unknowns_std
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.errors import OutputErrors
from drake_cafim.diagnosis.output_error.found import Found
from drake_cafim.diagnosis.output_error.moves import Moves
from drake_cafim.diagnosis.output_error.problem import NormalEquations, OutputErrorProblem, at_joint
from drake_cafim.diagnosis.output_error.starts import hypotheses
from drake_cafim.diagnosis.output_error.velocities import find_velocity_effects
from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.effects.servo_effect import CommandDelay
from drake_cafim.effects.timing import SensorDelay
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

KP, KV, FRICTION, LATE, PERIOD = 12.0, 0.8, 0.3, 0.03, 0.02
MASS, REACH = 0.4, 0.25
"""kg and m, of the link that hangs."""
WIDE = 4.0
"""N m/rad, the prior's standard deviation of kp."""


@pytest.mark.long
def test_a_light_axis_that_sticks_and_is_late(tmp_path: Path) -> None:
    """Its equations are satisfied best by a stiffness of a tenth; the scale of all efforts is known to a sixth only."""
    prepared = _prepared(tmp_path, 2e-3, 0.0)
    found = _found(prepared)
    late, friction = sorted(found.fitted.model.effects, key=lambda effect: effect.name)
    assert (late.name, friction.name) == ("command_delay", "joint_coulomb_friction")
    assert min(found.probability.values()) > 0.5
    assert abs(late.values["delay"] - LATE) < 3.0 * found.uncertainty.strengths[late.key][0] < 0.1 * LATE
    stiffness, damping = found.fitted.model.unknown
    std = found.uncertainty.unknown
    # 10 % of kp are as little as inertia shows: ratios are known, the scale is not
    assert abs(damping / stiffness / (KV / KP) - 1.0) < 0.03
    assert abs(friction.values["torque"] / stiffness / (FRICTION / KP) - 1.0) < 0.05
    assert 0.1 * KP < std[0] < WIDE and abs(stiffness - KP) < 2.0 * std[0]
    # the friction is as uncertain as the scale
    assert found.uncertainty.strengths[friction.key][0] / FRICTION > 0.5 * std[0] / KP
    assert found.error(found.fitted) < 0.1 * found.error(found.alone)
    _check_that_rows_add_nothing(prepared, found)


@pytest.mark.long
def test_the_verdict_names_what_simulations_show(tmp_path: Path) -> None:
    """From commands and positions to a verdict: names, values that hold, and a recording that nothing was fitted to."""
    prepared = _prepared(tmp_path, 2e-3, 9.81)
    runs = [_recorded(seed, 2e-3 + MASS * REACH**2, MASS * REACH * 9.81, FRICTION, LATE) for seed in (1, 2, 3)]
    verdict = diagnose(Scene.load(tmp_path / "pan.yaml"), runs[:2], held_out=runs[2:])
    assert {it.effect.name for it in verdict.explanation} == {"command_delay", "joint_coulomb_friction"}
    told = {it.effect.name: it.values for it in verdict.explanation}
    for name, strength, truth in (("command_delay", "delay", LATE), ("joint_coulomb_friction", "torque", FRICTION)):
        value = told[name][strength]
        assert value.std is not None and abs(float(value.value) - truth) < 3.0 * value.std < 0.3 * truth
    stiffness, damping = verdict.parameters
    assert abs(stiffness.value - KP) < 3.0 * stiffness.std < 0.3 * KP and abs(damping.value - KV) < 3.0 * damping.std
    assert verdict.held_out is not None
    assert verdict.held_out.corrected.rmse["q.pan"] < 0.1 * verdict.held_out.nominal.rmse["q.pan"]
    assert any(record.search == "simulations" and record.step == "admit" for record in verdict.trace) or told
    assert prepared.scene.known == ()


@pytest.mark.long
def test_gravity_fixes_the_scale_as_well_as_the_mass_is_known(tmp_path: Path) -> None:
    """The mass is known to a third; where it is known, the verdict's interval is (above)."""
    found = _found(_prepared(tmp_path, 2e-3, 9.81, sure=False), most_effects=0)
    stiffness, std = found.fitted.model.unknown[0], found.uncertainty.unknown[0]
    # the true mass is the prior's mean, so that the value is right
    assert abs(stiffness / KP - 1.0) < 0.1 and std > 0.2 * KP


def test_servos_whose_equations_hold_are_not_simulated(tmp_path: Path) -> None:
    exact = _prepared(tmp_path, 2e-3, 0.0, friction=0.0, late=0.0)
    assert exact.search_by_simulation(1, lambda text: None, Trace()) is None


def test_errors_of_what_is_right_are_those_of_noise(tmp_path: Path) -> None:
    prepared = _prepared(tmp_path, 2e-2, 0.0, friction=0.0, late=0.0)
    errors = OutputErrors(tuple(prepared.weak), ("pan",))
    right, wrong = (Model(np.array(x)).physics(prepared.scene) for x in ([KP, KV], [8.0, 1.2]))
    with_start = errors.mean_squares(errors.of(right))[0]
    errors.forgetting(right)
    by_right, by_wrong = errors.of(right), errors.of(wrong)
    assert 10.0 * errors.mean_squares(by_right)[0] < errors.mean_squares(by_wrong)[0]
    assert errors.mean_squares(by_right)[0] < 0.8 * with_start
    assert errors.p_values(by_right)[0] > 0.01 > 1e-6 > errors.p_values(by_wrong)[0]


def test_samples_that_are_missing_say_nothing(tmp_path: Path) -> None:
    """Nor does a window of one sample, whose first state explains all of it."""
    prepared = _prepared(tmp_path, 2e-2, 0.0, friction=0.0, late=0.0)
    errors = OutputErrors(tuple(prepared.weak), ("pan",))
    forecast = Forecast(
        "", np.arange(3.0), np.zeros(3, dtype=np.int64), {"q.pan": np.array([1.0, 2.0, np.nan])},
        {"q.pan": np.array([0.5, np.nan, 0.7])},
    )  # fmt: skip
    # what diverges counts as the range, what was not measured not at all
    assert np.allclose(errors._misses(forecast)[:, 0], [0.5, 0.0, 0.2])
    assert not np.any(errors._misses(replace(forecast, measured={"q.pan": np.full(3, np.nan)})))


def test_a_fit_moves_only_what_belongs_to_a_joint(tmp_path: Path) -> None:
    """With slopes that stay, each step takes one simulation, and the mass, which is no number of a joint, stays."""
    prepared = _prepared(tmp_path, 2e-3, 9.81, sure=False)
    problem = OutputErrorProblem(prepared.scene, OutputErrors(tuple(prepared.weak), ("pan",)))
    start = Model(prepared.scene.priors.mean).with_effects(
        [problem.sized(JointCoulombFriction("pan", {"torque": 0.1}))]
    )
    first = problem.fit(start, steps=1)
    assert first.names == ((".servo_stiffness", ".servo_damping", "joint_coulomb_friction@pan.torque"),)
    assert first.model.unknown[2] == prepared.scene.priors.mean[2]
    asked = 0
    whole = problem.errors_of

    def count(model: Model) -> Array:
        nonlocal asked
        asked += 1
        return whole(model)

    problem.errors_of = count  # type: ignore[method-assign]
    again = problem.fit(first.model, first.slopes_without(()), steps=2)
    assert asked <= 5 and again.costs[0] <= first.costs[0]
    dropped = first.slopes_without(first.model.effects)[0]
    assert np.array_equal(dropped, first.equations[0].J[:, :2])


def test_an_explanation_costs_more_with_each_strength_and_each_hypothesis(tmp_path: Path) -> None:
    prepared = _prepared(tmp_path, 2e-3, 0.0)
    problem = OutputErrorProblem(prepared.scene, OutputErrors(tuple(prepared.weak), ("pan",)))
    own = tuple(hypotheses(prepared.scene, prepared.weak, "pan"))
    names = {effect.name for effect in own}
    assert {"command_delay", "joint_viscous_friction", "rotor_inertia", "servo_dead_band"} <= names
    # a late command stands for the first two
    assert not names & {"actuator_delay", "actuator_lag", "payload"}
    assert all(at_joint(effect.at, "pan") for effect in own)
    problem.errors_of(Model(prepared.scene.priors.mean))
    price = Moves(problem, (own,)).price(JointViscousFriction("pan"))
    assert price == pytest.approx(np.log(problem.errors.likelihood.independent[0]) + 2.0 * np.log(len(own)))
    assert Moves(problem, (own[:2],)).price(CommandDelay("pan")) < price


def test_left_out_blocks_are_predicted_by_the_others(tmp_path: Path) -> None:
    """For linear errors to first order is exact: each block by a fit to the others."""
    random = np.random.default_rng(4)
    J, block = random.normal(size=(60, 2)), np.repeat(np.arange(6), 10)
    errors = random.normal(size=60)
    x = -np.linalg.solve(J.T @ J + np.eye(2), J.T @ errors)
    at_fit = NormalEquations(J, errors + J @ x, block, 1.0, np.ones(2), x)
    expected = []
    for b in range(6):
        own = block == b
        other = -np.linalg.solve(J[~own].T @ J[~own] + np.eye(2), J[~own].T @ errors[~own])
        expected.append(np.log(np.mean((errors[own] + J[own] @ other) ** 2)))
    assert np.allclose(at_fit.left_out(), expected, rtol=1e-9)


def test_simulations_begin_at_the_velocities_that_were_true(tmp_path: Path) -> None:
    prepared, late = _prepared(tmp_path, 2e-3, 9.81), 0.015
    weight = (2e-3 + MASS * REACH**2, MASS * REACH * 9.81, FRICTION, LATE)
    true, read = (prepare(prepared.scene, [_recorded(1, *weight, behind)]) for behind in (0.0, late))
    assert isinstance(true, Prepared) and isinstance(read, Prepared)
    delay = SensorDelay("v.pan", {"delay": late})
    begun = []
    for own, effects in ((true, ()), (read, ()), (read, (delay,))):
        errors, physics = OutputErrors(tuple(own.weak), ("pan",)), Model(np.array([KP, KV]), effects).physics(own.scene)
        starts = range(20, 180, 20)
        begun.append(np.array([errors._first_state(own.weak[0], physics, k, None)[1][0] for k in starts]))
    wrong, right = (np.sqrt(np.mean((v - begun[0]) ** 2)) for v in begun[1:])
    assert right < 0.2 * wrong


@pytest.mark.parametrize("late", [0.0, 0.015])
def test_a_late_velocity_shows_without_any_law_of_the_joint(tmp_path: Path, late: float) -> None:
    """Whatever drives it, its velocity is the derivative of its position."""
    prepared = _prepared(tmp_path, 2e-3, 9.81)
    runs = [_recorded(seed, 2e-3 + MASS * REACH**2, MASS * REACH * 9.81, FRICTION, LATE, late) for seed in (1, 2)]
    behind = prepare(prepared.scene, runs)
    assert isinstance(behind, Prepared)
    found = find_velocity_effects(behind.scene, behind.weak, ("pan",), Trace(), lambda text: None)
    if not late:
        assert found.effects == ()
        return
    (delay,) = found.effects
    assert delay.key == ("sensor_delay", "v.pan") and found.probability[delay.key] > 0.99
    assert abs(delay.values["delay"] - late) < 4.0 * found.std[delay.key][0] < 0.1 * late


def _found(prepared: Prepared, most_effects: int = 1) -> Found:
    found = prepared.search_by_simulation(most_effects, lambda text: None, Trace())
    assert found is not None
    return found


def _check_that_rows_add_nothing(prepared: Prepared, found: Found) -> None:
    """The rows are the samples that were simulated, so that they add nothing to what these tell of the servo."""
    known = prepared.with_servos_settled(found)
    assert known.settled is not None and all(unknown.settled for unknown in known.settled.unknown)
    # what is given stays
    assert known.scene.priors.mean[0] == prepared.scene.priors.mean[0] == 8.0
    settled = np.array([unknown.prior.std for unknown in known.settled.unknown])
    problem = known.problem()
    assert problem.scene.priors.mean[0] == known.settled.unknown[0].prior.mean
    best = unbiased_fit(problem, problem.nominal())
    # as further data the rows would leave a part of it only
    assert np.all(best.std[:2] < 0.7 * settled)
    std = standard_deviations(problem, best, 1.0)
    assert np.all(std[:2] > 0.99 * settled) and np.all(std[:2] < 1.01 * settled)
    assert np.all(unknowns_std(problem.scene, best) > 0.99 * settled)


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
    seed: int,
    inertia: float,
    weight: float,
    friction: float,
    late: float,
    read_late: float = 0.0,
    samples: int = 400,
    parts: int = 100,
) -> Recording:
    """The axis under slow and quick commands with pauses, integrated in steps of 0.2 ms; `weight` is N m at q = 0.

    Commands arrive `late`, velocities are recorded `read_late`, s.
    """
    random = np.random.default_rng(seed)
    time = PERIOD * np.arange(samples)
    rates, phases = 2.0 * np.pi * random.uniform(0.1, 1.5, 4), random.uniform(0.0, 6.0, 4)
    command = 0.2 * np.sum(np.sin(rates * time[:, None] + phases), axis=1)
    command[samples // 2 : samples // 2 + 50] = command[samples // 2]
    q, v, read, h, behind = command[0], 0.0, [], PERIOD / parts, round(late / PERIOD * parts)
    speeds = [0.0] * (round(read_late / h) + 1)
    for k in range(samples):
        read.append((q, speeds[-1 - round(read_late / h)]))
        for i in range(parts):
            goal = command[max(0, (k * parts + i - behind) // parts)]
            # turning about y by q takes the link's end down by sin q
            effort = KP * (goal - q) + weight * np.cos(q)
            # an implicit step with damping and dry friction
            free = (inertia * v + h * effort) / (inertia + h * KV)
            v = float(np.sign(free) * max(abs(free) - h * friction / (inertia + h * KV), 0.0))
            q += h * v
            speeds.append(v)
    positions, velocities = np.array(read).T
    noise: Array = random.normal(size=(2, samples))
    columns = {"q.pan": positions + 3e-4 * noise[0], "v.pan": velocities + 1e-2 * noise[1], "cmd.pan": command}
    return Recording(f"pan {seed}", time, columns)


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
