"""``desim_uav.compare`` and ``compare_runs``: frames, names and policies of any kind."""

import csv
import io
from pathlib import Path

import pytest

import desim_uav as du
from desim_uav.errors import PolicyError, UsageError
from desim_uav.policies.hover import Hover


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def east(observation, mask):
    return "right"


HOW = {"seeds": 3, "episodes": 2, "warmup": 1}


@pytest.fixture(scope="module")
def found():
    return du.compare("case8", {"users.count": 12}, policies=["hover", "random"], **HOW)


class TestFrames:
    @pytest.mark.thorough
    def test_one_row_per_policy_and_seed(self, found):
        frame = found.frame
        assert frame["policy"].tolist() == ["hover"] * 3 + ["random"] * 3
        assert frame["seed"].tolist() == [0, 1, 2] * 2
        alone = du.run("case8", {"users.count": 12}, policy="random", seeds=3, episodes=2, warmup=1)
        for name in ("qoe1_percent", "qoe3_percent", "reward_mean"):
            of_random = frame[frame["policy"] == "random"].set_index("seed")[name]
            assert of_random.tolist() == alone.qoe("seed")[name].tolist()

    def test_estimates_and_differences(self, found):
        means = found.frame.groupby("policy")["qoe3_percent"].mean()
        row = found.estimates.loc[("qoe3_percent", "random")]
        assert row["mean"] == pytest.approx(means["random"])
        assert row["low"] < row["mean"] < row["high"]
        row = found.differences.loc[("qoe3_percent", "random")]
        assert row["mean"] == pytest.approx(means["random"] - means["hover"])
        assert "hover" not in found.differences.index.get_level_values("policy")

    def test_a_notebook_shows_both_tables(self, found):
        shown = found._repr_html_()
        assert shown.count("<table>") == 2
        assert "difference from hover, paired by seed" in shown

    def test_the_values_of_each_seed_as_csv(self, found):
        assert found.save("values/all.csv") == Path("values/all.csv")
        rows = list(csv.DictReader(io.StringIO(Path("values/all.csv").read_text())))
        assert [row["seed"] for row in rows] == ["0", "1", "2"] * 2


class TestPolicies:
    def test_a_mapping_names_them(self):
        policies = {"still": Hover, "east": east, "also still": lambda o, m: "hover"}
        found = du.compare("tiny", policies=policies, against="still", **HOW)
        assert found.policies == ["still", "east", "also still"]
        difference = found.differences.loc[("qoe3_percent", "also still")]
        assert (difference["mean"], difference["excludes_zero"]) == (0, False)

    def test_a_training_is_compared(self):
        trained = du.train("tiny", episodes=3)
        how = {"policies": [trained, "hover"], "seeds": 2, "episodes": 1}
        found = du.compare("tiny", world_seed=1, **how)
        assert found.policies == ["q_learning-s1", "hover"]
        assert found.frame["world_seed"].tolist() == [1] * 4
        with pytest.warns(du.DesimWarning, match="learned in world 1") as caught:
            du.compare("tiny", **how)
        assert caught[0].filename == __file__

    @pytest.mark.thorough
    def test_in_processes_of_their_own(self):
        found = du.compare("tiny", policies=["hover", Hover()], jobs=2, **HOW)
        alone = du.compare("tiny", policies=["hover", Hover()], **HOW)
        assert found.rows() == alone.rows()

    @pytest.mark.parametrize(
        ("policies", "options", "error", "part"),
        [
            ([], {}, UsageError, "the list is empty"),
            ("hover", {}, UsageError, "policies: 'hover': must be a sequence of"),
            (["hover", "hover"], {}, UsageError, "twice"),
            (["hover", "hoover"], {}, PolicyError, "hoover"),
            ({"mine": lambda o, m: 0}, {"jobs": 2}, UsageError, "cannot be sent"),
            (["hover"], {"jobs": 0}, UsageError, "jobs: 0"),
            (["hover"], {"world_seed": -1}, UsageError, "world_seed: -1: must be a whole number"),
            (["hover"], {"against": "random"}, UsageError, "against: random: "),
            (["hover"], {"overrides": {"seed": 3}}, UsageError, "override seed: each replication"),
        ],
    )
    def test_what_cannot_be_compared(self, policies, options, error, part):
        with pytest.raises(error) as caught:
            du.compare("tiny", policies=policies, **options)
        assert part in str(caught.value)


def test_no_measure_stands_for_the_default():
    found = du.compare("tiny", policies=["hover", "random"], measure=[], **HOW)
    usual = du.compare("tiny", policies=["hover", "random"], **HOW)
    assert found.measures == usual.measures != ()
    assert found.plot(measure=[]).axes


def test_finished_runs():
    for policy in ("hover", "random"):
        du.run("case8", {"users.count": 12}, policy=policy, seeds=2, out=policy)
    folders = [f"{policy}/s{seed}" for policy in ("hover", "random") for seed in (0, 1)]
    found = du.compare_runs(folders, against="random", out="values.csv")
    assert found.frame["seed"].tolist() == [0, 1, 0, 1]
    assert found.against == "random"
    assert Path("values.csv").is_file()
