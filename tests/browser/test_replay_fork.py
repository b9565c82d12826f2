"""The replay of a counterfactual: its branches side by side, and where they part."""

import pytest

import desim_uav as du

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def forked(tmp_path_factory):
    """The page of both branches, which part after 12 steps of episode 1."""
    out = tmp_path_factory.mktemp("fork") / "out"
    du.counterfactual(
        "case8", policy="baseline", to="hover", fork=(1, 12), episodes=3, out=out, progress=False
    )
    return du.write_replay(out, progress=False).file


def both(page):
    return [page.run("return replay.state(arguments[0])", k) for k in (0, 1)]


def places(state):
    return [(drone["x_m"], drone["y_m"]) for drone in state["drones"]]


def test_the_common_past_is_shown_as_common(page, forked):
    page.open(forked, size=(1400, 900))
    assert page.run("return replay.episodes") == [1, 2]
    assert page.run("return replay.runs") == ["baseline", "baseline, then hover"]
    page.seek(1, 700)
    one, other = both(page)
    assert one == other
    assert "so far the same" in page.text("caption-1")
    assert "so far the same" not in page.text("caption-0")
    page.picture("fork-before")
    page.seek(1, 800)
    one, other = both(page)
    assert places(one) != places(other)
    assert "so far the same" not in page.text("caption-1")
    page.picture("fork-after")
    page.seek(2, 0)
    assert "so far the same" not in page.text("caption-1")


def test_runs_without_a_fork_say_nothing_of_it(page, forked, tmp_path):
    for policy in ("baseline", "hover"):
        du.run("tiny", policy=policy, events=True, out=tmp_path / policy, progress=False)
    file = du.write_replay(tmp_path / "baseline", beside=tmp_path / "hover", progress=False).file
    page.open(file, size=(1400, 900))
    assert "so far the same" not in page.text("caption-0") + page.text("caption-1")
