"""`unknown:` with a parameter of an effect, stated under `effects:` or not: estimated, diagnosed, put back."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.report_json import parameters_of
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scenario.schema import load, parse
from drake_cafim.scene.scene import Scene

PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1.0"/>
<inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="20" velocity="20"/></joint></robot>"""
SLIDER = """<robot name="slider"><link name="base"/>
<link name="ball"><inertial><mass value="1.0"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="ball"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="200" velocity="20"/></joint></robot>"""
STEP, FINE = 0.004, 10


def moved(acceleration: Callable[[float, float, float], float], u: np.ndarray[Any, Any], q0: float) -> Any:
    """q and v at the samples of the held efforts `u`, by the midpoint rule ten times as fine."""
    q, v, h = np.full(len(u), q0), np.zeros(len(u)), STEP / FINE
    for k in range(len(u) - 1):
        x, w = q[k], v[k]
        for _ in range(FINE):
            middle_x, middle_w = x + 0.5 * h * w, w + 0.5 * h * acceleration(x, w, u[k])
            x, w = x + h * middle_w, w + h * acceleration(middle_x, middle_w, u[k])
        q[k + 1], v[k + 1] = x, w
    return q, v


def recorded(joint: str, q: Any, v: Any, u: Any, std: tuple[float, float], bias: float = 0.0) -> Recording:
    rng = np.random.default_rng(3)
    columns = {f"q.{joint}": q + bias + rng.normal(0, std[0], len(q)), f"v.{joint}": v + rng.normal(0, std[1], len(q))}
    return Recording("run", STEP * np.arange(len(q)), columns | {f"u.{joint}": u})


def swung(friction: float = 0.0, delay: int = 0, bias: float = 0.0) -> Recording:
    """A driven pendulum over 2 s; `delay` in samples."""
    time = STEP * np.arange(500)
    u = 3.0 * np.sin(2.0 * np.pi * 0.8 * time) + 2.0 * np.sin(2.0 * np.pi * 1.7 * time + 1.0)
    acts = np.concatenate([np.full(delay, u[0]), u[: len(u) - delay]])
    q, v = moved(lambda x, w, f: (f - 0.5 * 9.81 * np.sin(x) - friction * w) / 0.27, acts, 0.0)
    return recorded("pivot", q, v, u, (2e-4, 2e-3), bias)


def pressed(cubic: float) -> Recording:
    """A ball that is pressed onto the ground by a changing effort over 2 s."""
    time = STEP * np.arange(500)
    u = -20.0 + 8.0 * np.sin(2.0 * np.pi * 1.3 * time) + 6.0 * np.sin(2.0 * np.pi * 3.1 * time)

    def acceleration(x: float, w: float, f: float) -> float:
        depth = 0.02 - x
        return f - 9.81 + (max(0.0, 4000.0 * depth - 60.0 * w + cubic * depth**3) if depth > 0.0 else 0.0)

    q, v = moved(acceleration, u, 0.0145)
    return recorded("slide", q, v, u, (2e-6, 2e-4))


def scene_of(folder: Path, model: str, effect: dict[str, Any], unknown: dict[str, Any], **more: Any) -> Scene:
    entry = unknown | {"effect": effect["effect"], "at": effect["at"]}
    return with_unknowns(folder, model, [entry], effects=[effect], **more)


def with_unknowns(folder: Path, model: str, unknown: list[dict[str, Any]], **more: Any) -> Scene:
    std = (2e-4, 2e-3) if model == PENDULUM else (2e-6, 2e-4)
    (folder / "model.urdf").write_text(model)
    raw = {
        "model": "model.urdf",
        "weld": [{"body": "base"}],
        "channels": {"q": {"std": std[0]}, "v": {"std": std[1]}, "u": {"std": 0.0}},
        "unknown": unknown,
    }
    return Scene.build(parse(raw | more, "arm.yaml"), folder, "arm.yaml")


GROUND = {"bodies": ["ball", "ground"], "ground": {"point": [0, 0, 0], "normal": [0, 0, 1]}, "stiffness": 4000.0}
CASES: list[tuple[str, dict[str, Any], dict[str, Any], Recording, float]] = [
    (PENDULUM, {"effect": "joint_viscous_friction", "at": "pivot", "coefficient": 0.1},
     {"parameter": "coefficient", "std": 0.1}, swung(friction=0.15), 0.15),
    (PENDULUM, {"effect": "actuator_delay", "at": "pivot", "delay": 0.004},
     {"parameter": "delay", "mean": 0.005, "std": 0.005}, swung(delay=2), 0.008),
    (PENDULUM, {"effect": "sensor_bias", "at": "q.pivot", "bias": 0.0},
     {"parameter": "bias", "std": 0.1}, swung(bias=0.05), 0.05),
    (SLIDER, {"effect": "contact_nonlinear_stiffness", "at": "ground/ball", "cubic": 1e7},
     {"parameter": "cubic", "std": 5e7}, pressed(4e7), 4e7),
]  # fmt: skip


@pytest.mark.parametrize(
    ("model", "effect", "unknown", "recording", "truth"), CASES, ids=[c[1]["effect"] for c in CASES]
)
def test_a_parameter_of_an_effect_is_estimated(
    tmp_path: Path, model: str, effect: dict[str, Any], unknown: dict[str, Any], recording: Recording, truth: float
) -> None:
    more = {"contact": [GROUND | {"damping": 60.0}]} if model == SLIDER else {}
    scene = scene_of(tmp_path, model, effect, unknown, **more)
    [found] = estimate(scene, [recording]).parameters
    assert found.effect == effect["effect"] and found.parameter == unknown["parameter"]
    assert abs(found.value - truth) < max(5.0 * found.std, 0.01 * truth)
    assert found.std < 0.1 * abs(unknown["std"])


