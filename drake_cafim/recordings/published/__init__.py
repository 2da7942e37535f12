"""Converters for published recordings of real machines, whose files the user fetches from their sources."""

from drake_cafim.recordings.published.cube_toss import CUBE_TOSS
from drake_cafim.recordings.published.double_pendulum import DOUBLE_PENDULUM_A0
from drake_cafim.recordings.published.emps_drive import EMPS_DRIVE
from drake_cafim.recordings.published.published_set import PublishedSet, Run, content_hash
from drake_cafim.recordings.published.simple_pendulum import SIMPLE_PENDULUM

SETS = {data_set.name: data_set for data_set in (EMPS_DRIVE, DOUBLE_PENDULUM_A0, SIMPLE_PENDULUM, CUBE_TOSS)}

__all__ = ["SETS", "PublishedSet", "Run", "content_hash"]
