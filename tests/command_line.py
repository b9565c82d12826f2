"""Commands as users give them, here or in a process of their own, and how they ended."""

import importlib
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from desim_uav import cli
from desim_uav.experiment import interrupt

ROOT = Path(__file__).parents[1]
START = "import sys; from desim_uav.cli import main; sys.exit(main())"
USUAL = {
    signal.SIGINT: signal.default_int_handler,
    **dict.fromkeys(
        (getattr(signal, name) for name in (*interrupt.ALWAYS[1:], *interrupt.UNLESS_USED)),
        signal.SIG_DFL,
    ),
}
"""What a signal does to a program that has just begun."""

IN_TROUBLE = '''
import os
import signal
import time
from pathlib import Path

from desim_uav.rules.admission import FirstCome
from desim_uav.policies.hover import Hover


class Own(FirstCome):
    """An admission rule that is not compiled."""

    def scan(self, waiting, free_hz):
        served = []
        for request in waiting:
            if request.needs_hz <= free_hz:
                free_hz -= request.needs_hz
                served.append(request)
        return served, ()


class OnSeedTwo(Hover):
    """Does something where the world is that of seed 2."""

    def begin(self, world, streams, carried=False):
        if world.seed == 2:
            self.do()


class Broken(OnSeedTwo):
    def do(self):
        raise KeyError("boom")


class Killed(OnSeedTwo):
    def do(self):
        os.kill(os.getpid(), signal.SIGKILL)


class Interrupted(OnSeedTwo):
    def do(self):
        os.kill(os.getpid(), signal.SIGINT)
'''
"""A module of policies that are in trouble on seed 2."""


AT_TIMES = re.compile(
    r"^desim-uav: (compiling the engine .*|compiled code cannot be kept on disk: .* too large|"
    r"[\d,]+ of [\d,]+ \w+)\n",
    re.MULTILINE,
)
"""What a command says only the first time, or on a slow machine: of compiling, of its progress."""


class Ended:
    """How a command ended: its exit code and what it printed, but for its progress."""

    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, AT_TIMES.sub("", err)

    @property
    def message(self):
        """What stands on stderr, without frames and line breaks."""
        return " ".join(re.sub(r"[│╭╮╰╯─|+]", " ", self.err).split())

    @property
    def json(self):
        def refuse(constant):
            raise AssertionError(f"{constant} is no JSON")

        return json.loads(self.out, parse_constant=refuse)

    def failed(self, code, *parts):
        """It ended with this code, one message with these parts, and nothing on stdout."""
        assert "Traceback" not in self.err
        assert (self.code, self.out) == (code, ""), self.err
        for part in parts:
            assert part in self.message, self.err
        return self


def program(*arguments):
    """A command in a process of its own."""
    return [sys.executable, "-c", START, *map(str, arguments)]


def elsewhere(*arguments, **options):
    """Run a command in a process of its own."""
    done = subprocess.run(
        program(*arguments), capture_output=True, text=True, timeout=120, check=False, **options
    )
    return Ended(done.returncode, done.stdout, done.stderr)


@contextmanager
def started(script, *arguments, **options):
    """Start a script of the checkout, and kill it at the end of the block if it is still there."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, str(script), *map(str, arguments)],
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options},
        env=os.environ | {"PYTHONPATH": path},
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def runner(capsys, monkeypatch):
    """What runs a command in this process."""

    module = importlib.import_module("desim_uav.cli.main")  # its name in ``cli`` is a function's
    monkeypatch.setattr(module, "leave", lambda code: None)  # it would end the tests' process

    def run(*arguments):
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["desim-uav", *map(str, arguments)])
        handlers = {number: signal.getsignal(number) for number in USUAL}
        try:
            with pytest.raises(SystemExit) as end:
                cli.main()
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
        return Ended(end.value.code or 0, *capsys.readouterr())

    return run


def with_plug_ins(name, text, tmp_path, monkeypatch):
    """An empty working folder, a module of this name that can be imported, signals as usual.

    For a fixture to yield from.
    """
    modules = tmp_path / "modules"
    modules.mkdir()
    (modules / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [*sys.path, str(modules)])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(modules)]))
    monkeypatch.setenv("COLUMNS", "300")
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    handlers = {number: signal.signal(number, handler) for number, handler in USUAL.items()}
    yield folder
    for number, handler in handlers.items():
        signal.signal(number, handler)
    sys.modules.pop(name, None)
