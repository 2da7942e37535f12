"""The section of a report's page on the next experiment, replaced once `cafim discriminate` has designed it."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from drake_cafim.report import wording

TEMPLATE = "next_experiment.html.j2"
BEGIN, END = "<!-- next experiment -->", "<!-- end of next experiment -->"


def next_experiment(found: Mapping[str, Any] | None, command: str = "") -> str:
    """The section as HTML; where `found` is None, the `command` that designs the experiment, if it is not empty."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template(TEMPLATE).render(found=found, command=command, wording=wording)
    return f"{BEGIN}\n{text}\n{END}"


def with_next_experiment(page: str, found: Mapping[str, Any]) -> str:
    """The page of a report with its section on the next experiment replaced by that of `found`."""
    return re.sub(f"{BEGIN}.*?{END}", lambda _: next_experiment(found), page, count=1, flags=re.DOTALL)
