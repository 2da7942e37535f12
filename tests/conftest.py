"""Where recorded data are, for the tests that need them."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder that `DRAKE_CAFIM_DATA` names; without it the test is skipped and says so."""
    place = os.environ.get("DRAKE_CAFIM_DATA")
    if not place:
        pytest.skip("DRAKE_CAFIM_DATA names no folder with practice cases and real recordings")
    return Path(place)


KNOWN_FAILURES = Path(__file__).with_name("known_failures.txt")
"""Tests that fail at present: a line each, address and why, with a tab between. They run and are reported."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests of `KNOWN_FAILURES` as expected to fail, with their reasons."""
    lines = [line for line in KNOWN_FAILURES.read_text().splitlines() if line and not line.startswith("#")]
    reasons = dict(line.split("\t", 1) for line in lines)
    for item in items:
        if item.nodeid in reasons:
            item.add_marker(pytest.mark.xfail(reason=reasons[item.nodeid]))
