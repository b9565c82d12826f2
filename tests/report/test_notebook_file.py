"""Tutorials as notebooks: what their cells are, and that they can be run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from desim_uav import cli
from desim_uav.api.files import list_tutorials
from desim_uav.errors import UsageError
from desim_uav.report.notebook_file import INSTALL, notebook_of, title_of
from desim_uav.shipped import tutorials

PAGE = """\
---
kernelspec:
  name: python3
---

# A page

See [](../howto/run.md), [the model](../explanation/model.md#users) and [SimPy](https://simpy.test).

![A picture](../picture.png)

```sh thorough
pip install -e . && desim-uav run tiny
```

```text output thorough
tiny
```

```{code-cell}
print(1)
```

```python file=mine.py
X = 1
```

```yaml
name: mine
```

The end.
"""


WITH_FILES = "3_component_of_your_own"
"""The tutorial that writes files; the blocks of the others are run as those of pages are."""


def cells(page: str) -> list[tuple[str, str]]:
    return [(cell["cell_type"], cell["source"]) for cell in notebook_of(page)["cells"]]


def test_the_cells_of_a_page():
    assert title_of(PAGE) == "A page"
    assert cells(PAGE) == [
        ("code", INSTALL.rstrip("\n")),
        (
            "markdown",
            "# A page\n\nSee `howto/run.md`, the model (`explanation/model.md`) and "
            "[SimPy](https://simpy.test).",
        ),
        ("code", "!desim-uav run tiny"),
        ("code", "print(1)"),
        ("code", "%%writefile mine.py\nX = 1"),
        ("markdown", "```yaml\nname: mine\n```"),
        ("markdown", "The end."),
    ]


def test_they_are_notebooks():
    nbformat = pytest.importorskip("nbformat")
    for path in tutorials().values():
        nbformat.validate(notebook_of(path.read_text(encoding="utf-8")))


def test_the_command_copies_all_and_overwrites_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["desim-uav", "tutorials", "--copy", "here", "--json"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code
    made = json.loads(capsys.readouterr().out)
    assert set(made.values()) == set(list_tutorials().values())
    assert all(json.loads(Path(file).read_text())["nbformat"] == 4 for file in made)
    Path("here/0_start.ipynb").unlink()
    with pytest.raises(UsageError, match=r"--copy here/1_run_and_look.ipynb: exists already"):
        list_tutorials("here")
    assert not Path("here/0_start.ipynb").exists()


OTHERS = [pytest.param(name, marks=pytest.mark.slow) for name in tutorials() if name != WITH_FILES]


@pytest.mark.thorough
@pytest.mark.parametrize("name", [WITH_FILES, *OTHERS])
def test_a_notebook_runs_from_top_to_bottom(name: str, tmp_path: Path):
    """Without Jupyter: cells are run in one process, commands in a shell."""
    script = tmp_path / "cells.py"
    script.write_text("\n".join(as_python(cell) for cell in of_code(name)), encoding="utf-8")
    environment = {"MPLBACKEND": "Agg"}
    subprocess.run([sys.executable, script], check=True, cwd=tmp_path, env=own(environment))


def of_code(name: str) -> list[str]:
    made: list[dict[str, Any]] = notebook_of(tutorials()[name].read_text(encoding="utf-8"))["cells"]
    return [cell["source"] for cell in made if cell["cell_type"] == "code"][1:]


def as_python(cell: str) -> str:
    if cell.startswith("%%writefile"):
        head, _, text = cell.partition("\n")
        return f"open({head.split()[1]!r}, 'w').write({text + chr(10)!r})"
    if cell.startswith("!"):
        commands = [line[1:] for line in cell.splitlines()]
        return (
            f"import subprocess\nfor c in {commands!r}: subprocess.run(c, shell=True, check=True)"
        )
    return cell


def own(changes: dict[str, str]) -> dict[str, str]:
    import os

    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return {**os.environ, "PATH": path, "PYTHONPATH": str(Path(__file__).parents[2]), **changes}
