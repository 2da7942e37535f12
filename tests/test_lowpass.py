"""Channels that their maker filtered: the equations are filtered alike, and a filter that nobody states is told."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.signal import butter, sosfilt, sosfiltfilt

from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.noise.filters import end_of_spectrum
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.filtered_windows import RESPONSE_SHARE, FilteredWindows, response
from drake_cafim.diagnosis.rows.test_functions import lay_windows
from drake_cafim.diagnosis.whitening.noise_jacobian import noise_jacobian
from drake_cafim.diagnosis.whitening.sampled_noise import sampled_noise
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.artifacts import replay_of
from drake_cafim.scenario.schema import Lowpass
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.test_unknown_effects import PENDULUM, moved

STEP, SAMPLES = 0.004, 5000
MAKERS = Lowpass(4, 3.0)
FRICTION = 0.3


@pytest.mark.parametrize("lowpass", [MAKERS, Lowpass(2, 5.0, zero_phase=False)], ids=["zero phase", "causal"])
def test_filtered_test_functions_are_test_functions_of_what_is_filtered(lowpass: Lowpass) -> None:
    time = STEP * np.arange(2000)
    windows = lay_windows(time, (time > 3.0) & (time < 5.0), 0.25)
    rng = np.random.default_rng(0)
    values = rng.normal(size=len(time))
    sections = butter(lowpass.order, lowpass.cutoff, fs=1.0 / STEP, output="sos")
    filtered = (sosfiltfilt if lowpass.zero_phase else sosfilt)(sections, values)
    own = FilteredWindows.of(windows, lowpass)
    for rows, plain in ((own.value, windows.value), (own.rate, windows.rate)):
        wanted = plain @ filtered
        np.testing.assert_allclose(rows @ values, wanted, atol=0.02 * np.abs(wanted).max())
    # of the recorded efforts, which are filtered already, the windows are what they were
    np.testing.assert_array_equal(own.held(time).toarray(), windows.held(time).toarray())


def test_beyond_the_reach_hardly_anything_is_left_of_an_impulse_and_rest_passes_unchanged() -> None:
    impulse = np.zeros(4001)
    impulse[2000] = 1.0
    whole = np.abs(sosfiltfilt(butter(4, 3.0, fs=1.0 / STEP, output="sos"), impulse))
    kept = response(MAKERS, 1.0 / STEP)
    reach = len(kept) // 2
    assert whole[2001 + reach :].sum() <= 1.01 * RESPONSE_SHARE * whole[2000:].sum()
    assert whole[2000 + reach // 2 :].sum() > RESPONSE_SHARE * whole[2000:].sum()
    assert kept.sum() == pytest.approx(1.0, abs=1e-12)


def _made(filtered: bool) -> tuple[Array, dict[str, Array]]:
    """A driven pendulum with viscous friction over 20 s: time and columns, its efforts measured with noise.

    If `filtered`, velocities and efforts were low-passed before they were published.
    """
    time = STEP * np.arange(SAMPLES)
    u = 3.0 * np.sin(2.0 * np.pi * 0.3 * time) + 2.0 * np.sin(2.0 * np.pi * 0.7 * time + 1.0)
    q, v = moved(lambda x, w, f: (f - 0.5 * 9.81 * np.sin(x) - FRICTION * w) / 0.27, u, 0.0)
    rng = np.random.default_rng(1)
    u, v = u + rng.normal(0.0, 0.05, SAMPLES), v + rng.normal(0.0, 0.02, SAMPLES)
    if filtered:
        sections = butter(MAKERS.order, MAKERS.cutoff, fs=1.0 / STEP, output="sos")
        u, v = sosfiltfilt(sections, u), sosfiltfilt(sections, v)
    return time, {"q.pivot": q + rng.normal(0.0, 2e-4, SAMPLES), "v.pivot": v, "u.pivot": u}


def _scene(folder: Path, **channels: object) -> Scene:
    (folder / "pendulum.urdf").write_text(PENDULUM)
    raw = {"model": "pendulum.urdf", "weld": [{"body": "base"}], "channels": {"q": {"std": 2e-4}, **channels}}
    (folder / "scenario.yaml").write_text(yaml.safe_dump(raw))
    return Scene.load(folder / "scenario.yaml")


STATED = {"order": MAKERS.order, "cutoff": MAKERS.cutoff, "zero_phase": True}


@pytest.mark.long
def test_with_the_filter_stated_the_friction_is_found_and_nothing_else(tmp_path: Path) -> None:
    scene = _scene(tmp_path, v={"lowpass": STATED}, u={"lowpass": STATED})
    recording = Recording("run", *_made(True))
    verdict, outcome = examine(scene, [recording])
    [accepted] = verdict.explanation
    assert accepted.effect.name == "joint_viscous_friction"
    assert accepted.effect.values["coefficient"] == pytest.approx(FRICTION, rel=0.02)
    assert any(note.startswith("v.pivot: filtered after") for note in verdict.notes)
    assert not any("nothing is left above" in note for note in verdict.notes)
    # the replay reads the recording anew, with the velocities that are not used
    assert replay_of(verdict, outcome, recording) is not None


def test_noise_is_propagated_through_narrow_windows_as_through_the_filtered_ones(tmp_path: Path) -> None:
    scene = _scene(tmp_path, v={"lowpass": STATED}, u={"std": 0.05, "lowpass": STATED})
    [form] = prepare(scene, [Recording("run", *_made(True))]).weak
    physics = scene.physics
    of_motion, of_efforts, jacobian = sampled_noise(form, physics)
    covariance = of_motion.full() + of_efforts.full()
    whole = noise_jacobian(form, physics)
    assert jacobian.keys() == whole.keys() == {"q.pivot", "u.pivot"}
    expected = sum(form.samples.std[name] ** 2 * (block @ block.T).toarray() for name, block in whole.items())
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(covariance.toarray() / size / size[:, None], expected / size / size[:, None], atol=1e-4)
    change = np.sin(2.0 * np.pi * 0.5 * form.samples.time)
    for name, block in whole.items():
        np.testing.assert_allclose(jacobian[name] @ change, block @ change, atol=1e-3 * np.abs(block @ change).max())


def test_a_filter_that_nobody_states_is_told_and_an_unfiltered_channel_is_not(tmp_path: Path) -> None:
    scene = _scene(tmp_path)
    for filtered in (True, False):
        notes = prepare(scene, [Recording("run", *_made(filtered))]).notes
        told = [note for note in notes if "nothing is left above about" in note]
        assert bool(told) is filtered
        assert not told or told[0].startswith("v.pivot, u.pivot: ")


def test_the_end_of_the_spectrum_is_near_the_cutoff() -> None:
    time, columns = _made(True)
    end = end_of_spectrum(Recording("run", time, columns), "u.pivot")
    assert end is not None and 0.5 * MAKERS.cutoff < end < 2.0 * MAKERS.cutoff
    assert end_of_spectrum(Recording("run", time, columns), "q.pivot") is None


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        ({"q": {"std": 1e-3, "lowpass": STATED}}, "channels.q.lowpass is given, but a filter is supported of u and v"),
        ({"u": {"lowpass": {"order": 2}}}, "channels.u.lowpass has no cutoff, expected a number in Hz"),
        ({"u": {"lowpass": {**STATED, "order": 0}}}, "channels.u.lowpass.order is 0, expected a whole number from 1"),
        ({"u": {"lowpass": {**STATED, "cutoff": 200.0}}}, "the cutoff 200 Hz of u is not below half the rate"),
        ({"u": {"lowpass": {**STATED, "cutoff": 1e-12}}}, "the cutoff 1e-12 Hz of u has a longer period"),
    ],
)
def test_a_filter_that_cannot_be_is_refused(channels: dict[str, object], sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        prepare(_scene(tmp_path, **channels), [Recording("run", *_made(False))])
    assert sentence in str(caught.value)
