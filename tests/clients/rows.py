"""Makes the rows of the table in ``docs/clients.md`` again, by the commands in it.

python -m tests.clients.rows torchrl benchmarl --write

Each row whose library's cell has one of the words is made: its command is run here, the versions
are those that are installed here, and it works if all tests pass and none is skipped. Rows of
libraries that are not installed are made in another environment.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).parents[2] / "docs" / "clients.md"

DISTRIBUTIONS = {
    "Gymnasium": "gymnasium",
    "PettingZoo": "pettingzoo",
    "stable-baselines3": "stable-baselines3",
    "sb3-contrib": "sb3-contrib",
    "RLlib": "ray",
    "TorchRL": "torchrl",
    "BenchMARL": "benchmarl",
    "Tianshou": "tianshou",
    "SuperSuit": "supersuit",
    "Optuna": "optuna",
    "TensorBoard": "tensorboard",
}
"""The distribution of each library: the first word of a row, without a comma."""


class Row(NamedTuple):
    """A row of the table, by its columns."""

    library: str
    version: str
    works: str
    needs: str
    command: str

    def __str__(self) -> str:
        return f"| {' | '.join(self)} |"

    @property
    def distribution(self) -> str:
        return DISTRIBUTIONS[self.library.split()[0].rstrip(",")]

    @property
    def arguments(self) -> list[str]:
        """The arguments of pytest."""
        program, *arguments = shlex.split(self.command.strip("`"))
        assert program == "pytest", self.command
        return arguments


def rows(text: str) -> list[Row]:
    """The rows of a page's table."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    return [Row(*one) for one in cells[2:]]


def made(row: Row) -> Row:
    """The row after its command has been run."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tests.xml"
        command = [sys.executable, "-m", "pytest", *row.arguments, f"--junit-xml={file}"]
        subprocess.run(command, cwd=PAGE.parents[1], check=False)
        (suite,) = ElementTree.parse(file).getroot()
    tests, *bad = (int(suite.get(key, 0)) for key in ("tests", "failures", "errors", "skipped"))
    works = "yes" if tests and not any(bad) else "no"
    print(f"{row.library}: {tests} tests, failed {bad[0] + bad[1]}, skipped {bad[2]}", flush=True)
    return row._replace(version=version(row.distribution), works=works)


def main(arguments: list[str] | None = None) -> int:
    """Make the rows that are asked for; the exit code is 1 if one of them does not work."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("words", nargs="+", metavar="WORD", help="of a library's cell: torchrl")
    parser.add_argument("--write", action="store_true", help=f"write the rows into {PAGE.name}")
    asked = parser.parse_args(arguments)
    works = True
    for row in rows(PAGE.read_text(encoding="utf-8")):
        if not any(word.lower() in row.library.lower() for word in asked.words):
            continue
        try:
            version(row.distribution)
        except PackageNotFoundError:
            print(f"{row.library}: {row.distribution} is not installed here")
            works = False
            continue
        again = made(row)
        works &= again.works == "yes"
        print(again, flush=True)
        if asked.write:
            text = PAGE.read_text(encoding="utf-8")
            PAGE.write_text(text.replace(str(row), str(again)), encoding="utf-8")
    return 0 if works else 1


if __name__ == "__main__":
    sys.exit(main())
