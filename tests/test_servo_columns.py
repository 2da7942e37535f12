"""Derivatives of the rows by a servo's stiffness and damping agree with differences of the rows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.differences import Differences
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.step_response import Answers, oscillator, oscillator_slopes
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

PERIOD = 0.02
EFFECTS = {
    "friction": [("joint_load_dependent_friction", {"coefficient": 0.1}), ("joint_coulomb_friction", {"torque": 0.1})],
    "speed limit": [("actuator_speed_limit", {"no_load_speed": 2.0, "stall_torque": 2.0})],
    "late": [("command_delay", {"delay": 0.013})],
    "slow": [("command_lag", {"time_constant": 0.03})],
    "gain and band": [("servo_gain_error", {"gain": 0.8}), ("servo_dead_band", {"width": 0.02})],
}


@pytest.mark.parametrize(("stiffness", "damping"), [(2500.0, 100.0), (1.5e6, 1e5), (400.0, 3.0), (1e-3, 5.0)])
def test_slopes_of_an_oscillator(stiffness: float, damping: float) -> None:
    h, found = 0.02, oscillator_slopes(*np.array([[stiffness], [damping], [0.02]]))
    scale = np.array([1.0, h, max(1.0, stiffness * h), 1.0, h**2, h, h**3, h**2])
    for by, (k, d) in zip(found, ((1e-5 * stiffness, 0.0), (0.0, 1e-5 * damping)), strict=True):
        ahead, behind = (
            np.ravel(oscillator(*np.array([[stiffness + sign * k], [damping + sign * d], [h]]))) for sign in (1, -1)
        )
        size = (k or d) / 1e-5
        # a loose joint's series end with their first terms, wrong by ω² h² of what they are
        allowed = 1e-6 + stiffness * h**2 * (stiffness * h**2 < 1e-5)
        np.testing.assert_allclose(size * np.ravel(by) / scale, (ahead - behind) / 2e-5 / scale, atol=allowed)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("number", ["k", "d", "steps"])
def test_slopes_of_coupled_answers(joint: int, number: str) -> None:
    time, ones = 0.01 * np.arange(12), np.ones((12, 1))
    M_inverse = np.array([[8.0, -3.0], [-3.0, 60.0]]) + 0.0 * time[:, None, None]
    times, values = ([0.0, 0.013, 0.05], [0.0, 0.03]), ([0.0, 2.0, -1.0], [0.0, 1.0])

    def answers(change: float) -> Answers:
        k, d, size = np.array([40.0, 25.0]), np.array([1.5, 0.4]), np.ones(2)
        {"k": k, "d": d, "steps": size}[number][joint] += change
        steps = {j: Effort(np.array(times[j]), size[j] * np.array(values[j])) for j in (0, 1)}
        return Answers.of(time, M_inverse, (ones * k, ones * d), steps)

    by_steps = Effort(np.array(times[joint]), (number == "steps") * np.array(values[joint]))
    found = answers(0.0).by_slopes(joint, float(number == "k"), float(number == "d"), by_steps)
    ahead, behind = answers(1e-4).responses, answers(-1e-4).responses
    for j in (0, 1):
        for name in ("integral", "moment", "after", "before", "q", "v"):
            expected = (getattr(ahead[j], name) - getattr(behind[j], name)) / 2e-4
            assert np.any(expected)
            np.testing.assert_allclose(getattr(found[j], name), expected, atol=1e-5 * np.max(np.abs(expected)))


@pytest.mark.parametrize("parameter", ["stiffness", "damping"])
def test_slopes_of_the_law(parameter: str) -> None:
    random = np.random.default_rng(0)
    at = random.normal(size=(3, 200)) * np.array([[0.3], [0.1], [1.0]])
    values = {"stiffness": 20.0, "damping": 0.5, "limit": 3.0, "dead_band": 0.05}
    ahead, behind = (
        Servo("a", **{**values, parameter: values[parameter] + sign * 1e-6}).effort(*at, 0.5, 0.9).value
        for sign in (1, -1)
    )
    found = Servo("a", **values).effort_by(parameter, *at, 0.5, 0.9)
    np.testing.assert_allclose(found, (ahead - behind) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("measured", [True, False], ids=["q and v", "q alone"])
@pytest.mark.parametrize("effects", EFFECTS)
@pytest.mark.parametrize("limit", [1.0, None])
def test_columns_are_those_of_differences(tmp_path: Path, measured: bool, effects: str, limit: float | None) -> None:
    problem, model = _problem(tmp_path, measured, [effect_named(name)("b", at) for name, at in EFFECTS[effects]], limit)
    differences = Differences(problem.scene, problem.runs, lambda model: np.zeros(0))
    for i, unknown in enumerate(problem.scene.unknown):
        found = problem._by_unknowns.servos.by_unknown(model, i)
        step = 1e-4 * model.unknown[i]
        expected = differences._difference(model, i, step)
        if effects == "speed limit":
            # the instants at which an effort enters the envelope move: there is no analytic one
            assert found is None
            # one that was taken under a wider envelope is not kept
            kept, step = problem._by_unknowns.differences, 1e-2 * problem.scene.priors.std[i]
            wide = kept.by_unknown(replace(model, effects=(_widened(model.effects[0]),)), i)
            assert np.array_equal(kept.by_unknown(model, i), kept._difference(model, i, step))
            assert not np.array_equal(kept.by_unknown(model, i), wide)
            continue
        assert found is not None
        assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected), unknown.key


def _widened(envelope: Effect) -> Effect:
    return envelope.with_values({name: 3.0 * value for name, value in envelope.values.items()})


def _problem(folder: Path, measured: bool, effects: list[Effect], limit: float | None) -> tuple[WeakProblem, Model]:
    """Two links under servos, moved as no law says: the columns are those of the rows, whatever these are."""
    link = (
        '<link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="0.2"/>'
        '<inertia ixx="2e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>'
        '<axis xyz="0 1 0"/></joint>'
    )
    parts = [link.format("upper"), link.format("lower")]
    parts += [joint.format("a", "base", "upper", 0), joint.format("b", "upper", "lower", 0.2)]
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/>{"".join(parts)}</robot>')
    limited = "" if limit is None else f", limit: {limit}"
    unknown = [
        f"{{parameter: servo_{name}, joint: {at}, std: {std}}}"
        for at in "ab"
        for name, std in (("stiffness", 6.0), ("damping", 0.2))
    ]
    velocities = ", v: {std: 1.0e-3}" if measured else ""
    (folder / "arm.yaml").write_text(
        f"model: arm.urdf\nweld: [{{body: base}}]\nchannels: {{q: {{std: 1.0e-4}}{velocities}}}\n"
        f"servo: {{kp: 12.0, kv: 0.4{limited}}}\nunknown: [{', '.join(unknown)}]\n"
    )
    random, columns, time = np.random.default_rng(3), {}, PERIOD * np.arange(200)
    for name in "ab":
        rates, phases = random.uniform(1.0, 8.0, 4), random.uniform(0.0, 6.0, 4)
        at = rates * time[:, None] + phases
        columns[f"cmd.{name}"] = 0.15 * np.sum(np.sin(at), axis=1)
        columns[f"q.{name}"] = 0.12 * np.sum(np.sin(at - 0.05 * rates), axis=1) + 1e-4 * random.normal(size=200)
        if measured:
            columns[f"v.{name}"] = 0.12 * np.sum(rates * np.cos(at - 0.05 * rates), axis=1)
    problem = prepare(Scene.load(folder / "arm.yaml"), [Recording("arm", time, columns)]).problem()
    assert isinstance(problem, WeakProblem)
    return problem, problem.nominal().with_effects(effects)
