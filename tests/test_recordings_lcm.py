"""LCM logs of Drake's types."""

from pathlib import Path

from drake_cafim import recordings
from tests.bags.lcm_log import write_lcm


def test_lcm_log_of_drake_types(tmp_path: Path) -> None:
    path = write_lcm(tmp_path / "a.lcm")
    read = recordings.read(path)
    assert read.time.tolist() == [0.0, 0.001, 0.002, 0.003, 0.004]
    assert read.columns["q.iiwa_joint_2"].tolist() == [0.0, -1.0, -2.0, -3.0, -4.0]
    assert read.wrench("FT")[:, 2].tolist() == [9.0, 10.0, 11.0, 12.0, 13.0]
    assert read.columns["u.a"].tolist() == [0.5] * 5 and read.other_columns == ("speed",)
    assert any(note.startswith("OTHER: ") and "left alone (unknown type)" in note for note in read.notes)
    path.write_bytes(path.read_bytes()[:-300])
    assert any("the log is cut at byte" in note for note in recordings.read(path).notes)
