"""Diagnosis of tosses: the missing effect is named, and none where nothing is missing."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import drake_cafim
from drake_cafim.diagnosis.diagnose import diagnose, estimate, examine
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.noise.coloured import Memory, drawn
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.tosses import initial_states as settling
from drake_cafim.diagnosis.tosses.arcs import arcs_of
from drake_cafim.diagnosis.tosses.initial_states import fit_initial_states
from drake_cafim.diagnosis.tosses.innovation import Innovation
from drake_cafim.diagnosis.tosses.poses import PoseNoise, track_of
from drake_cafim.diagnosis.tosses.preparation import PreparedTosses
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.surface_search import fit_surface
from drake_cafim.diagnosis.tosses.tangent import displace
from drake_cafim.effects.body import AerodynamicDrag
from drake_cafim.effects.surface import SurfaceTilt
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.report_html import render
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.concealed_case import written
from tests.tosses import BLOCK, SCENARIO, thrown, thrown_scene


@pytest.mark.long
def test_a_ball_that_lacks_nothing_and_one_in_thick_air(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    true = scene.physics_at(np.array([3150.0, 0.31]))
    verdict = diagnose(scene, thrown(true, 1, count=2))
    assert verdict.kind == "none", str(verdict)
    shift = {found.parameter: (found.value - found.prior_mean) / found.std for found in verdict.parameters}
    assert shift["stiffness"] > 2.0
    recordings = thrown(true.with_effects([AerodynamicDrag("body", {"coefficient": 0.1})]), 2)
    verdict, outcome = examine(scene, recordings[:2], held_out=recordings[2:])
    assert verdict.kind == "explained", str(verdict)
    (found,) = verdict.explanation
    assert found.effect.key == ("aerodynamic_drag", "body")
    assert found.values["coefficient"].value == pytest.approx(0.1, abs=4.0 * found.values["coefficient"].std)
    assert verdict.held_out is not None
    assert verdict.held_out.corrected.nll < verdict.held_out.nominal.nll
    assert verdict.held_out.corrected.rmse["pose.body.x"] < verdict.held_out.nominal.rmse["pose.body.x"]
    page = render(verdict, outcome, recordings[2:], ["cafim", "diagnose"])
    assert "turn about x" in page
    assert "simulated − measured (m)" in page
    assert "effort" not in page


def test_the_unknowns_of_a_toss_are_estimated(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    found = estimate(scene, thrown(scene.physics_at(np.array([3300.0, 0.27])), 4, count=1))
    for parameter, truth in zip(found.parameters, (3300.0, 0.27), strict=True):
        assert parameter.value == pytest.approx(truth, abs=4.0 * parameter.std)


def test_a_toss_without_its_pose_is_refused(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    (recording,) = thrown(scene.physics, 5, count=1)
    others = {name.replace("body", "hand"): values for name, values in recording.columns.items()}
    with pytest.raises(InputError, match=r"expected columns pose\.body\.x.*found pose\.hand"):
        diagnose(scene, [Recording("a.csv", recording.time, others)])
    scaled = {n: 2.0 * v if n[-2:] in ("qw", "qx", "qy", "qz") else v for n, v in recording.columns.items()}
    with pytest.raises(InputError, match="quaternion of length 2"):
        diagnose(scene, [Recording("a.csv", recording.time, scaled)])


def test_arcs_are_settled_from_a_wrong_beginning(tmp_path: Path) -> None:
    """A ball that slides where it rolled, and the other way round, bends too much for full steps."""
    scene = thrown_scene(tmp_path)
    true = scene.physics_at(np.array([3000.0, 0.3]))
    tracks = tuple(track_of(recording, "body") for recording in thrown(true, 6, count=2))
    noise = PoseNoise(2e-4, 2e-3)
    arcs = arcs_of(tracks, noise)
    rng = np.random.default_rng(8)
    wrong = displace(arcs.start, rng.normal(size=(len(arcs.counts), 12)) * np.repeat([1e-3, 0.01, 0.1, 5.0], 3))
    settled = fit_initial_states(replace(arcs, start=wrong), noise, true, wrong)
    assert not np.any(settled.improvable)
    np.testing.assert_allclose(settled.cost, 6.0 * arcs.counts, rtol=0.35)


def test_innovations_of_arcs_that_did_not_move_are_kept(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, BLOCK)
    noise = PoseNoise(2e-4, 2e-3)
    arcs = arcs_of([track_of(recording, "body") for recording in thrown(scene.physics, 9, count=2)], noise)
    step = np.zeros((len(arcs.start), 12))
    step[:2, 6:] = 0.3
    settled = fit_initial_states(arcs, noise, scene.physics, displace(arcs.start, step))
    anew = Innovation.of(settled.shot.start_jacobian)
    for part in ("reflections", "triangle", "spread"):
        kept, whole = getattr(settled.innovation, part), getattr(anew, part)
        np.testing.assert_allclose(kept, whole, rtol=1e-9, atol=1e-9 * float(np.max(np.abs(whole))))


def test_an_arc_on_the_wrong_side_of_an_edge_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block that lands on another corner fits no better for a small change; where the arc before ended, it does."""
    scene = thrown_scene(tmp_path, BLOCK)
    true = scene.physics_at(np.array([3000.0, 0.3]))
    noise = PoseNoise(2e-4, 2e-3)
    arcs = arcs_of([track_of(recording, "body") for recording in thrown(true, 6, count=1)], noise)
    off = np.random.default_rng(0).normal(size=(len(arcs.counts), 12)) * np.repeat([1e-3, 0.3, 0.1, 5.0], 3)
    off[::2] = 0.0
    wrong = displace(arcs.start, off)
    astray = replace(arcs, start=wrong)
    settled = fit_initial_states(astray, noise, true, wrong)
    np.testing.assert_allclose(settled.cost, 6.0 * arcs.counts, rtol=0.35)
    monkeypatch.setattr(settling, "SECOND_LOOKS", 0)
    assert np.any(fit_initial_states(astray, noise, true, wrong).cost > 100.0 * settled.cost)


