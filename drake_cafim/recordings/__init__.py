"""Recordings: the one frozen table that every file format is read into, and what is wrong with a file."""

from drake_cafim.recordings.checks import cleaned, require
from drake_cafim.recordings.files import read, write
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS, Recording
from drake_cafim.recordings.units import unit_mistakes

__all__ = [
    "POSE_COMPONENTS",
    "WRENCH_COMPONENTS",
    "Recording",
    "cleaned",
    "read",
    "require",
    "unit_mistakes",
    "write",
]
