"""What README and documentation say is so: their code blocks run, their commands exist."""

from __future__ import annotations

import os
import re
import subprocess
import sys
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
