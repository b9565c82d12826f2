"""Checks the simulator against theory and independent programs, and prints tables of the results.

python analysis/verification.py [--quick] [--data FOLDER] [PART…]

Each row has the simulator's figure, that of theory or an independent program, their difference, the
largest allowed difference, and the number of cases or independent replications. The limit is a
tolerance for exact figures and 4 standard errors for estimates. Without --quick there are more
replications, which takes some minutes. --data writes PART.json for each part: its rows, command,
date, processor and versions. ``docs/_data/verification`` has the files from which the documentation
makes its tables. The exit code is 6 if a figure does not hold. The script
needs a checkout and pip install -e ".[test]".
"""

import argparse
import json
import platform
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from desim_uav.errors import DesimError, MissingExtraError, UsageError
from desim_uav.experiment.progress import progress
from desim_uav.experiment.provenance import processor

PARTS = (
    *("transit", "crossings", "planning", "queueing", "tasks", "ages", "demand"),
    *("placement", "mobility", "streams"),
    *("determinism", "conservation", "identities", "convergence", "flights", "links", "engines"),
    "optimality",
)
COLUMNS = ("", "ours", "theory", "difference", "limit", "n", "holds")
PACKAGES = ("desim-uav", "numpy", "numba", "simpy", "scipy", "networkx")
DOES_NOT_HOLD = 6


def main() -> int:
    """Print the tables and return the exit code."""
    told = arguments()
    tables, failed, total = [], 0, 0
    made_by = provenance(told)
    with progress(True, len(told.parts), "parts") as advance:
        for part in told.parts:
            about, rows = examined(part, told.quick)
            tables.append(f"### {about}\n\n{drawn(rows)}\n")
            failed += sum(row[-1] != "yes" for row in rows)
            total += len(rows)
            if told.data is not None:
                write(told.data / f"{part}.json", as_json({"about": about, **made_by}, rows))
            advance()
    print("\n".join(tables))
    print(f"{total - failed} of {total} figures hold", file=sys.stderr)
    return DOES_NOT_HOLD if failed else 0


def arguments() -> argparse.Namespace:
    """Return the options of the command line."""
    about, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        description=about, epilog=rest.partition("\n\n")[2], allow_abbrev=False
    )
    parser.add_argument("--quick", action="store_true", help="fewer replications: some two minutes")
    parser.add_argument(
        "--data", type=Path, metavar="FOLDER", help="also write PART.json for each part to FOLDER"
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    told = parser.parse_args()
    unknown = [part for part in told.parts if part not in PARTS]
    if unknown:
        parser.error(f"no such part: {unknown[0]} (there are {', '.join(PARTS)})")
    told.parts = told.parts or PARTS
    return told


def examined(part: str, quick: bool) -> tuple[str, list[tuple[str, ...]]]:
    """Return the title and the rows of a part; a part that fails has a row that does not hold."""
    try:
        module = import_module(f"tests.verification.{part}")
    except ModuleNotFoundError as error:
        raise MissingExtraError(Path(__file__).name, "test") from error
    about = (module.__doc__ or part).partition("\n\n")[0].rstrip(".")
    return about, list(rows_of(module.figures(quick)))


def rows_of(figures: Iterator) -> Iterator[tuple[str, ...]]:
    """Yield the rows of figures."""
    try:
        for figure in figures:
            yield (*figure.cells(), "yes" if figure.holds else "NO")
    except (AssertionError, DesimError) as error:
        yield (f"{type(error).__name__}: {error}".partition("\n")[0], "", "", "", "", "", "NO")


def drawn(rows: list[tuple[str, ...]]) -> str:
    """Return an aligned Markdown table."""
    table = [COLUMNS, *(tuple(cell.replace("|", "\\|") for cell in row) for row in rows)]
    widths = [max(3, *map(len, column)) for column in zip(*table, strict=True)]
    rule = tuple("-" * width for width in widths)
    return "\n".join(
        "| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |"
        for row in (table[0], rule, *table[1:])
    )


def provenance(told: argparse.Namespace) -> dict[str, str]:
    """Return the command, the date, the processor and the versions."""
    options = ["--quick"] * told.quick + list(told.parts if told.parts != PARTS else ())
    return {
        "command": " ".join(["python analysis/verification.py", *options]),
        "date": datetime.now(UTC).date().isoformat(),
        "processor": processor(),
        "versions": ", ".join(
            (
                f"Python {platform.python_version()}",
                *(f"{name} {version(name)}" for name in PACKAGES),
            )
        ),
    }


def as_json(head: dict[str, str], rows: list[tuple[str, ...]]) -> str:
    """Return the file of a part: an object whose rows stand in a line each."""
    keys = "".join(f" {text(key)}: {text(value)},\n" for key, value in head.items())
    lines = ",\n".join(f"  {text(row)}" for row in rows)
    return f'{{\n{keys} "rows": [\n{lines}\n ]\n}}\n'


def text(value: object) -> str:
    """Return a value as JSON in one line."""
    return json.dumps(value, ensure_ascii=False)


def write(file: Path, content: str) -> None:
    """Write a file. Raises UsageError if it cannot be written."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot write {file}: {error.strerror or error}") from error


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    try:
        sys.exit(main())
    except DesimError as error:
        print(f"verification.py: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
