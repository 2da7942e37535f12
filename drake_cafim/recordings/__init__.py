"""Recordings of a robot: files of every format read into one kind of table, checked, converted and written."""

from drake_cafim.recordings.checks import clean, require
from drake_cafim.recordings.files import read, write
from drake_cafim.recordings.importing import Description, convert, describe
from drake_cafim.recordings.mcap_out import write_mcap
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS, Recording
from drake_cafim.recordings.resampling import resample
from drake_cafim.recordings.topics import Topic, Topics, check_topics
from drake_cafim.recordings.units import unit_mistakes
from drake_cafim.recordings.vector_log import from_vector_log

__all__ = [
    "POSE_COMPONENTS",
    "WRENCH_COMPONENTS",
    "Description",
    "Recording",
    "Topic",
    "Topics",
    "check_topics",
    "clean",
    "convert",
    "describe",
    "from_vector_log",
    "read",
    "require",
    "resample",
    "unit_mistakes",
    "write",
    "write_mcap",
]
