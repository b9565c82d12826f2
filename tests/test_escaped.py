"""Text of others does nothing where it is written: in Markdown, CSV, SVG and a terminal."""

import csv
import io
import os
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

from desim_uav import errors, escaped, notices
from desim_uav.experiment.bench.board import markdown as board
from desim_uav.experiment.compare import Comparison, Replication
from desim_uav.report.figures.style import as_text, to_bytes
from tests.command_line import elsewhere, program

HOSTILE = (
    "\x1b]0;owned\x07",
    "\x1b[2J",
    "\u202egnp.exe",
    "a\nb\r| c",
    "[click](javascript:alert(1))",
    "![x](http://t/p.png)",
    "<img src=x onerror=alert(1)>",
    "&lt;script&gt;",
    "`code`",
    "**bold** _em_ ~~s~~ $x$",
    "https://evil.example www.evil.example",
    "\\[x](y)",
)


@pytest.mark.parametrize("text", HOSTILE)
def test_markdown(text):
    """Nothing is left that a renderer would act on, and the line stays one line."""
    written = escaped.markdown(text)
    assert written.isprintable()
    without = re.sub(r"\\[\\`*\[\]<>|~$&_:.]", "", written)
    assert not re.search(
        r"[\\`*\[\]<>|~$&]|https?:|www\.|(^|\W)_|_(\W|$)", without.replace("\\", "")
    )
    row = {"policy": text, "knows_future": False, "score": None, "information": text}
    row |= dict.fromkeys(("qoe1_percent", "qoe3_percent", "fairness", "decision_ms"))
    row |= dict.fromkeys(("crashes_per_drone_episode", "worst_tenth_qoe1_percent", "j_per_mbit"))
    row |= dict.fromkeys(("to_best", "better_than_best", "better_than_reference"))
    row |= {
        "trainings": None,
        "seeds": 10,
        "all_seeds": 10,
        "different_runs": 10,
        "checked": "claimed",
    }
    table = {"task": "t", "track": "one", "bounded": True, "scored": True, "measures": []}
    page = board([table | {"rows": [row]}])
    assert page.count(written) == 2 and page.count("\n") == 5
    assert all(line.isprintable() for line in page.splitlines())


def test_names_of_ours_stay_as_they_are():
    for name in (
        "q_learning",
        "ppo (radar)",
        "runs/x-1/policy.npz",
        "drones.count",
        "rollout:hover",
    ):
        assert escaped.markdown(name) == name


@pytest.mark.parametrize(
    ("text", "code"), [("a", "`a`"), ("a `b`", "`` a `b` ``"), ("`", "`` ` ``")]
)
def test_code_in_markdown(text, code):
    assert escaped.markdown_code(text) == code


@pytest.mark.parametrize("first", ["=", "+", "-", "@", "\t", "\r"])
def test_a_formula_in_csv(first):
    name = f'{first}HYPERLINK("http://t";"x")'
    comparison = Comparison("tiny", 1, 0, [name], name, [Replication(name, 1, 1, {"m": -0.5})])
    (row,) = csv.DictReader(io.StringIO(comparison.as_csv(), newline=""))
    assert (row["policy"], row["m"]) == (f"'{name}", "-0.5")


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("text", ["\x1b[2J", "\x00\x0b", "\u202egnp", "\uffff"])
def test_svg(text):
    figure = Figure()
    axes = figure.add_subplot()
    axes.set_title(text)
    axes.set_yticks([0.0], [text])
    root = ElementTree.fromstring(to_bytes(figure, ".svg"))
    assert "".join(root.itertext()).replace("\n", " ").isprintable()


def test_the_same_svg_whatever_its_clip_paths_are_called():
    """In some versions of Matplotlib their names depend on addresses in memory."""
    one = b'<clipPath id="p0123456789"/><clipPath id="pabcdefabcd"/><g a="url(#pabcdefabcd)"/>'
    other = one.replace(b"0123456789", b"9999999999").replace(b"abcdefabcd", b"0123456789")
    assert as_text(one) == as_text(other) != one.decode()
    assert as_text(one).count("i1") == 2


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "ascii"])
def test_an_encoding_that_lacks_characters(encoding, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr("sys.stdout", stream)
    notices.replace_lacking()
    notices.tell("≠ 0, ε, \x1b[2J")
    stream.flush()
    assert stream.buffer.getvalue() == b"? 0, ?, \\x1b[2J\n"


@pytest.mark.thorough
@pytest.mark.parametrize("encoding", ["latin-1", "cp1252"])
def test_a_command_on_such_a_terminal(encoding, tmp_path):
    flags = ("--policies", "hover,random", "--seeds", 3, "--episodes", 1)
    env = os.environ | {"PYTHONIOENCODING": f"{encoding}:strict"}
    done = subprocess.run(
        program("compare", "tiny", *flags), env=env, capture_output=True, cwd=tmp_path, check=False
    )
    assert (done.returncode, b"QoE3" in done.stdout) == (0, True), done.stderr


@pytest.mark.parametrize(
    "arguments",
    [("scenarios",), pytest.param(("--help",), marks=pytest.mark.thorough), ("validate", "none")],
)
def test_a_reader_who_has_seen_enough_is_no_failure(arguments):
    """The code is what it would be otherwise."""
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(program(*arguments), stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert done.returncode == (3 if "none" in arguments else 0)
    assert b"Traceback" not in done.stderr and b"Exception ignored" not in done.stderr


def test_nobody_reads_the_progress(monkeypatch):
    """A run is not lost because of that."""

    class Closed(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    monkeypatch.setattr("sys.stderr", Closed())
    errors.notice("1 of 2 episodes")


@pytest.mark.thorough
def test_a_folder_with_a_hostile_name(tmp_path):
    """``bench verify *`` names it."""
    place = tmp_path / "a\x1b[2Jb"
    place.mkdir()
    ended = elsewhere("bench", "verify", place)
    assert ended.code == 4 and "\x1b" not in ended.err + ended.out
    assert Path(place).exists()
