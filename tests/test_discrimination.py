"""Motions that discriminate between two explanations: evidence against closed forms, limits, simulation, designs."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from drake_cafim.design.planner import PlannerConfig
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.discrimination.closed_loop import measured, simulated, simulated_together
from drake_cafim.discrimination.design import Designer, Effort, default_effort
from drake_cafim.discrimination.evidence import Course, expected, expected_log_odds, explain, linearise
from drake_cafim.discrimination.hypotheses import Pair, named_pair
from drake_cafim.discrimination.motions import Limits, Shape, control_points, inverse_dynamics, plan
from drake_cafim.discrimination.outcome import log_odds, settled_after
from drake_cafim.discrimination.planned import noise_of, problem_of
from drake_cafim.discrimination.scores import Information, Odds, Soonest, passed
from drake_cafim.effects.actuator import ActuatorBias, ActuatorDelay, ActuatorLag
from drake_cafim.effects.coupling import JointElasticity
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointSpring, JointViscousFriction
from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.scenario.unknown import apply_unknowns
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

ARM = """<robot name="arm" xmlns:drake="http://drake.mit.edu">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="2.0"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0 0 -0.12"/><mass value="1.2"/>
    <inertia ixx="0.008" iyy="0.008" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 -0.3"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="12" velocity="4"/></joint>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type>
    <joint name="elbow"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="drive"><drake:rotor_inertia value="0.03"/><drake:gear_ratio value="1"/></actuator></transmission>
</robot>
"""
SCENARIO = """model: arm.urdf
weld: [{body: base}]
channels: {q: {std: 2.0e-3}, v: {std: 2.0e-2}, u: {std: 0.0}}
unknown: [{parameter: mass, body: fore, std: 0.1}]
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(ARM)
    (folder / "scenario.yaml").write_text(SCENARIO)
    return Scene.load(folder / "scenario.yaml")


@dataclass(frozen=True)
class Linear:
    """Rows that are linear in one unknown and in each effect's strengths."""

    data: Array
    unknown: Array
    effects: dict[str, Array]

    @property
    def rows(self) -> int:
        return len(self.data)

    @property
    def runs(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(weak=SimpleNamespace(rows_per_window=3))]

    @property
    def scene(self) -> SimpleNamespace:
        return SimpleNamespace(priors=Parameters.of([Parameter("mass", 1.5, 0.2, unit="kg")]))

    def matrix(self, effect: Effect) -> Array:
        return np.column_stack([self.unknown, self.effects[effect.name]])

    def residual(self, model: Model) -> Array:
        [effect] = model.effects
        numbers = np.concatenate([model.unknown - 1.5, effect.vector])
        return np.concatenate([self.matrix(effect) @ numbers - self.data, np.zeros(1)])

    def jacobian(self, model: Model) -> Array:
        [effect] = model.effects
        return np.concatenate([self.matrix(effect), np.zeros((1, 2))])


@pytest.fixture
def linear() -> Linear:
    random = np.random.default_rng(3)
    columns = {name: random.normal(size=12) for name in ("actuator_bias", "joint_viscous_friction")}
    return Linear(random.normal(size=12), 4.0 * random.normal(size=12), columns)


def _models() -> tuple[Model, Model]:
    unknown = np.array([1.5])
    bias, friction = ActuatorBias("elbow", {"torque": 0.4}), JointViscousFriction("elbow", {"coefficient": 0.7})
    return Model(unknown, (bias,)), Model(unknown, (friction,))


def _spread(linear: Linear, model: Model) -> Array:
    """The covariance of unit noise and of what is unknown beforehand."""
    [effect] = model.effects
    X = linear.matrix(effect) * np.array([0.2, effect.strengths[0].typical])
    return np.eye(linear.rows) + X @ X.T


def test_the_evidence_of_linear_rows_is_that_of_a_gaussian(linear: Linear) -> None:
    first, second = _models()
    # friction cannot drive: a coefficient that the data want below zero is no Gaussian's any more
    random = np.random.default_rng(0)
    linear = replace(linear, data=linear.matrix(second.effects[0]) @ [0.1, 2.0] + random.normal(size=linear.rows))
    found = explain(linear, first).log_evidence - explain(linear, second).log_evidence
    zero = np.zeros(linear.rows)
    exact = [
        multivariate_normal.logpdf(linear.data, zero, _spread(linear, explanation)) for explanation in (first, second)
    ]
    assert found == pytest.approx(exact[0] - exact[1], abs=2e-3)


