"""Sweeps on Ray: the rows are those of this machine alone, whoever dies meanwhile."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

pytest.importorskip("ray", reason='needs the extra ray: pip install -e ".[ray]"')

ROOT = Path(__file__).parents[2]
SWEEP = ("sweep", "tiny", "-S", "episode.steps=3,4", "--episodes", "2", "--warmup", "1")
SECONDS = 300
PLUG_INS = '''
import os
import signal
from pathlib import Path

from desim_uav.policies.hover import Hover


class DiesOnce(Hover):
    """Kills its process in the world of seed 2, but once only."""

    def begin(self, world, streams, carried=False):
        if world.seed == 2 and os.environ.get("RAY_JOB_ID") and not Path(DEAD).exists():
            Path(DEAD).touch()
            os.kill(os.getpid(), signal.SIGKILL)


class Broken(Hover):
    def begin(self, world, streams, carried=False):
        if world.seed == 2:
            raise KeyError("boom")


DEAD = str(Path(__file__).with_name("dead"))
'''
CLUSTER = """
import sys
from ray.cluster_utils import Cluster

cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
second = cluster.add_node(num_cpus=2)
print(cluster.address, flush=True)
sys.stdin.readline()
cluster.remove_node(second, allow_graceful=False)
print("one node less", flush=True)
sys.stdin.readline()
cluster.shutdown()
"""


@pytest.fixture
def desim_uav(tmp_path, monkeypatch):
    """Run a command in an empty folder, from which policies can be imported."""
    (tmp_path / "on_ray.py").write_text(PLUG_INS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name, value in {
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)]),
        "RAY_USAGE_STATS_ENABLED": "0",
    }.items():
        monkeypatch.setenv(name, value)

    def run(*arguments):
        command = [sys.executable, "-m", "desim_uav", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)

    return run


@pytest.fixture
def cluster(desim_uav):
    """Two nodes on this machine: their address, and what takes the second one down."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", CLUSTER], **pipes) as nodes:
        address = nodes.stdout.readline().strip()

        def lose_a_node():
            print(file=nodes.stdin, flush=True)
            assert nodes.stdout.readline() == "one node less\n"

        yield address, lose_a_node
        nodes.communicate("\n\n", timeout=60)


def dataset(out):
    return pd.read_parquet(Path(out) / "results").sort_values("job").reset_index(drop=True)


def test_the_rows_are_those_of_this_machine(desim_uav):
    flags = ("--policies", "random,on_ray:DiesOnce", "--seeds", 3, "-q")
    local = desim_uav(*SWEEP, *flags, "--out", "local")
    assert (local.returncode, local.stderr) == (0, "")
    on_ray = desim_uav(*SWEEP, *flags, "--out", "ray", "--backend", "ray")
    assert (on_ray.returncode, on_ray.stdout) == (0, ""), on_ray.stderr
    assert Path("dead").exists()
    pd.testing.assert_frame_equal(dataset("ray"), dataset("local"))
    again = desim_uav(*SWEEP, *flags, "--out", "ray", "--resume")
    assert "12 of 12 jobs had ended before" in again.stderr


def test_a_cluster_that_loses_a_node(desim_uav, cluster):
    address, lose_a_node = cluster
    train = ("--train", "--algorithm", "sarsa", "-S", "learning.episodes=400", "--seeds", 12, "-q")
    command = [sys.executable, "-m", "desim_uav", *SWEEP, *train, "--out", "ray"]
    command += ["--backend", "ray", "--address", address]
    with subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, text=True) as sweep:
        while sweep.poll() is None and len(list(Path("ray").glob("results/*.parquet"))) < 2:
            time.sleep(0.05)
        lose_a_node()
        _, said = sweep.communicate(timeout=SECONDS)
    assert (sweep.returncode, said) == (0, ""), said
    assert desim_uav(*SWEEP, *train, "--out", "local").returncode == 0
    pd.testing.assert_frame_equal(dataset("ray"), dataset("local"))
    for file in Path("local/policies").iterdir():
        assert (Path("ray/policies") / file.name).read_bytes() == file.read_bytes()


def test_a_failed_job_is_not_tried_again(desim_uav):
    flags = ("--policies", "hover,on_ray:Broken", "--seeds", 3, "-q", "-j", 2)
    ended = desim_uav(*SWEEP, *flags, "--out", "ray", "--backend", "ray")
    assert ended.returncode == 1 and "Traceback" not in ended.stderr
    assert "KeyError: 'boom'" in ended.stderr and "2 of 12 jobs failed" in ended.stderr
    assert len(dataset("ray")) == 10


def test_no_cluster_there(desim_uav):
    ended = desim_uav(*SWEEP, "--seeds", 1, "--out", "x", "--backend", "ray", "--address", "auto")
    assert ended.returncode == 2 and "Traceback" not in ended.stderr
    assert "--backend ray: --address auto: " in ended.stderr
    assert not Path("x").exists()


@pytest.fixture
def silent():
    """A port at which somebody listens who is no Ray cluster and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_somebody_else_at_the_address(desim_uav, silent: int):
    address = f"127.0.0.1:{silent}"
    words = (*SWEEP, "--seeds", 1, "--out", "x", "--backend", "ray", "--address", address)
    began = time.monotonic()
    ended = desim_uav(*words)
    assert ended.returncode == 2 and "Traceback" not in ended.stderr
    assert f"--address {address}: no Ray cluster answers there" in ended.stderr
    assert time.monotonic() - began < SECONDS / 2, "Ray alone takes a quarter of an hour"
    assert not Path("x").exists(), "the corrected command would be refused"


@pytest.mark.parametrize("address", ["127.0.0.1:1", "no-such-host.invalid:6379"])
def test_nobody_at_the_address(desim_uav, address: str):
    words = (*SWEEP, "--seeds", 1, "--out", "x", "--backend", "ray", "--address", address)
    ended = desim_uav(*words)
    assert ended.returncode == 2 and not Path("x").exists()
    assert f"--address {address}: no Ray cluster answers there: " in ended.stderr


@pytest.mark.parametrize("address", ["head", "head:port", ":6379", "head:99999"])
def test_what_is_no_address(desim_uav, address: str):
    ended = desim_uav(*SWEEP, "--out", "x", "--backend", "ray", "--address", address)
    assert ended.returncode == 2 and "write auto or HOST:PORT" in ended.stderr
