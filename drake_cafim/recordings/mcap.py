"""Messages of an MCAP file, read once from front to back, so that a truncated file gives what it holds."""

import struct
from collections.abc import Iterator
from io import BufferedReader, FileIO
from pathlib import Path

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from drake_cafim.errors import InputError
from drake_cafim.recordings.messages import Raw

LARGEST_RECORD = 256 * 2**20  # bytes; chunks have about 1 MiB, so that a greater length is damage and not allocated
CUT = (EndOfFile, EOFError, struct.error)
BROKEN = (*CUT, McapError, ValueError, RuntimeError)


def mcap_messages(path: Path, notes: list[str]) -> Iterator[Raw]:
    """The file's messages in its own order, with one chunk in memory at a time.

    A truncated file and chunks that cannot be unpacked get a note once reading has passed them. Raises `InputError`
    when the file does not begin as an MCAP file does.
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
    """The ROS 2 name of a message type, package/msg/Type; in ROS 1 it is package/Type."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}" if name and "/" not in name else kind


def _records(path: Path, notes: list[str]) -> Iterator[McapRecord]:
    any_record = False
    bad_chunks = 0
    limit = min(LARGEST_RECORD, path.stat().st_size)  # of a longer record not even the length is true
    with _Bounded(FileIO(path), limit) as file:
        stream = StreamReader(file, emit_chunks=True, record_size_limit=limit)
        try:
            for record in stream.records:
                any_record = True
                if not isinstance(record, Chunk):
                    yield record
                    continue
                if record.uncompressed_size > LARGEST_RECORD:
                    bad_chunks += 1
                    continue
                try:
                    inside = breakup_chunk(record, validate_crc=True)
                except Exception:  # each decompressor raises errors of its own
                    bad_chunks += 1
                    continue
                yield from inside
        except BROKEN as error:
            if not any_record:
                raise InputError(f"{path}: not an MCAP file, or cut before its first record") from error
            if isinstance(error, CUT):
                notes.append(f"{path.name} is cut at byte {file.tell()}, all before it is read")
            else:
                why = " ".join(str(error).split())
                notes.append(f"{path.name} is damaged at byte {file.tell()} ({why}), all before it is read")
    if bad_chunks:
        notes.append(f"{bad_chunks} chunks of {path.name} cannot be unpacked and are left out")


class _Bounded(BufferedReader):
    """A file of which no read takes memory for more than `limit` bytes, whatever length a damaged field states."""

    def __init__(self, file: FileIO, limit: int) -> None:
        super().__init__(file)
        self._limit = limit

    def read(self, size: int | None = -1, /) -> bytes:
        """At most `size` bytes, and at most `limit`; none for a negative size, at which the record ends."""
        return super().read(min(max(size or 0, 0), self._limit))
