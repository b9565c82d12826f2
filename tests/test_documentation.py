"""What README and documentation say is so: their code blocks run, their commands exist."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest
import yaml
from pytest import mark

from tests.documentation import (
    DIRECTIVES,
    LANGUAGES,
    LINKED,
    NEEDED,
    ROOT,
    WORDS,
    blocks,
    extras_of,
    optional_dependencies,
    pages,
)
from tests.selection import by_default

PAGES = {str(page.relative_to(ROOT)): page for page in pages()}
README = PAGES["README.md"].read_text(encoding="utf-8")


def blocks_of(name: str) -> list:
    return blocks(PAGES[name].read_text(encoding="utf-8"))


def any_block(name: str, *, thorough: bool) -> bool:
    """Has a page a block that this run would run?"""
    return any(
        block.runs and ("thorough" in block.words) is thorough
        for block in blocks_of(name)
        if block.language in LANGUAGES - {"text"}
    )


def run(page: Path, folder: Path, *options: str) -> None:
    """Run a page's blocks in a folder, in a process of their own."""
    for name in LINKED:
        (folder / name).symlink_to(ROOT / name)
    environment = os.environ | {
        "PYTHONPATH": str(ROOT),
        "MPLBACKEND": "agg",
        "COLUMNS": "100",
    }
    done = subprocess.run(
        [sys.executable, "-m", "tests.documentation", str(page), *options],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def tell_what_was_left_out(name: str, *, thorough: bool) -> None:
    """Skip the rest of a test whose page has blocks of extras that are not installed."""
    left_out = [
        f"line {block.line}, which needs the extra {block.missing}"
        for block in blocks_of(name)
        if block.missing and (thorough or "thorough" not in block.words)
    ]
    if left_out:
        pytest.skip(f"all blocks ran but those of {'; '.join(left_out)}")


QUICK = [name for name in PAGES if any_block(name, thorough=False)]
FIRST = ("README.md", "CONTRIBUTING.md")
"""The pages that are read first: their quick blocks run by default."""
WHOLE = [name for name in PAGES if any_block(name, thorough=True)]
LONGEST = [
    *(name for name in WHOLE if name.startswith("docs/scenarios/")),
    *(f"docs/howto/{name}.md" for name in ("free_flight", "ppo", "report")),
]
"""Pages whose thorough blocks train for long."""


@pytest.mark.parametrize(
    "name", by_default(FIRST, [n for n in QUICK if n in FIRST or n not in WHOLE or n in LONGEST])
)
def test_the_code_blocks_of_a_page_run(name: str, tmp_path: Path) -> None:
    run(PAGES[name], tmp_path)
    tell_what_was_left_out(name, thorough=False)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=mark.slow if n in LONGEST else mark.thorough) for n in WHOLE]
)
def test_all_code_blocks_of_a_page_run(name: str, tmp_path: Path) -> None:
    run(PAGES[name], tmp_path, "--thorough")
    tell_what_was_left_out(name, thorough=True)


def test_a_block_that_was_left_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NEEDED, "rllib", ("no_such_module",))
    tell_what_was_left_out("docs/howto/policies.md", thorough=False)
    with pytest.raises(pytest.skip.Exception, match=r"line \d+, which needs the extra rllib"):
        tell_what_was_left_out("docs/howto/policies.md", thorough=True)


def test_a_page_whose_block_fails_is_noticed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```python\nx = 1\n```\n\n```python\nassert x == 2\n```\n", encoding="utf-8")
    with pytest.raises(AssertionError, match=r"page\.md"):
        run(page, tmp_path)


@pytest.mark.parametrize("name", PAGES)
def test_every_block_says_what_it_is(name: str) -> None:
    for block in blocks_of(name):
        assert block.language in LANGUAGES | DIRECTIVES, f"{name}:{block.line}"
        if block.language in LANGUAGES:
            assert set(block.words) <= WORDS, f"{name}:{block.line}"
            assert block.words.get("extra", "sb3") in NEEDED
        assert block.words.get("by-hand") != "", f"{name}:{block.line}: no reason"
        if block.language == "text" and "output" not in block.words:
            commands = re.findall(r"^(?:\$ )?(?:desim-uav|pip|python|pytest) ", block.text, re.M)
            assert not commands, f"{name}:{block.line}: commands belong into a block of sh"


