"""What must hold before anything is published, and that it is refused until then."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import desim_uav

ROOT = Path(__file__).parents[1]
FILES = (
    "README.md",
    "publish.toml",
    "CITATION.cff",
    "CHANGELOG.md",
    "pyproject.toml",
    "desim_uav/__init__.py",
)
FILLED = {
    "repository": "https://forge.test/owner/desim-uav",
    "documentation": "https://owner.test/desim-uav",
    "contact": "somebody@owner.test",
    "doi": "10.1234/archive.567",
}


def script() -> Any:
    spec = importlib.util.spec_from_file_location("release", ROOT / ".ci" / "release.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RELEASE = script()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The files of a checkout that are ready but for the addresses."""
    for name in FILES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    edit(tmp_path / "CHANGELOG.md", "(unreleased)", "(2027-01-31)")
    edit(tmp_path / "CITATION.cff", "license:", "date-released: 2027-01-31\nlicense:")
    return tmp_path


def edit(file: Path, before: str, after: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert before in text
    file.write_text(text.replace(before, after, 1), encoding="utf-8")


def fill_in(root: Path, **values: str) -> None:
    lines = [f'{key} = "{value}"' for key, value in {**FILLED, **values}.items()]
    (root / "publish.toml").write_text("\n".join(lines), encoding="utf-8")


def problems(root: Path, capsys: pytest.CaptureFixture[str], verb: str = "check") -> list[str]:
    code = RELEASE.main([verb], root)
    lines = capsys.readouterr().err.splitlines()
    assert code == bool(lines)
    return [line.partition(": ")[0] + ": " + line.split(": ")[1] for line in lines]


def test_this_checkout_is_not_published_by_accident(capsys: pytest.CaptureFixture[str]):
    assert RELEASE.main(["check"], ROOT) == 1
    assert "publish.toml: doi: it has to be filled in" in capsys.readouterr().err


def test_what_is_filled_in_once_stands_everywhere(copy: Path, capsys: pytest.CaptureFixture[str]):
    fill_in(copy)
    assert set(problems(copy, capsys)) == {
        *(
            f"CITATION.cff: {key} is not that of publish.toml; run .ci/release.py fill"
            for key in ("repository-code", "url", "doi")
        ),
        *(
            f"pyproject.toml: {key} is not that of publish.toml; run .ci/release.py fill"
            for key in ("repository", "documentation")
        ),
    }
    for _ in "twice":
        assert problems(copy, capsys, "fill") == []
        assert problems(copy, capsys) == []
    cited = yaml.safe_load((copy / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["doi"] == FILLED["doi"]
    assert cited["repository-code"] == FILLED["repository"]
    project = tomllib.loads((copy / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["urls"] == {
        "Repository": FILLED["repository"],
        "Documentation": FILLED["documentation"],
    }
    fill_in(copy, doi="10.1234/archive.568")
    assert problems(copy, capsys, "fill") == []
    assert "archive.567" not in (copy / "CITATION.cff").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("key", "value"),
    [("repository", "forge.test/owner"), ("contact", "nobody"), ("doi", "https://doi.test/10.1")],
)
def test_what_is_no_address(copy: Path, key: str, value: str, capsys: pytest.CaptureFixture[str]):
    fill_in(copy, **{key: value})
    assert problems(copy, capsys, "fill") == [f"publish.toml: {key}"]


@pytest.mark.parametrize(
    ("file", "before", "after", "problem"),
    [
        (
            "desim_uav/__init__.py",
            '__version__ = "',
            '__version__ = "9',
            "CITATION.cff: its version",
        ),
        ("CHANGELOG.md", "(2027-01-31)", "(unreleased)", "CHANGELOG.md: there is no heading"),
        (
            "CITATION.cff",
            "date-released: 2027-01-31\n",
            "",
            "CITATION.cff: there is no date-released",
        ),
    ],
)
def test_what_was_forgotten(
    copy: Path, file: str, before: str, after: str, problem: str, capsys: pytest.CaptureFixture[str]
):
    fill_in(copy)
    assert problems(copy, capsys, "fill") == []
    edit(copy / file, before, after)
    assert any(line.startswith(problem) for line in problems(copy, capsys))


def test_links_of_the_readme_name_files_of_the_version(copy: Path):
    """A package index shows the README without the files beside it."""
    assert RELEASE.main(["links"], copy) == 1  # nothing is filled in
    fill_in(copy)
    there = (copy / "README.md").read_text(encoding="utf-8")
    at, version = FILLED["repository"], desim_uav.__version__
    for _ in "twice":
        assert RELEASE.main(["links"], copy) == 0
        text = (copy / "README.md").read_text(encoding="utf-8")
        assert f"]({at}/raw/v{version}/docs/replay.gif)" in text
        assert f"[Speed]({at}/blob/v{version}/docs/speed.md)" in text
        assert {link.partition(":")[0] for link in re.findall(r"\]\(([^)]+)\)", text)} == {"https"}
    assert len(re.findall(r"\]\(", text)) == len(re.findall(r"\]\(", there)) > 10


def test_other_words_are_refused(capsys: pytest.CaptureFixture[str]):
    assert RELEASE.main(["publish"]) == 2
    assert "usage" in capsys.readouterr().err


def test_the_version_stands_once():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert RELEASE.version_of(ROOT) == desim_uav.__version__


def test_the_forge_runs_what_the_readme_says():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^pip install -e .* && .*$", readme, re.MULTILINE)
    workflow = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8"))
    steps = workflow["jobs"]["tests"]["steps"]
    assert [step["run"] for step in steps if "run" in step] == commands[:2]
    classifiers = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for version in workflow["jobs"]["tests"]["strategy"]["matrix"]["python"]:
        assert f"Python :: {version}" in classifiers


def test_files_of_the_forge_can_be_read():
    for file in [*(ROOT / ".github").rglob("*.yml")]:
        assert yaml.safe_load(file.read_text(encoding="utf-8")), file
    json.loads((ROOT / ".devcontainer/devcontainer.json").read_text(encoding="utf-8"))