@pytest.mark.long
def test_a_ground_that_is_tilted_by_far_is_found(tmp_path: Path) -> None:
    """With level ground a ball's arcs fit centimetres off their samples; from there the tilt seemed no better."""
    case = simulate("single:surface_tilt", "toss", 0xE841FF9AAD707E2882483F2FF5486021)
    scene, read = written(case, tmp_path)
    verdict = diagnose(scene, read[:1])
    [found], [effect] = verdict.explanation, case.truth["effects"]
    assert verdict.kind == "explained" and found.effect.key == ("surface_tilt", "ground")
    for name, (true, _) in effect["parameters"].items():
        assert found.values[name].value == pytest.approx(true, abs=4.0 * found.values[name].std)


@pytest.mark.long
def test_a_surface_stands_where_a_body_comes_to_and_does_not_pass(tmp_path: Path) -> None:
    """A box on ground that is tilted by 4°: level ground fits none of its arcs."""
    case = simulate("single:surface_tilt", "toss", 0x4A89AA4265669F76DDB3730E0202236E)
    prepared = prepare(*written(case, tmp_path))
    assert isinstance(prepared, PreparedTosses)
    found = fit_surface(prepared.tracks, prepared.scene.physics.contacts[0], SurfaceTilt("ground"))
    for name, (true, _) in case.truth["effects"][0]["parameters"].items():
        assert found.values[name] == pytest.approx(true, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "seed", "recordings"),
    [
        # a minute; another tilt is found from afar above
        pytest.param("surface_tilt", 0x4A89AA4265669F76DDB3730E0202236E, 3, marks=pytest.mark.long),
        pytest.param("contact_hunt_crossley_dissipation", 0x2340459A777EF7FF0C193DF1DB59730, 2, marks=pytest.mark.long),
    ],
)
def test_what_makes_throws_bounce_otherwise_is_found_from_afar(
    name: str, seed: int, recordings: int, tmp_path: Path
) -> None:
    """Under the model as given its arcs were so far off, and the unknowns then, that slopes led nowhere."""
    scene, read = written(simulate(f"single:{name}", "toss", seed), tmp_path)
    verdict = diagnose(scene, read[:recordings])
    assert verdict.kind == "explained"
    assert [explanation.effect.name for explanation in verdict.explanation] == [name]


