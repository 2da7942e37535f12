"""Each effect is recovered from the data of an independent simulator: its name, its place, its strength."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.search import Outcome, search
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.scene.scene import Scene
from tests.concealed.case import Case
from tests.concealed.make import make

ARM_EFFECTS = [
    "joint_stribeck_friction",
    "joint_load_dependent_friction",
    "torque_ripple",
    "joint_hard_stop",
    "joint_elasticity",
    "joint_backlash",
    "actuator_delay",
    "actuator_lag",
    "actuator_saturation",
    "actuator_dead_zone",
    "aerodynamic_drag",
    "external_disturbance",
    "sensor_gain_error",
    "sensor_drift",
    "sensor_delay",
    "sensor_lag",
    "clock_skew",
]
CONTACT_EFFECTS = [
    "contact_stribeck_friction",
    "contact_adhesion",
    "contact_nonlinear_stiffness",
    "contact_viscoelastic_relaxation",
    "contact_hunt_crossley_dissipation",
    "contact_anisotropic_friction",
    "contact_presliding",
    "surface_offset",
    "surface_tilt",
]
FIRST, LAST = 300, 360


def _plain_and_clear(kind: str, rig: str) -> Case:
    """The first case of this kind whose noise is white and stated, and whose effect the data show clearly."""
    for seed in range(FIRST, LAST):
        case = make(kind, rig, seed)
        settings: dict[str, Any] = case.truth["settings"]  # type: ignore[assignment]
        [effect] = case.truth["effects"]  # type: ignore[misc]
        [strength] = case.truth["strengths"]  # type: ignore[misc]
        plain = settings["noise"] == "white" and settings["jitter"] == "none" and settings["states_std"]
        exact = not effect.get("variant") and not settings["process"] and not settings["effort_std"]
        if plain and exact and strength["clear"] and not case.truth.get("accept"):
            return case
    raise AssertionError(f"{kind}: no clear case among the seeds {FIRST}–{LAST}")


def _searched(case: Case, folder: Path) -> Outcome:
    case.write(folder)
    scene = Scene.load(folder / "scenario.yaml")
    read = [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2, 3)]
    return search(prepare(scene, read).problem(), Settings())


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "rig"),
    [*((effect, "arm2") for effect in ARM_EFFECTS), *((effect, "press") for effect in CONTACT_EFFECTS)],
)
def test_recovered(effect: str, rig: str, tmp_path: Path) -> None:
    case = _plain_and_clear(f"single:{effect}", rig)
    best = _searched(case, tmp_path).best
    [truth] = case.truth["effects"]  # type: ignore[misc]
    assert [found.key for found in best.model.effects] == [(truth["effect"], truth["at"])]
    [found] = best.model.effects
    std = dict(zip((s.name for s in found.strengths), best.std[len(best.model.unknown) :], strict=True))
    if effect == "external_disturbance":
        # of the push, a planar arm feels some directions only; when it came is seen
        start, stop = truth["interval"]
        middle = 0.5 * (found.values["start"] + found.values["stop"])
        assert middle == pytest.approx(0.5 * (start + stop), abs=0.05)
        return
    for name, (value, _) in truth["parameters"].items():
        tolerance = max(0.05 * abs(value), 5.0 * std.get(name, 0.0))
        difference = found.values[name] - value
        if name == "phase":
            difference = float(np.angle(np.exp(1j * difference)))
        assert abs(difference) <= tolerance, f"{name}: {found.values[name]} ± {std.get(name)}, concealed {value}"
