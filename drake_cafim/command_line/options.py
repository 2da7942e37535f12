"""Options that several commands take."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from drake_cafim.errors import InputError

Command = TypeVar("Command", bound=Callable[..., Any])
SCHEDULED = ("diagnose", "study")


class Finite(click.FloatRange):
    """A number that is neither NaN nor infinite, which `float` and `click.FloatRange` take."""

    name = "float"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number; click's usage error otherwise."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is no finite number.", param, ctx)
        return number


def _package_folders(context: click.Context, option: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    from drake_cafim.description.packages import package_folders

    return package_folders(value)


package_option = click.option(
    "--package", "packages", multiple=True, callback=_package_folders,
    help="NAME=DIR: where package://NAME/... of a model leads; repeatable.",
)  # fmt: skip


def _check_scheduler(context: click.Context, option: click.Parameter, value: str | None) -> str | None:
    """Raises `InputError` where the command is a single task, since no option without an effect is accepted."""
    if value is not None and context.info_name not in SCHEDULED:
        raise InputError(
            f"--scheduler {value}: {context.info_name} is a single task; a cluster takes diagnose --fleet and study"
        )
    return value


def _check_jobs(context: click.Context, option: click.Parameter, value: int) -> int:
    if value == 0:
        raise InputError("--jobs 0: expected a number of processes, or -1 for one per core")
    return value


def parse_share(context: click.Context, option: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """(i, N) of `--shard i/N`, 1 ≤ i ≤ N. Raises `InputError`."""
    if value is None:
        return None
    number, _, of = value.partition("/")
    if not (number.isdecimal() and of.isdecimal() and len(value) < 16 and 1 <= int(number) <= int(of)):
        raise InputError(f"--shard {value}: expected i/N with 1 <= i <= N, as 3/16")
    return int(number), int(of)


def common(function: Command) -> Command:
    """The options that every command takes."""
    options = [
        click.option(
            "--out", type=click.Path(path_type=Path), help="Where to write; by default cafim-out/<command>-<n>."
        ),
        click.option(
            "--seed",
            type=click.IntRange(0, 2**32 - 1),
            default=0,
            show_default=True,
            help="Of all random numbers; the same seed gives the same bytes.",
        ),
        click.option("--json", "as_json", is_flag=True, help="Print the result as JSON."),
        click.option(
            "--jobs",
            type=int,
            default=-1,
            show_default=True,
            callback=_check_jobs,
            help="Processes; -1: one per core.",
        ),
        click.option(
            "--scheduler",
            metavar="ADDRESS",
            callback=_check_scheduler,
            help="Of a Dask cluster, as tcp://10.0.0.1:8786, for diagnose --fleet and study.",
        ),
        click.option("--resume", is_flag=True, help="Continue an interrupted run in --out."),
        click.option("--overwrite", is_flag=True, help="Write into a folder that is not empty."),
    ]
    for option in reversed(options):
        function = option(function)
    return function
