"""Messages of bags: ROS 2 folders and files (MCAP, SQLite) and ROS 1 files."""

import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags import rosbag1, rosbag2

from drake_cafim.errors import InputError
from drake_cafim.recordings.mcap import LARGEST_RECORD, full_name, mcap_messages
from drake_cafim.recordings.messages import Raw
from drake_cafim.yaml_file import read_mapping

STORAGE = (".mcap", ".db3")
DAMAGED = (sqlite3.Error, UnicodeDecodeError, OverflowError)  # SQLite's own messages may be no UTF-8 on damaged bytes
SHORTEST_LIMIT = 2**20  # bytes, of a value in SQLite: below it the schema itself may not fit


def is_bag_folder(path: Path) -> bool:
    """Whether the path is a ROS 2 bag's folder: with a metadata.yaml, or with storage files where that is missing."""
    return path.is_dir() and ((path / "metadata.yaml").is_file() or bool(_storage(path)))


def folder_messages(path: Path, notes: list[str]) -> Iterator[Raw]:
    """The messages of a ROS 2 bag's folder, file after file; missing or truncated files get a note."""
    metadata = _metadata(path)
    if metadata is None:
        notes.append("the bag has no readable metadata.yaml, as when the recorder was killed; its files are read")
    elif str(metadata.get("compression_mode")).lower() in ("file", "message"):
        yield from rosbags_messages(path, notes)
        return
    listed = (metadata or {}).get("relative_file_paths")
    names = [Path(name).name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
    files = [path / name for name in names] or _storage(path)
    for file in files:
        if not os.path.isfile(file):  # a name that is too long for any file is none, where `Path.is_file` raises
            notes.append(f"the bag's file {file.name} is not there, the others are read")
        elif file.suffix == ".mcap":
            yield from mcap_messages(file, notes)
        else:
            yield from sqlite_messages(file, notes)


def sqlite_messages(path: Path, notes: list[str]) -> Iterator[Raw]:
    """The messages of a .db3 file in the order in which they were written; of a truncated file, those that it holds.

    Raises `InputError` when it is not an SQLite file or lacks the tables of a ROS 2 bag.
    """
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(LARGEST_RECORD, max(path.stat().st_size, SHORTEST_LIMIT)))
    database.text_factory = bytes  # text that is no UTF-8 must not end the reading
    try:
        try:
            topics = _sqlite_topics(database, path)
        except DAMAGED as error:
            raise InputError(f"{path}: not a whole ROS 2 bag in SQLite ({error})") from error
        wrong = 0
        try:
            for number, log, data in database.execute("SELECT topic_id, timestamp, data FROM messages"):
                if not (isinstance(log, int) and isinstance(data, bytes)):
                    wrong += 1
                elif number in topics:
                    name, kind, form = topics[number]
                    yield Raw(name, full_name(kind), form, log, data)
        except DAMAGED as error:
            notes.append(f"{path.name} is cut or damaged ({error}), what could be read is read")
        if wrong:
            notes.append(f"{wrong} rows of {path.name} without a stamp or data are left out")
    finally:
        database.close()


def _sqlite_topics(database: sqlite3.Connection, path: Path) -> dict[int, tuple[str, str, str]]:
    """Name, type and encoding of each topic. Raises `InputError` where a view, of any length, stands for a table."""
    for name, kind in database.execute("SELECT name, type FROM sqlite_master"):
        if name.lower() in (b"topics", b"messages") and kind != b"table":
            found = f"{_text(name)} is a {_text(kind)}"
            raise InputError(f"{path}: {found}, expected the table of a ROS 2 bag")
    rows = database.execute("SELECT id, name, type, serialization_format FROM topics")
    return {
        number: (_text(name), _text(kind), _text(form))
        for number, name, kind, form in rows
        if all(isinstance(text, bytes) for text in (name, kind, form))
    }


def _text(value: bytes) -> str:
    return value.decode("utf-8", errors="replace")


def rosbags_messages(path: Path, notes: list[str]) -> Iterator[Raw]:
    """The messages of a ROS 1 .bag file or of a compressed ROS 2 bag.

    Of a damaged file those before the damage, with a note. Raises `InputError` when there are none, as in a truncated
    ROS 1 bag, which has lost its index.
    """
    count = 0
    try:
        encoding, library = ("ros1", rosbag1) if path.is_file() else ("cdr", rosbag2)
        with library.Reader(path) as reader:
            for connection, log, data in reader.messages():
                yield Raw(connection.topic, full_name(connection.msgtype), encoding, int(log), bytes(data))
                count += 1
    except Exception as error:  # the library's own exceptions, and those of its decompressors and parsers
        why = " ".join(str(error).split()) or type(error).__name__
        if count:
            notes.append(f"{path.name} is damaged ({why}), the {count} messages before are read")
            return
        raise InputError(f"{path}: not a whole bag, it may have been cut ({why})") from error


def _metadata(path: Path) -> dict[str, Any] | None:
    """The bag's metadata; None where the file is missing or damaged."""
    try:
        found = read_mapping(path / "metadata.yaml", "a ROS 2 bag's metadata").get("rosbag2_bagfile_information")
    except InputError:
        return None
    return found if isinstance(found, dict) else None


def _storage(path: Path) -> list[Path]:
    """The folder's storage files in the recorder's order: by length first, so that number 10 comes after 9."""
    files = [file for file in path.iterdir() if file.suffix in STORAGE]
    return sorted(files, key=lambda file: (len(file.name), file.name))
