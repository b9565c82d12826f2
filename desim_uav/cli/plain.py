"""Help without the types of a programming language: a flag takes nothing, a name is a name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from desim_uav.errors import drop


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


class PlainCommand(TyperCommand):
    """A command with such a help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters as the help shows them."""
        return _plain(super().get_params(ctx))


class PlainGroup(TyperGroup):
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
