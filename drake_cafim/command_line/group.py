"""The group of commands: every error of the input or the system ends it with one sentence."""

from typing import Any

import click
from click.exceptions import NoArgsIsHelpError

from drake_cafim.command_line.output import FOLDER
from drake_cafim.errors import InputError, one_line
from drake_cafim.interruption import pass_on_interruption, status_of
from drake_cafim.output import describe_error

RESUMABLE = ("run", "diagnose", "discriminate", "study")


class Cafim(click.Group):
    """A group whose commands end with status 2 and one sentence where the input, or the system, cannot be used."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return self._carry_out(ctx)
        except (InputError, click.UsageError, OSError, MemoryError) as error:
            if isinstance(error, NoArgsIsHelpError) or _is_closed_pipe(error):
                raise
            click.echo(f"cafim: {_sentence(error)}", err=True)
            ctx.exit(2)
        except KeyboardInterrupt as error:
            click.echo(f"cafim: interrupted{_way_on(ctx)}", err=True)
            ctx.exit(status_of(error))

    def _carry_out(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except Exception:
            pass_on_interruption()
            raise

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
    """What is kept after Ctrl-C or SIGTERM and how to go on, as the end of a sentence."""
    folder = ctx.meta.get(FOLDER)
    if folder is None or not folder.is_dir() or not any(folder.iterdir()):
        return "; nothing was written"
    if ctx.invoked_subcommand in RESUMABLE:
        return f"; what was finished is in {folder}, the same command with --out {folder} --resume goes on from there"
    return f"; what was finished is in {folder}, the same command with --out {folder} --overwrite begins anew"
