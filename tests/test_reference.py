"""The reference page is what its command prints, and says of every key, column and effect what there is to say."""

import re
from dataclasses import dataclass, fields
from pathlib import Path

import pytest
from click.testing import CliRunner

from drake_cafim.cli import main
from drake_cafim.diagrams.reference import limits
from drake_cafim.diagrams.reference.field_comments import field_comments
from drake_cafim.diagrams.reference.limits import LIMITS, Limit, answer
from drake_cafim.diagrams.reference.page import page
from drake_cafim.diagrams.reference.scenario_keys import REQUIRED, SECTIONS
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import CHANNELS, parse
from drake_cafim.scene.scene import Scene
from tests.tosses import thrown_scene

PAGE = Path(__file__).parents[1] / "diagrams" / "reference.md"


@dataclass
class Commented:
    """A dataclass with every form of comment."""

    beside: float = 0.0  # at its end
    # above it,
    # on two lines
    above: float = 0.0
    without: float = 0.0


def test_comments_are_read_beside_fields_and_above_them() -> None:
    assert field_comments(Commented) == {"beside": "at its end", "above": "above it, on two lines", "without": ""}


def test_the_page_is_what_its_command_prints() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), (
        "diagrams/reference.md is old; python -m drake_cafim.diagrams.reference > diagrams/reference.md"
    )


@pytest.mark.parametrize("kind", SECTIONS.values(), ids=lambda kind: kind.__name__)
def test_every_key_has_a_meaning(kind: type) -> None:
    comments = field_comments(kind)
    assert [field.name for field in fields(kind) if not comments[field.name]] == []


def test_what_is_called_required_is_refused_without() -> None:
    whole = {
        "model": "arm.urdf",
        "weld": [{"body": "base"}],
        "unknown": [{"parameter": "mass", "body": "link", "std": 0.1}],
        "contact": [{"bodies": ["link", "wall"], "stiffness": 1000.0}],
    }
    assert parse(whole, "arm.yaml").model == "arm.urdf"
    keys = {"Weld": "weld", "Unknown": "unknown", "ContactPair": "contact", "Scenario": ""}
    for kind, name in REQUIRED:
        # effects are refused by name or place, once there is a model; a supply by the tests of values
        if kind in ("EffectEntry", "Supply"):
            continue
        lacking = {key: [dict(entry) for entry in value] if isinstance(value, list) else value
                   for key, value in whole.items()}  # fmt: skip
        part = lacking if kind == "Scenario" else lacking[keys[kind]][0]
        assert isinstance(part, dict)
        del part[name]
        with pytest.raises(InputError, match=name):
            parse(lacking, "arm.yaml")


def test_every_effect_and_every_channel_is_there() -> None:
    text = PAGE.read_text(encoding="utf-8")
    sections = dict(re.findall(r"^#### (\w+)\n(.*?)(?=^#|\Z)", text, re.MULTILINE | re.DOTALL))
    assert list(sections) and set(sections) == {effect.name for effect in EFFECTS}
    for effect in EFFECTS:
        told = sections[effect.name]
        assert "**Law:** " in told and f"**Source:** {effect.reference}" in told
        assert re.search(r"\*\*Looked for\*\* of (robots|thrown bodies) at `", told)
        assert all(f"- `{other}`: {reason}" in told for other, reason in effect.alike.items())
        assert all(
            f"`{s.name}`" in told for s in effect.strengths if not (effect.brief and s.name in ("start", "stop"))
        )
    assert all(f"| `{kind}." in text for kind in CHANNELS)


@pytest.mark.parametrize("limit", LIMITS, ids=lambda limit: limit.what)
def test_what_is_not_supported_is_said_where_it_is_met(limit: Limit) -> None:
    said = answer(limit)
    assert said.startswith("robot.yaml: ") is not limit.noted
    words = {
        "A floating base with joints": "a floating base with joints is not supported",
        "Closed chains, by links": "closed chains are not supported, expected a tree",
        "Closed chains, by a constraint of an MJCF, once recordings are given": "closed chains are not supported; hold",
        "Tendons": "tendons are ignored (cable)",
        "Contacts of other shapes": "expected a body with one collision sphere",
    }.get(limit.what, "support")
    assert words in said


@pytest.mark.parametrize(
    ("more", "scenario"),
    [
        (limits.CONNECTED, "lock: [left_joint, right_joint]"),
        (limits.CONNECTED.replace("<connect ", '<connect active="false" '), ""),
        ('<equality><weld body1="hand" body2="right"/></equality>', ""),
    ],
    ids=["held", "not active", "to a body that is moved by hand"],
)
def test_a_constraint_that_closes_nothing_is_taken(more: str, scenario: str) -> None:
    model = limits.mjcf(more).replace("<worldbody>", '<worldbody><body name="hand" mocap="true"/>')
    assert "closed chain" not in answer(Limit("", model, scenario, "xml"))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            '<drake:ball_constraint><drake:ball_constraint_body_A name="b"/><drake:ball_constraint_body_B name="c"/>'
            '<drake:ball_constraint_p_AP value="0 0 0"/><drake:ball_constraint_p_BQ value="0 0 0"/>'
            "</drake:ball_constraint>",
            "closed chains are not supported",
        ),
        ("<drake:linear_bushing_rpy/>", "drake:linear_bushing_rpy is not supported"),
    ],
)
def test_drake_s_own_constraints_and_bushings_are_refused(more: str, said: str) -> None:
    model = limits.urdf(*limits.TWO, limits.joint("j2", "a", "c"), more)
    assert said in answer(Limit("", model))


@pytest.mark.parametrize("command", ["discriminate", "replay"])
def test_commands_for_robots_refuse_a_thrown_body(command: str, tmp_path: Path) -> None:
    thrown_scene(tmp_path)
    (tmp_path / "a.csv").write_text("time,pose.body.x\n0,0\n")
    what = ["--between", "payload@body", "--between", "aerodynamic_drag@body"] if command == "discriminate" else []
    files = [str(tmp_path / "scenario.yaml"), *([str(tmp_path / "a.csv")] if command == "replay" else [])]
    result = CliRunner().invoke(main, [command, *files, *what, "--out", str(tmp_path / "out.html")])
    assert result.exit_code == 2 and f"cafim {command} is of robots" in result.output


def test_a_spring_of_a_model_is_no_closed_chain(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(limits.mjcf("").replace("<joint ", '<joint stiffness="2" '))
    assert Scene.load(tmp_path / "m.xml").tree.joint_names == ("left_joint", "right_joint")
