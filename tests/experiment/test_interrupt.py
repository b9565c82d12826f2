"""A second Ctrl-C ends a command at once, even while machine code runs that never comes back."""

import importlib
import json
import os
import signal
import subprocess
import threading
import time
import weakref
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from desim_uav.experiment import interrupt
from desim_uav.experiment.interrupt import at_once, interruptible
from tests.command_line import program, with_plug_ins

PLUG_INS = '''
import time
from pathlib import Path
from types import SimpleNamespace

import numba

from desim_uav.model.mobility.mobility import Static
from desim_uav.rules.rewards import Coverage
from desim_uav.policies.hover import Hover


@numba.njit(nogil=True)
def endless(number):
    """Thousands of years of work."""
    for _ in range(1 << 62):
        number = number * 6364136223846793005 + 1442695040888963407
    return number


def get_stuck():
    if Path("reached").exists():
        return
    endless.compile("int64(int64)")
    Path("reached").touch()
    endless(1)


class Stuck(Hover):
    """Gets stuck in machine code in its third episode."""

    def begin(self, world, streams, carried=False):
        self.episode = getattr(self, "episode", -1) + 1
        if self.episode == 2:
            get_stuck()


class Large:
    """Its memory takes long to free, as that of millions of objects does."""

    def __del__(self, sleep=time.sleep):  # at Python's end the module has no names any more
        sleep(600)


class LargeAndStuck(Hover):
    """Is at work in Python code, without an end, in its third episode."""

    def begin(self, world, streams, carried=False):
        self.episode = getattr(self, "episode", -1) + 1
        if self.episode == 2:
            LargeAndStuck.large = Large()
            Path("reached").touch()
            while True:
                time.sleep(0.01)


class StuckOnSeedTwo(Hover):
    """Gets stuck in machine code in the world of seed 2."""

    def begin(self, world, streams, carried=False):
        if world.seed == 2:
            get_stuck()


class StuckWalks(Static):
    """Gets stuck in machine code while a scenario is checked."""

    def problems(self, users, area):
        get_stuck()


class StuckReward(Coverage):
    """Gets stuck in machine code in the third episode."""

    def pay(self, world, state, drone):
        StuckReward.calls = getattr(StuckReward, "calls", 0) + 1
        if StuckReward.calls == 2 * world.steps * len(state.drones) + 1:
            get_stuck()
        super().pay(world, state, drone)
'''


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    yield from with_plug_ins("stuck", PLUG_INS, tmp_path, monkeypatch)


