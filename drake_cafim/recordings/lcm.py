"""Messages of an LCM log that have one of Drake's own LCM types."""

import functools
import importlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drake_cafim.errors import InputError
from drake_cafim.recordings.messages import DECODERS, Raw

SYNC = 0xEDA1DA01
EVENT = struct.Struct(">IqqII")  # sync word, number, microseconds, lengths of the channel's name and the data


def lcm_messages(path: Path, notes: list[str]) -> Iterator[Raw]:
    """The log's events in its own order; a message's type is found by the fingerprint at its beginning.

    A truncated log gets a note. Raises `InputError` when the file does not begin as a log does.
    """
    types = {fingerprint: kind for kind, fingerprint in _fingerprints()}
    with path.open("rb") as file:
        position = 0
        while head := file.read(EVENT.size):
            sound = len(head) == EVENT.size and EVENT.unpack(head)[0] == SYNC
            if not sound and position == 0:
                raise InputError(f"{path}: not an LCM log, its first event is not whole")
            if sound:
                _, _, microseconds, name_length, length = EVENT.unpack(head)
                name, data = file.read(name_length), file.read(length)
                sound = len(data) == length
            if not sound:
                notes.append(f"the log is cut at byte {position}, all before it is read")
                return
            kind = types.get(data[:8], "(a type of no known fingerprint)")
            yield Raw(name.decode("utf-8", errors="replace"), kind, "lcm", microseconds * 1000, data)
            position = file.tell()


@functools.cache
def lcm_type(kind: str) -> Any:
    """Drake's Python class for the LCM type of this name."""
    return getattr(importlib.import_module(f"drake.{kind}"), kind)


def _fingerprints() -> list[tuple[str, bytes]]:
    kinds = [kind for kind in DECODERS if kind.startswith("lcmt_")]
    return [(kind, lcm_type(kind)._get_packed_fingerprint()) for kind in kinds]
