"""A load on an arm's flange: as an unknown payload it fits; as the last link's numbers it cannot, and that is said."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from drake_cafim import recordings
from drake_cafim.cli import main
from drake_cafim.diagnosis.diagnose import Estimate, estimate
from tests import loaded_arm
from tests.loaded_arm import ARM, NOISE, beyond_flange
from tests.parametrize import long_after

DISTANCES = (0.05, 0.1, 0.15, 0.2, 0.3)
SHORT = 1.2
"""s, for the recordings of the tests that run always."""


def of_load(distance: float, unknown: list[dict[str, object]], seed: int, duration: float) -> Estimate:
    return estimate(loaded_arm.scene(unknown), [loaded_arm.recording(beyond_flange(distance), 1.0, seed, duration)])


def check_payload(found: Estimate, distance: float) -> None:
    """The fit is accepted, and mass and place are within three standard deviations, which are small."""
    assert found.goodness_of_fit.accepted and not found.goodness_of_fit.locations
    assert str(found).startswith("Goodness of fit: the model fits")
    for parameter, truth, most in zip(
        found.parameters, [1.0, *beyond_flange(distance)], [5e-3, 2e-3, 2e-3, 2e-3], strict=True
    ):
        assert (
            parameter.effect == "payload"
            and abs(parameter.value - truth) < 3.0 * parameter.std
            and parameter.std < most
        ), parameter


def check_refused(found: Estimate) -> None:
    """The fit is refused at once, and where it fails is said; no number is known less well than beforehand."""
    fit = found.goodness_of_fit
    assert not fit.accepted and fit.reduced_chi_square > 1.3 and fit.p_value < 1e-6
    text = str(found)
    assert text.startswith("Goodness of fit: WARNING, the model does not fit (reduced χ²")
    assert {location.kind for location in fit.locations} <= {"joint", "sensor"} and fit.locations[0].name in text
    assert all(0.0 < parameter.std <= parameter.prior_std * (1.0 + 1e-9) for parameter in found.parameters)


@pytest.mark.parametrize("distance", long_after(2, DISTANCES))
def test_a_payload_is_found_where_it_is(distance: float) -> None:
    check_payload(of_load(distance, loaded_arm.payload(), 2, SHORT), distance)


@pytest.mark.parametrize("distance", long_after(2, DISTANCES))
def test_a_link_s_own_numbers_cannot_express_it_and_that_is_said(distance: float) -> None:
    check_refused(of_load(distance, loaded_arm.link(mass=0.1), 2, SHORT))


@pytest.mark.long
def test_the_command_says_so_first_and_in_its_report(tmp_path: Path) -> None:
    """The exit status is 0: that a model does not fit is a finding."""
    recordings.write(loaded_arm.recording(beyond_flange(0.3), 1.0, 2, SHORT), tmp_path / "run.parquet")
    reports = {}
    for name, unknown in (("payload", loaded_arm.payload()), ("link", loaded_arm.link(mass=0.1))):
        content = {"model": str(ARM), "weld": [{"body": "link0"}], "unknown": unknown}
        content |= {"channels": {kind: {"std": std} for kind, std in NOISE.items()}}
        (tmp_path / f"{name}.yaml").write_text(json.dumps(content))
        out = tmp_path / name
        command = ["estimate", str(tmp_path / f"{name}.yaml"), str(tmp_path / "run.parquet"), "--out", str(out)]
        result = CliRunner().invoke(main, command)
        assert result.exit_code == 0, result.output
        assert result.stdout.startswith("Goodness of fit: ")
        reports[name] = json.loads((out / "report.json").read_text())
        assert reports[name]["sentence"] in result.stdout and reports[name]["verdict"] is None
    good, bad = reports["payload"], reports["link"]
    assert good["goodness_of_fit"]["accepted"] and not good["mismatch"]["detected"]
    assert good["mismatch"]["locations"] == [] and good["goodness_of_fit"]["reduced_chi_square"] < 1.2
    assert not bad["goodness_of_fit"]["accepted"] and bad["mismatch"]["detected"]
    assert bad["mismatch"]["locations"][0]["name"] in bad["sentence"].splitlines()[0]
    assert bad["mismatch"]["locations"][0]["recording"].endswith("run.parquet")
    assert all(np.isfinite(parameter["std"]) for parameter in bad["parameters"])


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("distance", DISTANCES)
def test_over_four_seconds_whatever_the_noise(distance: float, seed: int) -> None:
    check_payload(of_load(distance, loaded_arm.payload(), seed, 4.0), distance)
    check_refused(of_load(distance, loaded_arm.link(mass=0.1), seed, 4.0))
    check_refused(of_load(distance, loaded_arm.link(mass=1.0), seed, 4.0))
