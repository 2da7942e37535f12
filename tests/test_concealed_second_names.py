"""Second names: which other effects explain a sealed truth about as well, and how those of a pair are scored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_concealed_proof import COULOMB, report, truth

from tests.concealed.make import paired, seen_in, simulate
from tests.concealed.score import score
from tests.concealed.strength import Alternative, Excess, Leftovers, reckoned
from tests.concealed.strength_arm import ArmRows, arm_alternatives
from tests.concealed.summary import curve

VISCOUS = {"effect": "joint_viscous_friction", "at": "wrist", "parameters": {"coefficient": [0.1, ""]}}


def of_shapes(rows: np.ndarray, *unknown: np.ndarray, offset: tuple[float, ...] = ()) -> Excess:
    """One channel of three recordings, rows (3, W) in std."""
    known = (
        np.array([rows_of_unknown[:, :, None] for rows_of_unknown in unknown])
        if unknown
        else np.zeros((0, *rows.shape, 1))
    )
    return Excess(("elbow",), rows[:, :, None], known, np.zeros(rows.shape), np.array(offset))


def test_of_a_pair_either_name_may_be_an_accepted_one_but_not_both() -> None:
    sealed = [
        {"effect": "joint_load_dependent_friction", "at": "elbow", "log_bayes_factor": 1.0, "of": 0},
        {"effect": "actuator_gain_error", "at": "wrist", "log_bayes_factor": 2.0, "of": 1},
    ]
    load, gain = ("joint_load_dependent_friction", "elbow", {}), ("actuator_gain_error", "wrist", {})
    coulomb, viscous = ("joint_coulomb_friction", "elbow", {}), ("joint_viscous_friction", "wrist", {})
    both = truth([COULOMB, VISCOUS], "pair", accept=sealed)
    assert score(both, report("explained", load, viscous))["second_name"]
    assert score(both, report("explained", coulomb, gain))["right"]
    assert not score(both, report("explained", load, gain))["right"]
    assert not score(both, report("explained", load))["right"]
    assert not score(truth([COULOMB, VISCOUS], "pair"), report("explained", load, viscous))["right"]


def test_what_strains_a_prior_pays_for_it_and_the_truth_only_for_its_own() -> None:
    rng = np.random.default_rng(3)
    mass = 30.0 * rng.normal(size=(3, 200))
    effect = 2.0 * mass  # as if the mass were two prior std off
    [found] = Leftovers.of(of_shapes(effect, mass, offset=(1.0,)), []).acceptable(1)
    # The nominal moves the mass by two std, from one below its mean to one above: it pays the same as the truth.
    assert found["effect"] == "none" and found["log_bayes_factor"] == pytest.approx(-0.5 * np.log(600), abs=0.01)
    assert Leftovers.of(of_shapes(effect, mass, offset=(-4.0,)), []).acceptable(1) == []
    assert Leftovers.of(of_shapes(effect, mass, offset=(2.0,)), []).acceptable(1) != []


def test_what_is_fitted_beside_may_make_another_name_as_good() -> None:
    rng = np.random.default_rng(4)
    effect, other = 3.0 * rng.normal(size=(3, 200)), rng.normal(size=(3, 200))
    rival = Alternative("actuator_bias", "elbow", (effect + other)[None, :, :, None], 1)
    excess = of_shapes(effect)
    assert Leftovers.of(excess, [rival]).acceptable(1) == []
    [found] = Leftovers.of(excess, [rival], beside=other[None, :, :, None]).acceptable(1)
    assert (found["effect"], found["at"]) == ("actuator_bias", "elbow")


def test_sigma_is_the_distance_from_nothing_and_from_the_nearest_rival_that_is_as_simple() -> None:
    rng = np.random.default_rng(5)
    effect, other = rng.normal(size=(2, 3, 200))
    other -= effect * np.sum(effect * other) / np.sum(effect**2)
    size = float(np.linalg.norm(effect))
    near = Alternative("joint_spring", "elbow", (effect + 0.1 * other)[None, :, :, None], 1)
    far = Alternative("actuator_bias", "elbow", other[None, :, :, None], 1)
    wider = Alternative("joint_stribeck_friction", "elbow", effect[None, :, :, None], 3)
    found = Leftovers.of(of_shapes(effect), [far, wider, near]).sigmas(1)
    angle = np.arctan(0.1 * float(np.linalg.norm(other)) / size)
    assert found["sigma"] == pytest.approx(size)
    assert found["sigma_beside_rival"] == pytest.approx(size * np.sin(angle))
    assert Leftovers.of(of_shapes(effect), [far, wider]).sigmas(1)["sigma_beside_rival"] == pytest.approx(size)
    assert Leftovers.of(of_shapes(effect), [wider]).sigmas(3)["sigma_beside_rival"] == pytest.approx(0.0, abs=1e-6)


def test_the_curve_tells_how_single_effects_end_by_sigma() -> None:
    def single(sigma: float, verdict: str, *, right: bool = False, wrong: bool = False) -> dict[str, object]:
        names = [["joint_spring", "elbow"]] if wrong else []
        return {"kind": "single", "sigmas": [sigma], "verdict": verdict, "right": right, "wrong_names": names}

    items = [
        single(0.3, "none"),
        single(12.0, "explained", right=True),
        single(12.0, "unexplained"),
        single(15.0, "unexplained", wrong=True),
        single(18.0, "explained", wrong=True),
        {"kind": "null", "sigmas": [], "verdict": "none", "right": True, "wrong_names": []},
    ]
    faint, clear = curve(items)
    assert (faint["low"], faint["count"], faint["nothing"]) == (0.0, 1, 1.0)
    assert (clear["low"], clear["count"]) == (10.0, 4)
    assert (clear["named"], clear["misnamed"], clear["unexplained"]) == (0.25, 0.5, 0.25)


def test_arms_are_reckoned_about_their_true_masses() -> None:
    """Without an effect nothing is left before any mass is fitted, however far off its prior's mean one is."""
    case = simulate("null", "arm2", 2)
    excess = ArmRows(case).excess()
    assert np.abs(excess.offset).max() > 0.3
    assert float(np.mean(excess.rows**2)) < 1e-3


