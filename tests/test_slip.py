"""Dry friction that builds up over a displacement after the motion turns round is named, and simulates so."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from drake_cafim.corrected.brakes import brake_levels
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.left_out.law_terms import candidates
from drake_cafim.diagnosis.predict.forecast import forecast
from drake_cafim.diagnosis.rows.adjustment import adjust
from drake_cafim.diagnosis.rows.weak_form import memory_of
from drake_cafim.diagnosis.search import law_shapes
from drake_cafim.effects.friction import JointLoadDependentFriction, JointStribeckFriction
from drake_cafim.effects.joint import (
    SLIP_VELOCITY,
    SLIPS,
    DryFriction,
    JointAsymmetricCoulombFriction,
    JointCoulombFriction,
    doubt_at_rest,
)
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.learned_force import MEMORY, LearnedForce, Term
from drake_cafim.numerics.rounding import short
from drake_cafim.recordings.recording import Recording
from tests import test_learned_memory
from tests.test_learned_memory import FRICTION, MASS, SLIP, effort_at, prepared_with, slid
from tests.test_left_out import NOISE, STEP, scene

LAWS: list[DryFriction] = [
    JointCoulombFriction("rail", {"torque": 2.0}),
    JointAsymmetricCoulombFriction("rail", {"torque_positive": 2.0, "torque_negative": 1.5}),
    JointStribeckFriction("rail", {"coulomb": 1.5, "static": 2.5, "velocity": 0.05}),
    JointLoadDependentFriction("rail", {"torque": 1.0, "coefficient": 0.2}),
]


def with_slip(law: DryFriction, slip: float = SLIP) -> DryFriction:
    return replace(law, values={**law.values, "slip": slip})


def along(width: float = 0.0) -> JointSamples:
    """A path that turns round twice, with the velocity's std `width`."""
    t = np.linspace(0.0, 7.0, 400)
    return JointSamples(0.1 * np.sin(t), 0.1 * np.cos(t), 3.0 * np.cos(0.7 * t), width, in_order=True)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_after_a_way_of_many_slips_it_is_the_friction_that_jumps(law: DryFriction) -> None:
    path = along()
    given, jumping = with_slip(law, 1e-4).force(path).value, law.force(path).value
    sliding = (np.abs(path.v) > 10.0 * SLIP_VELOCITY.nominal) & (np.abs(path.q - path.q[0]) > 2e-3)
    assert np.sum(sliding) > 100
    np.testing.assert_allclose(given[sliding], jumping[sliding], rtol=1e-3)
    # with nothing known of the past it slides
    unknown = replace(path, in_order=False)
    np.testing.assert_array_equal(with_slip(law).force(unknown).value, law.force(unknown).value)


@pytest.mark.parametrize("std", [0.0, 0.01])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_its_slopes_are_those_of_its_force(law: DryFriction, std: float) -> None:
    law, path = with_slip(law), along(std)
    force, size = law.force(path), 1e-6
    for column, strength in enumerate(law.strengths):
        behind, ahead = (
            replace(law, values={**law.values, strength.name: law.values[strength.name] + step}).force(path).value
            for step in (-size, size)
        )
        np.testing.assert_allclose((ahead - behind) / (2.0 * size), force.d_strengths[:, column], atol=1e-6)
    known = replace(path, in_order=False, bristles={SLIP: path.bent(SLIP)})
    by_v = (law.force(replace(known, v=path.v + size)).value - law.force(known).value) / size
    np.testing.assert_allclose(by_v, force.d_v, atol=1e-3)
    # along a path that goes on in one direction the side follows the position
    moved = path.bent(SLIP) + size * (1.0 - np.sign(path.v) * path.bent(SLIP)) / SLIP
    by_q = (law.force(replace(known, bristles={SLIP: moved})).value - law.force(known).value) / size
    turning = np.abs(path.bent(SLIP)) < 1e-3
    np.testing.assert_allclose(by_q[~turning], force.d_q[~turning], atol=1e-3 * np.max(np.abs(force.d_q)))


def test_nothing_of_it_is_in_doubt_at_rest_and_no_brake_holds_it() -> None:
    path = along(0.01)
    for law in LAWS:
        assert np.max(doubt_at_rest(law, path)[1]) > 0.5
        assert not np.any(doubt_at_rest(with_slip(law), path))
    assert brake_levels(LAWS[:1]) == [FRICTION] and brake_levels([with_slip(law) for law in LAWS]) == [0.0] * 4


