"""Tutorials as notebooks: a page in Markdown becomes cells of text, code and commands."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$\n?", re.MULTILINE | re.DOTALL)
FRONT_MATTER = re.compile(r"\A---\n.*?^---\n", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[([^\]]*)\]\((?!https?:)(?:\.\./)*([^)#]+)(?:#[^)]*)?\)")
PICTURE = re.compile(r"!\[([^\]]*)\]\([^)]*\)")

INSTALL = """\
try:
    import desim_uav
except ModuleNotFoundError:
    %pip install -q desim-uav
"""
"""The first cell: a hosted notebook does not have the package."""


def notebook_of(page: str) -> dict[str, Any]:
    """Return the notebook of a page, in the format 4.5 of Jupyter.

    Code cells, Python blocks and commands become cells, and files become cells that write them;
    output is left to the notebook. Links to other pages become their names.
    """
    page = FRONT_MATTER.sub("", page)
    cells, begin = [_cell("code", INSTALL)], 0
    for fence in FENCE.finditer(page):
        cells += _text(page[begin : fence.start()])
        cells += _of_block(fence[1].strip(), fence[2])
        begin = fence.end()
    cells += _text(page[begin:])
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {
        "cells": cells,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }


def title_of(page: str) -> str:
    """Return the first heading of a page."""
    return page.partition("\n# ")[2].partition("\n")[0] or page.partition("\n")[0].lstrip("# ")


def _of_block(words: str, text: str) -> Iterator[dict[str, Any]]:
    language, _, rest = words.partition(" ")
    file = re.search(r"file=(\S+)", rest)
    if file:
        yield _cell("code", f"%%writefile {file[1]}\n{text}")
    elif language in ("{code-cell}", "python"):
        yield _cell("code", text)
    elif language == "sh":
        lines = (part for line in text.splitlines() for part in line.split(" && "))
        kept = [line for line in lines if not line.startswith("pip install -e")]
        if kept:
            yield _cell("code", "".join(f"!{line}\n" for line in kept))
    elif "output" not in rest:
        yield _cell("markdown", f"```{language}\n{text}```")


def _text(text: str) -> Iterator[dict[str, Any]]:
    text = PICTURE.sub("", text)
    text = LINK.sub(lambda link: f"{link[1]} (`{link[2]}`)" if link[1] else f"`{link[2]}`", text)
    if text.strip():
        yield _cell("markdown", text.strip())


def _cell(kind: str, source: str) -> dict[str, Any]:
    cell: dict[str, Any] = {"cell_type": kind, "metadata": {}, "source": source.rstrip("\n")}
    return cell | ({"execution_count": None, "outputs": []} if kind == "code" else {})
