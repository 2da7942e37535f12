"""Scenarios, models and command lines that were made to break the tool: each ends in one sentence."""

import fcntl
import json
import os
import resource
import signal
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.commands.reports import read_report
from drake_cafim.description.trial import try_apart
from drake_cafim.errors import InputError
from drake_cafim.output import TEMPORARY, alone_in, prepare_folder, write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.yaml_file import dump, read_mapping
from tests.test_cli import PENDULUM, cafim

DIRECTIVES = "directives:\n- add_model: {name: arm, file: pendulum.urdf}\n"
SPRING = ("run", "hefting", "--conceal", "joint_spring@joint1")
HEFTED = ("run", "hefting", "--experiments", "1", "--conceal", "payload@link7")
LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]\n" for i in range(9)
)


def refusal(path: Path) -> str:
    """The sentence with which the scenario or model is refused."""
    with pytest.raises(InputError) as raised:
        Scene.load(path)
    said = str(raised.value)
    assert path.name in said and "\n" not in said and len(said) < 500
    return said


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    (tmp_path / "package.xml").write_text("<package><name>own</name></package>")
    return tmp_path


@pytest.mark.parametrize(
    "text, said",
    [
        (LAUGHS + "model: pendulum.urdf\n", "its aliases make more than"),
        ("model: pendulum.urdf\ntask: &a\n  b: *a\n", "holds itself"),
        ("directives: &a\n- add_model: {name: x, file: pendulum.urdf}\n- *a\n", "holds itself"),
        ("model: pendulum.urdf\ntask: " + "[" * 60 + "]" * 60, "nests more than"),
        ("model: pendulum.urdf\ntask: " + "[" * 9000 + "]" * 9000, "nests too deeply"),
        ("model: pendulum.urdf\nchannels: {1: {std: 1}}", "has the key 1"),
        ("model: pendulum.urdf\neffects: {null: 1}", "expected a list"),
        ("model: pendulum.urdf\ntopics: {x: {scale: " + "9" * 4000 + "}}", "more than 30 digits"),
        ("model: pendulum.urdf\ntopics: {x: {offset: 1e300}}", "topics.x.offset"),
        ("model: pendulum.urdf\nweld: [{body: " + "b" * 5000 + "}]", "which the model lacks"),
        ("model: " + "x" * 5000, "there is no such model file"),
        ("model: pendulum.urdf\npackages: {own: " + "x" * 5000 + "}", "which is no folder"),
        ('model: pendulum.urdf\npackages: {own: "a\\0b"}', "expected a text without NUL"),
    ],
)
def test_scenarios(folder: Path, text: str, said: str) -> None:
    path = folder / "robot.yaml"
    path.write_text(text)
    assert said in refusal(path)


@pytest.mark.parametrize(
    "text, said",
    [
        ("null", "found NoneType"),
        ("directives: null", "directives holds none"),
        ("directives: [5]", "directives[0] holds int"),
        ("directives: [{add_model: {name: null, file: 5}}]", "add_model.name is None"),
        ("directives:\n- add_directives: {file: 'package://own/robot.dmd.yaml'}", "which adds itself"),
        (DIRECTIVES + DIRECTIVES.partition("\n")[2].replace("arm", "second"), "is in the models arm and second"),
    ],
)
def test_directives(folder: Path, text: str, said: str) -> None:
    path = folder / "robot.dmd.yaml"
    path.write_text(text)
    assert said in refusal(path)


def test_directives_with_tags_of_drake_are_read(folder: Path) -> None:
    path = folder / "robot.dmd.yaml"
    turned = "{base_frame: world, rotation: !Rpy {deg: [0, 90, 0]}}"
    path.write_text(
        f"{DIRECTIVES}- add_weld: {{parent: world, child: arm::base, X_PC: {turned}}}\n".replace(
            "base_frame: world, ", ""
        )
    )
    scene = Scene.load(path)
    context = scene.plant.CreateDefaultContext()
    R_WB = scene.plant.EvalBodyPoseInWorld(context, scene.plant.GetBodyByName("base")).rotation().matrix()
    assert np.allclose(R_WB @ [1.0, 0.0, 0.0], [0.0, 0.0, -1.0])
    assert read_mapping(path, "") == read_mapping_of(dump(read_mapping(path, "")), folder)


def read_mapping_of(text: str, folder: Path) -> dict[str, object]:
    (folder / "again.yaml").write_text(text)
    return read_mapping(folder / "again.yaml", "")


@pytest.mark.parametrize(
    "name, text, said",
    [
        ("a.xml", "<mujoco><include file='a.xml'/><include file='a.xml'/></mujoco>", "which includes itself"),
        ("a.urdf", '<!DOCTYPE r [<!ENTITY a "aaa">]><robot name="&a;"/>', "declares the entity 'a'"),
        (
            "a.xml",
            "<mujoco><worldbody>" + "<body>" * 9000 + "</body>" * 9000 + "</worldbody></mujoco>",
            "nest more than",
        ),
        ("a.xml", "<mujoco><worldbody><body pos='x'><joint ref='1'/></body></worldbody></mujoco>", "pos is 'x'"),
        (
            "a.xml",
            "<mujoco><worldbody><body quat='0 0 0 0'><joint ref='1'/></body></worldbody></mujoco>",
            "not all of them",
        ),
        ("a.xml", "<mujoco><option gravity='1'/><worldbody/></mujoco>", "gravity is '1', expected 3 numbers"),
    ],
)
def test_models(folder: Path, name: str, text: str, said: str) -> None:
    (folder / name).write_text(text)
    assert said in refusal(folder / name)