def stopped(number, signals, *arguments):
    """The code and output of a command that got stuck and was then told to end so often."""
    process = subprocess.Popen(
        program(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    begun = time.monotonic()
    while not Path("reached").exists() and process.poll() is None:
        assert time.monotonic() < begun + 120
        time.sleep(0.05)
    for _ in range(signals):
        time.sleep(1.0)
        process.send_signal(number)
    try:
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    return process.returncode, out, err


def test_a_run_keeps_its_finished_episodes():
    code, out, err = stopped(
        signal.SIGINT, 2, "run", "tiny", "--policy", "stuck:Stuck", "--episodes", 9, "--json"
    )
    assert code == 130
    assert err.endswith(  # after what may be said of compiling
        "desim-uav: interrupted; the finished episodes are kept: runs/tiny-stuck-Stuck-s1 "
        "(--resume goes on)\n"
    )
    assert "Traceback" not in err
    folder = Path(json.loads(out)["run_dir"])
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]
    assert set(pd.read_parquet(folder / "requests.parquet")["episode"]) == {0, 1}


@pytest.mark.thorough
@pytest.mark.parametrize("command", ["validate", "run", "train"])
def test_the_checks_of_a_scenario_can_be_interrupted(command):
    """Machine code in a check was deaf to Ctrl-C."""
    walks = ("-S", "users.mobility={kind: 'stuck:StuckWalks'}")
    Path("some.yaml").write_text("name: some\n")
    code, out, err = stopped(signal.SIGINT, 1, command, "some.yaml", *walks)
    assert code == 130
    assert out == ""
    assert "Traceback" not in err


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_memory_of_a_run_is_not_waited_for(number):
    """The work that was left ends by itself here; only its memory would keep the process."""
    code, out, err = stopped(
        number, 2, "run", "tiny", "--policy", "stuck:LargeAndStuck", "--episodes", 9, "--json"
    )
    assert (code, json.loads(out)["episodes"]) == (130, 2), err


@pytest.mark.thorough
def test_sigterm_ends_a_run_too():
    code, out, _ = stopped(
        signal.SIGTERM, 2, "run", "tiny", "--policy", "stuck:Stuck", "--episodes", 9, "--json"
    )
    assert (code, json.loads(out)["episodes"]) == (130, 2)


@pytest.mark.thorough
def test_a_training_keeps_its_last_checkpoint():
    reward = ("-S", "reward={kind: 'stuck:StuckReward'}")
    flags = ("--episodes", 9, "--checkpoint-every", 1, "--out", "t")
    code, out, err = stopped(signal.SIGINT, 2, "train", "tiny", *reward, *flags)
    assert (code, out) == (130, "")
    *_, last = err.splitlines()  # before it: which engine is used, and why
    assert last == "desim-uav: interrupted; the last checkpoint is kept: --resume goes on from it"
    assert not [path.name for path in Path().iterdir() if path.name.startswith(".t")]
    done = subprocess.run(
        program("train", "tiny", "--out", "t", "--resume", *reward, *flags[:2], "--json"),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert json.loads(done.stdout)["episodes"] == 9


@pytest.mark.thorough
def test_a_comparison_shows_what_has_ended():
    code, out, err = stopped(
        signal.SIGINT,
        1,
        *("compare", "tiny", "--policies", "hover,stuck:StuckOnSeedTwo", "--seeds", 4),
        *("--episodes", 1, "--warmup", 0, "--json"),
    )
    assert code == 130
    assert err.endswith("desim-uav: interrupted; what had ended is shown\n")
    assert [row["seeds"] for row in json.loads(out)["policies"]] == [[0, 1, 2], [0, 1]]


@pytest.mark.thorough
def test_a_sweep_keeps_the_jobs_that_have_ended():
    code, _, err = stopped(
        signal.SIGINT,
        1,
        *("sweep", "tiny", "--policies", "hover,stuck:StuckOnSeedTwo", "--seeds", 4, "--out", "s"),
        *("--episodes", 1, "--warmup", 0, "-q"),
    )
    assert code == 130
    assert "interrupted; 5 of 8 jobs are kept; --resume goes on" in err
    assert len(list(Path("s/results").glob("[!.]*"))) == 5


class TestLeave:
    def test_a_further_ctrl_c_ends_at_once(self, monkeypatch):
        """The process would end with a traceback, while it waits for abandoned work."""
        codes = []

        def end(code):
            codes.append(code)
            raise SystemExit

        waited = SimpleNamespace(join=lambda s: signal.raise_signal(signal.SIGINT))
        monkeypatch.setattr(os, "_exit", end)
        monkeypatch.setattr(interrupt, "_left", [waited])
        with pytest.raises(SystemExit):
            interrupt.leave(1)
        assert codes == [130]

    def test_while_the_first_one_is_reported(self, capsys, monkeypatch):
        """Whatever the command: the code is that of an interruption, without a traceback."""
        module = importlib.import_module("desim_uav.cli.main")

        def interrupted(**_):
            raise KeyboardInterrupt

        monkeypatch.setattr(module, "_program", lambda: interrupted)
        monkeypatch.setattr(module, "leave", lambda code: None)
        monkeypatch.setattr(module.sys, "exit", end_once := Once(module.sys.exit))
        with pytest.raises(SystemExit) as ended:
            module.main()
        assert ended.value.code == 130 and end_once.disturbed


class Once:
    """A function that is interrupted when it is first called."""

    def __init__(self, function):
        self.function, self.disturbed = function, False

    def __call__(self, *arguments):
        if not self.disturbed:
            self.disturbed = True
            signal.raise_signal(signal.SIGINT)
        return self.function(*arguments)


class Fragile:
    """Is destroyed just when a signal comes."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


class Thing:
    """Tells when it is gone, as ``weakref.finalize`` does it."""

    def __init__(self):
        weakref.finalize(self, signal.raise_signal, signal.SIGINT)


@pytest.mark.parametrize("kind", [Fragile, Thing])
@pytest.mark.parametrize("noted", [False, True])
def test_a_signal_is_not_lost_while_an_object_is_destroyed(kind, noted, monkeypatch):
    """Python ignores what is raised in a destructor: a training went on after Ctrl-C."""
    stop, begun = interrupt.Stop("this"), time.monotonic()
    monkeypatch.setattr(stop, "_pending", True)
    signal.signal(signal.SIGINT, stop.note if noted else signal.default_int_handler)
    try:
        if not noted:
            interrupt.end_politely()
        with pytest.raises(KeyboardInterrupt):
            made = kind()
            del made
            time.sleep(60)
        assert time.monotonic() < begun + 30, "it wakes what waits, too"
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


class TestInterruptible:
    def test_items_come_as_they_are_asked_for(self):
        made = []

        def make():
            for k in range(3):
                made.append((k, threading.current_thread() is threading.main_thread()))
                yield k

        for k in interruptible(make()):
            assert made == [(j, False) for j in range(k + 1)]

    def test_what_goes_wrong_is_raised(self):
        def make():
            yield 1
            raise KeyError("boom")

        with pytest.raises(KeyError, match="boom"):
            list(interruptible(make()))

    def test_python_code_that_was_left_ends(self):
        """It does not go on behind the back of the main thread."""
        ended = threading.Event()

        def make():
            try:
                os.kill(os.getpid(), signal.SIGINT)
                while True:
                    time.sleep(0.01)
            finally:
                ended.set()

        with pytest.raises(KeyboardInterrupt):
            at_once(make)
        assert ended.wait(60)

    def test_outside_the_main_thread_nothing_is_handed_on(self):
        where = []
        thread = threading.Thread(
            target=lambda: where.append(at_once(threading.current_thread) is thread)
        )
        thread.start()
        thread.join()
        assert where == [True]
