"""Reading of the tensor in a PyTorch .pt file without PyTorch: nothing in the file is executed."""

import io
import pickle
import struct
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.typing import Array

MAGIC = 0x1950A86A20F9469CFC6C  # the first pickle of the format before PyTorch 1.6
TYPES = {"DoubleStorage": "<f8", "FloatStorage": "<f4"}


def read_tensor(path: Path) -> Array:
    """The tensor of floating-point numbers that the file holds, in its own shape.

    Reads the zip archives of PyTorch 1.6 and later, and the format before. Raises `InputError` for any other file.
    """
    try:
        return _from_zip(path) if zipfile.is_zipfile(path) else _from_stream(path)
    except Exception as error:  # pickles that were damaged raise anything
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: not a PyTorch file of one tensor ({why})") from error


class _Tensor:
    """A tensor's type, shape, strides and offset; its numbers are in the storage of name `key`."""

    def __init__(self, storage: tuple[str, str], offset: int, shape: tuple[int, ...], strides: tuple[int, ...]) -> None:
        self.kind, self.key = storage
        self.offset, self.shape, self.strides = int(offset), shape, strides

    def array(self, data: bytes) -> Array:
        numbers = np.frombuffer(data, dtype=TYPES[self.kind])
        itemsize = numbers.itemsize
        last = self.offset + sum((n - 1) * s for n, s in zip(self.shape, self.strides, strict=True))
        if last >= numbers.size:
            raise ValueError(f"the storage holds {numbers.size} numbers, the tensor reaches {last + 1}")
        strides = [stride * itemsize for stride in self.strides]
        view = np.lib.stride_tricks.as_strided(numbers[self.offset :], self.shape, strides, writeable=False)
        return np.array(view, dtype=np.float64)


class _Unpickler(pickle.Unpickler):
    """An unpickler that accepts only the names that a tensor needs, so that no code of the file is executed."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda storage, offset, shape, strides, *_: _Tensor(storage, offset, shape, strides)
        if module == "torch" and name in TYPES:
            return name
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        raise pickle.UnpicklingError(f"it holds {module}.{name}")

    def persistent_load(self, pid: Any) -> tuple[str, str]:
        return str(pid[1]), str(pid[2])


def _from_zip(path: Path) -> Array:
    with zipfile.ZipFile(path) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        tensor = _tensor(_Unpickler(io.BytesIO(archive.read(name))).load())
        return tensor.array(archive.read(f"{name.removesuffix('data.pkl')}data/{tensor.key}"))


def _from_stream(path: Path) -> Array:
    with path.open("rb") as file:
        if _Unpickler(file).load() != MAGIC:
            raise ValueError("it does not begin as one")
        _Unpickler(file).load()  # protocol
        _Unpickler(file).load()  # the writing machine
        tensor = _tensor(_Unpickler(file).load())
        keys = _Unpickler(file).load()
        if keys != [tensor.key]:
            raise ValueError(f"it holds {len(keys)} storages")
        (count,) = struct.unpack("<q", file.read(8))
        return tensor.array(file.read(count * np.dtype(TYPES[tensor.kind]).itemsize))


def _tensor(loaded: Any) -> _Tensor:
    if not isinstance(loaded, _Tensor):
        raise ValueError(f"it holds {type(loaded).__name__}")
    return loaded
