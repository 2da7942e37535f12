"""The README's scripts run as they stand, its links and those of the other pages lead somewhere, its targets exist."""

import re
from pathlib import Path
from typing import Any

import pytest
from pydrake.systems.analysis import Simulator

import drake_cafim
from tests import two_links

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "diagrams").rglob("*.md"))]
RUBBING = (0.3, 0.2)
"""N m, Coulomb friction of shoulder and elbow."""


def _scripts() -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL | re.M)


def _write(name: str, seed: int, friction: tuple[float, float] = RUBBING) -> None:
    recording = two_links.recording(name, seed, friction=friction, noise=(2e-4, 1e-3, 0.0))
    drake_cafim.write(recording, name)


def test_the_scripts_run_as_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(two_links.MODEL)
    # within the joints' limits with these seeds
    for seed, name in ((3, "run_1.parquet"), (7, "run_2.mcap"), (8, "run_3.csv")):
        _write(name, seed)
    names: dict[str, Any] = {}
    diagnosed, built, tested = _scripts()
    exec(diagnosed, names)
    verdict = names["verdict"]
    assert {accepted.effect.at for accepted in verdict.explanation} == {"shoulder", "elbow"}
    assert str(verdict) in capsys.readouterr().out
    exec(built, names)
    Simulator(names["diagram"]).AdvanceTo(0.05)
    channels = "channels: {q: {std: 2.0e-4}, v: {std: 1.0e-3}, u: {std: 0.0}}"
    (tmp_path / "arm.yaml").write_text(f"model: arm.urdf\nweld: [{{body: base}}]\n{channels}\n")
    exec(tested, names)
    _write("last_night.mcap", 18)
    with pytest.raises(AssertionError, match="friction"):
        names["test_the_arm_is_as_its_model_says"]()
    _write("last_night.mcap", 15, (0.0, 0.0))
    names["test_the_arm_is_as_its_model_says"]()


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_links_lead_somewhere(page: Path) -> None:
    for address in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in address:
            continue
        file, _, heading = address.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), address
        if heading:
            lines = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
            assert heading in {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}, address


def test_targets_exist() -> None:
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for page in PAGES:
        named = set(re.findall(r"`make ([a-z-]+)", page.read_text(encoding="utf-8")))
        assert named <= targets, f"{page}: {named - targets}"
