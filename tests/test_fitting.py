"""Fits on a pendulum: the estimate is near the truth, also where the regressors are mostly noise."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.posterior import subtract_excess
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.robust_covariance import wald_p_value
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.pulses import pulses_of, strongest_pushes
from drake_cafim.diagnosis.rows.samples import samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import REGRESSOR_SIGNAL_SHARE
from drake_cafim.effects.actuator import ActuatorDelay
from drake_cafim.effects.body import ExternalDisturbance, pulse
from drake_cafim.effects.coupling import JointBacklash, JointCoupling, JointElasticity
from drake_cafim.effects.joint import JointSpring, JointViscousFriction
from drake_cafim.effects.link import Payload
from drake_cafim.effects.sensor import SensorGainError
from drake_cafim.effects.timing import SensorDelay
from drake_cafim.effects.transmission import JointHardStop
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.schema import parse
from drake_cafim.scene.scene import Scene

MODEL = """<robot name="slider"><link name="base"/>
  <link name="block"><inertial><mass value="2.0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/></joint>
  <transmission name="drive"><type>transmission_interface/SimpleTransmission</type>
    <joint name="rail"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="rail"><drake:rotor_inertia value="ROTOR"/><drake:gear_ratio value="1"/></actuator></transmission>
</robot>"""
PUSH = {"x": 3.0, "start": 1.228, "stop": 1.428}
NOISE = {"q.rail": 1e-4, "v.rail": 0.03, "u.rail": 0.0}


def sliding_mass(
    folder: Path, *, mass: float, friction: float, seed: int, still: bool = False, rotor: float = 0.0, N: int = 1500
) -> WeakProblem:
    """A sliding mass, solved exactly between the steps of its effort; the velocity is measured badly."""
    (folder / "slider.urdf").write_text(MODEL.replace("ROTOR", str(rotor)))
    rng = np.random.default_rng(seed)
    h = 0.002
    time = h * np.arange(N)
    u = np.zeros(N) if still else 4.0 * np.sin(2 * np.pi * 1.3 * time) + 2.0 * np.sin(2 * np.pi * 3.1 * time)
    q, v = np.zeros(N), np.zeros(N)
    rate = friction / mass
    for k in range(N - 1):
        decay, toward = np.exp(-rate * h), u[k] / friction if friction else 0.0
        if friction:
            v[k + 1] = toward + (v[k] - toward) * decay
            q[k + 1] = q[k] + toward * h + (v[k] - toward) * (1.0 - decay) / rate
        else:
            v[k + 1] = v[k] + h * u[k] / mass
            q[k + 1] = q[k] + h * v[k] + 0.5 * h**2 * u[k] / mass
    columns = {"q.rail": q + 1e-4 * rng.normal(size=N), "v.rail": v + 0.03 * rng.normal(size=N), "u.rail": u}

    raw = {"model": "slider.urdf", "weld": [{"body": "base"}],
           "unknown": [{"parameter": "mass", "body": "block", "mean": 2.0, "std": 0.4}]}  # fmt: skip
    scene = Scene.build(parse(raw, "test"), folder, "test")
    weak = WeakForm(samples_of(scene, Recording("a", time, columns), NOISE), ())
    return WeakProblem.of(scene, [weak], Model(scene.priors.mean))


@pytest.mark.long
def test_estimates_are_centred_and_as_sure_as_they_say(tmp_path: Path) -> None:
    scores = []
    for seed in range(30):
        problem = sliding_mass(tmp_path, mass=2.3, friction=1.5, seed=seed)
        start = Model(problem.scene.priors.mean, (JointViscousFriction("rail", {"coefficient": 1.0}),))
        found = unbiased_fit(problem, start)
        # under the model that was found, as a search whitens them
        found = unbiased_fit(problem.rewhitened(found.model), found.model)
        scores.append((found.model.vector - [2.3, 1.5]) / found.std)
    mean, std = np.mean(scores, axis=0), np.std(scores, axis=0)
    assert np.all(np.abs(mean) < 4.0 / np.sqrt(30)), mean
    assert np.all((std > 0.65) & (std < 1.45)), std


def test_a_gain_of_pure_noise_is_not_significant(tmp_path: Path) -> None:
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=1, still=True)
    gain = SensorGainError("v.rail", {"gain": 1.05})
    found = unbiased_fit(problem, Model(problem.scene.priors.mean, (gain,)))
    assert wald_p_value(problem, found, gain.key) > 0.01


@pytest.mark.parametrize("seed", range(3))
def test_a_mass_is_not_drawn_to_zero_by_noise(tmp_path: Path, seed: int) -> None:
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=seed)
    found = unbiased_fit(problem, problem.nominal())
    assert abs(found.model.unknown[0] - 2.0) < 4.0 * found.std[0]


@pytest.mark.parametrize(
    "coupling",
    [
        JointElasticity("rail", {"stiffness": 1e6, "damping": 500.0}),
        JointBacklash("rail", {"gap": 0.0, "stiffness": 1e6, "damping": 500.0}),
    ],
)
def test_a_stiff_coupling_is_a_rigid_one(tmp_path: Path, coupling: JointCoupling) -> None:
    """Also where its law has no start to reckon with, as a gap's has not."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=3, rotor=0.5)
    rigid = fit(problem, problem.nominal())
    coupled = problem.residual(rigid.model.with_effects([coupling]))
    assert float(coupled @ coupled) == pytest.approx(rigid.chi_square, abs=1.0)
    fitted = fit(problem, rigid.model.with_effects([coupling]))
    assert rigid.chi_square - 12.0 < fitted.chi_square < rigid.chi_square + 12.0


