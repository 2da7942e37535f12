"""report.html: the verdict as one page that needs no network."""

from collections.abc import Sequence
from pathlib import Path

from drake_cafim.diagnosis.search import Outcome
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording


def write_report_page(
    path: Path, verdict: Verdict, outcome: Outcome, held_out: Sequence[Recording], command: Sequence[str]
) -> None:
    """Write the page to `path`."""
    write_text(path, f"<!doctype html><title>Diagnosis</title><p>{verdict}</p>")
