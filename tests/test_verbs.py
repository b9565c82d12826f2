"""Commands are made of verbs: no option has a default, a help or a check of its own."""

import inspect
import re
import subprocess
import sys
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import pytest
import typer

import desim_uav as du
from desim_uav.api import files, measures
from desim_uav.cli import app, terminal
from desim_uav.cli.looks import LOOKS
from desim_uav.cli.made import helps
from desim_uav.errors import UsageError
from desim_uav.typed import Label, OneOf, Within, hints_of, marks_of, typed

VERBS = {
    "scenarios": [files.list_scenarios],
    "tutorials": [files.list_tutorials],
    "validate": [files.validate],
    "schema": [files.schema],
    "run": [du.run, du.counterfactual],
    "train": [du.train],
    "optimum": [du.find_optimum],
    "reproduce": [du.reproduce],
    "qoe": [measures.measures_of],
    "ls": [du.list_runs],
    "compare": [du.compare, du.compare_runs],
    "sweep": [du.sweep],
    "replay": [du.write_replay],
    "report": [du.write_report],
    "plot": [du.plot],
    "levels": [du.write_levels],
    "video": [du.film],
    "paper": [files.paper],
    "doctor": [files.doctor],
    "bench list": [du.bench_list],
    "bench run": [du.bench_run],
    "bench verify": [du.bench_verify],
    "bench board": [du.bench_board],
    "bench export": [du.bench_export],
    "bench seal": [du.bench_seal],
    "bench reveal": [du.bench_reveal],
}
"""The Python functions that each command is made of; the first one describes the command."""

OPTIONAL = {("compare", "policies"), ("run", "fork"), ("run", "to"), ("paper", "name")}
"""What a command may do without, although the function that describes it may not."""

PROGRAM = typer.main.get_command(app)
COMMANDS = {
    f"{name} {within}".strip(): each
    for name, command in PROGRAM.commands.items()
    for within, each in getattr(command, "commands", {"": command}).items()
}
OF_TERMINALS = {
    each.name: each for each in vars(terminal).values() if isinstance(each, inspect.Parameter)
}


def described(command, name):
    """The function that describes a parameter of a command, if it is not one of terminals."""
    if name in OF_TERMINALS:
        return None
    return next(each for each in VERBS[command] if name in inspect.signature(each).parameters)


PARAMETERS = [
    (command, parameter.name)
    for command in COMMANDS
    for parameter in COMMANDS[command].params
    if parameter.name not in OF_TERMINALS
]


def test_each_command_has_its_verb():
    assert set(COMMANDS) == set(VERBS)


@pytest.mark.parametrize(("command", "name"), PARAMETERS)
def test_no_option_has_a_default_or_help_of_its_own(command, name):
    (parameter,) = [each for each in COMMANDS[command].params if each.name == name]
    verb = described(command, name)
    default = inspect.signature(verb).parameters[name].default
    if (command, name) in OPTIONAL or default in (inspect.Parameter.empty, (), None):
        assert parameter.default is None or callable(parameter.default)
    else:
        assert parameter.default == default
    assert parameter.required == (
        default is inspect.Parameter.empty and (command, name) not in OPTIONAL
    )
    assert parameter.help == helps(verb)[name]
    told = " ".join(inspect.getdoc(verb).replace("``", "").split())
    assert parameter.help in told


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_command_is_that_of_its_verb(command):
    for verb in VERBS[command][:1]:
        told = " ".join(inspect.getdoc(verb).replace("``", "").split())
        for paragraph in COMMANDS[command].help.split("\n\n"):
            assert " ".join(paragraph.split()) in told


OF_TEXTS = {OneOf: "allowed: ", Label: "must be one line"}
"""The message that refuses a text."""


@pytest.mark.parametrize(("command", "name"), PARAMETERS)
def test_a_command_and_its_verb_refuse_the_same(command, name):
    """The number or the word just beyond what the annotation allows, with either's own words."""
    verb = described(command, name)
    (parameter,) = [each for each in COMMANDS[command].params if each.name == name]
    for mark in marks_of(hints_of(verb)[name]):
        wrong = mark.high + 1 if isinstance(mark, Within) else "none\nsuch"
        with pytest.raises(typer.BadParameter) as typed_in:
            parameter.callback(None, None, wrong)
        with pytest.raises(UsageError, match=f"^{name}: {re.escape(repr(wrong))}") as called:
            verb(**{name: wrong})
        words = mark.words if isinstance(mark, Within) else OF_TEXTS[type(mark)]
        assert words in str(typed_in.value) and words in str(called.value)


def test_every_documented_argument_is_one_and_each_is_documented():
    verbs = [each for several in VERBS.values() for each in several] + [du.find_bounds]
    for verb in verbs:
        assert list(helps(verb)) == list(inspect.signature(verb).parameters), verb.__name__


def test_commands_are_there_without_docstrings():
    code = "from desim_uav.cli import main; main()"
    program = [sys.executable, "-OO", "-c", code, "scenarios"]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    assert "tiny" in done.stdout


def test_looks_are_of_parameters_that_there_are():
    known = {name for _, name in PARAMETERS}
    full = {f"{described(*each).__name__}.{each[1]}" for each in PARAMETERS}
    assert set(LOOKS) <= known | full


def test_the_public_names_are_those_of_the_stub():
    from desim_uav.lazily import names_in_stub

    assert du.__all__ == ["__version__", *names_in_stub(du.__file__)]
    for name, module in names_in_stub(du.__file__).items():
        assert module.startswith("desim_uav."), name


Few = Annotated[int, Within(1, 3)]
FewOrList = Annotated[int | Sequence[int] | None, Within(1, 3)]
Share = Annotated[float, Within(0.0, 1.0)]
Name = Annotated[str, OneOf(lambda: ["left", "right"])]


class TestMarks:
    def test_numbers_become_those_of_python(self):
        @typed
        def both(whole: Few = 1, share: Share = 0.5) -> list:
            return [whole, share]

        assert [*map(type, both(np.int64(3), np.float32(0.5)))] == [int, float]
        assert both(share=1) == [1, 1.0]
        for wrong in ({"whole": 0}, {"whole": 4}, {"share": 1.5}, {"share": float("nan")}):
            with pytest.raises(UsageError, match=": must be a "):
                both(**wrong)

    def test_alternatives_are_left_alone(self):
        @typed
        def several(whole: FewOrList = None) -> object:
            return whole

        assert several([7, 8]) == [7, 8] and several(None) is None
        assert several(np.array([7, 8])).tolist() == [7, 8]  # an array has a __float__
        with pytest.raises(UsageError, match="whole: 7: must be a whole number from 1 to 3"):
            several(7)

    def test_a_name(self):
        @typed
        def one(name: Name) -> str:
            return name

        assert one("left") == "left"
        with pytest.raises(UsageError, match=r"name: 'lft' \(did you mean 'left'\?\); allowed: l"):
            one("lft")