def test_what_begins_beyond_its_bounds_is_fitted_from_them(tmp_path: Path) -> None:
    """Shapes are tried at multiples of a stiffness that may stand at its bound already; beyond it there is no slope."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=3, rotor=0.5)
    beyond = JointElasticity("rail", {"stiffness": 1.6e8, "damping": 1.0})
    fitted = fit(problem, Model(problem.scene.priors.mean, (beyond,)))
    assert fitted.model.effects[0].values["stiffness"] <= 1e8
    assert np.all(np.isfinite(fitted.jacobian)) and np.all(np.isfinite(fitted.covariance))


def test_of_what_no_row_sees_nothing_is_known(tmp_path: Path) -> None:
    problem = sliding_mass(tmp_path, mass=2.3, friction=0.0, seed=4)
    stop = JointHardStop("rail", {"position": 100.0, "stiffness": 10.0, "damping": 0.1})
    found = fit(problem, Model(problem.scene.priors.mean, (stop,)))
    assert found.std[0] < 0.4 and np.all(found.std[1:] >= 1e6)
    assert found.model.effects[0].values == stop.values


@pytest.mark.parametrize(("along", "seen"), [(30.0, True), (0.0, False)])
def test_a_push_is_judged_by_the_direction_that_is_felt(tmp_path: Path, along: float, seen: bool) -> None:
    """However large it came out along the ones that are not, of which slopes know no more than rounding."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=0, still=True)
    rng = np.random.default_rng(1)
    felt = np.array([0.8, 0.0, 0.6])
    force = along * felt + 500.0 * np.array([0.6, 0.0, -0.8])
    columns = rng.normal(size=(problem.rows + 1, 6)) / np.sqrt(problem.rows)
    columns[:, 1:4] = np.outer(columns[:, 1], felt) + 3e-6 * columns[:, 1:4]
    columns[:, 2] = 1e-17 * columns[:, 0]
    columns[:, 4:] *= 1000.0  # that it lasts is known, as of any push that is felt
    values = dict(zip("xyz", force, strict=True)) | {"start": 1.0, "stop": 1.1}
    push = ExternalDisturbance("block", values, "a")
    covariance = np.linalg.pinv(columns.T @ columns, rcond=1e-30, hermitian=True)
    fitted = Fit(Model(np.array([2.0]), (push,)), rng.normal(size=len(columns)), columns, covariance, problem.rows)
    assert (wald_p_value(problem, fitted, push.key) < 1e-6) is seen