@pytest.mark.parametrize("name", PAGES)
def test_install_commands_name_a_checkout_and_an_extra_that_exists(name: str) -> None:
    text = PAGES[name].read_text(encoding="utf-8")
    assert "desim-uav[" not in text
    for command in re.findall(r"pip install [^`\n]*\[[^`\n]*\"", text):
        words = command.replace('"', "").split()
        assert set(extras_of(words[:4])) <= set(optional_dependencies()), command


@pytest.mark.parametrize("folder", ["desim_uav", "analysis", "benchmarks", "policies"])
def test_messages_install_from_a_checkout(folder: str) -> None:
    """There is no release yet: ``pip install desim-uav[…]`` would find another package or none."""
    sources = [*(ROOT / folder).rglob("*.py")]
    assert sources and not [p for p in sources if "desim-uav[" in p.read_text(encoding="utf-8")]


def test_the_readme_is_short() -> None:
    assert len(README.split()) <= 900


def test_the_two_commands_of_the_readme() -> None:
    assert re.findall(r"^pip install -e .* && .*$", README, re.MULTILINE) == [
        "pip install -e . && desim-uav run case8",
        'pip install -e ".[test]" && pytest -n auto',
    ]


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_links_of_pages_outside_the_site_lead_somewhere(name: str) -> None:
    for link in re.findall(r"\]\(([^)#]+)", PAGES[name].read_text(encoding="utf-8")):
        assert link.startswith("https://") or (ROOT / link).exists(), link


def test_the_sidebar_of_the_front_page_is_short() -> None:
    """What stands in the toctrees of the front page is visible there; pages below them are not."""
    text, docs = PAGES["docs/index.md"].read_text(encoding="utf-8"), ROOT / "docs"
    lines = [line for block in blocks(text) for line in block.text.splitlines()]
    named = [line for line in lines if re.fullmatch(r"[\w/*]+", line)]
    shown = [page for name in named for page in docs.glob(f"{name}.md")]
    assert len(named) <= len(shown) <= 40


def words_in(page: Path) -> int:
    """Return the words and numbers of a page, without the bars between the cells of tables."""
    return len(
        [part for part in page.read_text(encoding="utf-8").split() if re.search(r"\w", part)]
    )


@pytest.mark.parametrize(
    ("folders", "most"),
    [
        (("tutorials", "howto", "scenarios"), 33_000),
        (("explanation",), 24_500),
        (("design",), 5_300),
    ],
)
def test_pages_are_short(folders: tuple[str, ...], most: int) -> None:
    starts = tuple(f"docs/{folder}/" for folder in folders)
    pages_there = [page for name, page in PAGES.items() if name.startswith(starts)]
    assert sum(map(words_in, pages_there)) <= most


def test_the_pages_of_the_site_are_short_together() -> None:
    site = [page for name, page in PAGES.items() if name.startswith("docs/")]
    assert sum(map(words_in, site)) <= 86_000


FOLDERS = ("desim_uav", "tests", "analysis", "benchmarks", "policies", "scenarios", "docs")
SOURCES = {
    str(file.relative_to(ROOT)): file
    for folder in FOLDERS
    for file in (ROOT / folder).rglob("*")
    if "__pycache__" not in file.parts and "_build" not in file.parts
}
DESIGN = [
    *(name for name in PAGES if name.startswith("docs/design")),
    *("CONTRIBUTING.md", "docs/explanation/engines.md"),
]
"""The pages that describe the code."""


@cache
def words_of_the_code() -> tuple[set[str], dict[str, set[str]]]:
    """All words of the code, and those of each module or package by its name."""
    words, modules = set[str](), defaultdict[str, set[str]](set)
    for place, file in SOURCES.items():
        if file.suffix == ".py" and place != "tests/test_documentation.py":
            own = set(re.findall(r"\w+", file.read_text(encoding="utf-8")))
            words |= own | {file.stem}
            if place.startswith("desim_uav/"):
                modules[file.stem] |= own
                modules[file.parent.name] |= {file.stem, *own}
    return words, modules


