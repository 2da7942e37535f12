"""Without noise, the rows of arms that are commanded by position are far below it, at samples every 8 ms."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.servo_efforts import servo_key
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.scene.scene import Scene
from tests.concealed import served_case
from tests.concealed.make import make
from tests.concealed.served_case import QUANTUM
from tests.parametrize import long_after


@pytest.mark.parametrize(
    ("kind", "seed", "most"),
    long_after(
        1,
        [
            ("null", 905, 0.02),
            # without the bends where the effort enters and leaves the envelope .0049
            ("single:actuator_speed_limit", 0xF61252CBAA935F18730E5AAEEB6796C3, 0.003),
            ("single:command_lag", 905, 0.02),
            ("single:command_delay", 903, 0.02),
        ],
    ),
)
def test_steps_of_commands_within_the_sampling_are_integrated_exactly(
    kind: str, seed: int, most: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What joints make of a step between two samples, too: each takes a part of it back by its own motion.

    At the envelope of its motor, a joint takes back less.
    """
    monkeypatch.setattr(served_case, "QUANTUM", 1e-9)
    case = make(kind, "served3", seed)
    case.write(tmp_path)
    stated = yaml.safe_load((tmp_path / "scenario.yaml").read_text())
    stated["channels"] = {"q": {"std": float(QUANTUM / np.sqrt(12.0))}}
    for item in case.truth["effects"]:  # type: ignore[attr-defined]
        values = {name: value for name, (value, _) in item["parameters"].items()}
        stated.setdefault("effects", []).append({"effect": item["effect"], "at": item["at"], **values})
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(stated))
    own = [recordings.read(path) for path in sorted(tmp_path.glob("train*"))]
    problem = prepare(Scene.load(tmp_path / "scenario.yaml"), own).problem()
    rows = problem.rows_of(problem.nominal())
    assert np.mean(rows**2) < most


@pytest.mark.long
def test_a_motors_envelope_is_part_of_its_servo(tmp_path: Path) -> None:
    """It is fitted exactly from a start that is off, and acts as its name says though it takes nothing off any more."""
    case = make("single:actuator_speed_limit", "served2", 4001)
    case.write(tmp_path)
    [truth] = case.truth["effects"]  # type: ignore[attr-defined]
    values = {name: value for name, (value, _) in truth["parameters"].items()}
    own = [recordings.read(path) for path in sorted(tmp_path.glob("train*"))]
    problem = prepare(Scene.load(tmp_path / "scenario.yaml"), own).problem()
    envelope = effect_named(truth["effect"])
    start = envelope(truth["at"], {name: 0.9 * value for name, value in values.items()})
    found = fit(problem, problem.nominal().with_effects((start,))).model
    [fitted] = found.effects
    assert fitted.values["stall_torque"] == pytest.approx(values["stall_torque"], rel=0.01)
    assert fitted.values["no_load_speed"] == pytest.approx(values["no_load_speed"], rel=0.1)
    assert problem.plausible(found)
    idle = problem.nominal().with_effects((envelope(truth["at"], {name: 10.0 * v for name, v in values.items()}),))
    assert not problem.plausible(idle)
    # what an envelope leaves of the servo's effort is cached beside what is without
    bounded, whole = found.physics(problem.scene), problem.nominal().physics(problem.scene)
    assert servo_key(bounded) != servo_key(whole)


@pytest.mark.long
def test_a_bounded_acceleration_is_fitted_from_afar(tmp_path: Path) -> None:
    """When it gets to its commands changes by whole samples, so that slopes over tiny steps are those of nothing."""
    case = make("single:command_acceleration_limit", "served3", 0x8DC19AC3C0D5C793204B182ECB0FE237)
    case.write(tmp_path)
    [truth] = case.truth["effects"]  # type: ignore[attr-defined]
    value, _ = truth["parameters"]["acceleration"]
    own = [recordings.read(path) for path in sorted(tmp_path.glob("train*"))]
    problem = prepare(Scene.load(tmp_path / "scenario.yaml"), own).problem()
    limit = effect_named(truth["effect"])
    start = limit(truth["at"], {"acceleration": 1.4 * value})
    [fitted] = fit(problem, problem.nominal().with_effects((start,))).model.effects
    assert fitted.values["acceleration"] == pytest.approx(value, rel=2e-3)
