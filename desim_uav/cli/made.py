"""Commands are made of verbs: Python functions, which alone have defaults, help and checks.

The help is that of the docstring: what comes before ``Args:`` is about the command, and the entries
there are about its options. What begins with "In Python" is left out. A parameter's default is that
of the signature, its type and what it may be stand in its annotation.
"""

from __future__ import annotations

import builtins
import inspect
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType, NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import typer

from desim_uav.cli.looks import OptionLook, flags_of, look_of
from desim_uav.cli.terminal import NO_PLUGINS, QUIETS
from desim_uav.typed import OfTexts, Within, marks_of

Verb = Callable[..., Any]
Work = Callable[..., None]

IN_PYTHON = "In Python"
ENTRY = re.compile(r"    (\w+): (.+)")
PLACES = re.compile("DIR|FILE|RUN")
"""In a metavar: the value is a path, unless it may be a name that is completed."""


def made(
    verb: Verb,
    *terminal: inspect.Parameter,
    without: Collection[str] = (),
    optional: Collection[str] = (),
    also: Mapping[str, Verb] | None = None,
) -> Callable[[Work], Work]:
    """Make a command of a verb, and give its arguments, as a dict, to the function decorated.

    Args:
        verb: The Python function.
        terminal: Options that only a terminal has; the function gets them by their names.
        without: Parameters that are no options.
        optional: Parameters that the command may do without; they are then None.
        also: Parameters of other verbs.
    """
    of = {name: verb for name in parameters_of(verb) if name not in without}
    shows = of.pop("progress", None) is not None
    of |= also or {}

    def decorate(work: Work) -> Work:
        own = [parameter_of(of[name], name, name in optional) for name in of]

        def command(**values: Any) -> None:
            arguments = {name: value_of(of[name], name, values.pop(name)) for name in of}
            if shows and any(each in QUIETS for each in terminal):
                arguments["progress"] = not values["quiet"]
            values.pop(NO_PLUGINS.name, None)
            work(arguments, **values)

        command.__name__, command.__module__ = work.__name__, work.__module__
        command.__doc__ = about(verb)
        made_of = {each.name: each for each in (*own, *terminal)}
        command.__annotations__ = {each.name: each.annotation for each in made_of.values()}
        command.__dict__["__signature__"] = inspect.Signature([*made_of.values()])
        return command

    return decorate


def commands_of(module: ModuleType) -> Iterator[Work]:
    """Yield the commands that are made in a module, in their order there."""
    for one in vars(module).values():
        if getattr(one, "__module__", "") == module.__name__ and hasattr(one, "__signature__"):
            yield one


@cache
def parameters_of(verb: Verb) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a verb by their names."""
    return inspect.signature(verb).parameters


def parameter_of(verb: Verb, name: str, optional: bool = False) -> inspect.Parameter:
    """Return a parameter of a verb as typer reads it."""
    parameter, look = parameters_of(verb)[name], look_of(verb.__name__, name)
    hint = hint_of(verb, parameter)
    kind, default = kind_of(hint, look), parameter.default
    if optional or default == ():
        default = None
    if default is None:
        kind |= None
    info = typer.Argument if look.argument else typer.Option
    flags = flags_of(verb.__name__, name)
    option: Any = info(
        *(() if look.argument else flags),
        metavar=look.metavar or ("N" if kind in (int, float, int | None, float | None) else None),
        help=helps(verb).get(name),  # without docstrings (python -OO), there is none
        callback=_check(marks_of(hint), flags[-1]),
        parser=_parser(kind, marks_of(hint)),
        autocompletion=look.complete,
        rich_help_panel=look.heading,
    )
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option]
    )


class _InTerminals(dict[str, Any]):
    """The names of an annotation; what only Python has is text in a terminal."""

    def __missing__(self, name: str) -> Any:
        return str


def hint_of(verb: Verb, parameter: inspect.Parameter) -> Any:
    """Return the annotation of a verb's parameter, without importing what only Python has."""
    names = inspect.unwrap(verb).__globals__
    return eval(parameter.annotation, names, _InTerminals(vars(builtins) | names))


