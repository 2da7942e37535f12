"""A report says which friction and rotor inertias that the model file states are far too large."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import pytest

from drake_cafim.diagnosis.diagnose import diagnose, judge_prepared, select_findings, with_overstated_unknown
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.long.budget import Budget
from drake_cafim.diagnosis.long.examine import _of_all, _restored, examine_parts
from drake_cafim.diagnosis.long.fit_of_all import AllRows, FitOfAll
from drake_cafim.diagnosis.long.parts import Parts
from drake_cafim.diagnosis.notes.overstated import FRICTION, ROTOR, Overstated, find_overstated
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.kept import Kept
from drake_cafim.recordings.long import in_parts
from drake_cafim.recordings.pieces import pieces_of
from drake_cafim.scene.scene import Scene
from tests import two_links
from tests.pan_servo import pan_recorded, pan_scene

SLOW = (("a", 3), ("b", 7))
"""Names and seeds of recordings that stay within the limits with little friction."""


def _stating(folder: Path, elbow: str, shoulder: str = "", channels: str = two_links.CHANNELS) -> Scene:
    """The arm whose joints have these dynamics in its file."""
    path = two_links.scenario(folder, channels)
    model = folder / "two_links.urdf"
    text = model.read_text()
    for name, dynamics in (("elbow", elbow), ("shoulder", shoulder)):
        end = text.index("</joint>", text.index(f'<joint name="{name}"'))
        text = f"{text[:end]}<dynamics {dynamics}/>{text[end:]}"
    model.write_text(text)
    return Scene.load(path)


def _notes(problem: SearchProblem) -> Mapping[str, str]:
    found = find_overstated(problem)
    return {} if found is None else found.notes[FRICTION]


@pytest.mark.parametrize(
    ("dynamics", "said"),
    [
        ('damping="1.0"', "states a damping of 1 N m s/rad, "),
        ('friction="2.0"', "states a dry friction of 2 N m, "),
        ('damping="1.0" friction="1.0"', "states a damping of 1 N m s/rad and a dry friction of 1 N m, "),
    ],
)
def test_stated_friction_that_is_far_too_large_is_told(tmp_path: Path, dynamics: str, said: str) -> None:
    scene = _stating(tmp_path, dynamics)
    problem = prepare(scene, [two_links.recording("a", 1), two_links.recording("b", 2)]).problem()
    [(joint, note)] = _notes(problem).items()
    assert joint == "elbow" and note.startswith(f"elbow: two_links.urdf {said}of which the recordings show far less: ")


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_friction_that_is_as_stated_or_larger_is_not(tmp_path: Path, friction: float) -> None:
    scene = _stating(tmp_path, f'damping="0.0" friction="{friction}"')
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3)) for name, seed in (("a", 1), ("b", 2))]
    problem = prepare(scene, recordings).problem()
    assert not _notes(problem)


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_friction_beside_a_far_larger_mistake_is_not(tmp_path: Path, share: float) -> None:
    """Of the efforts at the elbow 2 N m are none, so that friction is the least of what is wrong there."""
    scene = _stating(tmp_path, 'friction="0.3"')
    recordings = []
    for name, seed in SLOW:
        made = two_links.recording(name, seed, friction=(0.0, 0.3 * share))
        recordings.append(replace(made, columns={**made.columns, "u.elbow": made.columns["u.elbow"] + 2.0}))
    problem = prepare(scene, recordings).problem()
    assert not _notes(problem)


@pytest.mark.parametrize("share", [0.6, 0.4])
def test_far_less_is_less_than_half(tmp_path: Path, share: float) -> None:
    scene = _stating(tmp_path, 'friction="0.3"')
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3 * share)) for name, seed in SLOW]
    problem = prepare(scene, recordings).problem()
    assert len(_notes(problem)) == (share < 0.5)


def test_each_joint_has_its_own(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'friction="0.1"', 'friction="2.0"')
    problem = prepare(scene, [two_links.recording(name, seed, friction=(0.0, 0.1)) for name, seed in SLOW]).problem()
    [(joint, note)] = _notes(problem).items()
    assert joint == "shoulder" and note.startswith("shoulder: two_links.urdf states a dry friction of 2 N m, ")


def test_of_a_servo_whose_efforts_nobody_recorded_nothing_is_told(tmp_path: Path) -> None:
    """What damps there may be the servo's."""
    pan_scene(tmp_path)
    model = tmp_path / "pan.urdf"
    model.write_text(model.read_text().replace('damping="0.6"', 'damping="2.0"'))
    problem = prepare(Scene.load(tmp_path / "pan.yaml"), [pan_recorded(1), pan_recorded(2)]).problem()
    assert not _notes(problem)


