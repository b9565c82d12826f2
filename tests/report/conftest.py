"""Runs and trainings that several figures are drawn of."""

import pytest

from tests.report.helpers import make_run, make_training

SMALL = ("users.count=16", "episode.steps=12")


@pytest.fixture(scope="session")
def flown(tmp_path_factory):
    """Random flights of two episodes after a warm-up, with returns, charges, queues and crashes."""
    overrides = ("users.count=16", "drones.battery.autonomy_min=20", "stations.count=1")
    overrides += ("drones.battery.return_below=0.9",)
    folder = tmp_path_factory.mktemp("flown") / "run"
    return make_run(folder, "case8", "random", overrides, episodes=2, warmup=1)


@pytest.fixture(scope="session")
def bare(flown, tmp_path_factory):
    """The same without events."""
    folder = tmp_path_factory.mktemp("bare") / "run"
    folder.mkdir()
    for file in flown.iterdir():
        if file.name not in ("events.parquet", "legs.parquet"):
            (folder / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.fixture(scope="session")
def flat(tmp_path_factory):
    """A flat map, without batteries."""
    return make_run(tmp_path_factory.mktemp("flat") / "run", "tiny", "baseline")


@pytest.fixture(scope="session")
def seeds(tmp_path_factory):
    """Two policies on three seeds, a run each."""
    where = tmp_path_factory.mktemp("seeds")
    return [
        make_run(where / f"{policy}{seed}", "case8", policy, (*SMALL, f"seed={seed}"))
        for policy in ("hover", "baseline")
        for seed in range(3)
    ]


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """Two algorithms on two seeds, a training of sixty episodes each."""
    where = tmp_path_factory.mktemp("trained")
    return [
        make_training(
            where / f"{algorithm}{seed}",
            "case4",
            (
                *("users.count=12", "episode.steps=8", "learning.episodes=60"),
                *(f"learning.algorithm={algorithm}", f"seed={seed}", "world_seed=0"),
            ),
        )
        for algorithm in ("q_learning", "sarsa")
        for seed in range(2)
    ]
