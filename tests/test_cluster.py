"""Tasks on processes and on a real Dask cluster: nothing is lost, nothing told twice, and the rest is done."""

import subprocess
import sys

import pytest

from drake_cafim.errors import InputError
from drake_cafim.parallel.cluster import on_cluster
from drake_cafim.parallel.task import Task, carry_out
from tests.fleets import faults
from tests.fleets.faulty import cannot_write, die
from tests.parametrize import long_after


@pytest.mark.parametrize("name", long_after(1, sorted(faults.CASES)))
def test_what_fails_costs_its_own_task_alone(name: str) -> None:
    found = faults.CASES[name]()
    assert (found.lost, found.twice, found.half) == (0, 0, 0)
    words = {
        "a result cannot be written": {7: "No such file or directory"},
        "a task dies every time": {7: "its process died in each of 4 attempts"},
        "a task dies every time, on processes": {7: "its process died in each of 3", 9: "No such file"},
    }.get(name, {})
    assert set(found.failures) == set(words)
    assert all(words[index] in failure for index, failure in found.failures.items())


def test_a_scheduler_that_is_not_there_is_said() -> None:
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        list(on_cluster([Task("one", die, ())], "tcp://127.0.0.1:9", patience=0.5))


def test_dask_is_only_asked_for_where_it_is_used() -> None:
    line = "import sys, drake_cafim.parallel.distribute; assert 'distributed' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", line], check=False).returncode == 0


def test_an_exception_is_a_failure_of_the_task(tmp_path: object) -> None:
    def refuse() -> None:
        raise InputError("x.csv: it is no table")

    def break_down() -> None:
        raise KeyError("elbow")

    assert carry_out(3, Task("t", refuse, ())).failure == "x.csv: it is no table"
    broken = carry_out(3, Task("t", break_down, ()))
    assert broken.defect and broken.failure == "t: KeyError: 'elbow'"
    assert not carry_out(3, Task("t", cannot_write, (tmp_path, 1))).defect
