"""Arguments of wrong types and values from a script: each ends in one sentence that names the argument."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import drake_cafim
from drake_cafim import InputError, Recording, Scene
from tests.test_cli import PENDULUM, pendulum_recording

RECORDING = pendulum_recording("a", damping=0.0, seed=1)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM)
    return path


@pytest.mark.parametrize(
    "call, said",
    [
        (lambda model: Scene.load("x" * 5000), "there is no such file"),
        (lambda model: Scene.load(model, packages=5), "packages is of the type int"),
        (lambda model: Scene.load(model, packages={"x": "a\0b"}), "packages.x"),
        (lambda model: Scene.from_model(None), "model is of the type NoneType"),
        (lambda model: Scene.from_model(model, channels=[1]), "channels is of the type list"),
        (lambda model: Scene.from_model(model, channels={"q": -1.0}), "channels.q.std is -1"),
        (lambda model: Scene.from_model(model, channels={"z": 1.0}), "unknown channel 'z'"),
        (lambda model: Scene.from_model(model, weld="base"), "weld is of the type str"),
        (lambda model: Scene.from_model(model, weld=[5]), "weld[0].body is 5"),
        (lambda model: drake_cafim.read(None), "path is of the type NoneType"),
        (lambda model: drake_cafim.read(model, topics={"x": 5}), "unknown suffix .urdf"),
        (lambda model: drake_cafim.write(None, model), "recording is of the type NoneType"),
        (lambda model: Recording("a", np.arange(2.0), {"q.a": np.array(["x", "y"])}), "a: column q.a holds no numbers"),
        (lambda model: Recording("a", np.arange(2.0), {"q.a": np.arange(2) * 1j}), "a: column q.a holds no numbers"),
        (lambda model: Recording("a", np.arange(2.0), None), "a: columns is of the type NoneType"),
    ],
)
def test_what_a_script_gives(model: Path, call: Callable[[Path], object], said: str) -> None:
    with pytest.raises(InputError) as raised:
        call(model)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    "given, said",
    [
        ({"scene": "arm.yaml"}, "scene is of the type str"),
        ({"recordings": []}, "recordings is empty"),
        ({"recordings": None}, "recordings is of the type NoneType"),
        ({"recordings": RECORDING}, "recordings is of the type Recording"),
        ({"recordings": ["a.csv"]}, "recordings[0] is of the type str"),
        ({"held_out": [None]}, "held_out[0] is of the type NoneType"),
        ({"effects": 5}, "effects is of the type int"),
        ({"effects": [int]}, "effect class int"),
        ({"settings": 5}, "settings is of the type int"),
    ],
)
def test_what_a_diagnosis_is_given(model: Path, given: dict[str, object], said: str) -> None:
    arguments: dict[str, object] = {"scene": Scene.from_model(model, weld=["base"]), "recordings": [RECORDING]}
    with pytest.raises(InputError) as raised:
        drake_cafim.diagnose(**(arguments | given))
    assert said in str(raised.value)
    if set(given) <= set(arguments):
        with pytest.raises(InputError, match=said.replace("[", r"\[")):
            drake_cafim.estimate(**(arguments | given))


def test_topics_are_topics(model: Path) -> None:
    drake_cafim.write(RECORDING, model.with_name("a.csv"))
    with pytest.raises(InputError, match=r"a\.csv: topics: x is of the type int"):
        drake_cafim.read(model.with_name("a.csv"), topics={"x": 5})


def test_numbers_of_numpy_are_numbers(model: Path) -> None:
    scene = Scene.from_model(model, channels={"q": np.float32(0.5), "v": 1}, weld=["base"])
    assert scene.std("q.pivot") == 0.5 and scene.std("v.pivot") == 1.0


def test_a_number_too_long_for_the_parser(tmp_path: Path) -> None:
    path = tmp_path / "arm.sdf"
    path.write_text(f'<sdf version="{"9" * 400}"><model name="arm"><link name="base"/></model></sdf>')
    with pytest.raises(InputError, match=r"arm\.sdf: Drake's parser refuses it"):
        Scene.load(path)
