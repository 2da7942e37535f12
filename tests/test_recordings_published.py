"""Converters of the published sets.

The published files are no part of the project. Their parsing is tested on small files made here in the published
layout (the .pt ones by hand after PyTorch's own writer); the hashes are tested against the sets' own columns where
DRAKE_CAFIM_DATA has them. That the two meet, a published file giving the hash, is what a user's conversion checks.
"""

import io
import os
import pickle
import struct
import zipfile
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from drake_cafim import recordings
from drake_cafim.errors import InputError
from drake_cafim.recordings.published import SETS, Run, content_hash
from drake_cafim.recordings.published.torch_file import MAGIC, read_tensor


def with_its_own_hash(
    name: str, run: str, folder: Path, rows: tuple[int, int | None] = (0, None)
) -> recordings.Recording:
    """The run as the set's converter reads it, from a file whose hash is taken to be right."""
    published = SETS[name]
    open_run = replace(published.runs[run], rows=rows)
    columns = published.table(folder / open_run.source, open_run)
    sha256 = content_hash(recordings.clean("a", columns))
    checked = replace(published, runs={run: replace(open_run, sha256=sha256)})
    checked.convert(folder, folder / "out")
    return recordings.read(folder / "out" / f"{run}.parquet")


def placed(folder: Path, name: str, run: str) -> Path:
    path = folder / SETS[name].runs[run].source
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


@pytest.mark.parametrize("name", SETS)
def test_hashes_are_those_of_the_sets(name: str, data_folder: Path) -> None:
    files = {path.stem: path for path in (data_folder / "data" / name / "runs").glob("*.parquet")}
    assert sorted(files) == sorted(SETS[name].runs)
    for run, path in files.items():
        assert content_hash(recordings.read(path)) == SETS[name].runs[run].sha256, run


def test_emps_drive(tmp_path: Path) -> None:
    t = np.arange(9)[:, None] * 0.001
    held = {"t": t, "qm": t + 1.0, "qg": t + 2.0, "vir": t + 3.0, "gtau": 35.0}
    savemat(placed(tmp_path, "emps_drive", "ident_1"), held)
    read = with_its_own_hash("emps_drive", "ident_1", tmp_path, rows=(3, 6))
    assert np.allclose(read.time, [0.0, 0.001, 0.002], atol=1e-15) and read.joints("u") == ("carriage",)
    assert read.columns["u.carriage"].tolist() == (35.0 * (t[3:6, 0] + 3.0)).tolist()
    assert read.columns["q_ref.carriage"].tolist() == (t[3:6, 0] + 2.0).tolist()
    savemat(placed(tmp_path, "emps_drive", "ident_1"), {"t": t})
    with pytest.raises(InputError, match="no variable qm, expected t, qm, qg, vir, gtau"):
        SETS["emps_drive"].recording(tmp_path, "ident_1")


DOUBLE = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2,tau_fric1,tau_fric2,tau_meas1,tau_meas2\n"


def test_double_pendulum(tmp_path: Path) -> None:
    rows = [[time, *(10 * time + np.arange(10))] for time in (0.5, 0.502, 0.502, 0.504)]
    text = DOUBLE + "".join(",".join(f"{cell:.18e}" for cell in row) + "\n" for row in rows)
    placed(tmp_path, "double_pendulum_A0", "trajectory_03").write_text(text)
    read = with_its_own_hash("double_pendulum_A0", "trajectory_03", tmp_path)
    assert np.allclose(read.time, [0.0, 0.002, 0.004]) and read.joints("q") == ("shoulder", "elbow")
    offsets = {name: values[0] - 5.0 for name, values in read.columns.items()}
    assert offsets == {
        **{"q.shoulder": 0, "v.shoulder": 2, "u.shoulder": 8, "u_cmd.shoulder": 4},
        **{"q.elbow": 1, "v.elbow": 3, "u.elbow": 9, "u_cmd.elbow": 5},
    }


def test_simple_pendulum(tmp_path: Path) -> None:
    text = "time,position,velocity,torque\n" + "".join(f"{0.02 * i:.18e},{i},{-i},7\n" for i in range(6))
    placed(tmp_path, "simple_pendulum", "ilqr").write_text(text)
    read = with_its_own_hash("simple_pendulum", "ilqr", tmp_path, rows=(0, 4))
    assert len(read) == 4 and read.columns["v.shoulder"].tolist() == [0.0, -1.0, -2.0, -3.0]
    placed(tmp_path, "simple_pendulum", "ilqr").write_text(text.replace("torque", "effort"))
    with pytest.raises(InputError, match="no column torque; it has time, position, velocity, effort"):
        SETS["simple_pendulum"].recording(tmp_path, "ilqr")


