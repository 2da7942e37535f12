"""The command line `cafim`: parses arguments, calls a function of `commands`, and prints its summary or JSON."""

import atexit
import gc
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from drake_cafim.command_line.arguments import spread_values
from drake_cafim.command_line.fleet import FleetArguments, diagnose_as_fleet
from drake_cafim.command_line.group import Cafim
from drake_cafim.command_line.options import Finite, common, package_option, parse_share
from drake_cafim.command_line.output import open_folder, print_result, progress_line
from drake_cafim.command_line.run import run
from drake_cafim.errors import InputError
from drake_cafim.interruption import status_of, watch_for_interruptions


@click.group(cls=Cafim, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="drake_cafim")
def main() -> None:
    """A robot that touches things learns what they are made of, and names the physics its model left out."""


main.add_command(run)


@main.command()
@click.argument("scenario", required=False)
@click.option("--recording", "recordings", multiple=True, help="Recordings to diagnose; repeat, or list after one.")
@click.option(
    "--held-out",
    multiple=True,
    help="Recordings that test the explanation; nothing is fitted to them. With --fleet a pattern, as 'held_*'.",
)
@click.option(
    "--fleet",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="A folder ROBOT/DATE/FILES: a report for each folder with recordings, one table and one page.",
)
@click.option(
    "--shard", metavar="i/N", callback=parse_share, help="Of --fleet: the i-th of N shares; --resume gathers them."
)
@click.option(
    "--false-alarm-rate",
    type=float,
    help="Probability that noise alone is taken for missing physics.  [default: 0.01]",
)
@click.option(
    "--adequacy-level",
    type=float,
    help="p-value above which what remains counts as noise, so that a verdict is `explained`.  [default: 0.01]",
)
@click.option(
    "--memory",
    type=Finite(min=0.25),
    default=4.0,
    show_default=True,
    help="GiB that recordings may take; longer ones are diagnosed in parts.",
)
@click.option("--cuts", is_flag=True, help="Diagnose the recordings cut in other ways too: what holds in each?")
@click.option("--replay/--no-replay", default=True, help="Draw replay.html, which takes some seconds.")
@click.option("--mcap", is_flag=True, help="Write each recording as MCAP too, with its residuals as channels.")
@package_option
@common
def diagnose(
    scenario: str | None,
    recordings: tuple[str, ...],
    held_out: tuple[str, ...],
    fleet: Path | None,
    shard: tuple[int, int] | None,
    false_alarm_rate: float | None,
    adequacy_level: float | None,
    memory: float,
    cuts: bool,
    replay: bool,
    mcap: bool,
    packages: dict[str, str],
    out: Path | None,
    as_json: bool,
    jobs: int,
    scheduler: str | None,
    seed: int,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Say what physics a model lacks, where, and how sure that is.

    A fleet is a folder ROBOT/DATE/FILES, as arm_07/2026-W12/a.parquet: every folder below it with recordings gets a
    report, the first part of its path is the robot, dates are read from the names by ISO 8601. The nearest
    scenario.yaml above a folder holds for it, or else SCENARIO.
    """
    from drake_cafim.commands.cuts import CutOptions
    from drake_cafim.commands.diagnose import diagnose_command
    from drake_cafim.commands.levels import Levels

    levels = Levels(false_alarm_rate, adequacy_level)
    if fleet is not None:
        if cuts:
            raise InputError("diagnose: --cuts is given beside --fleet, expected --recording: one robot at a time")
        request = FleetArguments(scenario, fleet, shard, recordings, held_out, packages, levels)
        diagnose_as_fleet(request, out, as_json, jobs, scheduler, resume=resume, overwrite=overwrite)
        return
    if scheduler is not None or shard is not None:
        raise InputError(f"--{'shard' if shard else 'scheduler'}: it spreads folders, expected it with --fleet DIR")
    if scenario is None:
        raise InputError("diagnose: no SCENARIO was given, expected a name, a scenario file or a model file")
    if not recordings:
        raise InputError("diagnose: no --recording was given, expected at least one file")
    folder = open_folder(out, "diagnose", resume=resume, overwrite=overwrite)
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
            levels=levels,
            cuts=CutOptions(seed, jobs) if cuts else None,
            memory=memory * 2**30,
            jobs=jobs,
        )
    print_result(report, as_json, f"{report['sentence']}\n{folder / 'report.html'}")


@main.command()
@click.argument("scenario")
@click.argument("report", required=False, type=click.Path(path_type=Path, exists=True))
@click.option("--between", multiple=True, help="EFFECT@PLACE EFFECT@PLACE: two explanations of your own.")
@click.option("--duration", type=Finite(), default=2.0, show_default=True, help="Duration of the motion, s.")
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
    folder = open_folder(out, "discriminate", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        result = discriminate_command(request, folder, progress, resume=resume)
    print_result(result, as_json, f"{in_words(result)}\n{folder / result['next_experiment']['file']}")


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
    print_result(answer, as_json, in_words(answer))


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

    folder = open_folder(out, "estimate", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        report = estimate_command(scenario, recordings, folder, progress, packages)
    print_result(report, as_json, f"{report['sentence']}\n{folder / 'report.json'}")


@main.command()
@click.argument("scenario")
@click.option("--to", "form", required=True, help="The format of its model file: urdf, sdf or mjcf.")
@click.option("--recording", help="A recording whose efforts move the robot in the check; left out, all joints swing.")
@package_option
@common
def export(
    scenario: str,
    form: Any,
    recording: str | None,
    packages: dict[str, str],
    out: Path | None,
    as_json: bool,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Write a scenario's values back into a copy of its model file.

    Masses, inertias, damping, friction, springs, armature, limits and gears, as far as the format has them; what it
    cannot hold is told and stays in scenario.exported.yaml. The copy is then simulated beside the corrected scene.
    """
    from drake_cafim.commands.export import export_command, in_words

    if form not in ("urdf", "sdf", "mjcf"):
        raise InputError(f"--to {form}: expected one of urdf, sdf, mjcf")
    folder = open_folder(out, "export", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        result = export_command(scenario, form, recording, folder, progress, packages)
    print_result(result, as_json, f"{in_words(result)}\n{folder / result['model']}")


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
    scheduler: str | None,
    resume: bool,
    overwrite: bool,
    **_: object,
) -> None:
    """Repeat a study of many runs: figures and tables beside the paper's claims."""
    from drake_cafim.commands.study import find_study, study_command

    find_study(name)
    folder = open_folder(out, f"study-{name}", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        record, text = study_command(name, folder, jobs, progress, short=short, seeds=seeds, scheduler=scheduler)
    print_result(record, as_json, f"{text}\n\n{folder / 'study.html'}")


@main.command(name="import")
@click.argument("files", nargs=-1, required=True)
@click.option("--scenario", help="A scenario file whose section topics: maps foreign names to columns.")
@click.option(
    "--period", type=Finite(), help="Resample to this many seconds; left out, samples stay as they were taken."
)
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

    folder = open_folder(out, "import", resume=resume, overwrite=overwrite)
    found = import_command(files, folder, scenario=scenario, period=period)
    print_result(found, as_json, "\n".join(file["text"] for file in found))


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

    path = out or open_folder(None, "replay", resume=False, overwrite=False) / "replay.html"
    if path.exists() and not overwrite:
        raise InputError(f"--out {path}: the file is there already; give --overwrite or another name")
    meshcat = make_meshcat() if live else None
    with progress_line() as progress:
        progress("simulating and drawing")
        result = replay_command(scenario, recording, report, path, meshcat, packages)
    print_result(result, as_json, str(path))
    if meshcat is not None:
        # Ctrl-C may arrive while the address is printed
        with suppress(KeyboardInterrupt):
            click.echo(f"{meshcat.web_url()}  pause and speed: Open Controls, Animations; Ctrl-C ends it", err=True)
            threading.Event().wait()


def run_cli() -> None:
    """The entry point of the console script `cafim`."""
    # at its end the interpreter would search all objects for cycles, half a second after a diagnosis
    atexit.register(gc.freeze)
    watch_for_interruptions()
    words = spread_values(sys.argv[1:], ("--recording", "--held-out", "--between", "--conceal"))
    try:
        sys.exit(main(args=words, prog_name="cafim", standalone_mode=False))
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt) as error:
        click.echo("cafim: interrupted, before it began or after its end", err=True)
        sys.exit(status_of(error.__cause__ or error))


if __name__ == "__main__":
    run_cli()
