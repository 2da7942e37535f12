"""`cafim study`: repeats a study of many runs, resumably, and writes its findings as one page and as JSON."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.studies.catalogue import STUDIES, Study
from drake_cafim.studies.page import as_text, render
from drake_cafim.studies.sweep import limit_seeds, sweep


def find_study(name: str) -> Study:
    """The study called `name`; `InputError` lists the valid ones."""
    if name not in STUDIES:
        raise InputError(f"{name}: there is no such study, expected one of {', '.join(STUDIES)}")
    return STUDIES[name]


def study_command(
    name: str,
    out: Path,
    jobs: int,
    progress: Callable[[str], None],
    *,
    short: bool = False,
    seeds: int | None = None,
    scheduler: str | None = None,
) -> tuple[dict[str, Any], str]:
    """The findings as JSON and as text; `out` gets study.html, study.json and a file a run under runs/.

    Runs whose file is there are not run again; with a Dask `scheduler` its workers run them, in the same folder.
    With `seeds`, no more than so many of runs that differ in the seed
    alone. Raises `InputError` for a study that there is not.
    """
    study = find_study(name)
    cells = study.cells(short) if seeds is None else limit_seeds(study.cells(short), seeds)
    results = sweep(cells, out / "runs", jobs, progress, scheduler)
    findings = study.conclude(results)
    command = f"cafim study {name}{' --short' if short else ''}{'' if seeds is None else f' --seeds {seeds}'}"
    record = {"schema": "drake_cafim.study/1", "study": name, "short": short, "seeds": seeds, **asdict(findings)}
    del record["figures"]  # they are on the page
    write_text(out / "study.html", render(findings, command))
    write_text(out / "study.json", json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    return record, as_text(findings)