@pytest.mark.parametrize("gain", [1.0, 0.9])
@pytest.mark.parametrize("parameter", ["damping", "dry_friction"])
def test_slopes_by_stated_friction_are_those_of_differences(tmp_path: Path, parameter: str, gain: float) -> None:
    scene = _stating(tmp_path, 'damping="0.3" friction="0.4"', 'damping="0.1" friction="0.2"').with_stated_unknown()
    problem = prepare(scene, [two_links.recording("a", 1), two_links.recording("b", 2)]).problem()
    assert isinstance(problem, WeakProblem)
    effects = [effect_named("actuator_gain_error")("elbow", {"gain": gain})]
    model = Model(scene.priors.mean, tuple(effects[: gain != 1.0]))
    i = [(unknown.parameter, unknown.at) for unknown in scene.unknown].index((parameter, "elbow"))
    found = problem.jacobian(model)[:, i]
    step = np.zeros(len(scene.unknown))
    step[i] = 1e-3
    ahead, behind = (problem.residual(replace(model, unknown=model.unknown + sign * step)) for sign in (1.0, -1.0))
    assert np.linalg.norm(found - (ahead - behind) / 2e-3) < 1e-6 * np.linalg.norm(found)


def test_what_the_file_states_is_left_out_and_what_is_there_found(tmp_path: Path) -> None:
    """The elbow truly has .3 N m of dry friction and no damping, and the shoulder .6 N m, which the file lacks."""
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    recordings = [two_links.recording(name, seed, friction=(0.6, 0.3)) for name, seed in (("a", 3), ("b", 7))]
    found = diagnose(scene, recordings[:1], held_out=recordings[1:])
    named = {accepted.effect.at: accepted for accepted in found.explanation}
    assert len(found.explanation) == len(named) == 2
    for joint, true in (("shoulder", 0.6), ("elbow", 0.3)):
        assert named[joint].effect.name == "joint_coulomb_friction"
        torque = named[joint].values["torque"]
        assert abs(torque.value - true) < 4.0 * torque.std < 1e-3
    values = {(parameter.parameter, parameter.at): parameter for parameter in found.parameters}
    assert all(0.0 <= values[name, "elbow"].value < 1e-4 for name in ("damping", "dry_friction"))
    assert found.kind == "unexplained" and found.adequate
    assert found.mismatch.p_value < 1e-6
    assert ("joint", "elbow") in [(location.kind, location.name) for location in found.mismatch.locations]
    assert found.held_out is not None
    errors = [own.rmse["q.elbow"] for own in (found.held_out.nominal_as_given, found.held_out.nominal)]
    assert found.held_out.corrected.rmse["q.elbow"] < 0.2 * min(errors)
    # the unknowns alone are those with the friction estimated, as of a diagnosis that looks for no effects
    alone = diagnose(scene, recordings[:1], held_out=recordings[1:], settings=Settings(most_effects=0))
    assert alone.held_out is not None
    assert found.held_out.nominal.nll == pytest.approx(alone.held_out.nominal.nll, rel=1e-3)
    assert found.held_out.nominal.nll < found.held_out.nominal_as_given.nll
    assert str(found).startswith("The model lacks ")
    assert (
        "The model file states far more friction at elbow than the recordings show; all that it states is left out, "
        "and looked for anew."
    ) in str(found)
    # the mass, which is as the model says, stays as given
    assert found.correction.unknowns_held and not found.correction.left_out
    corrected = found.corrected
    assert np.max(corrected.physics.dampings, initial=0.0) < 1e-4