class Named:
    """Pickles as a global of the given name, as PyTorch's classes and functions do."""

    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name


class Call:
    """Pickles as a call of a global."""

    def __init__(self, function: Named, arguments: tuple[Any, ...]) -> None:
        self.function, self.arguments = function, arguments


class Storage:
    """Pickles as a persistent identity; its numbers stand elsewhere in the file."""

    def __init__(self, identity: tuple[Any, ...]) -> None:
        self.identity = identity


class TorchPickler(pickle._Pickler):  # the Python one: it lets a global be written that does not exist here
    def persistent_id(self, obj: Any) -> Any:
        return obj.identity if isinstance(obj, Storage) else None

    def save(self, obj: Any, save_persistent_id: bool = True) -> None:
        if isinstance(obj, Named):
            self.write(pickle.GLOBAL + f"{obj.module}\n{obj.name}\n".encode())
        elif isinstance(obj, Call):
            self.save(obj.function)
            self.save(obj.arguments)
            self.write(pickle.REDUCE)
        else:
            super().save(obj, save_persistent_id)


def pickled(obj: Any) -> bytes:
    out = io.BytesIO()
    TorchPickler(out, protocol=2).dump(obj)
    return out.getvalue()


def tensor_file(path: Path, values: np.ndarray, old_format: bool) -> None:
    """What PyTorch's writer leaves for one contiguous tensor of doubles."""
    storage = Storage(("storage", Named("torch", "DoubleStorage"), "0", "cpu", values.size))
    strides = tuple(int(stride) // 8 for stride in values.strides)
    arguments = (storage, 0, values.shape, strides, False, OrderedDict())
    tensor = Call(Named("torch._utils", "_rebuild_tensor_v2"), arguments)
    if old_format:
        head = [MAGIC, 1001, {"little_endian": True}]
        parts = [pickled(item) for item in head] + [pickled(tensor), pickled(["0"])]
        path.write_bytes(b"".join(parts) + struct.pack("<q", values.size) + values.tobytes())
    else:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("archive/data.pkl", pickled(tensor))
            archive.writestr("archive/data/0", values.tobytes())


@pytest.mark.parametrize("old_format", [True, False])
def test_cube_toss(tmp_path: Path, old_format: bool) -> None:
    states = np.zeros((1, 3, 19))
    states[0, :, 0] = [0.0, 1.0, 2.0]
    states[0, :, 3:7] = [[2.0, 0, 0, 0], [-2.0, 0, 0, 0], [0, -3.0, 0, 0]]
    tensor_file(placed(tmp_path, "cube_toss", "toss_027"), states, old_format)
    read = with_its_own_hash("cube_toss", "toss_027", tmp_path)
    assert read.time.tolist() == [0.0, 1 / 148, 2 / 148]
    assert read.pose("cube")[:, 0].tolist() == [0.0, 0.0524, 0.1048]
    assert read.pose("cube")[:, 3].tolist() == [1.0, 1.0, 0.0] and abs(read.pose("cube")[2, 4]) == 1.0


def test_a_torch_file_runs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.pt"
    path.write_bytes(pickle.dumps(os.getcwd))
    with pytest.raises(InputError, match=r"not a PyTorch file of one tensor \(it holds posix\.getcwd"):
        read_tensor(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="not a PyTorch file of one tensor"):
        read_tensor(path)


def test_another_file_is_refused_by_its_hash(tmp_path: Path) -> None:
    placed(tmp_path, "simple_pendulum", "ilqr").write_text("time,position,velocity,torque\n0,1,2,3\n1,1,2,3\n")
    with pytest.raises(InputError, match=r"has columns of sha256 .*, expected 457b30377ef4"):
        SETS["simple_pendulum"].recording(tmp_path, "ilqr")
    with pytest.raises(InputError, match=r"expected a checkout of https://github\.com/DAIRLab/contact-nets at c3dc"):
        SETS["cube_toss"].recording(tmp_path, "toss_000")
    with pytest.raises(InputError, match="there is no run toss_1; it has toss_000"):
        SETS["cube_toss"].recording(tmp_path, "toss_1")


def test_the_hash_sees_names_and_numbers() -> None:
    def of(**columns: np.ndarray) -> str:
        return content_hash(recordings.Recording(name="a", time=np.arange(2.0), columns=columns))

    digest = of(a=np.array([1.0, -0.0]))
    assert digest == of(a=np.array([1.0 + 1e-12, 0.0]))
    assert len({digest, of(b=np.array([1.0, 0.0])), of(a=np.array([1.0, 1e-8]))}) == 3
    assert Run(source="a", sha256=digest).rows == (0, None)
