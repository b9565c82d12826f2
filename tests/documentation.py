"""Runs the code blocks of a page of the documentation, in order, in the current folder.

    python -m tests.documentation PAGE [--thorough]

What a block needs stands behind its language, where Markdown shows nothing of it:

    sh, python      is run; the Python blocks of a page share their names
    sh thorough     is run with --thorough only
    python extra=sb3        is run if the packages of this extra are installed
    python file=north.py    is written to a file instead (yaml: as well)
    sh by-hand="reason"     is not run
    text output     stands in what the last command printed
    yaml            is a valid scenario
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
LANGUAGES = {"python", "sh", "text", "yaml"}
WORDS = {"by-hand", "extra", "file", "output", "same-as-preset", "thorough"}
DIRECTIVES = {"{code-cell}", "{eval-rst}", "{include}", "{toctree}"}
"""What the build of the site runs or resolves by itself."""

NEEDED = {
    "benchmarl": ("benchmarl",),
    "optuna": ("optuna",),
    "torch": ("torch",),
    "ray": ("ray",),
    "rllib": ("ray.rllib", "tree", "torch"),  # Ray alone has the first of them
    "sb3": ("sb3_contrib",),
    "tensorboard": ("tensorboard",),
    "torchrl": ("torchrl",),
    "video": ("imageio_ffmpeg",),
}
"""Modules of each extra that blocks may ask for."""

LINKED = ("analysis", "benchmarks", "policies", "scenarios")
"""Folders of the checkout that commands name; they are linked, ``docs`` is not."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the words behind it, its text and the line it begins at."""

    language: str
    words: dict[str, str]
    text: str
    line: int

    @property
    def runs(self) -> bool:
        """Does anything come of it in a run?"""
        return "by-hand" not in self.words

    @property
    def missing(self) -> str:
        """The extra without which it cannot be run here, or nothing."""
        extra = self.words.get("extra", "")
        return extra if extra and not installed(extra) else ""


def pages() -> list[Path]:
    """Every page a person reads."""
    within = (ROOT / "docs").rglob("*.md")
    made = [page for page in within if not {"_build", "_generated"} & set(page.parts)]
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(made)]


def blocks(text: str) -> list[Block]:
    """The fenced blocks of a page."""
    found = []
    for fence in re.finditer(r"^(```+)([^\n]*)\n(.*?)^\1 *$", text, re.MULTILINE | re.DOTALL):
        language, _, rest = fence[2].strip().partition(" ")
        words = dict(word.partition("=")[::2] for word in shlex.split(rest))
        line = text.count("\n", 0, fence.start()) + 1
        found.append(Block(language, words, fence[3], line))
    return found


def commands(text: str) -> Iterator[list[str]]:
    """The commands of a shell block, comments left out."""
    for line in text.splitlines():
        for part in line.split(" && "):
            words = shlex.split(part, comments=True)
            if words:
                yield words


class Page:
    """The blocks of a page, as they are run."""

    def __init__(self, path: Path, thorough: bool) -> None:
        self.path, self.thorough = path, thorough
        self.names: dict[str, object] = {"__name__": path.stem}
        self.printed = ""

    def run(self) -> None:
        """All blocks in order. Raises what a block raises, AssertionError for a failed command."""
        for block in blocks(self.path.read_text(encoding="utf-8")):
            if block.runs and self.wanted(block):
                print(f"{self.path.name}:{block.line}: {block.language}", flush=True)
                self.run_block(block)

    def wanted(self, block: Block) -> bool:
        """Is it run this time?"""
        return not block.missing and (self.thorough or "thorough" not in block.words)

    def run_block(self, block: Block) -> None:
        if "file" in block.words:
            Path(block.words["file"]).write_text(block.text, encoding="utf-8")
        if block.language == "yaml":
            check_scenario(block)
        elif "file" in block.words:
            return
        elif block.language == "python":
            text = "\n" * block.line + block.text  # and not this module's future imports
            code = compile(text, str(self.path), "exec", dont_inherit=True)
            exec(code, self.names)
        elif block.language == "sh":
            for command in commands(block.text):
                self.run_command(command)
        elif "output" in block.words:
            for line in block.text.splitlines():
                assert as_words(line) in as_words(self.printed), f"not printed: {line}"

    def run_command(self, words: list[str]) -> None:
        program, *arguments = words
        if program == "desim-uav":
            self.printed = run_here(words)
        elif program == "python":
            done = subprocess.run([sys.executable, *arguments], check=False)
            assert done.returncode == 0, words
        elif program == "pip":
            assert set(extras_of(words)) <= set(optional_dependencies()), words
        elif program == "pytest":
            files = [word.partition("::")[0] for word in arguments if word.startswith("tests/")]
            assert all((ROOT / file).exists() for file in files), words
        else:
            raise AssertionError(f"{program}: no block may run this")


def check_scenario(block: Block) -> None:
    """A scenario is valid, and one that says what a preset does is the same."""
    from desim_uav.scenario.load import loads, to_plain

    found = loads(block.text, base=Path())
    if "same-as-preset" in block.words:
        preset = loads("name: as_in_the_paper\npreset: paper")
        assert to_plain(found) | {"preset": "paper"} == to_plain(preset)


def run_here(words: list[str]) -> str:
    """What a command prints, run in this process. It has to succeed."""
    from desim_uav import cli

    sys.argv = words
    printed = io.StringIO()
    code: object = None
    with contextlib.redirect_stdout(printed):
        try:
            cli.main()
        except SystemExit as end:
            code = end.code
    text = printed.getvalue()
    print(text)
    assert code in (0, None), f"{shlex.join(words)}: exit code {code}"
    return text


def as_words(text: str) -> str:
    return " ".join(text.split())


def installed(extra: str) -> bool:
    """Are the packages of an extra here?"""
    try:
        return all(find_spec(module) is not None for module in NEEDED[extra])
    except ModuleNotFoundError:
        return False


def extras_of(words: list[str]) -> list[str]:
    """The extras that ``pip install`` asks for, of a checkout."""
    assert words[1:3] == ["install", "-e"] and words[3].startswith("."), words
    return re.findall(r"[\w-]+", words[3])


def optional_dependencies() -> dict[str, list[str]]:
    """The extras there are."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: dict[str, list[str]] = project["optional-dependencies"]
    return found


if __name__ == "__main__":
    sys.path.insert(0, "")
    Page(Path(sys.argv[1]), "--thorough" in sys.argv).run()