def test_friction_of_which_the_file_states_too_little_is_found_beside_what_is_too_large(tmp_path: Path) -> None:
    """Twelve times as much as the shoulder's file states: as an unknown of that size it would have a bound."""
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"', 'damping="0.02" friction="0.05"')
    recordings = [two_links.recording(name, seed, friction=(0.6, 0.3)) for name, seed in (("a", 3), ("b", 7))]
    found = diagnose(scene, recordings)
    named = {(accepted.effect.name, accepted.effect.at): accepted.values["torque"] for accepted in found.explanation}
    assert set(named) == {("joint_coulomb_friction", joint) for joint in ("shoulder", "elbow")}
    for (_, joint), torque in named.items():
        assert abs(torque.value - {"shoulder": 0.6, "elbow": 0.3}[joint]) < 4.0 * torque.std < 1e-3
    assert found.overstated == {FRICTION: ("elbow",)} and found.kind == "unexplained" and found.adequate


def test_the_verdict_has_the_note(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    found = diagnose(scene, [two_links.recording("a", 1)], settings=Settings(most_effects=0))
    assert found.kind == "unexplained" and found.mismatch.p_value < 1e-6
    assert any(note.startswith("elbow: two_links.urdf states") for note in found.notes)
    assert "The model file states far more friction at elbow than the recordings show; " in str(found)


def test_such_friction_is_no_noise_of_efforts(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'damping="1.0"', channels="channels: {q: {std: 2.0e-4}, v: {std: 2.0e-3}}")
    before = prepare(scene, [two_links.recording("a", 1, noise=(2e-4, 2e-3, 0.02))])
    after, _ = with_overstated_unknown(before)
    assert isinstance(before, Prepared) and isinstance(after, Prepared)
    assert after.effort_noise["u.elbow"] < 0.05 < 0.1 < before.effort_noise["u.elbow"]


def test_a_long_recording_is_told_of_too(tmp_path: Path) -> None:
    """What the first parts say holds for all parts, also where the diagnosis goes on after it was stopped."""
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    address = tmp_path / "log.parquet"
    made = two_links.recording("log", 3, duration=7.0, friction=(0.8, 0.3))
    pd.DataFrame({"time": made.time} | dict(made.columns)).to_parquet(address)
    long = in_parts(pieces_of(address), 450)
    kept = Kept.open(tmp_path / "parts", {}, resume=False)
    verdict = examine_parts(scene, [long], [], Budget(1350.0, 1.0), Settings(most_effects=0), kept=kept).verdict
    assert verdict.kind == "unexplained" and verdict.overstated == {"friction": ("elbow",)}
    values = {(parameter.parameter, parameter.at): parameter for parameter in verdict.parameters}
    # the friction of the shoulder is not looked for, and disturbs a little
    assert abs(values["dry_friction", "elbow"].value - 0.3) < 0.03
    first = kept.read("first", lambda raw: _restored(scene, Parts.of([long]), raw))
    assert first is not None and first[0].overstated is not None and len(first[1].unknown) == 3


def _with_rotor(folder: Path, inertia: float, friction: float = 0.0) -> Scene:
    """The arm whose file states a rotor of that inertia, kg m², at the elbow, which has none, and a friction, N m."""
    path, model = two_links.scenario(folder), folder / "two_links.urdf"
    rotor = f"""<transmission name="elbow"><type>transmission_interface/SimpleTransmission</type><joint name="elbow"/>
<actuator name="elbow">
<drake:rotor_inertia value="{inertia}"/><drake:gear_ratio value="1"/></actuator></transmission>"""
    text = model.read_text().replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ')
    end = text.index("</joint>", text.index('<joint name="elbow"'))
    text = f'{text[:end]}<dynamics friction="{friction}"/>{text[end:]}'
    model.write_text(text.replace("</robot>", f"{rotor}</robot>"))
    return Scene.load(path)


@pytest.mark.parametrize("mistake", [0.0, 2.0])
def test_a_stated_rotor_that_is_far_too_large_is_told(tmp_path: Path, mistake: float) -> None:
    """But not beside a far larger mistake: of the efforts there 2 N m are none."""
    scene, recordings = _with_rotor(tmp_path, 0.01), []
    for name, seed in SLOW:
        made = two_links.recording(name, seed)
        recordings.append(replace(made, columns={**made.columns, "u.elbow": made.columns["u.elbow"] + mistake}))
    found = find_overstated(prepare(scene, recordings).problem())
    if mistake:
        assert found is None
        return
    assert found is not None and found.joints == {ROTOR: ("elbow",)}
    [note] = found.words
    assert note.startswith("elbow: two_links.urdf states a rotor inertia of 0.01 kg m^2, of which the recordings show ")


@pytest.mark.parametrize("stated", [pytest.param(0.0, marks=pytest.mark.long), 0.2])
def test_what_is_there_beside_a_rotor_that_is_not_is_found(tmp_path: Path, stated: float) -> None:
    """The friction of the elbow is missing, or a part; with the rotor, no law of joints would explain its motion.

    What the file states of it less wrongly than the rotor stays as stated.
    """
    scene = _with_rotor(tmp_path, 0.03, stated)
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3)) for name, seed in SLOW]
    found = diagnose(scene, recordings[:1], held_out=recordings[1:])
    assert [(it.effect.name, it.effect.at) for it in found.explanation] == [("joint_coulomb_friction", "elbow")]
    assert abs(found.explanation[0].values["torque"].value - (0.3 - stated)) < 2e-3
    assert "dry_friction" not in [parameter.parameter for parameter in found.parameters]
    assert found.kind == "unexplained" and found.adequate and found.overstated == {ROTOR: ("elbow",)}
    assert "far more rotor inertia at elbow than the recordings show; it is estimated, if there is any." in str(found)
    assert np.max(found.corrected.physics.rotor_inertias) < 1e-6
    assert found.held_out is not None
    assert found.held_out.corrected.rmse["q.elbow"] < 0.2 * found.held_out.nominal_as_given.rmse["q.elbow"]


