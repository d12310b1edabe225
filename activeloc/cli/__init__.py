"""The ``activeloc`` command: a file for each subcommand.

Nothing heavy is imported before a subcommand runs, so that ``--help`` is quick. Whatever the user
can put right ends in one line on standard error:

==== ======================================================================
code meaning
==== ======================================================================
0    done
1    the machine failed: disk full, a process killed
2    the command line, a setting, a map or the output folder is refused
130  interrupted (Ctrl-C)
141  nobody reads the output any more
143  terminated
==== ======================================================================
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

import typer

from activeloc.cli import bench, calibrate, envs, evaluate, export, localize, play, run, watch
from activeloc.cli import map as map_command
from activeloc.errors import ActiveLocError

app = typer.Typer(
    name="activeloc",
    help="Active localization: a robot that chooses its motions so as to find out where it is.",
    add_completion=False,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("bench", help=bench.HELP)(bench.bench)
app.command("calibrate", help=calibrate.HELP)(calibrate.calibrate)
app.command("envs", help=envs.HELP)(envs.envs)
app.command("evaluate", help=evaluate.HELP)(evaluate.evaluate)
app.command("export", help=export.HELP)(export.export)
app.command("localize", help=localize.HELP)(localize.localize)
app.command("play", help=play.HELP)(play.play)
app.command("run", help=run.HELP)(run.run)
app.command("watch", help=watch.HELP)(watch.watch)
app.add_typer(map_command.app, name="map")


class Terminated(KeyboardInterrupt):
    """Somebody asked the process to end."""


@app.callback()
def _options(
    debug: bool = typer.Option(False, "--debug", help="Show where an error came from."),
) -> None:
    """Options of every subcommand; `main` reads them itself."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code.

    Args:
        arguments: Without the program's name; those of the process if None.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        return _run(given)
    except BrokenPipeError:
        # What is left in the buffer has nowhere to go: keep the interpreter from flushing it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    finally:
        signal.signal(signal.SIGTERM, before)


def _run(given: list[str]) -> int:
    """Run and flush; errors become a line and a code, unless ``--debug`` comes first."""
    try:
        # Not `app()`: it would turn signals and closed pipes into exit codes of its own.
        command = typer.main.get_command(app)
        with command.make_context("activeloc", list(given)) as context:
            command.invoke(context)
        if sys.stdout is not None:
            sys.stdout.flush()
        return 0
    except typer.Exit as done:
        if sys.stdout is not None:
            sys.stdout.flush()
        return done.exit_code
    except BrokenPipeError:
        raise
    except BaseException as error:
        expected = _expected(error)
        if expected is None or given[:1] == ["--debug"]:
            raise
        message, code = expected
        print(f"activeloc: {' '.join(message.split())}", file=sys.stderr)
        return code


def _expected(error: BaseException) -> tuple[str, int] | None:
    """Message and exit code of an error that is no defect of the program."""
    usage = typer.BadParameter.__mro__[1]
    if isinstance(error, usage):
        context = getattr(error, "ctx", None)
        path = context.command_path if context is not None else "activeloc"
        message = str(error.format_message()) or "a subcommand is missing"  # type: ignore[attr-defined]
        return f"{message.rstrip('.')} (see {path} --help)", 2
    if isinstance(error, ActiveLocError):
        return str(error), 2
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        ended = ("terminated", 143) if isinstance(error, Terminated) else ("interrupted", 130)
        return "; ".join([ended[0], *getattr(error, "__notes__", [])]), ended[1]
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}", 1
    return None


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise Terminated
