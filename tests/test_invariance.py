"""Verdicts do not depend on the order of recordings, names of joints, cuts of recordings, or sampling rates."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.noise.slow_channels import bridge_slow_channels
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests.concealed.case import Case
from tests.concealed.make import simulate

Read = list[Recording]
KIND, RIG, SEED = "pair:joint_viscous_friction,actuator_bias", "arm2", 4


@cache
def _case() -> Case:
    return simulate(KIND, RIG, SEED)


def _diagnosed(folder: Path, case: Case, change: Callable[[Read], Read]) -> Verdict:
    case.write(folder)
    read = [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2)]
    return diagnose(Scene.load(folder / "scenario.yaml"), change(read))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Verdict:
    verdict = _diagnosed(tmp_path_factory.mktemp("plain"), _case(), lambda read: read)
    truth = {(item["effect"], item["at"]) for item in _case().truth["effects"]}  # type: ignore[attr-defined]
    assert _named(verdict) == truth
    return verdict


def _named(verdict: Verdict) -> set[tuple[str, str]]:
    return {accepted.effect.key for accepted in verdict.explanation}


def _same(verdict: Verdict, plain: Verdict, within: float) -> None:
    """The same effects at the same places, each strength `within` so many standard deviations."""
    assert verdict.kind == plain.kind and _named(verdict) == _named(plain)
    strengths = {accepted.effect.key: accepted.values for accepted in plain.explanation}
    for accepted in verdict.explanation:
        for name, value in accepted.values.items():
            known = strengths[accepted.effect.key][name]
            assert abs(value.value - known.value) <= within * known.std


def _cut(read: Read) -> Read:
    pieces = []
    for recording in read:
        middle = 0.5 * (recording.time[0] + recording.time[-1])
        pieces += [recording.window(recording.time[0], middle), recording.window(middle, recording.time[-1])]
    return [replace(piece, name=f"piece {k}") for k, piece in enumerate(pieces)]


def _every_second(read: Read) -> Read:
    """Motion measured half as often; the efforts at their own rate."""
    empty = np.arange(len(read[0])) % 2 == 1

    def thinned(recording: Recording) -> Recording:
        odd = np.arange(len(recording)) % 2 == 1
        columns = {
            k: np.where(odd, np.nan, v) if k.startswith(("q.", "v.")) else v for k, v in recording.columns.items()
        }
        return replace(recording, columns=columns)

    assert empty.any()
    return [thinned(recording) for recording in read]


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "within"),
    [(lambda read: read[::-1], 0.5), (_cut, 1.0), (_every_second, 3.0)],
    ids=["order", "cut", "half"],
)
def test_same_recordings_otherwise_told(
    change: Callable[[Read], Read], within: float, plain: Verdict, tmp_path: Path
) -> None:
    _same(_diagnosed(tmp_path, _case(), change), plain, within)


@pytest.mark.long
def test_joints_by_other_names(plain: Verdict, tmp_path: Path) -> None:
    case = _case()
    names = [
        str(column).removeprefix("q.") for column in case.recordings["train_1.parquet"] if str(column).startswith("q.")
    ]
    # the first name sorts last now
    other = dict(zip(names, ("zeta", "alpha"), strict=True))

    def renamed(text: str) -> str:
        for name, new in other.items():
            text = text.replace(f'"{name}"', f'"{new}"')
        return text

    tables = {
        key: table.rename(columns={f"{kind}.{name}": f"{kind}.{new}" for kind in "qvu" for name, new in other.items()})
        for key, table in case.recordings.items()
    }
    verdict = _diagnosed(tmp_path, replace(case, model=renamed(case.model), recordings=tables), lambda read: read)
    back = {new: name for name, new in other.items()}
    assert {(effect, back.get(at, at)) for effect, at in _named(verdict)} == _named(plain)
    assert verdict.kind == plain.kind


def test_slow_channels_are_laid_on_the_clock_and_gaps_are_not() -> None:
    time = 0.002 * np.arange(500)
    q = np.sin(9.0 * time)
    slow, gap = q.copy(), q.copy()
    slow[1::2] = np.nan
    gap[100:300] = np.nan
    even, bridges = bridge_slow_channels(Recording("a", time, {"q.a": slow, "q.b": gap, "u.a": slow}))
    assert set(bridges) == {"q.a"} and "q.a" in even.notes[-1]
    # after its last sample a channel is held; windows end before that
    np.testing.assert_allclose(even["q.a"][:-1], q[:-1], atol=1e-6)
    assert np.all(np.isnan(even["q.b"]) == np.isnan(gap)) and np.all(np.isnan(even["u.a"]) == np.isnan(slow))
    assert abs(bridges["q.a"][:, 1::2]).sum() == 0.0
