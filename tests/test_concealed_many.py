"""Cases with many effects at once: what is drawn, how clear each effect is, and how a report is scored."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.concealed import arm_case, fake_diagnosis, plan, prove
from tests.concealed.case import Case
from tests.concealed.draw_many import FEWEST, MOST
from tests.concealed.make import make, simulate
from tests.concealed.noise import ChannelNoise
from tests.concealed.robots import random_arm
from tests.concealed.score import score
from tests.concealed.strength import Windows
from tests.concealed.strength_many import (
    Leftover,
    ManyRows,
    flat,
    footprints,
    inertial_columns,
    long_std,
    reckoned_many,
)
from tests.concealed.summary import figures
from tests.concealed.summary_many import by_effect, by_sigma
from tests.concealed.wrong_inertials import changed, wrong


@pytest.fixture(scope="module")
def case() -> Case:
    return simulate("many", "arm2", 3)


def cloud_of(link: object) -> np.ndarray:
    """The pseudo-inertia (4, 4) about the link's origin."""
    mass, com, inertia = link.mass, link.com, link.inertia  # type: ignore[attr-defined]
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(com, com)
    return np.block([[second, mass * com[:, None]], [mass * com, np.array([mass])]])


def test_every_link_is_wrong_by_the_share_and_is_still_a_body() -> None:
    rng = np.random.default_rng(6)
    robot = random_arm(rng, 7)
    for _ in range(20):
        true, unknown, values = wrong(rng, robot)
        for link, other in zip(robot.links, true.links, strict=True):
            assert 0.1 <= abs(other.mass / link.mass - 1.0) <= 0.3
            assert np.linalg.eigvalsh(cloud_of(other))[0] > 0.0
            second = 0.5 * np.trace(link.inertia) * np.eye(3) - link.inertia
            squares, axes = np.linalg.eigh(second / link.mass)
            shift = axes.T @ (other.com - link.com) / np.sqrt(squares)
            assert np.all((np.abs(shift) >= 0.1) & (np.abs(shift) <= 0.3))
            assert values[f"mass.{link.name}"] == other.mass
    assert unknown == [{"parameter": "inertials", "body": "all", "std": 0.2}]


def test_a_changed_link_is_the_cloud_stretched_along_its_axes() -> None:
    """Its second moment along the first axis changes by the share asked for, and nothing else does."""
    link = random_arm(np.random.default_rng(1), 2).links[0]
    by = np.zeros(10)
    by[4] = 0.2
    other = changed(link, by)
    before, after = (0.5 * np.trace(x.inertia) * np.eye(3) - x.inertia for x in (link, other))
    squares, axes = np.linalg.eigh(before)
    np.testing.assert_allclose(axes.T @ after @ axes, np.diag(squares * [1.2, 1.0, 1.0]), atol=1e-12)
    assert other.mass == link.mass and np.allclose(other.com, link.com)
    np.testing.assert_allclose(changed(link, np.zeros(10)).inertia, link.inertia, atol=1e-12)


