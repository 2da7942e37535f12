"""The command line `cafim`: parses arguments, calls a function of `commands`, and prints its summary or JSON."""

import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import click
from click.exceptions import NoArgsIsHelpError
from tqdm import tqdm

from drake_cafim.errors import InputError, one_line
from drake_cafim.output import alone_in, describe_error, prepare_folder

Command = TypeVar("Command", bound=Callable[..., Any])

FOLDER = "drake_cafim.folder"
"""Key of click's context for the folder that the command writes to."""
RESUMABLE = ("run", "diagnose", "discriminate", "study")


def _package_folders(context: click.Context, option: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    from drake_cafim.description.packages import package_folders

    return package_folders(value)


package_option = click.option(
    "--package", "packages", multiple=True, callback=_package_folders,
    help="NAME=DIR: where package://NAME/... of a model leads; repeatable.",
)  # fmt: skip


INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


class Cafim(click.Group):
    """A group whose commands end with status 2 and one sentence where the input, or the system, cannot be used."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (InputError, click.UsageError, OSError, MemoryError) as error:
            if isinstance(error, NoArgsIsHelpError) or _is_closed_pipe(error):
                raise
            click.echo(f"cafim: {_sentence(error)}", err=True)
            ctx.exit(2)
        except KeyboardInterrupt:
            click.echo(f"cafim: interrupted{_way_on(ctx)}", err=True)
            ctx.exit(INTERRUPTED)

    def make_context(self, *arguments: Any, **more: Any) -> click.Context:
        """The context of the whole command line; an unknown option or command is told in one line."""
        try:
            return super().make_context(*arguments, **more)
        except click.UsageError as error:
            if isinstance(error, NoArgsIsHelpError):
                raise
            click.echo(f"cafim: {_sentence(error)}", err=True)
            raise click.exceptions.Exit(2) from None


def _sentence(error: Exception) -> str:
    """The error in one line: a wrong argument with the command that lists the right ones, or what the system says."""
    if isinstance(error, click.UsageError):
        command = error.ctx.command_path.rpartition("cafim")[2].strip() if error.ctx else ""
        return one_line(f"{error.format_message()}  See `{' '.join(filter(None, ('cafim', command, '--help')))}`.")
    if isinstance(error, OSError):
        where = error.filename or "the working folder, or the one for temporary files"
        return one_line(f"{where}: {describe_error(error)}")
    if isinstance(error, MemoryError):
        return one_line(f"there is not enough memory for this input ({error or 'the system refused more'})")
    return one_line(str(error))


def _is_closed_pipe(error: BaseException) -> bool:
    """Whether the reader of our output has gone, as in `cafim study ... | head`; click ends quietly then."""
    return isinstance(error, BrokenPipeError)


def _way_on(ctx: click.Context) -> str:
    """What is kept after Ctrl-C and how to go on, as the end of a sentence."""
    folder = ctx.meta.get(FOLDER)
    if folder is None or not folder.is_dir() or not any(folder.iterdir()):
        return "; nothing was written"
    if ctx.invoked_subcommand in RESUMABLE:
        return f"; what was finished is in {folder}, the same command with --out {folder} --resume goes on from there"
    return f"; what was finished is in {folder}"


@click.group(cls=Cafim, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="drake_cafim")
def main() -> None:
    """A robot that touches things learns what they are made of, and names the physics its model left out."""


def _refuse_scheduler(context: click.Context, option: click.Parameter, value: str | None) -> None:
    """Raises `InputError`: a cluster cannot be used yet, and an option that has no effect must not be accepted."""
    if value is not None:
        raise InputError(f"--scheduler {value}: not supported by this version; --jobs spreads the work over processes")


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
        click.option("--jobs", type=int, default=-1, show_default=True, help="Processes; -1: one per core."),
        click.option(
            "--scheduler",
            callback=_refuse_scheduler,
            expose_value=False,
            help="A Dask cluster; not supported by this version.",
        ),
        click.option("--resume", is_flag=True, help="Continue an interrupted run in --out."),
        click.option("--overwrite", is_flag=True, help="Write into a folder that is not empty."),
    ]
    for option in reversed(options):
        function = option(function)
    return function


@main.command()
@click.argument("scenario")
@click.option(
    "--world", default="drake", show_default=True, help="Contact: drake (hydroelastic) or model (the planner's)."
)
@click.option("--experiments", type=int, help="How many; by default the scenario's number.")
@click.option("--until-std", type=float, help="Stop when every std is below this fraction of its estimate.")
@click.option(
    "--policy", default="contact-aware", show_default=True, help="Or finite-difference, asid, random, scripted, hold."
)
@click.option("--planner", default="predictive-sampling", show_default=True, help="Or cem, mppi, gradient.")
@click.option(
    "--criterion", default="logdet", show_default=True, help="Or trace, scaled_trace, a_optimal, min_eigenvalue."
)
@click.option(
    "--belief-samples",
    type=int,
    default=1,
    show_default=True,
    help="Points of the belief over which a plan's score is averaged.",
)
@click.option(
    "--force-guard/--no-force-guard",
    default=None,
    help="Reduce commands so that forces stay within the limit.  [default: contact-aware, where there is a limit]",
)
@click.option("--fisher", default="tangent", show_default=True, help="Or autodiff, finite-difference.")
@click.option(
    "--estimator", default="shooting", show_default=True, help="Or joint: parameters and forces in one program."
)
@click.option("--as-printed", is_flag=True, help="The paper's own choices, where they can be made.")
@click.option(
    "--place-std",
    type=float,
    default=0.0,
    show_default=True,
    help="How far the contact may be from where it is planned, m, learned beside the unknowns.",
)
@click.option(
    "--law",
    help="Contact law of the planner: kelvin_voigt, hunt_crossley, hydroelastic, paper, or all, between which the "
    "measurements decide.  [default: all in world drake, else the scenario's]",
)
@click.option(
    "--prior-scale", type=float, default=1.3, show_default=True, help="The prior's mean as a multiple of the truth."
)
@click.option(
    "--conceal",
    multiple=True,
    help="EFFECT@PLACE parameter=value ...: an effect of the world that the planner's model lacks; repeatable.",
)
@common
def run(
    scenario: str,
    world: Any,
    prior_scale: float,
    law: str | None,
    place_std: float,
    as_printed: bool,
    conceal: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    resume: bool,
    overwrite: bool,
    **chosen: Any,
) -> None:
    """Plan motions that touch, carry them out, and learn the scenario's unknowns."""
    from drake_cafim.commands.run import RunRequest, check_request, parse_concealed, run_command, table
    from drake_cafim.experiment.closed_loop import Options

    options = Options(**{name: value for name, value in chosen.items() if name != "jobs"})
    request = RunRequest(scenario, world, options, prior_scale, parse_concealed(conceal), as_printed, place_std, law)
    check_request(request)
    folder = _folder(out, "run", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        record = run_command(request, folder, progress, resume=resume)
    _print(record, as_json, f"{table(record)}\n{folder / 'replay.html'}")


@main.command()
@click.argument("scenario")
@click.option("--recording", "recordings", multiple=True, help="Recordings to diagnose; repeat, or list after one.")
@click.option("--held-out", multiple=True, help="Recordings that test the explanation; nothing is fitted to them.")
@click.option(
    "--fleet",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="A folder of folders with recordings: one report for each of them.",
)
@click.option("--replay/--no-replay", default=True, help="Draw replay.html, which takes some seconds.")
@click.option("--mcap", is_flag=True, help="Write each recording as MCAP too, with its residuals as channels.")
@package_option
@common
def diagnose(
    scenario: str,
    recordings: tuple[str, ...],
    held_out: tuple[str, ...],
    fleet: Path | None,
    replay: bool,
    mcap: bool,
    packages: dict[str, str],
    out: Path | None,
    as_json: bool,
    jobs: int,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Say what physics a model lacks, where, and how sure that is."""
    from drake_cafim.commands.diagnose import diagnose_command, diagnose_fleet

    if fleet is not None:
        reports = diagnose_fleet(scenario, fleet, out, jobs, resume=resume, overwrite=overwrite, packages=packages)
        _print(reports, as_json, "\n".join(report["sentence"] for report in reports))
        return
    if not recordings:
        raise InputError("diagnose: no --recording was given, expected at least one file")
    folder = _folder(out, "diagnose", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        report = diagnose_command(
            scenario,
            recordings,
            held_out,
            folder,
            progress,
            replay=replay,
            mcap=mcap,
            packages=packages,
            resume=resume,
        )
    _print(report, as_json, f"{report['sentence']}\n{folder / 'report.html'}")


@main.command()
@click.argument("scenario")
@click.argument("report", required=False, type=click.Path(path_type=Path, exists=True))
@click.option("--between", multiple=True, help="EFFECT@PLACE EFFECT@PLACE: two explanations of your own.")
@click.option("--duration", type=float, default=2.0, show_default=True, help="Duration of the motion, s.")
@click.option(
    "--criterion", default="odds", show_default=True, help="odds: those at its end; time: until they are 20:1."
)
@click.option("--planner", default="predictive-sampling", show_default=True, help="Or cem, mppi, gradient.")
@click.option("--replay/--no-replay", default=True, help="Draw replay.html, which takes some seconds.")
@package_option
@common
def discriminate(
    scenario: str,
    report: Path | None,
    between: tuple[str, ...],
    duration: float,
    criterion: str,
    planner: Any,
    replay: bool,
    packages: dict[str, str],
    seed: int,
    out: Path | None,
    as_json: bool,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Design the motion that tells rival explanations apart, and try it in simulation."""
    from drake_cafim.commands.discriminate import DiscriminateRequest, discriminate_command, in_words

    request = DiscriminateRequest(
        scenario, report, between, duration, criterion, planner, seed, replay, tuple(packages.items())
    )
    request.check()
    folder = _folder(out, "discriminate", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        result = discriminate_command(request, folder, progress, resume=resume)
    _print(result, as_json, f"{in_words(result)}\n{folder / result['next_experiment']['file']}")


@main.command()
@click.argument("report", type=click.Path(path_type=Path))
@click.argument("effect", required=False, metavar="[EFFECT@PLACE]")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def why(report: Path, effect: str | None, as_json: bool) -> None:
    """Say why an effect was named in a report, or was not.

    REPORT is a report.json, or the folder it is in. Without an effect: why each that is named, why not the first
    refused ones, why no further one, and what is left.
    """
    from drake_cafim.commands.why import in_words, why_command

    answer = why_command(report, effect)
    _print(answer, as_json, in_words(answer))


@main.command()
@click.argument("scenario")
@click.argument("recordings", nargs=-1, required=True)
@package_option
@common
def estimate(
    scenario: str,
    recordings: tuple[str, ...],
    packages: dict[str, str],
    out: Path | None,
    as_json: bool,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Estimate the scenario's unknown parameters from recordings."""
    from drake_cafim.commands.estimate import estimate_command

    folder = _folder(out, "estimate", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        report = estimate_command(scenario, recordings, folder, progress, packages)
    _print(report, as_json, f"{report['sentence']}\n{folder / 'report.json'}")


@main.command()
@click.argument("name")
@click.option("--short", is_flag=True, help="A few seeds only, to see that it works.")
@click.option("--seeds", type=click.IntRange(min=1), help="At most so many seeds of each kind of run.")
@common
def study(
    name: str,
    short: bool,
    seeds: int | None,
    out: Path | None,
    as_json: bool,
    jobs: int,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Repeat a study of many runs: figures and tables beside the paper's claims."""
    from drake_cafim.commands.study import find_study, study_command

    find_study(name)
    folder = _folder(out, f"study-{name}", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        record, text = study_command(name, folder, jobs, progress, short=short, seeds=seeds)
    _print(record, as_json, f"{text}\n\n{folder / 'study.html'}")


@main.command(name="import")
@click.argument("files", nargs=-1, required=True)
@click.option("--scenario", help="A scenario file whose section topics: maps foreign names to columns.")
@click.option("--period", type=float, help="Resample to this many seconds; left out, samples stay as they were taken.")
@common
def import_(
    files: tuple[str, ...],
    scenario: str | None,
    period: float | None,
    out: Path | None,
    as_json: bool,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Show what bags, logs and tables hold, and write them as Parquet.

    The way out again: `cafim diagnose --mcap`, or `cafim replay --out NAME.mcap`.
    """
    from drake_cafim.commands.importing import import_command

    folder = _folder(out, "import", resume=resume, overwrite=overwrite)
    found = import_command(files, folder, scenario=scenario, period=period)
    _print(found, as_json, "\n".join(file["text"] for file in found))


@main.command()
@click.argument("scenario")
@click.argument("recording")
@click.option("--report", type=click.Path(path_type=Path, exists=True), help="A report.json, or the folder it is in.")
@click.option("--live", is_flag=True, help="Show it in Meshcat at localhost too, until Ctrl-C.")
@package_option
@common
def replay(
    scenario: str,
    recording: str,
    report: Path | None,
    live: bool,
    packages: dict[str, str],
    out: Path | None,
    as_json: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Show a recording beside simulations of it by the model and by the corrected model.

    --out names a page, .html, or an .mcap: the recording with the residuals of each model as channels, for Foxglove
    or PlotJuggler.
    """
    from drake_cafim.commands.replay import replay_command
    from drake_cafim.report.replay import make_meshcat

    path = out or _folder(None, "replay", resume=False, overwrite=False) / "replay.html"
    if path.exists() and not overwrite:
        raise InputError(f"--out {path}: the file is there already; give --overwrite or another name")
    meshcat = make_meshcat() if live else None
    with progress_line() as progress:
        progress("simulating and drawing")
        result = replay_command(scenario, recording, report, path, meshcat, packages)
    _print(result, as_json, str(path))
    if meshcat is not None:
        # Ctrl-C may arrive while the address is printed
        with suppress(KeyboardInterrupt):
            click.echo(f"{meshcat.web_url()}  pause and speed: Open Controls, Animations; Ctrl-C ends it", err=True)
            threading.Event().wait()


def _folder(out: Path | None, command: str, *, resume: bool, overwrite: bool) -> Path:
    """The folder that a command alone writes to; it is removed at the end if nothing was written into it."""
    folder = prepare_folder(out, command, resume=resume, overwrite=overwrite)

    def leave_nothing_empty() -> None:
        with suppress(OSError):  # not empty
            folder.rmdir()

    context = click.get_current_context()
    context.call_on_close(leave_nothing_empty)
    context.with_resource(alone_in(folder))
    context.meta[FOLDER] = folder
    return folder


@contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """A function that shows progress on stderr: one line that changes, or a line per stage where it is no terminal."""
    if not sys.stderr.isatty():
        yield lambda text: click.echo(f"cafim: {text} ...", err=True)
        return
    with tqdm(bar_format="{elapsed} {desc}", file=sys.stderr, leave=False) as bar:
        yield bar.set_description_str


def _print(result: Any, as_json: bool, text: str) -> None:
    click.echo(json.dumps(result, indent=1, ensure_ascii=False) if as_json else text)


def spread_values(arguments: list[str], options: tuple[str, ...]) -> list[str]:
    """The arguments with `--recording A B C` as `--recording A --recording B --recording C`, the form click reads."""
    result: list[str] = []
    current: str | None = None
    for argument in arguments:
        if argument in options:
            current = argument
        elif argument.startswith("-") or (current == "--conceal" and "=" not in argument and "@" not in argument):
            current = None
            result.append(argument)
        elif current is not None:
            result += [current, argument]
        else:
            result.append(argument)
    return result


def run_cli() -> None:
    """The entry point of the console script `cafim`."""
    main(args=spread_values(sys.argv[1:], ("--recording", "--held-out", "--between", "--conceal")))