@pytest.mark.parametrize("way", [0.01, 0.0055])
def test_it_is_named_with_the_way_that_it_takes(way: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(test_learned_memory, "SLIP", way)
    recordings = [slid(str(seed), seed)[0] for seed in range(3)]
    verdict = diagnose(scene(tmp_path), recordings, held_out=[slid("9", 9)[0]])
    assert verdict.kind == "explained"
    [found] = verdict.explanation
    assert found.effect.key == ("joint_coulomb_friction", "rail")
    assert abs(found.values["torque"].value - FRICTION) < 4.0 * found.values["torque"].std
    assert found.effect.values["slip"] == pytest.approx(way, rel=0.01)
    assert f"(torque 2 N, built up over {short(found.effect.values['slip'])} m)" in found.sentence
    assert verdict.held_out.corrected.rmse["q.rail"] < 0.02 * verdict.held_out.nominal.rmse["q.rail"]


@pytest.mark.parametrize(("gain", "taken"), [(9.0, False), (11.0, True)])
def test_a_way_is_taken_where_its_rows_tell_of_it(gain: float, taken: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is left elsewhere: χ² as a whole is lower by 1 in a million here."""

    def stated(effect: DryFriction, chi_square: float) -> Fit:
        return cast(Fit, SimpleNamespace(model=Model(np.zeros(0), (effect,)), chi_square=chi_square, data_rows=10))

    jumps, builds_up = stated(LAWS[0], 1e6), stated(with_slip(LAWS[0]), 1e6 - 1.0)
    monkeypatch.setattr(law_shapes._Shapes, "_over_grid", lambda own, best: best)
    monkeypatch.setattr(law_shapes._Shapes, "_refined", lambda own, best, ratios: best)
    monkeypatch.setattr(law_shapes._Shapes, "_best_of", lambda own, best, others: (builds_up, 0.0))
    monkeypatch.setattr(law_shapes, "gain_over_residual", lambda problem, before, after: gain)
    found = law_shapes.fit_shapes(cast(SearchProblem, None), jumps)
    assert found is (builds_up if taken else jumps)


def jumping(seed: int, share: float = 1.0) -> Recording:
    """The mass under friction that jumps, moved by a `share` of the others' effort."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(1500)
    q, v, states, h = 0.0, 0.0, [], STEP / 32
    for effort in share * effort_at(time + 0.3 * seed):
        states.append((q, v, effort))
        for _ in range(32):
            v += h * (effort - FRICTION * np.tanh(v / 0.005)) / MASS
            q += h * v
    columns = np.array(states).T
    noise = np.array([*NOISE, 0.0])[:, None] * rng.normal(size=columns.shape)
    return Recording(str(seed), time, dict(zip(("q.rail", "v.rail", "u.rail"), columns + noise, strict=True)))


def test_friction_that_jumps_takes_no_way(tmp_path: Path) -> None:
    verdict = diagnose(scene(tmp_path), [jumping(seed) for seed in range(2)])
    [found] = verdict.explanation
    assert found.effect.key == ("joint_coulomb_friction", "rail") and found.effect.values.get("slip") is None


def test_what_holds_a_mass_over_a_short_way_does_not_blur_its_motion(tmp_path: Path) -> None:
    """Taken for a spring between two samples it would let the motion's error grow for as long as the mass rests."""
    recording = jumping(0, 0.3)
    assert np.mean(np.abs(recording.columns["v.rail"]) < 3.0 * NOISE[1]) > 0.3
    prepared, model = prepared_with(tmp_path, [recording], with_slip(LAWS[0], 1e-4))
    [weak], physics = prepared.weak, model.physics(prepared.scene)
    assert np.max(adjust(weak, physics).joint_samples(physics)[0].v_std) < 2.0 * NOISE[1]


def test_simulations_and_rows_follow_it(tmp_path: Path) -> None:
    recording, z = slid("a", 0)
    prepared, model = prepared_with(tmp_path, [recording], with_slip(LAWS[0]))
    [weak], physics = prepared.weak, model.physics(prepared.scene)
    assert np.max(np.abs(memory_of(weak, physics)[100:, 0] - z[100:])) < 0.05
    for horizon in (0.1, 1.0):
        simulated = forecast(weak, physics, horizon)
        error = simulated.predicted["q.rail"] - simulated.measured["q.rail"]
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.std(recording.columns["q.rail"])


def test_two_ways_at_one_joint_are_followed_each(tmp_path: Path) -> None:
    recording, _ = slid("a", 0, 2.0)
    halves = [JointCoulombFriction("rail", {"torque": 0.5 * FRICTION, "slip": SLIP})]
    learned = LearnedForce("rail", {}, (Term(MEMORY, (0.003,), (-0.5 * FRICTION,), 0.005),))
    prepared, model = prepared_with(tmp_path, [recording], *halves, learned)
    [weak], physics = prepared.weak, model.physics(prepared.scene)
    assert physics.bristles == ((0, 0.003), (0, SLIP)) and memory_of(weak, physics).shape[1] == 2
    assert np.all(np.isfinite(forecast(weak, physics, 0.1).predicted["q.rail"]))


def test_nothing_builds_up_beside_it_without_a_name() -> None:
    path = along()
    assert any(term.variables == MEMORY for term in candidates([path], LAWS[0]))
    assert not any(term.variables == MEMORY for term in candidates([path], with_slip(LAWS[0])))


def test_no_way_is_beyond_those_that_a_search_tries() -> None:
    for slip in (SLIPS[0], SLIPS[-1]):
        near = [float(law.values["slip"]) for law in with_slip(LAWS[0], slip).between_shapes(1.5)]
        assert len(near) == 1 and SLIPS[0] <= near[0] <= SLIPS[-1]
