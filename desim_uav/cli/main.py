"""The command line itself: its commands, and how errors leave it."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from functools import cache
from typing import Annotated, Any, NoReturn

import typer

from desim_uav import __version__
from desim_uav.api.invocation import begun_by
from desim_uav.cli import basics, bench, learning, pictures, runs
from desim_uav.cli.ending import complain
from desim_uav.cli.made import commands_of
from desim_uav.cli.plain import PlainCommand, PlainGroup
from desim_uav.errors import DesimError, UsageError, drop
from desim_uav.experiment.interrupt import INTERRUPTED, end_politely, leave
from desim_uav.notices import replace_lacking
from desim_uav.plug_ins import ADMISSION

app = typer.Typer(
    help="Exact discrete-event simulation of UAV-enabled wireless networks.",
    no_args_is_help=True,
    cls=PlainGroup,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

GROUPS = (basics, runs, learning, pictures)
"""The modules of the commands, which `--help` lists in their order."""


def main() -> NoReturn:
    """Run the command line; after an interruption, end the process without freeing its memory."""
    replace_lacking()
    code = INTERRUPTED
    with suppress(KeyboardInterrupt):  # a further Ctrl-C, while the first one is being handled
        try:
            _main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        code = _flushed(code)
    leave(code)
    sys.exit(code)


def _main() -> NoReturn:
    """Run the command line; every error a user can mend is one message and an exit code."""
    sys.path.append("")  # the working folder, where users keep their "module:Class" components
    try:
        _program()(prog_name="desim-uav")
    except DesimError as error:
        if error.__cause__ is not None and os.environ.get("DESIM_UAV_TRACEBACK"):
            raise
        complain(str(error))
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # whoever read the output has seen enough
        drop(sys.stdout)
    except OSError as error:
        complain(str(error))
        drop(sys.stdout)
        sys.exit(1)
    except Exception as error:
        if os.environ.get("DESIM_UAV_TRACEBACK"):
            raise
        complain(
            f"the simulation failed: {type(error).__name__}: {error}\n"
            "(DESIM_UAV_TRACEBACK=1 shows where)"
        )
        sys.exit(1)
    sys.exit(0)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        print(f"desim-uav {__version__}")
        raise typer.Exit
    end_politely()
    ADMISSION.begin(refuses=False)
    context.call_on_close(ADMISSION.end)
    context.with_resource(begun_by(["desim-uav", *sys.argv[1:]], complain))
    if context.invoked_subcommand != "doctor":
        _check_environment()


def _check_environment() -> None:
    """Raises UsageError for settings of Numba under which nothing would run."""
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not threads.isdecimal() or int(threads) < 1:
        raise UsageError(f"NUMBA_NUM_THREADS={threads}: must be a whole number from 1 on")
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        raise UsageError(
            "NUMBA_DISABLE_JIT is set: nothing runs without compiled kernels; unset it"
        )


@cache
def _program() -> Any:
    """Build the commands with their options, once per process: it takes longer than most errors."""
    return typer.main.get_command(app)


def _flushed(code: int) -> int:
    """Print what is still to be printed; return the exit code, which tells if that fails."""
    try:
        print(end="", flush=True)
    except BrokenPipeError:
        drop(sys.stdout)
    except OSError as error:
        complain(str(error))
        drop(sys.stdout)  # or Python complains at its end
        return code or 1
    return code


for group in GROUPS:
    for command in commands_of(group):
        app.command(cls=PlainCommand)(command)
app.add_typer(bench.app, name="bench")