def test_a_case_has_five_to_twenty_effects_of_one_kind_a_place_and_a_force_that_nobody_knows(case: Case) -> None:
    effects = case.truth["effects"]
    names = [(item["effect"], item["at"]) for item in effects]  # type: ignore[index, attr-defined]
    assert FEWEST <= len(names) <= MOST and len(set(names)) == len(names)
    assert case.scenario["unknown"] == [{"parameter": "inertials", "body": "all", "std": 0.2}]
    settings = case.truth["settings"]
    assert settings["process"] >= 2e-3 and settings["effort_std"] >= 1e-4  # type: ignore[index]
    assert {key for key in case.scenario["channels"] if key.startswith("u.")}  # type: ignore[attr-defined]


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 3])
def test_footprints_add_up_to_what_the_true_arm_without_its_effects_leaves(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Without the force that nobody knows. A command that comes within a step is not seen at its first sample."""
    drawn = arm_case.random_settings
    monkeypatch.setattr(
        arm_case, "random_settings", lambda rng, kind: replace(drawn(rng, kind), process=0.0, jitter="none")
    )
    rows = ManyRows(simulate("many", "arm2", seed))
    left = flat(rows.excess().rows[None])[:, 0]
    prints = footprints(rows)
    rest = left - sum(footprint.rows for footprint in prints)
    assert np.linalg.norm(rest) < 0.05 * np.linalg.norm(left)
    assert min(np.linalg.norm(left - footprint.rows) for footprint in prints) > 0.1 * np.linalg.norm(left)


def test_sigma_is_that_of_a_least_squares_fit() -> None:
    rng = np.random.default_rng(3)
    others, own = rng.normal(size=(60, 5)), rng.normal(size=60)
    left = Leftover(others, 2)
    # the std of the own amplitude, the first two others with a prior of one std
    design = np.column_stack([own, others])
    information = design.T @ design + np.diag([0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    std = np.sqrt(np.linalg.inv(information)[0, 0])
    assert np.linalg.norm(left.of(own[:, None])) == pytest.approx(1.0 / std, rel=1e-9)


def test_sums_over_many_windows_have_the_std_that_is_taken_for_them() -> None:
    rng = np.random.default_rng(5)
    windows = Windows.over(5000, 0.002)
    noise = ChannelNoise(0.3, 0.02)
    drawn = noise.draw(rng, np.tile(0.002 * np.arange(5000), (200, 1)), 1)
    sums = windows.integrate(drawn, windows.shape[0]).sum(axis=(1, 2))
    expected = long_std(windows, noise) * np.sqrt(len(windows.starts))
    assert sums.std() == pytest.approx(expected, rel=0.15)
    assert windows.noise_std(windows.shape[0], noise) < long_std(windows, noise)


VISCOUS = {"effect": "joint_viscous_friction", "at": "elbow", "parameters": {"coefficient": [0.5, "N m s/rad"]}}
COULOMB = {"effect": "joint_coulomb_friction", "at": "elbow", "parameters": {"torque": [1.0, "N m"]}}
BIAS = {"effect": "actuator_bias", "at": "elbow", "parameters": {"torque": [0.3, "N m"]}}
LAG = {"effect": "actuator_lag", "at": "wrist", "parameters": {"time_constant": [0.01, "s"]}}


def truth(*effects: dict[str, object], sigmas: tuple[float, ...], **more: object) -> dict[str, object]:
    strengths = [{"value": sigma, "clear": sigma >= 10.0} for sigma in sigmas]
    base = {"kind": "many", "rig": "arm3", "effects": list(effects), "strengths": strengths, "accept": []}
    return base | more


def report(*names: tuple[str, str], **values: tuple[float, float]) -> dict[str, object]:
    numbers = {name: {"value": value, "std": std} for name, (value, std) in values.items()}
    explanation = [{"effect": effect, "at": at, "parameters": numbers} for effect, at in names]
    return {"verdict": "unexplained", "explanation": explanation}


def test_each_clear_effect_and_each_name_counts() -> None:
    told = report(("joint_viscous_friction", "elbow"), ("actuator_lag", "elbow"), coefficient=(0.52, 0.02))
    first = score(truth(VISCOUS, COULOMB, LAG, sigmas=(40.0, 5.0, 12.0)), told)
    assert first["found"] == [True, False, False] and first["clear_effects"] == [True, False, True]
    assert first["wrong_names"] == [["actuator_lag", "elbow"]] and not first["right"]
    assert [entry[1] for entry in first["covered"]] == [True]
    other = score(truth(VISCOUS, COULOMB, sigmas=(40.0, 5.0)), report(("joint_viscous_friction", "elbow")))
    assert other["right"]  # what is faint need not be named
    table = {figure.name: figure for figure in figures([first, other])}
    named, false = (table[f"many effects at once: {name}"] for name in ("clear ones named", "names that are false"))
    assert (named.value, named.count, named.kept) == (pytest.approx(2.0 / 3.0), 3, False)
    assert (false.value, false.count, false.kept) == (pytest.approx(1.0 / 3.0), 3, False)
    rows = {row["name"]: row for row in by_effect([first, other])}
    assert rows["joint_viscous_friction"] == {
        "name": "joint_viscous_friction",
        "there": 2,
        "clear_count": 2,
        "named": 2,
        "false": 0,
    }
    assert rows["actuator_lag"]["false"] == 1
    assert [(row["there"], row["named"]) for row in by_sigma([first, other])] == [
        (0, 0),
        (2, 0),
        (1, 0),
        (2, 2),
        (0, 0),
    ]


def test_a_sealed_second_name_counts_for_its_own_effect_alone() -> None:
    accept = [{"effect": "actuator_delay", "at": "wrist", "of": 1, "log_bayes_factor": 0.2}]
    sealed = truth(VISCOUS, LAG, sigmas=(40.0, 12.0), accept=accept)
    told = score(sealed, report(("actuator_delay", "wrist")))
    assert told["found"] == [False, True] and not told["wrong_names"]
    assert score(sealed | {"accept": []}, report(("actuator_delay", "wrist")))["wrong_names"]


def test_unequal_friction_and_friction_with_a_bias_are_one_torque() -> None:
    unequal = {"effect": "joint_asymmetric_coulomb_friction", "at": "elbow", "parameters": {}}
    told = score(truth(COULOMB, BIAS, sigmas=(40.0, 40.0)), report(("joint_asymmetric_coulomb_friction", "elbow")))
    assert told["right"] and told["found"] == [True, True]
    two = report(("joint_coulomb_friction", "elbow"), ("actuator_bias", "elbow"))
    assert score(truth(unequal, sigmas=(40.0,)), two)["right"]
    # one of them alone is not the other, nor are they at another joint
    assert not score(truth(unequal, sigmas=(40.0,)), report(("joint_coulomb_friction", "elbow")))["right"]
    assert not score(truth(COULOMB, sigmas=(40.0,)), report(("joint_asymmetric_coulomb_friction", "elbow")))["right"]
    apart = report(("joint_coulomb_friction", "elbow"), ("actuator_bias", "wrist"))
    assert not score(truth(unequal, sigmas=(40.0,)), apart)["right"]


def test_without_a_report_nothing_clear_is_named() -> None:
    told = score(truth(VISCOUS, sigmas=(40.0,)), None, "no report after 600 s")
    assert told["verdict"] == "failed" and told["found"] == [False] and not told["right"]
    table = {figure.name: figure for figure in figures([told])}
    assert table["many effects at once: clear ones named"].value == 0.0
    assert table["diagnoses that failed or timed out"].value == 1.0
    assert table["clear single effects: exact name and place"].value is None


def test_the_fit_beside_the_others_takes_what_they_share(case: Case) -> None:
    """An effect is less clear beside the inertials and the other effects than alone, and what is not there is not."""
    rows = ManyRows(case)
    prints, unknown = footprints(rows), inertial_columns(rows)
    sigmas = [item["value"] for item in reckoned_many(case)["strengths"]]  # type: ignore[attr-defined]
    for footprint, sigma in zip(prints, sigmas, strict=True):
        assert 0.0 < sigma < np.linalg.norm(footprint.rows)
    same = Leftover(np.column_stack([unknown, prints[0].rows]), unknown.shape[1])
    assert np.linalg.norm(same.of(prints[0].rows[:, None])) < 1e-6


@pytest.mark.long
def test_a_case_is_the_same_again_and_tells_nothing_of_its_effects(tmp_path: Path) -> None:
    first, second = make("many", "arm2", 3), make("many", "arm2", 3)
    assert json.dumps(first.truth, default=float) == json.dumps(second.truth, default=float)
    first.write(tmp_path)
    text = (tmp_path / "scenario.yaml").read_text()
    assert not any(item["effect"] in text for item in first.truth["effects"])  # type: ignore[attr-defined]
    assert "inertials" in text


@pytest.mark.long
def test_the_proof_runs_cases_of_one_kind_and_tells_of_them(tmp_path: Path) -> None:
    out, diagnose = tmp_path / "proof", ["--diagnose", sys.executable, str(Path(fake_diagnosis.__file__))]
    prove.main(["--size", "8", "--kinds", "many", "--out", str(out), "--jobs", "1", "--seed", "0x5", *diagnose])
    (trial,) = json.loads((out / "scores.json").read_text())["trials"]
    assert trial["kind"] == "many" and len(trial["found"]) == len(trial["truth"]) >= FEWEST
    page = (out / "proof.html").read_text()
    assert "built-in method" not in page and "None" not in page
    assert "Many effects at once" in page and "5 to 20 effects" in page
    slots = plan.composition(np.random.default_rng(0x5), 8)
    assert slots[trial["slot"]] == ("many", trial["case_rig"])