@pytest.mark.parametrize(("rotor", "turning"), [(0.0, []), (0.006, ["elbow"])])
@pytest.mark.parametrize("mistake", [0.0, 0.3])
def test_a_joint_has_a_rotor_where_it_is_determined(
    tmp_path: Path, rotor: float, turning: list[str], mistake: float
) -> None:
    """Whatever else disturbs a little, as other joints' rotors do that are still as the file states them."""
    recordings = []
    for name, seed in SLOW:
        made = two_links.recording(name, seed, friction=(0.0, 0.2), rotor=rotor)
        recordings.append(replace(made, columns={**made.columns, "u.elbow": made.columns["u.elbow"] + mistake}))
    found = find_overstated(prepare(_with_rotor(tmp_path, 0.03, friction=0.2), recordings).problem())
    assert found is not None and list(found.turning) == turning


def test_a_smaller_rotor_than_is_stated_is_estimated_beside_the_search(tmp_path: Path) -> None:
    """Without any a light link would have friction and no inertia, by which other physics was named with certainty."""
    scene = _with_rotor(tmp_path, 0.03, friction=0.2)
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.2), rotor=0.006) for name, seed in SLOW]
    found = diagnose(scene, recordings[:1], held_out=recordings[1:])
    assert found.explanation == () and found.learned == ()
    assert found.kind == "unexplained" and found.adequate and found.overstated == {ROTOR: ("elbow",)}
    (rotor,) = [parameter for parameter in found.parameters if parameter.parameter == "rotor_inertia"]
    assert abs(rotor.value - 0.006) < 4.0 * rotor.std < 1e-3
    assert abs(found.corrected.physics.rotor_inertias[1] - rotor.value) < 1e-9
    assert found.held_out is not None and found.held_out.corrected.nll < found.held_out.nominal_as_given.nll