def kind_of(hint: object, look: OptionLook) -> Any:
    """Return the type that typer is told of."""
    members = _alternatives(hint)
    if members == [bool]:
        return bool
    number = next((each for each in (int, float) if each in members), None)
    if number is not None and str not in members:
        return number
    one: Any = Path if PLACES.search(look.metavar) and look.complete is None else str
    many = look.repeated or (int not in members and any(map(_is_sequence, members)))
    return list[one] if many and not look.commas else one


def _alternatives(hint: object) -> list[Any]:
    """Return the types that an annotation allows beside None."""
    if get_origin(hint) is Annotated:
        return _alternatives(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        return [each for one in get_args(hint) for each in _alternatives(one)]
    return [hint] if hint is not NoneType else []


def _is_sequence(hint: object) -> bool:
    return get_origin(hint) is Sequence


def value_of(verb: Verb, name: str, text: Any) -> Any:
    """Return what a verb is given for what was typed."""
    if text is None or text == []:
        default = parameters_of(verb)[name].default
        return default if default == () else None
    if text is not None and look_of(verb.__name__, name).commas:
        return text.split(",")
    return text


def _parser(kind: Any, marks: Sequence[Within | OfTexts]) -> Callable[[Any], Any] | None:
    """Return what reads a number that was typed, or None for other kinds."""
    number = next((each for each in (int, float) if each in _alternatives(kind)), None)
    if number is None:
        return None
    own = next((mark.words for mark in marks if isinstance(mark, Within)), None)
    words = own or ("a whole number" if number is int else "a number")

    def parse(text: Any) -> Any:
        try:
            return number(text)
        except ValueError:
            raise typer.BadParameter(f"{text!r} is not {words}") from None

    return parse


def _check(marks: Sequence[Within | OfTexts], flag: str) -> Callable[[Any], Any] | None:
    """Return what checks a value as the verb does, and says what is wrong as a terminal does."""
    if not marks:
        return None

    def check(value: Any) -> Any:
        for mark in marks:
            if isinstance(mark, Within) and value is not None and not mark.holds(value):
                text = f"{value:g}" if isinstance(value, float) else value
                raise typer.BadParameter(f"{text} is not {mark.words}")
            if isinstance(mark, OfTexts) and value is not None and (wrong := mark.problem(value)):
                raise typer.BadParameter(wrong, param_hint=flag)
        return value

    return check


# ---- the help


def about(verb: Verb) -> str:
    """Return what a docstring says of a command."""
    paragraphs = _parts(verb)[0].split("\n\n")
    for_terminal = (one for one in paragraphs if not one.startswith(IN_PYTHON))
    return "\n\n".join(for_terminal).replace("``", "")


@cache
def helps(verb: Verb) -> dict[str, str]:
    """Return what a docstring says of each parameter."""
    lines_of: dict[str, list[str]] = {}
    name = ""
    for line in _parts(verb)[1].splitlines():
        entry = ENTRY.fullmatch(line)
        if entry is not None:
            name = entry[1]
        lines_of.setdefault(name, []).append(line.strip() if entry is None else entry[2])
    texts = {name: " ".join(lines) for name, lines in lines_of.items() if name}
    return {
        name: f" {text}".partition(f" {IN_PYTHON}")[0].strip().replace("``", "")
        for name, text in texts.items()
    }


def _parts(verb: Verb) -> tuple[str, str]:
    """Return what comes before the sections of a docstring, and the section of arguments."""
    before, *sections = re.split(r"\n\n(?=\w+:\n)", inspect.getdoc(verb) or "")
    arguments = (each for each in sections if each.startswith("Args:\n"))
    return before, next(arguments, "")