def test_the_expected_odds_of_linear_rows_are_those_of_gaussians(linear: Linear) -> None:
    truth, rival = _models()
    linear = replace(linear, data=np.zeros(linear.rows))
    signal = linear.matrix(truth.effects[0]) @ [0.0, 0.4]

    def closed(model: Model) -> float:
        S = _spread(linear, model)
        precision = np.linalg.inv(S)
        return -0.5 * float(signal @ precision @ signal + np.trace(precision) + np.linalg.slogdet(S)[1])

    # no bound is met: the same law, of which a negative coefficient is no friction
    free = replace(linear, effects=linear.effects | {"joint_viscous_friction": _aligned(linear)})
    linear = free
    own, other = expected(linear, linearise(linear, truth), linearise(linear, rival))
    assert expected_log_odds(own, other)[-1] == pytest.approx(closed(truth) - closed(rival), abs=2e-3)


def test_a_course_holds_the_evidence_of_every_part_and_of_repeats(linear: Linear) -> None:
    first, _ = _models()
    whole = explain(linear, first)
    course = Course.of(linear, whole)
    for window in range(4):
        part = explain(linear, first, rows=3 * (window + 1)).log_evidence
        assert course.log_evidence[window] == pytest.approx(part, abs=2e-3)
    twice = replace(
        linear,
        data=np.tile(linear.data, 2),
        unknown=np.tile(linear.unknown, 2),
        effects={name: np.tile(column, 2) for name, column in linear.effects.items()},
    )
    repeated = course.after(course).log_evidence[-1]
    assert repeated == pytest.approx(explain(twice, first).log_evidence, abs=2e-3)


def _aligned(linear: Linear) -> Array:
    """The friction's column, on the bias's side."""
    bias, friction = linear.effects["actuator_bias"], linear.effects["joint_viscous_friction"]
    return friction + 2.0 * bias


def test_motions_keep_the_limits_and_come_home(scene: Scene) -> None:
    shape, limits = Shape(), Limits.of(scene.tree)
    random = np.random.default_rng(0)
    for _ in range(5):
        found = plan(shape, limits, scene.physics, random.uniform(-1.0, 1.0, (shape.points, 2)))
        assert np.all(found.q >= limits.lower) and np.all(found.q <= limits.upper)
        assert np.all(np.abs(found.v) <= limits.speed * (1.0 + 1e-9))
        assert np.all(np.abs(found.u) <= limits.effort)
        np.testing.assert_allclose(found.q[[0, -1]], np.tile(limits.home, (2, 1)), atol=1e-9)
        np.testing.assert_allclose(found.v[[0, -1]], 0.0, atol=1e-6)


def test_a_command_within_reach_is_taken_as_it_is(scene: Scene) -> None:
    shape, limits = Shape(), Limits.of(scene.tree)
    commands = np.full((shape.points, 2), 0.01)
    found = control_points(shape, limits, commands)[3:-3]
    np.testing.assert_allclose(found, np.tile(0.01 * limits.upper, (shape.points, 1)), rtol=1e-12)
    far = control_points(shape, limits, np.ones((shape.points, 2)))
    assert np.max(np.abs(np.diff(far, axis=0)) / shape.spacing) == pytest.approx(limits.speed.max())


def test_inverse_dynamics_are_those_of_drake(scene: Scene) -> None:
    from pydrake.multibody.tree import MultibodyForces

    random = np.random.default_rng(1)
    q, v, a = random.normal(size=(3, 4, 2))
    found = inverse_dynamics(scene.physics, np.arange(4.0), q, v, a)
    plant = scene.plant
    context = plant.CreateDefaultContext()
    for k in range(4):
        plant.SetPositions(context, q[k])
        plant.SetVelocities(context, v[k])
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        np.testing.assert_allclose(found[k], plant.CalcInverseDynamics(context, a[k], forces), atol=1e-9)


def test_the_robot_of_the_model_follows_its_plan(scene: Scene) -> None:
    shape, limits = Shape(points=8), Limits.of(scene.tree)
    planned = plan(shape, limits, scene.physics, np.random.default_rng(2).uniform(-1.0, 1.0, (8, 2)))
    run = simulated(scene.physics, scene.physics, limits, planned)
    assert np.max(np.abs(run.q - planned.q)) < 2e-4


def test_a_stiff_joint_moves_as_a_rigid_one_and_a_soft_one_does_not(scene: Scene) -> None:
    shape, limits = Shape(points=6), Limits.of(scene.tree)
    planned = plan(shape, limits, scene.physics, np.random.default_rng(2).uniform(-1.0, 1.0, (6, 2)))

    rigid = simulated(scene.physics, scene.physics, limits, planned)

    def apart(stiffness: float) -> float:
        soft = JointElasticity("elbow", {"stiffness": stiffness, "damping": 1e-3 * stiffness})
        physics = scene.physics.with_effects([soft])
        return float(np.max(np.abs(simulated(physics, scene.physics, limits, planned).q - rigid.q)))

    # what is left of a rotor on a spring goes with its compliance
    assert apart(2e4) == pytest.approx(apart(5e3) / 4.0, rel=0.3)
    assert apart(2e4) < 1e-3


