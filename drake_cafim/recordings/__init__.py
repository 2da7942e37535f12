"""Recordings: the one frozen table that every file format is read into, and what is wrong with a file."""

from drake_cafim.recordings.checks import cleaned, require
from drake_cafim.recordings.files import read, write
from drake_cafim.recordings.importing import Description, convert, describe
from drake_cafim.recordings.mcap_out import write_mcap
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS, Recording
from drake_cafim.recordings.resampling import resampled
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
    "cleaned",
    "convert",
    "describe",
    "from_vector_log",
    "read",
    "require",
    "resampled",
    "unit_mistakes",
    "write",
    "write_mcap",
]