@pytest.mark.parametrize(("case", "again"), [(CASES[1], True), (CASES[2], False)], ids=["delay", "bias"])
def test_slopes_by_an_unknown_are_taken_once_where_rows_are_nearly_linear_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: tuple[Any, ...], again: bool
) -> None:
    model, effect, unknown, recording, truth = case
    problem = prepare(scene_of(tmp_path, model, effect, unknown), [recording]).problem()
    problem.jacobian(problem.nominal())
    computed = []
    rows = WeakForm.rows_beside_contacts
    monkeypatch.setattr(
        WeakForm, "rows_beside_contacts", lambda form, physics: computed.append(1) or rows(form, physics)
    )
    problem.jacobian(Model(np.array([truth])))
    assert bool(computed) == again


def test_a_diagnosis_fits_it_reports_it_and_puts_it_back(tmp_path: Path) -> None:
    model, effect, unknown, recording, truth = CASES[0]
    scene = scene_of(tmp_path, model, effect, unknown)
    verdict = diagnose(scene, [recording])
    assert verdict.kind == "none" and not verdict.explanation
    [entry] = parameters_of(verdict.parameters)
    assert (
        entry["parameter"] == "coefficient" and entry["at"] == "pivot" and entry["effect"] == "joint_viscous_friction"
    )
    assert entry["value"] == pytest.approx(truth, rel=0.02)
    (tmp_path / "corrected.yaml").write_text(as_yaml(verdict.corrected.scenario, tmp_path, tmp_path))
    again = load(tmp_path / "corrected.yaml")
    assert again.effects[0].parameters["coefficient"] == pytest.approx(entry["value"])
    assert again.unknown[0].mean == pytest.approx(entry["value"])
    assert yaml.safe_load((tmp_path / "corrected.yaml").read_text())["unknown"][0]["effect"] == effect["effect"]
    assert Scene.load(tmp_path / "corrected.yaml").priors.mean[0] == pytest.approx(entry["value"])


@pytest.mark.parametrize(
    ("model", "effect", "unknown", "recording", "truth"), CASES, ids=[c[1]["effect"] for c in CASES]
)
def test_the_effect_need_not_be_stated(
    tmp_path: Path, model: str, effect: dict[str, Any], unknown: dict[str, Any], recording: Recording, truth: float
) -> None:
    more = {"contact": [GROUND | {"damping": 60.0}]} if model == SLIDER else {}
    entry = unknown | {"effect": effect["effect"], "at": effect["at"]}
    scene = with_unknowns(tmp_path, model, [entry], **more)
    assert [(stated.name, stated.at) for stated in scene.known] == [(effect["effect"], scene.unknown[0].at)]
    found = estimate(scene, [recording])
    [fitted] = found.parameters
    assert abs(fitted.value - truth) < max(5.0 * fitted.std, 0.01 * truth) and fitted.prior_mean == unknown.get(
        "mean", 0.0
    )
    assert 0.0 < fitted.std < 0.1 * fitted.prior_std
    # the ball's motion is integrated with an error that its rows see
    assert found.goodness_of_fit.accepted or model == SLIDER


LOAD = [{"effect": "payload", "at": "rod", "parameter": "mass", "std": 0.5},
        {"effect": "payload", "at": "rod", "parameter": "z", "std": 0.3, "mean": -0.2}]  # fmt: skip


def test_a_payload_that_only_unknown_names_is_put_back_as_an_effect(tmp_path: Path) -> None:
    scene = with_unknowns(tmp_path, PENDULUM, LOAD)
    [load] = scene.known
    assert load.values == {"mass": 0.0, "x": 0.0, "y": 0.0, "z": -0.2}
    assert [parameter.prior.name for parameter in scene.unknown] == ["payload.mass@rod", "payload.z@rod"]
    corrected = scene.corrected(np.array([0.3, -0.4]), ())
    (tmp_path / "corrected.yaml").write_text(as_yaml(corrected.scenario, tmp_path, tmp_path))
    again = Scene.load(tmp_path / "corrected.yaml")
    assert again.known[0].values == {"mass": 0.3, "x": 0.0, "y": 0.0, "z": -0.4}
    assert again.priors.mean.tolist() == [0.3, -0.4]
    assert [body.mass for body in again.physics.tree.bodies if "payload" in body.name] == [0.3]


def test_where_nothing_is_carried_no_more_is_known_of_the_place_than_before(tmp_path: Path) -> None:
    found = estimate(with_unknowns(tmp_path, PENDULUM, LOAD), [swung()])
    mass, z = found.parameters
    assert found.goodness_of_fit.accepted and mass.value < 3.0 * mass.std < 0.2
    assert z.std <= 0.3 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"effect": "paylod"}, "arm.yaml: unknown[1].effect: "),
        ({"at": "arm"}, "arm.yaml: unknown[1].at is arm, expected one of"),
        ({"parameter": "weight"}, "unknown[1].parameter is 'weight', which payload lacks; valid: mass, x, y, z"),
        ({"parameter": "x"}, "arm.yaml: unknown[1]: payload needs mass"),
        ({"mean": -1.0}, "arm.yaml: unknown[1].mass is -1"),
        ({"effect": "external_disturbance", "parameter": "x"}, "unknown[1]: external_disturbance acts once"),
        ({"effect": "joint_elasticity", "at": "pivot", "parameter": "stiffness"}, "unknown[1] (stiffness of joint_ela"),
    ],
    ids=str,
)
def test_an_unknown_of_no_effect_is_refused_by_its_own_name(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    first = {"body": "rod", "parameter": "mass", "std": 0.1}
    with pytest.raises(InputError) as refused:
        with_unknowns(tmp_path, PENDULUM, [first, LOAD[0] | change])
    assert words in str(refused.value)
