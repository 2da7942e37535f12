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
