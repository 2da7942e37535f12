"""Bags that do not fit into memory."""

import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from tests.bags.written import ROS2, built

BIG = """
import sys
from pathlib import Path
from drake_cafim import recordings
print(recordings.convert(sys.argv[1], sys.argv[2]).samples)
# ru_maxrss would begin with the memory of the process that forked this one
print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
"""


def convert_apart(path: Path, out: Path) -> tuple[int, float]:
    """Samples and peak memory (MiB) of a conversion in a process of its own."""
    done = subprocess.run([sys.executable, "-c", BIG, path, out], capture_output=True, text=True, check=True)
    samples, peak = done.stdout.split()
    return int(samples), int(peak) / 1024.0


def write_big(path: Path, joint_states: int, ballast: int) -> None:
    """Joint states of seven joints with `ballast` bytes of a camera's messages beside each hundredth."""
    names = [f"panda_joint{i + 1}" for i in range(7)]
    kind = "sensor_msgs/msg/JointState"
    holds = {"name": names, "position": [0.1] * 7, "velocity": [0.2] * 7, "effort": [0.3] * 7}
    template = bytearray(ROS2.serialize_cdr(built(ROS2, kind, 0, holds), kind))
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", ROS2.generate_msgdef(kind, ros_version=2)[0].encode())
        joints = writer.register_channel("/joint_states", "cdr", schema)
        camera = writer.register_channel("/camera", "cdr", writer.register_schema("a_msgs/msg/B", "ros2msg", b""))
        picture = bytes(ballast)
        for i in range(joint_states):
            stamp = 1_000_000 * (i + 1)
            template[4:12] = (stamp // 10**9).to_bytes(4, "little") + (stamp % 10**9).to_bytes(4, "little")
            writer.add_message(joints, stamp, bytes(template), stamp)
            if ballast and i % 100 == 0:
                writer.add_message(camera, stamp, picture, stamp)
        writer.finish()


def test_a_long_bag_is_streamed(tmp_path: Path) -> None:
    write_big(tmp_path / "a.mcap", 20_000, 500_000)  # 100 MB of pictures
    samples, peak = convert_apart(tmp_path / "a.mcap", tmp_path / "a.parquet")
    assert samples == 20_000 and peak < 450


@pytest.mark.long
@pytest.mark.parametrize(("joint_states", "ballast"), [(200_000, 1_000_000), (5_500_000, 0)])
def test_two_gibibytes_within_one_of_memory(tmp_path: Path, joint_states: int, ballast: int) -> None:
    write_big(tmp_path / "a.mcap", joint_states, ballast)
    assert (tmp_path / "a.mcap").stat().st_size > 1.9 * 2**30
    samples, peak = convert_apart(tmp_path / "a.mcap", tmp_path / "a.parquet")
    assert samples == joint_states and peak < 1024
