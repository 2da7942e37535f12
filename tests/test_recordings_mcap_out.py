"""MCAP that others open: written whole, read back the same, residuals as channels."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.errors import InputError
from drake_cafim.recordings import Recording
from tests.bags.written import assert_equal_to_the_bit, twin


def test_out_as_mcap_and_back_with_residuals(tmp_path: Path) -> None:
    given = twin(50)
    columns = dict(given.columns) | {"u_cmd.elbow": given.time}
    given = Recording(name="a", time=given.time, columns=columns)
    recordings.write(given, tmp_path / "a.mcap")
    assert_equal_to_the_bit(recordings.read(tmp_path / "a.mcap"), given)
    first = (tmp_path / "a.mcap").read_bytes()
    assert recordings.write(given, tmp_path / "b.mcap").read_bytes() == first
    residuals = {"q.elbow": np.where(np.isnan(given.columns["q.elbow"]), np.nan, 0.25)}
    recordings.write_mcap(given, tmp_path / "c.mcap", residuals)
    back = recordings.read(tmp_path / "c.mcap")
    assert np.nansum(back.columns["residual_q.elbow"]) == 0.25 * 50
    with pytest.raises(InputError, match=r"residual q\.elbow has shape"):
        recordings.write_mcap(given, tmp_path / "c.mcap", {"q.elbow": np.zeros(3)})


def test_a_public_reader_opens_what_is_written(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    given = twin(20)
    recordings.write(given, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    q = [message.position[1] for topic, message in decoded if topic == "/joint_states"]
    expected = given.columns["q.elbow"]
    assert q == expected[~np.isnan(expected)].tolist()
    w = [message.pose.orientation.w for topic, message in decoded if topic == "/ball"]
    assert w == given.columns["pose.ball.qw"][~np.isnan(given.columns["pose.ball.qw"])].tolist()