def test_a_first_arc_that_strikes_an_edge_begins_as_its_half_did(tmp_path: Path) -> None:
    case = simulate("single:clock_skew", "toss", 0xF61DCAA8D622904A451AD863213FA1BA)
    case.write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [drake_cafim.read(tmp_path / "held_1.parquet")])
    assert isinstance(prepared, PreparedTosses)
    numbers = case.truth["nominal_parameters_true"]
    true = Model(np.array([numbers[unknown.parameter] for unknown in scene.unknown])).physics(prepared.scene)
    arcs = arcs_of(prepared.tracks, prepared.noise)
    settled = fit_initial_states(arcs, prepared.noise, true, arcs.start)
    assert not np.any(settled.far)
    assert settled.cost[0] < 2.0 * (6 * arcs.counts[0] - 12)


@pytest.mark.long
@pytest.mark.parametrize(
    "seed",
    [0xCF9DC434AEC3F34E2E51C2ABAD0F0360, 0x26F878FDC54B6AA7C3C297AFF9B1AF1F],
)
def test_edges_that_are_struck_otherwise_do_not_lead_astray(tmp_path: Path, seed: int) -> None:
    """Boxes without any missing physics; the prior means misfit some of their arcs up to three hundred times."""
    prepared = prepare(*written(simulate("null", "toss", seed), tmp_path))
    assert isinstance(prepared, PreparedTosses)
    problem = prepared.problem()
    given = Model(prepared.scene.priors.mean)
    assert np.any(TossProblem.linearised_at(prepared.scene, problem.arcs, problem.noise, given).base.far)
    found = unbiased_fit(problem, problem.nominal())
    assert found.chi_square < 1.1 * problem.rows


def test_a_slow_noise_that_is_not_stated_is_not_taken_for_a_small_one(tmp_path: Path) -> None:
    """The scenario says how long the noise of a pose lasts, and not how large it is."""
    unsaid = SCENARIO.replace("{std: {position: 2.0e-4, rotation: 2.0e-3}}", "{correlation_time: 0.01}")
    scene = thrown_scene(tmp_path, scenario=unsaid)
    rng, recordings = np.random.default_rng(3), thrown(scene.physics, 3, count=2, noise=(0.0, 2e-3))
    noisy = []
    for recording in recordings:
        slow = {
            c: recording[c] + 2e-4 * drawn(rng, recording.time, Memory(0.01)) for c in ("pose.body.x", "pose.body.y")
        }
        slow["pose.body.z"] = recording["pose.body.z"] + 2e-4 * drawn(rng, recording.time, Memory(0.01))
        noisy.append(replace(recording, columns={**recording.columns, **slow}))
    prepared = prepare(scene, noisy)
    assert isinstance(prepared, PreparedTosses)
    assert prepared.noise.position == pytest.approx(2e-4, rel=0.2)


def test_a_state_that_no_sample_tells_of_stays() -> None:
    """Under physics that is far off a flight may tell of none, or of two alike."""
    triangle = np.eye(12)[None].repeat(2, 0)
    triangle[0] = 0.0
    triangle[1, 1] = triangle[1, 0]
    triangle[1, :, 1] = triangle[1, :, 0]
    arcs: Any = SimpleNamespace(innovation=SimpleNamespace(triangle=triangle), damping=np.zeros(2))
    change = settling.FittedArcs._change(arcs, np.ones((2, 12)))
    np.testing.assert_array_equal(change[0], 0.0)
    np.testing.assert_allclose(change[1, 2:], -1.0)
    assert np.all(np.isfinite(change[1, :2]))
