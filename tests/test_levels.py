"""The levels of the tests of a diagnosis: each does one thing, both are options, and what is no level is refused."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from drake_cafim import InputError
from drake_cafim.cli import main
from drake_cafim.commands import diagnose as command
from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction
from tests.test_degenerate_recordings import folder as _folder

folder = _folder
NO_LEVEL = ["0", "1", "-0.01", "2", "nan", "inf"]


class _TwoRows:
    """A recording of 500 windows, two rows each."""

    rows = 1000
    realised_noise = None
    runs = (SimpleNamespace(name="run", rows=1000, shape=(500, 2), time=np.arange(500.0)),)
    pictures = SimpleNamespace(row_labels=("j1: q against v", "j1: forces"))

    def hypotheses(self) -> tuple[Effect, ...]:
        return ()

    def residual(self, model: Model) -> np.ndarray:
        """The rows without effects, five times those that the effect leaves."""
        assert not model.effects
        return 5.0 * 1.07 * np.random.default_rng(2).normal(size=1000)


@pytest.fixture
def outcome(monkeypatch: pytest.MonkeyPatch) -> Outcome:
    """A friction that leaves noise of which the test of fit has a p-value well within 0 and 1; its size is known."""
    monkeypatch.setattr(judgement, "descend", lambda problem, found, laws: (found, []))
    friction = JointCoulombFriction("j1", {"torque": 1.0})
    rows, problem = 1.07 * np.random.default_rng(2).normal(size=1000), _as_any(_TwoRows())
    nominal = Fit(Model(np.zeros(0)), 5.0 * rows, np.zeros((1000, 0)), np.zeros((0, 0)), 1000)
    best = Fit(Model(np.zeros(0), (friction,)), rows, np.zeros((1000, 1)), np.eye(1), 1000)
    return Outcome(problem, problem, nominal, best, (best,), 10, (), 1e-6, {friction.key: 1.0})


def _as_any(problem: Any) -> Any:
    return problem


def _kind(outcome: Outcome, settings: Settings) -> str:
    return judgement._of_search(outcome, settings, Trace()).kind


def test_the_adequacy_level_alone_decides_whether_what_remains_is_noise(outcome: Outcome) -> None:
    p = adequacy(outcome.problem, outcome.best.residual, 1).p_value
    assert 0.02 < p < 0.98
    for rate in (1e-5, 0.01, 0.99):
        assert _kind(outcome, Settings(false_alarm_rate=rate, adequacy_level=0.9 * p)) == "explained"
        assert _kind(outcome, Settings(false_alarm_rate=rate, adequacy_level=1.01 * p)) == "unexplained"


def test_the_false_alarm_rate_alone_decides_whether_anything_is_missing(outcome: Outcome) -> None:
    for level in (1e-9, 0.01):
        assert _kind(outcome, Settings(false_alarm_rate=1.1e-6, adequacy_level=level)) == "explained"
        assert _kind(outcome, Settings(false_alarm_rate=0.9e-6, adequacy_level=level)) == "none"


def test_the_trace_says_which_level_was_used(outcome: Outcome) -> None:
    trace = Trace()
    judgement._of_search(outcome, Settings(false_alarm_rate=0.2, adequacy_level=0.003), trace)
    assert next(record.threshold for record in trace.records if record.step == "adequacy") == 0.003


@pytest.mark.parametrize("value", NO_LEVEL)
@pytest.mark.parametrize("option", ["--false-alarm-rate", "--adequacy-level"])
def test_what_is_no_level_is_refused_before_anything_is_read(option: str, value: str, folder: Path) -> None:
    asked = ["diagnose", "s.yaml", "--recording", "a.csv", option, value, "--out", "out"]
    result = CliRunner().invoke(main, asked, catch_exceptions=False)
    assert result.exit_code == 2 and "expected a number above 0 and below 1" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1 and not (folder / "out").exists()


@pytest.mark.parametrize("wrong", [{"most_effects": -1}, {"beam": 0}, {"refined": 0}])
def test_a_search_for_less_than_nothing_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(InputError, match="expected integers of at least 0, 1 and 1"):
        Settings(**wrong)  # type: ignore[arg-type]


def test_the_command_passes_both_on_and_a_finished_diagnosis_knows_them(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[Settings] = []
    examine = command.examine

    def watched(*arguments: Any, settings: Settings, **more: Any) -> Any:
        used.append(settings)
        return examine(*arguments, settings=settings, **more)

    monkeypatch.setattr(command, "examine", watched)
    asked = ["diagnose", "s.yaml", "--recording", "a.csv", "--no-replay", "--out", "out"]
    levels = ["--false-alarm-rate", "0.05", "--adequacy-level", "0.001"]
    assert CliRunner().invoke(main, [*asked, *levels], catch_exceptions=False).exit_code == 0
    assert (used[0].false_alarm_rate, used[0].adequacy_level) == (0.05, 0.001)
    made_by = json.loads((folder / "out" / "diagnosis.json").read_text())["command"]
    assert made_by[-2:] == ["--false-alarm-rate=0.05", "--adequacy-level=0.001"]
    other = CliRunner().invoke(main, [*asked, "--resume"], catch_exceptions=False)
    assert other.exit_code == 2 and "expected the same command" in other.stderr
    assert CliRunner().invoke(main, [*asked, *levels, "--resume"], catch_exceptions=False).exit_code == 0
    (folder / "fleet" / "a").mkdir(parents=True)
    (folder / "a.csv").rename(folder / "fleet" / "a" / "a.csv")
    fleet = ["diagnose", "s.yaml", "--fleet", "fleet", "--jobs", "1", "--out", "fleet_out", *levels]
    assert CliRunner().invoke(main, fleet, catch_exceptions=False).exit_code == 0
    # processes change no result
    assert len(used) == 2 and used[1] == replace(used[0], jobs=1)