def test_of_noise_alone_nothing_is_told(tmp_path: Path) -> None:
    """So little friction is stated that noise alone says whether it is there."""
    scene = _stating(tmp_path, 'damping="1e-7" friction="1e-7"')
    found = [find_overstated(prepare(scene, [two_links.recording("a", seed)]).problem()) for seed in (1, 2, 3, 7)]
    assert found == [None] * 4


def test_a_search_has_no_slopes_by_what_it_leaves_out(tmp_path: Path) -> None:
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    prepared, _ = with_overstated_unknown(prepare(scene, [two_links.recording("a", 3, friction=(0.6, 0.3))]))
    searched = prepared.without_overstated()
    assert isinstance(prepared, Prepared) and isinstance(searched, Prepared)
    with_it, without = (own.problem().jacobian(own.problem().nominal()) for own in (prepared, searched))
    places = [(unknown.parameter, unknown.at) for unknown in searched.scene.unknown]
    for name in ("damping", "dry_friction"):
        i, rows = places.index((name, "elbow")), searched.problem().rows
        assert np.any(with_it[:rows, i]) and not np.any(without[:rows, i]) and without[rows + i, i] > 1e5
    assert np.max(searched.searched.physics.dampings, initial=0.0) == 0.0


def test_where_nothing_predicts_better_the_corrected_scene_has_what_the_file_states(tmp_path: Path) -> None:
    """The elbow has the friction that its file states, which a search is made to leave out without anything instead."""
    scene = _stating(tmp_path, 'friction="0.3"')
    recordings = [two_links.recording(name, seed, friction=(0.0, 0.3)) for name, seed in SLOW]
    told, stated = ({FRICTION: {"elbow": "too large"}}, {FRICTION: {"elbow": 1.0}}), {"dry_friction": ["elbow"]}
    prepared = prepare(scene, recordings).with_overstated_unknown(Overstated(*told, 1.0, (), stated))
    searched, judgement, _ = judge_prepared(prepared.without_overstated(), None, Settings(most_effects=0), print)
    selection, _ = select_findings(searched, judgement, print)
    model, places = selection.fitted.model, [(unknown.parameter, unknown.at) for unknown in searched.scene.unknown]
    assert judgement.kind == "unexplained" and selection.as_given
    assert model.unknown[places.index(("dry_friction", "elbow"))] == 0.3


def test_unknowns_that_stay_as_given_are_not_replaced_by_those_that_all_parts_give(tmp_path: Path) -> None:
    """The mass is as the model says, and the corrected scene has the friction that was found in place of the file's."""
    scene = _stating(tmp_path, 'damping="1.0" friction="1.0"')
    made = [two_links.recording(name, seed, friction=(0.6, 0.3)) for name, seed in SLOW]
    prepared, problem = with_overstated_unknown(prepare(scene, made))
    searched, judgement, _ = judge_prepared(prepared, problem, Settings(), print)
    selection, _ = select_findings(searched, judgement, print)
    assert selection.fitted.model.keys == judgement.best.model.keys and selection.unknowns_held
    # they are not all as given, since there is no friction in place of that which the file states
    assert not selection.fitted.model.held and not selection.as_given
    whole = FitOfAll(cast(AllRows, None), judgement.best, judgement.best.chi_square, settled=True)
    assert _of_all(selection, whole) is selection
