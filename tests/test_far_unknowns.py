"""An unknown far from its prior: a mismatch at its place, and a rival of the effect that would take its part."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import Recording, Scene
from drake_cafim.diagnosis.diagnose import diagnose, examine
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.report.report_json import report_of
from tests.two_links import recording, scene

FAR = "unknown: [{parameter: mass, body: lower, mean: 0.6, std: 0.04}]"
"""The truth, 1.0 kg, is ten standard deviations away."""
ONE_LINK = """<robot name="pendulum"><link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1.0"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-9" upper="9" effort="50" velocity="50"/></joint></robot>"""


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Verdict:
    return diagnose(scene(tmp_path_factory.mktemp("heavy"), unknown=FAR), [recording("free", 3)])


def test_a_mass_ten_prior_deviations_away_is_a_mismatch_at_its_body(heavy: Verdict) -> None:
    assert heavy.kind == "unexplained" and heavy.explanation == ()
    (mass,) = heavy.parameters
    assert abs(mass.value - 1.0) < 4.0 * mass.std < 0.01 and mass.distance == pytest.approx(10.0, rel=0.01)
    (place,) = heavy.mismatch.locations
    assert heavy.mismatch.detected and (place.kind, place.name, place.share) == ("body", "lower", 1.0)
    assert "Mass of lower is" in str(heavy) and "10 standard deviations from the 0.6 kg of its prior" in str(heavy)
    assert any(record.step == "far_unknown" and record.asked == "mass@lower" for record in heavy.trace)
    assert heavy.reduced_chi_square[1] < 1.2


@pytest.mark.long
def test_its_friction_is_named_beside_it(tmp_path: Path) -> None:
    rubbed = [recording("rubbed", 4, friction=(0.0, 0.3))]
    verdict = diagnose(scene(tmp_path, unknown=FAR), rubbed)
    assert [(item.effect.name, item.effect.at) for item in verdict.explanation] == [("joint_coulomb_friction", "elbow")]
    assert verdict.kind == "unexplained" and verdict.parameters[0].distance > 9.0
    assert verdict.explanation[0].values["torque"].value == pytest.approx(0.3, rel=0.05)


def test_a_mass_four_prior_deviations_away_is_one_though_nothing_else_is_seen(tmp_path: Path) -> None:
    verdict = diagnose(
        scene(tmp_path, unknown="unknown: [{parameter: mass, body: lower, mean: 0.84, std: 0.04}]"),
        [recording("free", 3)],
    )
    assert verdict.kind == "unexplained" and verdict.explanation == () and verdict.mismatch.p_value < 1e-3
    assert [(parameter.parameter, parameter.at) for parameter in verdict.far] == [("mass", "lower")]


def test_within_three_it_is_none(tmp_path: Path) -> None:
    near = scene(tmp_path, unknown="unknown: [{parameter: mass, body: lower, mean: 0.9, std: 0.05}]")
    verdict = diagnose(near, [recording("free", 3)])
    assert verdict.kind == "none" and verdict.far == () and verdict.mismatch.locations == ()


def test_of_a_single_link_mass_and_gain_cannot_be_told_apart(tmp_path: Path) -> None:
    """u = m (l² q̈ + g l sin q) + I q̈: a mass, with the inertia that goes with it, is a factor of u."""
    (tmp_path / "pendulum.urdf").write_text(ONE_LINK)
    (tmp_path / "scenario.yaml").write_text(
        "model: pendulum.urdf\nweld: [{body: base}]\nchannels: {q: {std: 2.0e-4}, v: {std: 2.0e-3}, u: {std: 0.0}}\n"
        "unknown: [{parameter: mass, body: rod, mean: 0.5, std: 0.05}]\n"
    )
    verdict, outcome = examine(Scene.load(tmp_path / "scenario.yaml"), [_pendulum()])
    (gain,) = verdict.explanation
    (rival,) = [other for other in verdict.rivals if other.parameter is not None]
    assert (gain.effect.name, gain.effect.at) == ("actuator_gain_error", "pivot")
    assert (rival.parameter, rival.at, rival.effect) == ("mass", "rod", None)
    assert gain.probability >= max(other.probability for other in verdict.rivals)
    assert gain.probability + rival.probability <= 1.0 + 1e-9
    told = report_of(verdict, [], None, {})["rivals"]
    assert {"parameter": "mass", "at": "rod"}.items() <= next(item for item in told if "parameter" in item).items()
    assert outcome.best.model.free == () and verdict.kind == "explained"


def _pendulum() -> Recording:
    """A rod of 1 kg about its pivot under a sum of sines."""
    rng, step = np.random.default_rng(1), 0.002
    time = step * np.arange(2000)
    u = 4.0 * np.sin(3.0 * time) + 2.0 * np.sin(8.0 * time + 1.0) + np.sin(17.0 * time)
    state, states = np.zeros(2), np.zeros((len(time), 2))

    def rate(at: np.ndarray, effort: float) -> np.ndarray:
        return np.array([at[1], (effort - 9.81 * 0.5 * np.sin(at[0])) / (0.25 + 0.02)])

    for k, effort in enumerate(u):
        states[k] = state
        first = rate(state, effort)
        second = rate(state + 0.5 * step * first, effort)
        third = rate(state + 0.5 * step * second, effort)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + rate(state + step * third, effort))
    noisy = states + np.array([2e-4, 2e-3]) * rng.standard_normal(states.shape)
    return Recording("swing", time, {"q.pivot": noisy[:, 0], "v.pivot": noisy[:, 1], "u.pivot": u})
