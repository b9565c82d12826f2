"""Tasks in processes: every result once, errors as they are, and no process left behind."""

import errno
import math
import multiprocessing as mp
import operator
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from desim_uav.errors import SimulationError
from desim_uav.experiment.processes import run_each, run_script
from tests.selection import by_default

ROOT = Path(__file__).parents[2]
AWKWARD = '''
class Awkward(Exception):
    """Cannot be sent: it needs two words, and is sent with one."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


def fail(number):
    raise Awkward(number, "more")
'''


@pytest.mark.parametrize("jobs", [1, 2, 9])
def test_every_result_once(jobs):
    tasks = [(base, 2) for base in range(5)]
    assert sorted(run_each(operator.pow, tasks, jobs)) == [(0, 0), (1, 1), (2, 4), (3, 9), (4, 16)]


@pytest.mark.parametrize("tasks", [[], [(4,)]])
def test_few_tasks_need_no_process(tasks):
    here = [pid for _, pid in run_each(lambda _: os.getpid(), tasks, 3)]
    assert here == [os.getpid()] * len(tasks)


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_comes_as_it_is(jobs):
    with pytest.raises(ValueError, match=r"math domain error|nonnegative"):
        list(run_each(math.sqrt, [(4.0,), (-1.0,), (9.0,)], jobs))


def test_an_error_that_cannot_be_sent_says_what_it_says(tmp_path, monkeypatch):
    (tmp_path / "awkward.py").write_text(AWKWARD, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    import awkward

    with pytest.raises(SimulationError, match="Awkward: 1 and more"):
        list(run_each(awkward.fail, [(1,), (1,)], 2))


def test_a_process_that_dies():
    with pytest.raises(SimulationError, match="a process has died"):
        list(run_each(os._exit, [(0,), (0,), (0,)], 2))


@pytest.mark.thorough
def test_the_others_go_on_where_somebody_hears_of_the_dead():
    tasks = [(0.0,), (-1.0,), (0.1,), (-2.0,), (0.2,)]
    ended = dict(run_each(exit_if_below_zero, tasks, 2, lambda reason: reason))
    assert all("a process has died" in ended.pop(number) for number in (1, 3))
    assert ended == {0: 0.0, 2: 0.1, 4: 0.2}


def exit_if_below_zero(number):
    return number if number >= 0 else os._exit(1)


WITHOUT_GUARD = (
    "from desim_uav.experiment.processes import run_each\n"
    "print(dict(run_each(abs, [(-1,), (2,)], 2)))\n"
)


@pytest.mark.parametrize(
    "how", by_default(["file", "stdin"], ["file", "stdin", "command", "guarded"])
)
def test_a_script_whose_processes_cannot_begin_is_told_why(how, tmp_path):
    """They run the script again, which would start processes again, or they do not find it."""
    file, (first, second) = tmp_path / "script.py", WITHOUT_GUARD.splitlines()
    guard = 'if __name__ == "__main__":\n    ' if how == "guarded" else ""
    file.write_text(f"{first}\n{guard}{second}\n", encoding="utf-8")
    arguments = {"stdin": ["-"], "command": ["-c", WITHOUT_GUARD]}
    done = subprocess.run(
        [sys.executable, *arguments.get(how, [file])],
        input=WITHOUT_GUARD if how == "stdin" else "",
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60,
        check=False,
    )
    if how in ("command", "guarded"):
        assert sorted(done.stdout) == sorted("{0: 1, 1: 2}\n") and not done.stderr
        return
    told = {"file": "under `if __name__", "stdin": "save it in a file"}[how]
    assert "UsageError" in done.stderr and told in done.stderr.splitlines()[-1]
    assert "memory" not in done.stderr and "freeze_support" not in done.stderr


def test_the_system_has_no_room_for_a_process(monkeypatch):
    def start(process):
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(mp.get_context("spawn").Process, "start", start)
    with pytest.raises(SimulationError, match=r"no further process can be started \(Resource"):
        list(run_each(abs, [(-1,), (2,)], 2))


def test_a_second_ctrl_c_leaves_no_process_behind(monkeypatch):
    """It comes while the processes are being ended after the first one."""
    killed = []

    kill_it = mp.get_context("spawn").Process.kill

    def kill(process):
        if not killed:
            signal.raise_signal(signal.SIGINT)
        killed.append(process)
        kill_it(process)

    monkeypatch.setattr(mp.get_context("spawn").Process, "kill", kill)
    with pytest.raises(KeyboardInterrupt), closing(run_each(abs, [(-1,), (2,)], 2)) as ended:
        next(ended)
        raise KeyboardInterrupt
    assert len(killed) == 2 and not any(process.is_alive() for process in killed)


def test_whoever_gets_the_results_may_stop():
    begun = time.monotonic()
    with closing(run_each(time.sleep, [(0,), (600,)], 2)) as ended:
        assert next(ended) == (0, None)
    assert time.monotonic() - begun < 60


def test_signals_are_heard_again():
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    list(run_each(abs, [(1,), (2,)], 2))
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


def test_nobody_outlives_a_parent_that_is_killed(tmp_path):
    """The second task goes on for long; it writes its process down first."""
    (tmp_path / "long.py").write_text(
        "import os, pathlib, time\n"
        "def wait(name):\n"
        "    pathlib.Path(name).write_text(str(os.getpid()))\n"
        "    time.sleep(600)\n"
    )
    code = (
        "import long\n"
        "from desim_uav.experiment.processes import run_each\n"
        "list(run_each(long.wait, [('a',), ('b',)], 2))\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    program = [sys.executable, "-c", code]
    process = subprocess.Popen(program, cwd=tmp_path, env=environment)
    pids = [pid_in(tmp_path / name) for name in ("a", "b")]
    process.kill()
    process.wait()
    for pid in pids:
        until(lambda pid=pid: not is_alive(pid))


def pid_in(file):
    until(lambda: file.exists() and file.read_text())
    return int(file.read_text())


def is_alive(pid):
    """Does it run? Where nobody fetches it, the dead stay listed."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(condition):
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() < begun + 60
        time.sleep(0.05)


ENDLESS = """
import os, sys, time
from pathlib import Path
Path(sys.argv[1]).write_text(str(os.getpid()))
time.sleep(600)
"""


def test_a_script_gives_its_code_and_what_it_says(tmp_path):
    script = tmp_path / "script.py"
    text = "import sys, beside\nprint(1)\nprint(sys.argv[1:], file=sys.stderr)\nsys.exit(3)\n"
    script.write_text(text, encoding="utf-8")
    (tmp_path / "beside.py").write_text("", encoding="utf-8")
    assert run_script([str(script), "a", "b"]) == (3, "['a', 'b']\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_script_ends_with_the_process_that_runs_it(number, tmp_path):
    """However that one ends: as little as SIGKILL does SIGTERM let Python clean up."""
    script, started = tmp_path / "endless.py", tmp_path / "started"
    script.write_text(ENDLESS, encoding="utf-8")
    program = (
        "import sys; from desim_uav.experiment import processes as p; p.run_script(sys.argv[1:])"
    )
    parent = subprocess.Popen([sys.executable, "-c", program, str(script), str(started)], cwd=ROOT)
    child = pid_in(started)
    assert is_alive(child)
    parent.send_signal(number)
    parent.wait(60)
    until(lambda: not is_alive(child))
