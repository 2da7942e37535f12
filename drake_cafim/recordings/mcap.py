"""Messages out of an MCAP file, read once from front to back so that a cut file gives what it has."""

import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from drake_cafim.errors import InputError
from drake_cafim.recordings.messages import Raw

LARGEST_RECORD = 256 * 2**20  # bytes; writers use chunks of about a MiB
CUT = (EndOfFile, EOFError, struct.error)
BROKEN = (*CUT, McapError, ValueError, RuntimeError)


def mcap_messages(path: Path, notes: list[str]) -> Iterator[Raw]:
    """The file's messages in its own order; memory holds one chunk at a time.

    A file that was cut, or a chunk that cannot be unpacked, is said in `notes` once the reading has passed it.
    Raises `InputError` when the file does not begin as an MCAP file does.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in _records(path, notes):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            schema = schemas.get(channel.schema_id)
            kind = full_name(schema.name) if schema is not None else "(no schema)"
            yield Raw(channel.topic, kind, channel.message_encoding, record.log_time, record.data)


def full_name(kind: str) -> str:
    """The ROS 2 spelling of a message type; ROS 1 leaves `msg` out."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}" if name and "/" not in name else kind


def _records(path: Path, notes: list[str]) -> Iterator[McapRecord]:
    begun = False
    bad_chunks = 0
    with path.open("rb") as file:
        stream = StreamReader(file, emit_chunks=True, record_size_limit=LARGEST_RECORD)
        try:
            for record in stream.records:
                begun = True
                if not isinstance(record, Chunk):
                    yield record
                    continue
                try:
                    inside = breakup_chunk(record, validate_crc=True)
                except Exception:  # each decompressor raises errors of its own
                    bad_chunks += 1
                    continue
                yield from inside
        except BROKEN as error:
            if not begun:
                raise InputError(f"{path}: not an MCAP file, or cut before its first record") from error
            if isinstance(error, CUT):
                notes.append(f"{path.name} is cut at byte {file.tell()}, what stands before is read")
            else:
                why = " ".join(str(error).split())
                notes.append(f"{path.name} is damaged at byte {file.tell()} ({why}), what stands before is read")
    if bad_chunks:
        notes.append(f"{bad_chunks} chunks of {path.name} cannot be unpacked and are left out")