@pytest.mark.parametrize(
    "truth",
    [
        ActuatorDelay("elbow", {"delay": 0.006}),
        ActuatorLag("elbow", {"time_constant": 0.006}),
        JointElasticity("elbow", {"stiffness": 60.0, "damping": 0.2}),
    ],
)
def test_a_simulated_run_leaves_its_own_model_nothing_but_noise(scene: Scene, truth: Effect) -> None:
    shape, limits = Shape(points=15), Limits.of(scene.tree)
    planned = plan(shape, limits, scene.physics, np.random.default_rng(2).uniform(-1.0, 1.0, (15, 2)))
    model = Model(scene.priors.mean, (truth,))
    physics = model.physics(scene)
    run, rows = simulated(physics, scene.physics, limits, planned), []
    for seed in range(8):
        read = measured(scene, physics, run, noise_of(scene), np.random.default_rng(seed), "run")
        problem = problem_of(scene, [read])
        rows.append(problem.residual(model)[: problem.rows])
    assert float(np.mean(np.square(rows))) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / np.size(rows)))


def faint(scene: Scene) -> Pair:
    """A bias that hardly shows, and a spring."""
    unknown = scene.priors.mean
    spring = JointSpring("elbow", {"stiffness": 0.03, "rest": 0.6})
    return Pair(Model(unknown, (ActuatorBias("elbow", {"torque": 0.02}),)), Model(unknown, (spring,)))


@pytest.mark.long
def test_a_designed_motion_beats_random_ones_and_its_run_says_so(scene: Scene) -> None:
    shape = Shape()
    config = PlannerConfig(candidates=12, horizon=shape.points, knots=11, knot_std=0.6)
    designer = Designer.of(scene, shape, Effort(config, rounds=10, generations=4))
    pair, random = faint(scene), np.random.default_rng(0)
    odds = Odds((pair,))
    usual = [odds(designer.problem(designer.motion(designer.random_commands(random)))) for _ in range(8)]
    design = designer.design(odds, random)
    assert design.value > 1.2 * max(usual)
    assert odds(designer.problem(design.planned)) == pytest.approx(design.value)
    for truth, sign in ((pair.first, 1.0), (pair.second, -1.0)):
        physics = truth.physics(scene)
        run = simulated(physics, scene.physics, designer.limits, design.planned)
        problem = problem_of(scene, [measured(scene, physics, run, noise_of(scene), np.random.default_rng(1), "run")])
        assert sign * log_odds(problem, pair) > 3.0
        assert settled_after(problem, pair, sign) <= shape.duration


def test_the_time_until_odds_are_settled_goes_on_over_repeats(scene: Scene) -> None:
    designer, pair = Designer.of(scene), faint(scene)
    problem = designer.problem(designer.motion(designer.random_commands(np.random.default_rng(5))))
    own, other = expected(problem, linearise(problem, pair.first), linearise(problem, pair.second))
    after_one = float(expected_log_odds(own, other)[-1])
    duration = designer.shape.duration
    within, beyond = (Soonest((pair,), log_odds=x * after_one).directions(problem, pair)[0] for x in (0.2, 2.0))
    assert 0.0 < within < duration < beyond
    value = Soonest((pair,), log_odds=2.0 * after_one)
    assert 1.0 / value(problem) > max(value.directions(problem, pair))


def test_a_walk_has_passed_a_threshold_as_often_as_is_said() -> None:
    random, threshold, count = np.random.default_rng(0), 3.0, 4000
    steps = 0.002 + random.normal(size=(count, 3000)) * np.sqrt(0.004)
    walks = np.maximum.accumulate(np.cumsum(steps, axis=1), axis=1)
    means = np.array([1.0, 3.0, 6.0])
    found = np.mean(walks[:, (500 * means - 1).astype(int)] >= threshold, axis=0)
    # a walk that is linearise at in steps misses some of its peaks
    np.testing.assert_allclose(passed(means, threshold), found, atol=0.03)


@pytest.mark.long
def test_a_start_is_among_the_candidates(scene: Scene) -> None:
    designer, odds = (
        replace(Designer.of(scene), effort=replace(default_effort(Shape()), rounds=0, generations=0)),
        Odds((faint(scene),)),
    )
    good = designer.design(odds, np.random.default_rng(1))
    other = Information((faint(scene).first,))
    assert designer.design(other, np.random.default_rng(1), starts=[good.knots]).value >= other(
        designer.problem(good.planned)
    )
    np.testing.assert_array_equal(designer.commands(good.knots), good.commands)
    poor = np.zeros_like(good.knots)
    assert designer.design(odds, np.random.default_rng(1), starts=[poor]).value == good.value