def test_a_late_encoder_is_compared_with_a_slow_one() -> None:
    rows, excess = seen_in(simulate("single:sensor_delay", "arm2", 1))
    names = [(other["effect"], other["at"]) for other in reckoned(rows, excess)["accept"]]  # type: ignore[attr-defined]
    assert ("sensor_lag", "q.elbow") in names
    # One that is late by six milliseconds and well seen is not slow.
    rows, excess = seen_in(simulate("single:sensor_delay", "arm2", 2))
    looks = rows.alternatives(rows.effects[0], excess)
    assert {"q.joint_1", "v.joint_1"} <= {look.at for look in looks if look.effect == "sensor_lag"}
    assert not reckoned(rows, excess)["accept"]


@pytest.mark.long
def test_a_pulse_is_compared_with_one_on_the_other_links() -> None:
    """Three joints tell three components of a force, but hardly of which link; on the first one none is felt."""
    rows, excess = seen_in(simulate("single:external_disturbance", "arm3", 2))
    [item] = rows.effects
    looks = {look.at: look for look in rows.alternatives(item, excess) if look.effect == item.effect}
    assert set(looks) == {"link1", "link2", "link3"} and item.at == "link2"
    assert excess.cost(looks["link2"].regressors) < 1e-3 * excess.cost()
    [other] = Leftovers.of(excess, [looks["link1"], looks["link3"]], [looks["link2"]]).acceptable(3)
    assert other["at"] == "link3" and abs(float(str(other["log_bayes_factor"]))) < 1.0


def test_where_one_joint_alone_shows_a_tilt_its_drive_is_compared() -> None:
    case = simulate("single:gravity_misalignment", "arm2", 7)
    rows = ArmRows(case)
    excess, [item] = rows.excess(), rows.effects
    shoulder = rows.names[0]
    shown = replace(excess, rows=excess.rows * (np.array(excess.channels) == shoulder))
    assert ("actuator_bias", shoulder) in {(look.effect, look.at) for look in arm_alternatives(rows, item, shown)}


@pytest.mark.long
def test_a_pairs_effects_each_have_second_names() -> None:
    """A slightly late encoder might be a slow one, a viscous joint beside it or not."""
    kind = "pair:sensor_delay,joint_viscous_friction"
    alone = [simulate(kind, "arm2", 1, 0, only) for only in (0, 1)]
    told = paired(simulate(kind, "arm2", 1), alone).truth
    assert len(told["strengths"]) == 2  # type: ignore[arg-type]
    assert all(other["of"] in (0, 1) for other in told["accept"])  # type: ignore[attr-defined]
    assert told["accept"]


def test_a_surface_that_is_raised_might_be_the_encoder_that_tells_its_depth() -> None:
    rows, excess = seen_in(simulate("single:surface_offset", "press", 3))
    accept: list[dict[str, object]] = reckoned(rows, excess)["accept"]  # type: ignore[assignment]
    factors = {(other["effect"], other["at"]): other["log_bayes_factor"] for other in accept}
    assert factors["sensor_bias", "q.pz"] == pytest.approx(0.0, abs=0.2)
