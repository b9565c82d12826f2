"""The files of the digests: how they are read, compared and written."""

from __future__ import annotations

import json
import platform
import subprocess
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import desim_uav
from desim_uav.records import TABLES
from tests.frozen.programs import ENGINES, Program, Sets, sets
from tests.frozen.scenarios import HERE

COMMAND = "python -m tests.frozen --write"


@cache
def known(name: Sets) -> dict[str, Any]:
    """Return the content of a file."""
    content: dict[str, Any] = json.loads(file_of(name).read_text(encoding="utf-8"))
    return content


def file_of(name: Sets) -> Path:
    """Return the file of a set of programs."""
    return HERE / f"{name}.json"


def differences(
    name: Sets,
    chosen: Iterable[Program] | None = None,
    engines: tuple[str, ...] = ENGINES,
) -> list[str]:
    """Return which tables of which runs of a set differ from the frozen ones: a line for each."""
    found = []
    for program in sets()[name]() if chosen is None else chosen:
        expected = known(name)["programs"][str(program)]
        for engine in engines:
            digests = program.digests(engine, known(name)["columns"])
            found += [
                f"{program}, engine {engine}: the table {table!r} is not the frozen one"
                for table in expected
                if digests[table] != expected[table]
            ]
    return found


def circumstances(name: Sets) -> list[str]:
    """Return in what this machine differs from the one on which the digests were made."""
    frozen, here = known(name)["made_with"], _made_with()
    return [
        f"the digests were made with {key} {frozen[key]}, and this is {key} {here[key]}"
        for key in frozen
        if frozen[key] != here[key]
    ]


def write(name: Sets) -> list[str]:
    """Write the digests of a set, unless the engines differ; return in which tables they do."""
    columns = {table: dict(types) for table, types in TABLES.items()}
    of_program, apart = {}, []
    for program in sets()[name]():
        one, *others = (program.digests(engine, columns) for engine in ENGINES)
        apart += [
            f"{program}: the table {table!r} depends on the engine"
            for other in others
            for table in one
            if other[table] != one[table]
        ]
        of_program[str(program)] = one
    if not apart:
        file_of(name).write_text(_text(name, columns, of_program), encoding="utf-8")
        known.cache_clear()
    return apart


def _text(
    name: Sets, columns: dict[str, dict[str, str]], of_program: dict[str, dict[str, str]]
) -> str:
    """JSON with a line per run, so that a change shows which runs it concerns."""
    head = {
        "command": f"{COMMAND} {name}",
        "commit": _commit(),
        "made_with": _made_with(),
        "columns": columns,
    }
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(of_program[key])}" for key in of_program)
    return f'{json.dumps(head, indent=1)[:-2]},\n "programs": {{\n{lines}\n }}\n}}\n'


def _commit() -> str:
    """Return the commit of the simulator that is imported, which may be another checkout's."""
    package = Path(desim_uav.__file__).parent
    told = subprocess.run(
        ["git", "-C", package, "rev-parse", "HEAD"], capture_output=True, text=True, check=True
    )
    return told.stdout.strip()


def _made_with() -> dict[str, str]:
    return {
        "machine": platform.machine(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "numba", "simpy")},
    }
