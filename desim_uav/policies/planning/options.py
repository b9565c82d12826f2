"""Options in the name of a policy: ``greedy:horizon=20+waiting=2``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from desim_uav.errors import did_you_mean


class Option(NamedTuple):
    """A number that a planner can be told: its default, and the least and the largest value."""

    default: float
    least: float
    most: float


def options_of(
    planner: str, text: str, arguments: Mapping[str, Any], options: Mapping[str, Option]
) -> dict[str, Any]:
    """Return the values of all options: those in the text, those given, and defaults.

    ``text`` is a list of ``key=value`` that is separated by ``+``. An option whose default is a
    whole number has whole numbers only. Raises ValueError for an unknown key or a bad value.
    """
    values: dict[str, Any] = {key: option.default for key, option in options.items()}
    settings: dict[str, Any] = dict(arguments)
    for part in text.split("+") if text else ():
        key, equals, value = part.partition("=")
        if not equals:
            raise ValueError(f"{part!r}: write an option as key=value, and + between two of them")
        if key in settings:
            raise ValueError(f"{key}: it is given twice")
        settings[key] = value
    for key, value in settings.items():
        if key not in options:
            hint = did_you_mean(key, options)
            raise ValueError(
                f"{planner} has no option {key!r}{hint}; allowed: {', '.join(options) or 'none'}"
            )
        values[key] = _number(key, value, options[key])
    return values


def _number(key: str, value: Any, option: Option) -> float:
    kind = int if isinstance(option.default, int) else float
    what = "a whole number" if kind is int else "a number"
    message = f"{key}: {value!r}: must be {what} from {option.least:g} to {option.most:g}"
    try:
        number = kind(value)
    except (TypeError, ValueError):
        raise ValueError(message) from None
    if isinstance(value, bool) or (not isinstance(value, str) and number != value):
        raise ValueError(message)
    if not option.least <= number <= option.most:
        raise ValueError(message)
    return number


def split_options(argument: str) -> tuple[str, str]:
    """Split ``BASE+key=value+…`` into the base and its options."""
    parts = argument.split("+")
    count = len(parts)
    while count > 1 and "=" in parts[count - 1]:
        count -= 1
    return "+".join(parts[:count]), "+".join(parts[count:])
