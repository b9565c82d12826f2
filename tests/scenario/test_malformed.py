"""Every malformed file ends in a ScenarioError that says where, what, and what is allowed."""

import time
from pathlib import Path

import pytest

from desim_uav.errors import ScenarioError
from desim_uav.scenario.load import load, loads

FILES = sorted((Path(__file__).parent / "malformed").glob("*.yaml"))


def expectations(file: Path) -> list[str]:
    """One fragment a problem: from a sidecar, else from the first comments of the file."""
    sidecar = file.with_suffix(".expect")
    if sidecar.exists():
        return sidecar.read_text().splitlines()
    lines = file.read_text().splitlines()
    return [line.removeprefix("# expect: ") for line in lines if line.startswith("# expect: ")]


def located(fragment: str, file: Path) -> str:
    return f"{file}:{fragment}" if fragment[0].isdigit() else fragment


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_malformed_file(file: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(file)
    problems = list(caught.value.problems)
    expected = [located(fragment, file) for fragment in expectations(file)]
    assert expected
    for fragment in expected:
        matching = [problem for problem in problems if fragment in problem]
        assert matching, f"{fragment}\nis not in\n{caught.value}"
        problems.remove(matching[0])
    assert problems == []
    assert all(len(problem.splitlines()) == 1 for problem in caught.value.problems)
    assert caught.value.exit_code == 3


def test_there_are_many_of_them() -> None:
    assert len(FILES) >= 250


def test_problems_stand_in_the_order_of_the_file() -> None:
    file = next(file for file in FILES if file.stem == "ten_at_once")
    with pytest.raises(ScenarioError) as caught:
        load(file)
    assert len(caught.value.problems) >= 10
    lines = [int(p.removeprefix(f"{file}:").split(":")[0]) for p in caught.value.problems]
    assert lines == sorted(lines)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 20_000,
        "{a: " * 20_000,
        "- " * 20_000 + "x",
        "? " * 20_000 + "x",
        "\n".join(" " * depth + "a:" for depth in range(1_400)),
        "[\n" * 20_000,
    ],
    ids=["flow list", "flow mapping", "block list", "block key", "block mapping", "lines"],
)
def test_deep_nesting_is_one_quick_error(text: str) -> None:
    begin = time.perf_counter()
    with pytest.raises(ScenarioError) as caught:
        loads(text)
    assert time.perf_counter() - begin < 5
    deep = [
        problem for problem in caught.value.problems if "nested more than 50 levels deep" in problem
    ]
    assert len(deep) == 1
    assert len(caught.value.problems) <= 2


def test_a_flood_of_errors_is_cut_off() -> None:
    with pytest.raises(ScenarioError, match="and 1 more") as caught:
        loads("".join(f"&a{k} key{k}: 1\n" for k in range(101)))
    assert len(caught.value.problems) == 101


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    large = tmp_path / "large.yaml"
    large.write_text("#" * (2**20 + 1))
    for path, reason in [
        (tmp_path / "none.yaml", "no such file"),
        (tmp_path, "a folder, not a scenario file"),
        (large, "larger than 1 MiB"),
        ("a\0b", "neither a file nor a shipped scenario"),
    ]:
        with pytest.raises(ScenarioError, match=reason):
            load(path)


def test_long_values_are_shortened() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads("users: {count: " + "x" * 5_000 + "}")
    assert len(str(caught.value)) < 200


def test_line_breaks_in_values_stay_on_one_line() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads('"a\\nb\\u0085c": "x\\ny"\nseed: "\\n"')
    assert len(str(caught.value).splitlines()) == len(caught.value.problems) == 2
