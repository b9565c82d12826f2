"""The benchmark from Python: the same as from the command line."""

import pytest

import desim_uav as du
from desim_uav.errors import PolicyError, UsageError

TASK = "uav-v1/coverage/small"


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_the_tasks():
    found = du.bench_list()
    assert TASK in [task["task"] for task in found["tasks"]]
    assert found["protocol"]["training_seeds"] == 10


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"policy": []}, "policy: give at least one"),
        ({"policy": "hover", "seeds": 33}, "seeds: 33: must be a whole number from 1 to 32"),
        ({"policy": "hover", "seeds": 11}, "seeds: 11: track one has 10"),
        ({"policy": "hover", "jobs": 0}, "jobs: 0: must be"),
        ({"policy": "hover", "training_steps": 0}, "training_steps: 0: must be"),
        ({"policy": "hover", "training_steps": 10**6 + 1}, "at most 1,000,000"),
        ({"policy": ["hover", "hover"]}, "one is given twice"),
        ({"policy": "hover", "track": "ani"}, "did you mean 'any'"),
    ],
)
def test_what_is_refused(arguments, said):
    with pytest.raises(UsageError, match=said):
        du.bench_run(TASK, **arguments)


def test_a_board_of_nothing():
    with pytest.raises(PolicyError, match="no such folder"):
        du.bench_board(["nothing"])


@pytest.mark.thorough
def test_a_submission_is_made_verified_and_ranked(tmp_path):
    one = du.bench_run(TASK, "baseline", seeds=1, out="base", progress=False)
    two = du.bench_run(TASK, ["hover", "random"], seeds=1, name="both", out="both", progress=False)
    assert one.rows[0]["qoe3_percent"] > two.rows[0]["qoe3_percent"]
    assert one.manifest["command"] == [
        f"desim_uav.bench_run('{TASK}', 'baseline', seeds=1, out='base')"
    ]
    assert du.bench_verify(two.folder, decide=True, progress=False) == []
    found = du.bench_board([one.folder, two.folder], out="page.md", figure="profiles.svg")
    (table,) = found.content()
    assert [row["policy"] for row in table["rows"]] == ["baseline", "both"]
    assert table["rows"][0]["score"]["value"] == 0
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == found.markdown()
    assert "</svg>" in (tmp_path / "profiles.svg").read_text(encoding="utf-8")
