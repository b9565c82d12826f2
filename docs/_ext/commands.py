"""The commands and their options, as typer knows them."""

from __future__ import annotations

import inspect
from typing import Any

import typer
from markdown_table import table

from desim_uav.cli import app


def markdown() -> str:
    """One section for each command."""
    return "\n".join(_section(name, command) for name, command in _commands())


def _commands() -> list[tuple[str, Any]]:
    group: Any = typer.main.get_command(app)
    return [
        (f"{name} {within}" if within else name, each)
        for name, command in group.commands.items()
        if not command.hidden
        for within, each in getattr(command, "commands", {"": command}).items()
    ]


def _section(name: str, command: Any) -> str:
    shown = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    arguments = [p for p in shown if p.param_type_name == "argument"]
    options = [p for p in shown if p.param_type_name == "option"]
    usage = " ".join(
        ["desim-uav", name, *map(_as_argument, arguments), "[OPTIONS]" * bool(options)]
    )
    rows = [[f"`{_as_argument(p)}`", p.help or "", ""] for p in arguments]
    rows += [[f"`{_as_option(p)}`", p.help or "", _default(p)] for p in options]
    about = inspect.cleandoc(command.help or "")
    return f"## {name}\n\n{about}\n\n```text\n{usage.strip()}\n```\n\n" + (
        table(("Argument or option", "Meaning", "Default"), rows) if rows else ""
    )


def _as_argument(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name.upper())


def _as_option(parameter: Any) -> str:
    names = ", ".join([*parameter.opts, *parameter.secondary_opts])
    return names if parameter.is_flag else f"{names} {parameter.metavar or 'VALUE'}"


def _default(parameter: Any) -> str:
    default = parameter.default
    return "" if parameter.is_flag or default is None or callable(default) else f"`{default}`"