class _Pushed(Problem):
    """A push whose force along y moves the rows by noise alone, of which a `share` is the rows' own."""

    runs = (SimpleNamespace(name="a", shape=(1000, 1), rows=1000),)
    scene: Any = SimpleNamespace(unknown=(), priors=SimpleNamespace(mean=np.zeros(0), std=np.zeros(0), clip=np.array))

    def __init__(self, along_y: float, share: float) -> None:
        rng = np.random.default_rng(2)
        self.columns, self.noise = rng.normal(size=(1000, 5)) * [1.0, 1.0, 1.0, 10.0, 10.0], rng.normal(size=1000)
        mixed = np.sqrt(1.0 - share**2) * self.columns[:, 1] - share * self.noise
        self.columns[:, 1] = along_y / np.sqrt(1000) * mixed

    def rows_of(self, model: Model) -> np.ndarray:
        strengths = model.vector if model.effects else np.array([0.0, 0.0, 0.0, 1.0, 1.2])
        return self.noise + self.columns @ (strengths - [3.0, 0.0, 2.0, 1.0, 1.2])

    def jacobian(self, model: Model) -> np.ndarray:
        return self.columns

    @property
    def regressors_noisy(self) -> bool:
        return True

    def shared_noise(self, model: Model, residual: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        only_y = jacobian * [0.0, 1.0, 0.0, 0.0, 0.0]
        return np.zeros(5), only_y.T @ only_y

    def rewhitened(self, model: Model) -> "_Pushed":
        return self

    def plausible(self, model: Model) -> bool:
        return True


@pytest.mark.parametrize(("along_y", "share", "echo"), [(0.3, 0.0, False), (30.0, 0.0, False), (30.0, 0.5, True)])
def test_a_push_is_no_echo_for_a_direction_that_is_not_seen(along_y: float, share: float, echo: bool) -> None:
    """It is one where noise of that direction is what fits the rows."""
    problem = _Pushed(along_y, share)
    push = ExternalDisturbance("hand", {"x": 2.5, "y": 0.0, "z": 2.5, "start": 1.0, "stop": 1.2}, "a")
    found = unbiased_fit(problem, Model(np.zeros(0), (push,)))
    assert found.echo is echo
    assert (wald_p_value(problem, found, push.key) < 1e-6) is not echo
    if not echo:
        assert found.std[1] > 1e4 and np.all(found.std[[0, 2]] < 0.1)
        assert found.model.effects[0].values["x"] == pytest.approx(3.0, abs=0.2)


class _Unseen(_Pushed):
    """Two unknowns: the rows' slopes by the second are noise of the measurement, and so is what they fit."""

    def __init__(self, louder: float) -> None:
        rng = np.random.default_rng(4)
        self.scene = SimpleNamespace(
            unknown=2 * (SimpleNamespace(through="", kind="body"),),
            priors=SimpleNamespace(mean=np.zeros(2), std=np.array([0.5, 0.1]), clip=np.array),
        )
        self.columns, self.noise = rng.normal(size=(1000, 2)) * [1.0, 3e4], rng.normal(size=1000)
        self.louder = louder

    def rows_of(self, model: Model) -> np.ndarray:
        return self.noise + self.columns @ model.vector

    def jacobian(self, model: Model) -> np.ndarray:
        return np.vstack([self.columns, np.diag([2.0, 10.0])])

    @property
    def regressors_noisy(self) -> bool:
        return True

    def shared_noise(self, model: Model, residual: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        error = jacobian * [0.0, self.louder]
        return np.zeros(2), error.T @ error


@pytest.mark.parametrize(("louder", "known"), [(0.0, True), (0.8, True), (0.95, False), (3.0, False)])
def test_no_unknown_is_known_less_well_than_by_its_prior(louder: float, known: bool) -> None:
    """Where a regressor is noise, what the prior says is left; the rows' own share was once all that was left of it."""
    problem = _Unseen(louder)
    found = unbiased_fit(problem, Model(np.zeros(2)))
    assert found.std[0] == pytest.approx(1.0 / np.sqrt(1000), rel=0.1)
    assert (found.std[1] < 1e-5) if known else (0.09 < found.std[1] <= 0.1 * (1.0 + 1e-9))


@pytest.mark.parametrize(("moments", "there"), [((1.5, -1.0, 2.0), False), ((8.0, 0.0, 0.0), True)])
@pytest.mark.parametrize("mass", [1e-3, 0.3, 20.0])
def test_a_load_is_judged_by_its_moments_where_they_alone_are_known(
    tmp_path: Path, mass: float, moments: tuple[float, float, float], there: bool
) -> None:
    """However mass and place share them, neither counts as known: the p-value is that of the moments themselves."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=0, still=True)
    rng = np.random.default_rng(1)
    by_moment, _ = np.linalg.qr(rng.normal(size=(problem.rows + 1, 4)))
    place = np.array(moments) / mass
    columns = np.column_stack([by_moment[:, 0], by_moment[:, 1:] @ place, mass * by_moment[:, 1:]])
    load = Payload("block", dict(zip(("mass", "x", "y", "z"), (mass, *place), strict=True)))
    information = columns.T @ columns
    size = np.sqrt(np.diag(information))
    known, axes = np.linalg.eigh(information / np.outer(size, size))
    covariance = (axes / np.maximum(known, 1e-13)) @ axes.T / np.outer(size, size)
    fitted = Fit(Model(np.array([2.0]), (load,)), rng.normal(size=len(columns)), columns, covariance, problem.rows)
    p_value = wald_p_value(problem, fitted, load.key)
    # beside variances of 1e13 of what is not known, the others are right to a few thousandths
    assert p_value > 0.98 * chi2.sf(np.sum(np.square(moments)), 4)
    assert (p_value < 1e-6) is there


@pytest.mark.parametrize(("stiffness", "rings"), [(1e5, False), (20.0, True)])
def test_a_start_in_balance_costs_nothing(tmp_path: Path, stiffness: float, rings: bool) -> None:
    """A joint begins with a ring only where that, its doubt included, tells the rows better than balance does."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=1.5, seed=0, rotor=0.5)
    coupling = JointElasticity("rail", {"stiffness": stiffness, "damping": 1.0})
    physics = Model(problem.scene.priors.mean, (coupling,)).physics(problem.scene)
    run = problem.runs[0]
    begun = run.marginalise_start(physics)
    balanced = run.whitened(run.noisy_rows(physics))
    assert (begun.paid > 0.1) == rings
    if rings:
        assert begun.rows @ begun.rows + begun.paid < balanced @ balanced
    else:
        assert np.linalg.norm(begun.rows - balanced) < 1e-3 * np.linalg.norm(balanced)


def test_slopes_are_those_under_doubts_that_stay_as_they_are(tmp_path: Path) -> None:
    """The likelihood is at its largest in how wide they are; rows under widths of their own hide what a ring tells."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=1.5, seed=0, rotor=0.5)
    coupling = JointElasticity("rail", {"stiffness": 500.0, "damping": 1.0})
    model = Model(problem.scene.priors.mean, (coupling,))
    run = problem.runs[0]
    widths = run.marginalise_start(model.physics(problem.scene)).widths
    assert np.max(widths) > 0.1
    step = 0.1
    sides = (coupling.with_values({**coupling.values, "stiffness": 500.0 + change}) for change in (step, -step))
    ahead, behind = (
        run.marginalise_start(replace(model, effects=(side,)).physics(problem.scene), widths).rows for side in sides
    )
    held, slope = (ahead - behind) / (2.0 * step), problem.jacobian(model)[: run.rows, 1]
    doubts = run.marginalise_start(model.physics(problem.scene)).U.T
    np.testing.assert_allclose(doubts @ slope, doubts @ held, rtol=0.02, atol=0.02 * np.max(np.abs(doubts @ held)))


def test_a_spring_without_stiffness_is_absent(tmp_path: Path) -> None:
    """Where it would rest moves no row, and has no size to measure the others by."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=0)
    none = Model(problem.scene.priors.mean, (JointSpring("rail", {"stiffness": 0.0, "rest": 0.0}),))
    jacobian = problem.jacobian(none)
    slack = Fit(none, problem.residual(none), jacobian, np.linalg.pinv(jacobian.T @ jacobian), problem.rows)
    assert wald_p_value(problem, slack, ("joint_spring", "rail")) == 1.0


def test_slopes_in_unknowns_hold_the_noise_of_a_late_sensors_own_time(tmp_path: Path) -> None:
    """What was reckoned before the delay was known holds the noise of other samples: masses then came out biased."""
    late = Model(np.array([2.3]), (SensorDelay("v.rail", {"delay": 0.006}),))
    fresh = sliding_mass(tmp_path, mass=2.3, friction=0.0, seed=0)
    wanted = fresh.jacobian(late)[:, 0]
    used = sliding_mass(tmp_path, mass=2.3, friction=0.0, seed=0)
    before = used.jacobian(used.nominal())[:, 0]
    np.testing.assert_allclose(used.jacobian(late)[:, 0], wanted)
    assert np.linalg.norm(wanted - before) > 0.01 * np.linalg.norm(wanted)


@pytest.mark.parametrize("delay", [0.0007, 0.0031])
def test_a_velocity_steps_when_the_effort_acts(tmp_path: Path, delay: float) -> None:
    """Efforts that shake step the velocity between its samples."""
    like = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=0)
    h, N = 0.002, 1500
    time, u = h * np.arange(N), np.random.default_rng(4).normal(0.0, 40.0, N)
    fine = np.unique(np.concatenate([time, time + delay]))
    acting = u[np.maximum(np.searchsorted(time + delay, fine[:-1] + 1e-12, side="right") - 1, 0)]
    step = np.diff(fine)
    v = np.append(0.0, np.cumsum(step * acting / 2.0))
    q = np.append(0.0, np.cumsum(step * v[:-1] + 0.25 * step**2 * acting))
    at = np.searchsorted(fine, time)
    weak = WeakForm(
        samples_of(like.scene, Recording("a", time, {"q.rail": q[at], "v.rail": v[at], "u.rail": u}), NOISE), ()
    )
    rows = {
        name: weak.residual(Model(np.array([2.0]), effects).physics(like.scene))[:, 0]
        for name, effects in (("late", (ActuatorDelay("rail", {"delay": delay}),)), ("at once", ()))
    }
    assert np.abs(rows["late"]).max() < 0.1 * np.abs(rows["at once"]).max()


def test_the_strongest_push_is_where_it_was_and_gains_what_a_fit_does(tmp_path: Path) -> None:
    """Pulses are tried in rows of their own, kept for the next residual."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=0)
    pushed = Model(np.array([2.0]), (ExternalDisturbance("block", dict.fromkeys("yz", 0.0) | PUSH, "a"),))
    residual = problem.residual(problem.nominal()) - problem.residual(pushed)
    for _ in range(2):
        [found], tried = strongest_pushes(problem, residual)
        assert (found.start, found.stop) == pytest.approx((PUSH["start"], PUSH["stop"]), abs=2e-3)
        assert found.gain == pytest.approx(residual @ residual, rel=0.02)
        assert tried > 100


@pytest.mark.long
def test_pulses_gain_what_least_squares_do_and_are_kept_in_long_recordings_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = sliding_mass(tmp_path, mass=2.0, friction=0.0, seed=0, N=24_000)
    [run] = problem.runs
    assert run.rows > 3000
    residual = np.random.default_rng(2).normal(size=problem.rows)
    [found], tried = strongest_pushes(problem, residual)
    gains, windows, time = [], run.weak.samples.windows, run.weak.samples.time
    pulses = pulses_of(problem, 0)
    for tested in (*pulses[:: len(pulses) // 40], pulses[-1]):
        rows = np.zeros(run.shape)
        inside = np.where((time >= tested.start) & (time < tested.stop), pulse(time, tested.start, tested.stop), 0.0)
        rows[:, run.weak.dynamic.start] = windows.value @ inside
        column = run.whitened(rows)
        gains.append(float(column @ residual) ** 2 / float(column @ column))
        own = run.whiten.transposed(residual[:, None]).reshape(run.shape)[:, run.weak.dynamic]
        assert tested.gain(own) == pytest.approx(gains[-1], rel=1e-6)
    assert found.gain >= (1.0 - 1e-6) * max(gains)

    def computed_again(*_: object) -> None:
        raise AssertionError("a pulse is computed again for another residual")

    monkeypatch.setattr("drake_cafim.diagnosis.joints.pulses._pulse", computed_again)
    assert strongest_pushes(problem, residual + 1.0)[1] == tried


@pytest.mark.parametrize(("share", "kept"), [(0.0, 1.0), (0.5, 0.5), (2.0, REGRESSOR_SIGNAL_SHARE)])
def test_a_direction_of_numbers_that_are_each_known_is_known(share: float, kept: float) -> None:
    """Its information falls by what noise adds to it, to a fifth at the least; others keep all of theirs."""
    size = np.array([1e4, 1e-3, 1.0])
    axes, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    information = (axes * [0.2, 1.0, 2.0]) @ axes.T * np.outer(size, size)
    excess = share * 0.2 * np.outer(axes[:, 0], axes[:, 0]) * np.outer(size, size)
    left = subtract_excess(information, excess) / np.outer(size, size)
    np.testing.assert_allclose(axes.T @ left @ axes, np.diag([0.2 * kept, 1.0, 2.0]), atol=1e-9)
