"""Reading of a bag or log: its messages as one table, with the topics that were not read and notes on defects."""

import functools
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from drake_cafim.errors import InputError
from drake_cafim.recordings.bags import folder_messages, is_bag_folder, rosbags_messages, sqlite_messages
from drake_cafim.recordings.joining import JoinedTable, join
from drake_cafim.recordings.lcm import lcm_messages, lcm_type
from drake_cafim.recordings.mcap import mcap_messages
from drake_cafim.recordings.messages import DECODERS, NEED_COLUMNS, MalformedError, Raw, Sample
from drake_cafim.recordings.topics import Topic, Topics, check_topics
from drake_cafim.recordings.tracks import Track

Reader = Callable[[Path, list[str]], Iterator[Raw]]

MESSAGES: dict[str, Reader] = {
    ".mcap": mcap_messages,
    ".db3": sqlite_messages,
    ".bag": rosbags_messages,
    ".lcm": lcm_messages,
    ".lcmlog": lcm_messages,
}
LATEST = 2**62  # ns, the year 2116; sums and differences of stamps then stay within 64 bits
ENCODINGS = ("cdr", "ros1", "lcm")
# What the decoders raise on damaged bytes; none of them documents an exception of its own.
UNDECODABLE = (SerdeError, MalformedError, ValueError, IndexError, KeyError, AssertionError, struct.error, MemoryError)


@dataclass(frozen=True)
class SkippedTopic:
    """A topic that was not read: its message type, the number of its messages, and why."""

    topic: str
    kind: str
    count: int
    why: str


@dataclass(frozen=True)
class LogContents:
    """The table of a bag or log, the topics that were not read, and notes on what was left out."""

    table: JoinedTable
    left_alone: tuple[SkippedTopic, ...]
    notes: tuple[str, ...]


def reader_of(path: Path) -> Reader | None:
    """The function that reads the messages of the file or folder; None when it is neither a bag nor a log."""
    if is_bag_folder(path):
        return folder_messages
    return MESSAGES.get(path.suffix.lower()) if path.is_file() else None


def gather(path: Path, topics: Topics) -> LogContents:
    """Read the bag or log once, front to back, with the samples on disk instead of in memory.

    Raises `InputError` when it cannot be read at all, holds nothing of a known type, or lacks a topic of
    `topics`.
    """
    check_topics(topics, str(path))
    reader = reader_of(path)
    if reader is None:
        raise InputError(f"{path}: neither a bag nor a log")
    tracks: dict[tuple[str, tuple[str, ...]], Track] = {}
    try:
        return _gather(path, topics, reader, tracks)
    finally:
        for track in tracks.values():
            track.close()


def _gather(
    path: Path, topics: Topics, reader: Reader, tracks: dict[tuple[str, tuple[str, ...]], Track]
) -> LogContents:
    notes: list[str] = []
    alone: Counter[tuple[str, str, str]] = Counter()
    malformed: dict[str, list[str]] = {}
    for raw in reader(path, notes):
        why = _why_not(raw, topics)
        if why:
            alone[raw.topic, raw.kind, why] += 1
            continue
        try:
            sample = _sample(raw, topics.get(raw.topic, Topic()))
        except UNDECODABLE as error:
            malformed.setdefault(raw.topic, []).append(" ".join(str(error).split()) or type(error).__name__)
            continue
        key = (raw.topic, sample.columns)
        if key not in tracks:
            tracks[key] = Track(raw.topic, raw.kind, sample.columns, topics.get(raw.topic, Topic()))
        tracks[key].add(sample, raw.log)
    notes += [f"{topic}: {len(bad)} messages left out ({bad[0]})" for topic, bad in malformed.items()]
    left = tuple(SkippedTopic(topic, kind, count, why) for (topic, kind, why), count in sorted(alone.items()))
    full = [track for track in tracks.values() if track.columns]
    _check_found(path, topics, full, left, notes)
    table = join(str(path), [track.series(str(path), notes) for track in full], topics, notes)
    sentences = [f"{topic.topic}: {topic.kind}, {topic.count} messages left alone ({topic.why})" for topic in left]
    return LogContents(table=table, left_alone=left, notes=(*notes, *sentences))


def _why_not(raw: Raw, topics: Topics) -> str:
    """Why the message is not read; empty when it is."""
    if topics and raw.topic not in topics:
        return "topics: does not name it"
    if raw.kind not in DECODERS or raw.encoding not in ENCODINGS:
        return "unknown type" if raw.kind not in DECODERS else f"unknown encoding {raw.encoding}"
    if raw.kind in NEED_COLUMNS and not (raw.topic in topics and topics[raw.topic].columns):
        return "it needs columns: in topics:"
    return ""


def _sample(raw: Raw, how: Topic) -> Sample:
    if raw.encoding == "lcm":
        message = lcm_type(raw.kind).decode(raw.data)
    elif raw.encoding == "ros1":
        message = _store(Stores.ROS1_NOETIC).deserialize_ros1(raw.data, raw.kind)
    else:
        message = _store(Stores.ROS2_HUMBLE).deserialize_cdr(raw.data, raw.kind)
    sample = DECODERS[raw.kind](message, raw.topic, how)
    if max(abs(raw.log), abs(sample.stamp or 0)) >= LATEST:
        raise MalformedError("its stamp is beyond the range of a clock")
    return sample


@functools.cache
def _store(store: Stores) -> Any:
    return get_typestore(store)


def _check_found(
    path: Path, topics: Topics, tracks: list[Track], left: tuple[SkippedTopic, ...], notes: list[str]
) -> None:
    found = {track.topic: track.kind for track in tracks} | {skipped.topic: skipped.kind for skipped in left}
    listed = ", ".join(f"{topic} ({kind})" for topic, kind in found.items()) or "no message at all"
    for topic in topics:
        if topic not in found:
            raise InputError(f"{path}: topics: {topic} has no usable message; the file has {listed}")
        why = next((skipped.why for skipped in left if skipped.topic == topic), "")
        if why:
            raise InputError(f"{path}: topics: {topic} of type {found[topic]} cannot be read: {why}")
    if not tracks:
        why = f"; {'; '.join(notes)}" if notes else ""
        raise InputError(
            f"{path}: no message of a type that is read; it has {listed}{why}; expected one of {', '.join(DECODERS)}"
        )