def code_of_a_page(name: str) -> list[str]:
    """What stands in backticks in the text of a page, outside of its blocks."""
    text = re.sub(r"^```.*?^```", "", PAGES[name].read_text(encoding="utf-8"), flags=re.M | re.S)
    return re.findall(r"`([^`\n]+)`", text)


@pytest.mark.parametrize("name", DESIGN)
def test_the_files_that_a_page_about_the_code_names_exist(name: str) -> None:
    named = [code for code in code_of_a_page(name) if re.fullmatch(r"[\w/-]+(/|\.py|\.md)", code)]
    places = {f"/{place}" for place in SOURCES} | {f"/{folder}" for folder in FOLDERS}
    missing = [one for one in named if not any(p.endswith("/" + one.rstrip("/")) for p in places)]
    assert not missing


@pytest.mark.parametrize("name", DESIGN)
def test_the_names_in_a_page_about_the_code_exist(name: str) -> None:
    """A name of a module's is in this module, and any other one somewhere in the code."""
    known, modules = words_of_the_code()
    missing = []
    for code in code_of_a_page(name):
        if not re.fullmatch(r"[A-Za-z_][\w.]*(\(.*\))?", code) or code.endswith((".py", ".md")):
            continue
        words = code.partition("(")[0].split(".")
        there = set(words) <= known
        if len(words) > 2 and words[-2] in modules:
            there &= words[-1] in modules[words[-2]]
        missing += [] if there else [code]
    assert not missing


def test_the_page_of_the_engines_lists_all_files_of_rules() -> None:
    text = PAGES["docs/explanation/engines.md"].read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`\w+\.py`.*?) \|", text, re.MULTILINE)
    listed = [file for row in rows for file in re.findall(r"`(\w+\.py)`", row)]
    there = {file.name for file in (ROOT / "desim_uav/rules").glob("*.py")} - {"__init__.py"}
    assert sorted(listed) == sorted(there)


def test_the_kinds_of_figures_are_those_there_are() -> None:
    from desim_uav.experiment.plot import KINDS

    text = PAGES["docs/howto/report.md"].read_text(encoding="utf-8")
    (table,) = re.findall(r"^\| Kind .*?\n\n", text, re.MULTILINE | re.DOTALL)
    assert set(re.findall(r"^\| `(\w+) ", table, re.MULTILINE)) == set(KINDS)


@pytest.mark.parametrize(
    ("page", "file", "command"),
    [
        ("report", "case8.png", "python analysis/case_picture.py runs/picture docs/case8.png 0 20"),
        ("report", "policy.png", "desim-uav plot policy case8.npz -o docs/policy.png"),
        ("report", "replay.gif", "desim-uav video runs/learned --gif docs/replay.gif --speed 240"),
        ("radio", "radio.png", "desim-uav plot radio town.yaml -o docs/radio.png"),
    ],
)
def test_pictures_stand_beside_their_commands(page: str, file: str, command: str) -> None:
    assert command in PAGES[f"docs/howto/{page}.md"].read_text(encoding="utf-8")
    assert (ROOT / "docs" / file).stat().st_size < 1.5e6


def test_each_picture_of_the_front_page_has_its_command() -> None:
    text = PAGES["docs/index.md"].read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text)
    assert len(pictures) == 5
    for before, picture in zip(re.split(r"!\[", text), pictures, strict=False):
        last = blocks(before)[-1].text
        assert re.search(rf"(-o|--gif) {re.escape(picture)}\b", last), picture
        assert (ROOT / "docs" / picture).stat().st_size < (1e6 if ".gif" in picture else 4e5)


def test_the_picture_of_the_readme_is_one_of_the_site() -> None:
    (picture,) = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    assert (ROOT / picture).is_file()
    assert f"]({Path(picture).name})" in PAGES["docs/index.md"].read_text(encoding="utf-8")


def test_a_commit_is_checked_by_the_linters_that_contributors_are_told_of() -> None:
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    hooks = [hook for repo in yaml.safe_load(text)["repos"] for hook in repo["hooks"]]
    linters = next(block for block in blocks_of("CONTRIBUTING.md") if "ruff" in block.text)
    assert [hook["name"] for hook in hooks] == [
        line.removesuffix(" .").removesuffix(" --check") for line in linters.text.splitlines()
    ]
    assert all(hook["entry"].startswith(hook["name"]) for hook in hooks)