def test_a_rehearsal_says_what_a_smooth_plan_says(scene: Scene) -> None:
    designer = Designer.of(scene, Shape(points=10))
    random, odds = np.random.default_rng(5), Odds((faint(scene),))
    planned = [designer.motion(designer.random_commands(random)) for _ in range(2)]
    found = designer.rehearsal(odds)(planned)
    np.testing.assert_allclose(found, [odds(designer.problem(motion)) for motion in planned], rtol=0.05, atol=0.05)
    assert found[0] != pytest.approx(found[1], rel=0.2)


@pytest.mark.long
def test_the_motion_that_does_best_in_rehearsal_is_kept(scene: Scene) -> None:
    shape = Shape(points=6)
    effort = replace(default_effort(shape), rounds=1, generations=1, rehearsals=1)
    designer, odds = Designer.of(scene, shape, effort), Odds((faint(scene),))
    found = designer.design(odds, np.random.default_rng(1))
    poor = replace(found, knots=np.zeros_like(found.knots))
    best = designer.rehearse(odds, poor, np.random.default_rng(1), starts=[found.knots])
    assert best.value >= designer.rehearsal(odds)([found.planned])[0]
    assert best.value == pytest.approx(designer.rehearsal(odds)([best.planned])[0])


def test_physics_that_are_kept_are_those_of_their_unknowns(scene: Scene) -> None:
    other = scene.corrected(scene.priors.mean + 0.01, ())
    for k in range(300):
        vector = scene.priors.mean + 1e-4 * (k % 200)
        for each in (scene, other):
            kept, fresh = each.physics_at(vector), apply_unknowns(each.unknown, each.physics, vector)
            assert kept.tree.bodies[1].mass == fresh.tree.bodies[1].mass
    assert scene.physics_at(vector) is scene.physics_at(vector.copy())


def test_runs_side_by_side_are_those_of_one_after_another(scene: Scene) -> None:
    shape, limits, random = Shape(points=4), Limits.of(scene.tree), np.random.default_rng(3)
    effects = [JointElasticity("elbow", {"stiffness": 60.0, "damping": 0.2}), ActuatorDelay("elbow", {"delay": 0.006})]
    physics = scene.physics.with_effects(effects)
    planned = [plan(shape, limits, scene.physics, random.uniform(-1.0, 1.0, (4, 2))) for _ in range(3)]
    together = simulated_together(physics, scene.physics, limits, planned)
    for motion, run in zip(planned, together, strict=True):
        alone = simulated(physics, scene.physics, limits, motion)
        np.testing.assert_allclose(run.q, alone.q, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(run.u, alone.u, rtol=1e-8, atol=1e-10)
    assert np.max(np.abs(together[0].q - together[1].q)) > 0.1


def test_information_counts_every_effect_once(scene: Scene) -> None:
    designer, pair = Designer.of(scene), faint(scene)
    problem = designer.problem(designer.motion(designer.random_commands(np.random.default_rng(5))))
    alone = Information((pair.first,))(problem)
    assert Information((pair.first, pair.first))(problem) == pytest.approx(alone)
    assert Information((pair.first, pair.second))(problem) > alone


def test_planned_odds_are_what_runs_bring_on_average(scene: Scene) -> None:
    designer, pair = Designer.of(scene), faint(scene)
    planned = designer.motion(designer.random_commands(np.random.default_rng(5)))
    expected = Odds((pair,)).directions(designer.problem(planned), pair)
    for truth, sign, wanted in ((pair.first, 1.0, expected[0]), (pair.second, -1.0, expected[1])):
        physics = truth.physics(scene)
        run = simulated(physics, scene.physics, designer.limits, planned)
        found = []
        for seed in range(12):
            recording = measured(scene, physics, run, noise_of(scene), np.random.default_rng(seed), "run")
            found.append(sign * log_odds(problem_of(scene, [recording]), pair))
        # odds spread with twice the root of half what they are, at most
        spread = np.sqrt(2.0 * max(abs(wanted), 1.0) / len(found))
        assert float(np.mean(found)) == pytest.approx(wanted, abs=4.0 * spread)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("actuator_bias", "joint_spring@elbow"), "EFFECT@PLACE"),
        (("actuator_bais@elbow", "joint_spring@elbow"), "actuator_bais"),
        (("actuator_bias@wrist", "joint_spring@elbow"), "shoulder, elbow"),
        (("actuator_bias@elbow", "actuator_bias@elbow"), "different"),
        (("external_disturbance@fore", "joint_spring@elbow"), "no motion of the robot"),
        (("joint_elasticity@shoulder", "joint_spring@elbow"), "elbow"),
    ],
)
def test_explanations_that_cannot_be_are_refused(scene: Scene, words: tuple[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        named_pair(scene, *words)


def test_channels_without_noise_are_refused(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    with pytest.raises(InputError, match="has no std"):
        noise_of(Scene.from_model(tmp_path / "arm.urdf", weld=["base"]))