@pytest.mark.skipif(sys.platform != "linux", reason="the trial forks")
def test_a_trial_that_ends_its_process_is_told() -> None:
    with pytest.raises(InputError, match=r"a\.urdf: Drake's parser ends the process \(SIGKILL\)"):
        try_apart(lambda: os.kill(os.getpid(), signal.SIGKILL), "a.urdf")
    try_apart(lambda: 1 / 0, "a.urdf")  # left to the caller's own call


@pytest.mark.parametrize(
    "change",
    [
        {"explanation": 5},
        {"explanation": [None]},
        {"explanation": [{"effect": "x"}]},
        {"parameters": [{"parameter": "mass", "at": "rod", "value": "much"}]},
        {"mismatch": {"locations": [{"name": "rod", "share": 10**400}]}},
        {"noise": {"q.a": 3}},
        {"trace": "x"},
    ],
)
def test_reports_of_other_types(tmp_path: Path, change: dict[str, object]) -> None:
    path = tmp_path / "report.json"
    path.write_text(json.dumps({"schema": "drake_cafim.report/1", **change}))
    with pytest.raises(InputError, match=rf"r\.json: {next(iter(change))}"):
        read_report(path, "r.json")


def test_a_report_a_hundred_thousand_deep(folder: Path) -> None:
    (folder / "report.json").write_text("[" * 100_000 + "]" * 100_000)
    done = cafim("why", "report.json", folder=folder)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "too deeply" in done.stderr


@pytest.mark.parametrize(
    "arguments, said",
    [
        (("run", "hefting", "--seed", "-1"), "-1 is not in the range"),
        (("import", "a.csv", "--period", "1e-12"), "a period of 1e-12 s"),
        (("import", "x" * 5000 + ".csv"), "File name too long"),
        (("why", "x" * 5000), "File name too long"),
        (("import", "a.csv", "--out", "x" * 5000), "the folder cannot be used (File name too long)"),
        (("import", "a.csv", "--out", "/proc/nowhere/x"), "the folder cannot be used"),
        (("import", "a.csv", "--out", "a.csv/x"), "the folder cannot be used (Not a directory)"),
        (("import", "a.csv", "--period", "inf"), "Invalid value for '--period': inf is no finite number"),
        (("diagnose", "scenario.yaml", "--recording", "a.csv", "--memory", "nan"), "nan is no finite number"),
        (("diagnose", "scenario.yaml", "--recording", "a.csv", "--cuts", "--jobs", "0"), "--jobs 0: expected a number"),
        (("import", "."), "cafim: .: the folder is not a ROS 2 bag"),
        (("nonsense",), "No such command 'nonsense'"),
        (("import", "--nonsense"), "No such option '--nonsense'"),
        (("import",), "Missing argument"),
        (("run", "hefting", "--conceal", "--world", "model"), "Option '--conceal' requires an argument"),
        (("run", "hefting", "--belief-samples", "999999999"), "--belief-samples 999999999: expected 1"),
        ((*SPRING, "stiffness=1", "stiffness=2"), "stiffness is given twice"),
        ((*SPRING, "stiffness=1e300"), "stiffness is 1e+300, expected a finite number from 0"),
        ((*HEFTED, "mass=1e9"), "payload@link7: Drake cannot simulate a world with it"),
        (("why", "pipe.json"), "pipe.json: it is no regular file, expected a report.json"),
        (("diagnose", "nowhere.yaml", "--fleet", "fleet"), "nowhere.yaml: there is no such file"),
    ],
)
def test_command_lines(folder: Path, arguments: tuple[str, ...], said: str) -> None:
    recordings.write(Recording("a", np.arange(20.0), {"q.pivot": np.arange(20.0)}), folder / "a.csv")
    os.mkfifo(folder / "pipe.json")
    (folder / "fleet" / "arm").mkdir(parents=True)
    (folder / "fleet" / "arm" / "a.csv").write_text("time\n")
    done = cafim(*arguments, folder=folder)
    lines = [line for line in done.stderr.splitlines() if not line.endswith(" ...")]
    assert done.returncode == 2 and len(lines) == 1 and len(lines[0]) < 500
    assert said in lines[0] and lines[0].startswith("cafim: ")


def test_a_folder_belongs_to_one_process_at_a_time(tmp_path: Path) -> None:
    (tmp_path / f"{TEMPORARY}left.json").write_text("half")
    with alone_in(tmp_path):
        assert not list(tmp_path.iterdir())
        with pytest.raises(InputError, match="another process is writing"), alone_in(tmp_path):
            pass
    with alone_in(tmp_path):
        pass
    with alone_in(tmp_path, shared=True):
        with alone_in(tmp_path, shared=True):
            pass
        with pytest.raises(InputError, match="another process is writing"), alone_in(tmp_path):
            pass


def test_the_copies_of_a_killed_process_may_end_after_it(tmp_path: Path) -> None:
    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    ending = threading.Timer(0.2, os.close, [handle])
    ending.start()
    with alone_in(tmp_path):
        pass
    ending.join()


def test_default_folders_are_never_shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    made = [prepare_folder(None, "run", resume=False, overwrite=False) for _ in range(3)]
    assert [folder.name for folder in made] == ["run-1", "run-2", "run-3"]


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    write_text(path, "before")
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
        with pytest.raises(InputError, match=r"report\.json: it cannot be written \(File too large\); what was there"):
            write_text(path, "x" * 5000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_text() == "before" and [file.name for file in tmp_path.iterdir()] == ["report.json"]


def test_a_folder_that_is_gone(folder: Path) -> None:
    gone = folder / "gone"
    gone.mkdir()
    before = Path.cwd()
    os.chdir(gone)
    gone.rmdir()
    try:
        with pytest.raises(InputError, match="the folder cannot be used"):
            prepare_folder(None, "run", resume=False, overwrite=False)
    finally:
        os.chdir(before)
