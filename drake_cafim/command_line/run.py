"""The command `cafim run`: its options, and the summary that it prints."""

from pathlib import Path
from typing import Any

import click

from drake_cafim.command_line.options import Finite, common
from drake_cafim.command_line.output import open_folder, print_result, progress_line


@click.command()
@click.argument("scenario")
@click.option(
    "--world", default="drake", show_default=True, help="Contact: drake (hydroelastic) or model (the planner's)."
)
@click.option("--experiments", type=int, help="How many; by default the scenario's number.")
@click.option("--until-std", type=Finite(), help="Stop when every std is below this fraction of its estimate.")
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
@click.option(
    "--fisher",
    default="tangent",
    show_default=True,
    help="Or autodiff (through robot and contact, slow), finite-difference.",
)
@click.option(
    "--estimator", default="shooting", show_default=True, help="Or joint: parameters and forces in one program."
)
@click.option("--as-printed", is_flag=True, help="The paper's own choices, where they can be made.")
@click.option(
    "--place-std",
    type=Finite(),
    default=0.0,
    show_default=True,
    help="How far the contact may be from where it is planned, m, learned beside the unknowns.",
)
@click.option(
    "--tilt-std",
    type=Finite(),
    default=0.0,
    show_default=True,
    help="How far the contact's frame may be turned from the plan's, degrees, learned beside the unknowns.",
)
@click.option(
    "--bias-std", type=Finite(), default=0.0, show_default=True, help="How far hefting's force sensor may be off, N."
)
@click.option(
    "--drift-std", type=Finite(), default=0.0, show_default=True, help="And how fast it may drift, N/s; both learned."
)
@click.option(
    "--law",
    help="Contact law of the planner: kelvin_voigt, hunt_crossley, hydroelastic, paper, or all, between which the "
    "measurements decide.  [default: all in world drake, else the scenario's]",
)
@click.option(
    "--prior-scale", type=Finite(), default=1.3, show_default=True, help="The prior's mean as a multiple of the truth."
)
@click.option(
    "--conceal",
    multiple=True,
    help="EFFECT@PLACE parameter=value ...: an effect of the world that the planner's model lacks; repeatable.",
)
@click.option("--no-diagnosis", is_flag=True, help="Leave out the diagnosis of the run's own recordings at its end.")
@common
def run(
    scenario: str,
    world: Any,
    prior_scale: float,
    law: str | None,
    place_std: float,
    tilt_std: float,
    bias_std: float,
    drift_std: float,
    as_printed: bool,
    conceal: tuple[str, ...],
    no_diagnosis: bool,
    out: Path | None,
    as_json: bool,
    resume: bool,
    overwrite: bool,
    **chosen: Any,
) -> None:
    """Plan motions that touch, carry them out, and learn the scenario's unknowns."""
    from drake_cafim.commands.run import RunRequest, check_request, parse_concealed, run_command, table
    from drake_cafim.experiment.closed_loop import Options

    options = Options(**{name: value for name, value in chosen.items() if name not in ("jobs", "scheduler")})
    request = RunRequest(
        scenario,
        world,
        options,
        prior_scale,
        parse_concealed(conceal),
        as_printed,
        place_std,
        tilt_std,
        bias_std,
        drift_std,
        law,
        diagnosed=not no_diagnosis,
    )
    check_request(request)
    folder = open_folder(out, "run", resume=resume, overwrite=overwrite)
    with progress_line() as progress:
        record = run_command(request, folder, progress, resume=resume)
    report = record.get("diagnosis", {}).get("report")
    written = [folder / "replay.html", *([(folder / report).with_suffix(".html")] if report else [])]
    print_result(record, as_json, "\n".join([table(record), *map(str, written)]))
