"""The file of the digests: how it is read, compared and written."""

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
from tests.frozen.programs import ENGINES, Run, Training, programs
from tests.frozen.scenarios import HERE

FILE = HERE / "digests.json"
COMMAND = "python -m tests.frozen --write"


@cache
def known() -> dict[str, Any]:
    """Return the content of the file."""
    content: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return content


def differences(
    chosen: Iterable[Run | Training] | None = None, engines: tuple[str, ...] = ENGINES
) -> list[str]:
    """Return which tables of which runs differ from the frozen ones: a line for each."""
    found = []
    for program in programs() if chosen is None else chosen:
        expected = known()["programs"][str(program)]
        for engine in engines:
            digests = program.digests(engine, known()["columns"])
            found += [
                f"{program}, engine {engine}: the table {name!r} is not the frozen one"
                for name in expected
                if digests[name] != expected[name]
            ]
    return found


def circumstances() -> list[str]:
    """Return in what this machine differs from the one on which the digests were made."""
    frozen, here = known()["made_with"], _made_with()
    return [
        f"the digests were made with {name} {frozen[name]}, and this is {name} {here[name]}"
        for name in frozen
        if frozen[name] != here[name]
    ]


def write() -> list[str]:
    """Write the digests of all runs, unless the engines differ; return in which tables they do."""
    columns = {name: dict(table) for name, table in TABLES.items()}
    of_program, apart = {}, []
    for program in programs():
        one, *others = (program.digests(engine, columns) for engine in ENGINES)
        apart += [
            f"{program}: the table {name!r} depends on the engine"
            for other in others
            for name in one
            if other[name] != one[name]
        ]
        of_program[str(program)] = one
    if not apart:
        FILE.write_text(_text(columns, of_program), encoding="utf-8")
        known.cache_clear()
    return apart


def _text(columns: dict[str, dict[str, str]], of_program: dict[str, dict[str, str]]) -> str:
    """JSON with a line per run, so that a change shows which runs it concerns."""
    head = {
        "command": COMMAND,
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
