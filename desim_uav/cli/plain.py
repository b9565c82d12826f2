"""Help without the types of a programming language: a flag takes nothing, a name is a name."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from desim_uav.cli.options import SCENARIO
from desim_uav.errors import drop
from desim_uav.plug_ins import ADMISSION


def _plain(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        elif parameter.param_type_name == "argument":
            parameter.display_type_rich = lambda ctx: ""  # newer versions of typer ask for it
    return parameters


@contextmanager
def _read_as_far_as_wanted() -> Iterator[None]:
    """End without a failure if nobody reads the output any more, as in ``… | head -1``."""
    try:
        yield
    except BrokenPipeError:
        drop(sys.stdout)
        raise typer.Exit from None
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # as rich ends the program then
            raise typer.Exit from None
        raise


def _begin(refuses: bool) -> bool:
    ADMISSION.begin(refuses)
    return refuses


NoPlugIns = Annotated[
    bool,
    typer.Option(
        "--no-plugins",
        callback=_begin,
        is_eager=True,
        help="Refuse components of one's own. Without this, what a scenario, the folder of a run "
        "or --policy names as module:Class is imported, which runs its code.",
        rich_help_panel=SCENARIO,
    ),
]


def careful(function: Callable[..., None]) -> Callable[..., None]:
    """Give a command, which reads files that may name components, the option ``--no-plugins``."""

    @wraps(function)
    def command(*arguments: Any, no_plugins: bool, **options: Any) -> None:
        function(*arguments, **options)

    own = inspect.signature(function, eval_str=True)
    kind = inspect.Parameter.KEYWORD_ONLY
    more = inspect.Parameter("no_plugins", kind, default=False, annotation=NoPlugIns)
    signature = own.replace(parameters=[*own.parameters.values(), more])
    command.__dict__["__signature__"] = signature
    command.__annotations__ = {**function.__annotations__, "no_plugins": NoPlugIns}
    return command


class Command(TyperCommand):
    """A command with such a help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters as the help shows them."""
        return _plain(super().get_params(ctx))


class Group(TyperGroup):
    """The program itself."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Read the command line, which may print the help."""
        with _read_as_far_as_wanted():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _read_as_far_as_wanted():
            return super().invoke(ctx)

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters as the help shows them."""
        return _plain(super().get_params(ctx))
