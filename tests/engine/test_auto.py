"""The engine called auto: it begins as what is there, changes once, and starts one compiler."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import desim_uav as du
from desim_uav.engine import ahead, choose, compiler
from desim_uav.engine.ahead import AHEAD, MARK, SWITCH, TRIES, Ahead, Lock
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import faster, first_of, look_ahead, make_engine
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.env import UavEnv, UavParallelEnv
from desim_uav.env.compiled import CompiledSession
from desim_uav.experiment import doctor
from desim_uav.rowcode import compiled_apart
from desim_uav.rowcode.kernels import CodeFile, NotOnDiskError, kernel, only_from_disk
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import some_command
from tests.env.test_vector import assert_same

CONFIG = {"episode.steps": 6}
SETTINGS = RunSettings((True,) * 3, carry_over=True)

ASLEEP = """
import sys
from desim_uav.engine import compiler
compiler._be_humble()
import socket, threading, time
line = socket.socket(fileno=int(sys.argv[1]))
threading.Thread(target=compiler._watch, args=(line,), daemon=True).start()
time.sleep({seconds})
"""
"""In the place of a process that compiles: it takes so many seconds."""


def case8(**changes: Any) -> World:
    return build_world(load(scenario_path("case8")), 0) if not changes else _world(changes)


def _world(changes: dict[str, Any]) -> World:
    return build_world(from_mapping(changes), 0)


@pytest.fixture
def comes() -> Iterator[Callable[[bool], None]]:
    """Say whether machine code is on disk, without a process that compiles it."""
    with pytest.MonkeyPatch.context() as patch:

        def say(there: bool) -> None:
            def none(*_: Any) -> Any:
                raise NotOnDiskError(True)

            patch.setattr(Ahead, "has_news", lambda self, worlds: there)
            patch.setattr(choose, "only_from_disk", nullcontext if there else none)

        yield say


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of machine code, in which processes may compile."""
    monkeypatch.setattr(ahead, "folder", lambda: tmp_path)
    monkeypatch.setenv(SWITCH, "1")
    return tmp_path


@pytest.fixture
def starts(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Ahead]]:
    """Return what stands for another process of the user's, whose compilers take some time."""
    made: list[Ahead] = []

    def start(seconds: float = 60.0) -> Ahead:
        monkeypatch.setattr(ahead, "PROGRAM", ASLEEP.format(seconds=seconds))
        monkeypatch.setattr(ahead, "PAUSE_S", 0.0)
        made.append(Ahead())
        return made[-1]

    yield start
    for one in made:
        if one.process is not None:
            one.process.kill()
            one.process.wait()
            one._forget()


class TestItChangesBetweenEpisodes:
    @staticmethod
    def played(env: Any, episodes: int, before: Callable[[int], Any]) -> list[Any]:
        """All that is told in some episodes of random allowed actions."""
        rng, told = np.random.default_rng(0), []
        for episode in range(episodes):
            env = before(episode) or env
            told.append([*env.reset(seed=5 if episode == 0 else None)])
            over = False
            while not over:
                masks = env.action_masks().reshape(3, -1)
                actions = [int(rng.choice(np.flatnonzero(mask))) for mask in masks]
                single = isinstance(env, UavEnv)
                one = env.step(actions if single else dict(zip(env.agents, actions, strict=True)))
                told.append([*one])
                over = one[2] or one[3] if single else not env.agents
        return told

    @pytest.mark.parametrize("make", [UavEnv, UavParallelEnv])
    def test_in_the_middle_of_a_loop_without_another_bit(self, make: Any, comes: Any):
        comes(False)
        env = make("case8", CONFIG, world_seed=0)
        met = []

        def before(episode: int) -> None:
            comes(episode == 2)
            met.append(type(env.session))

        told = self.played(env, 4, before)
        assert issubclass(met[3], CompiledSession) and not issubclass(met[2], CompiledSession)
        expected = self.played(
            make("case8", CONFIG, world_seed=0, engine="des"), 4, lambda episode: None
        )
        for one, other in zip(told, expected, strict=True):
            assert_same(dict(enumerate(one)), dict(enumerate(other)))

    def test_info_says_which(self, comes: Any):
        comes(False)
        env = UavEnv("case8", CONFIG)
        told = [env.reset(seed=1)[1]["compiled"]]
        comes(True)
        told += [env.step([0, 0, 0])[-1]["compiled"], env.reset()[1]["compiled"]]
        assert told == [0, 0, 1]

    def test_copies_and_saved_states_go_on(self, comes: Any):
        comes(False)
        env = UavEnv("case8", CONFIG)
        env.reset(seed=1)
        env.step([0, 1, 2])
        state = env.save()
        copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), *env.fork(1)]
        comes(True)
        for one in (env, *copies):
            one.reset()
            assert type(one.session) is CompiledSession
            observation, info = one.restore(state)
            assert (info["compiled"], info["sim_time_s"]) == (1, 60.0)
            assert_same({0: observation}, {0: copies[0].session.observation()})
        env.step([0, 0, 0])
        assert env.render_mode is None and env.screen.session is env.session

    def test_a_curriculum_waits_for_the_code_of_all_its_stages(self, comes: Any, monkeypatch: Any):
        comes(False)
        asked: list[int] = []
        news = lambda self, worlds: asked.append(len(worlds())) or False  # noqa: E731
        monkeypatch.setattr(Ahead, "has_news", news)
        env = UavEnv("case8", CONFIG, curriculum=[(2, {"users.count": 20})])
        env.reset(seed=0)
        assert asked == [2]

    def test_with_the_code_on_disk_it_is_compiled_at_once(self, comes: Any):
        comes(True)
        assert type(UavEnv("case8", CONFIG).session) is CompiledSession
        assert type(make_engine("auto", case8(), SETTINGS)) is BatchSimulation

    def test_a_run_says_who_has_played_what(self, comes: Any, tmp_path: Path):
        comes(False)
        calls = []

        def news(self: Ahead, worlds: Any) -> bool:
            calls.append(worlds)
            comes(True)
            return False

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Ahead, "has_news", news)
            mine = du.run("case8", CONFIG, episodes=3, out=tmp_path / "mine", progress=False)
        plain = du.run("case8", CONFIG, episodes=3, engine="des", progress=False)
        assert mine.manifests[0]["engine"] == "auto"
        assert mine.manifests[0]["played_by"] == {"des": 1, "batch": 2}
        assert plain.manifests[0]["played_by"] == {"des": 3}
        for table in ("requests", "steps", "episodes"):
            assert getattr(mine, table).equals(getattr(plain, table)), table


class TestWhatOnlyOneEngineHas:
    OWN: ClassVar = {
        "reward": {"reward": {"kind": "tests.engine.test_batch:Flat"}},
        "drones.admission": {"drones": {"admission": {"kind": "tests.engine.helpers:Loss"}}},
    }

    @pytest.mark.parametrize("key", OWN)
    def test_what_is_not_compiled_is_simpys_with_one_notice(self, key: str, folder: Path, capsys):
        choose._SAID.clear()
        worlds = [case8(**self.OWN[key]) for _ in range(2)]
        for world in worlds:
            engine = make_engine("auto", world, SETTINGS)
            assert type(faster("auto", engine)) is Simulation
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1
        assert said[0].startswith("desim-uav: the SimPy engine (des) is used, which is slower: ")
        assert f"{key}: " in said[0]
        assert not list(folder.iterdir())  # no process has been started

    def test_an_observation_that_only_simpy_has(self, folder: Path, capsys):
        choose._SAID.clear()
        config = {"observation": {"kind": "tests.env.test_parallel_vector:Shown"}}
        env = UavEnv("case8", config | CONFIG)
        env.reset(seed=0)
        assert (env.session.compiled, env.session.chooses) == (0, False)
        assert "observation: 'Shown' is not compiled" in capsys.readouterr().err
        assert not list(folder.iterdir())

    def test_without_a_place_for_machine_code_it_is_simpy(self, monkeypatch: Any):
        monkeypatch.setattr(choose, "folder", lambda: None)
        monkeypatch.setattr(ahead, "folder", lambda: None)
        monkeypatch.setenv(SWITCH, "1")
        world = case8()
        engine = make_engine("auto", world, SETTINGS)
        assert first_of(world) == "des"
        assert type(engine) is type(faster("auto", engine)) is Simulation
        assert AHEAD.process is None and ahead.at_work() is None


class TestOneCompiler:
    def test_is_started_once(self, starts: Any, monkeypatch: Any):
        one, other, worlds = starts(), starts(), list
        assert not one.has_news(worlds) and one.works()
        assert not other.has_news(worlds)
        assert other.process is None and other.waits_for_another
        number = one.process.pid
        assert not one.has_news(worlds) and one.process.pid == number
        assert ahead.at_work().startswith(f"{MARK} {number}, since ")
        (finding,) = [each for each in doctor.examine() if each.what == "compiling"]
        assert f"process {number}" in finding.words
        one.process.kill()
        one.process.wait()
        assert ahead.at_work() is None
        assert other.has_news(worlds)  # the other one's process has ended
        assert one.has_news(worlds) and one.process is None

    def test_is_not_started_for_ever(self, starts: Any, capsys):
        one, worlds = starts(seconds=0), list
        for _ in range(TRIES):
            assert not one.has_news(worlds)
            one.process.wait()
            assert one.has_news(worlds)  # but the code is not there
        assert not one.has_news(worlds) and one.gave_up and one.process is None
        assert "engine='batch' (--engine batch) compiles it" in capsys.readouterr().err
        assert not one.has_news(worlds)
        assert capsys.readouterr().err == ""

    def test_is_not_started_if_that_is_switched_off(self, starts: Any, monkeypatch: Any):
        monkeypatch.setenv(SWITCH, "0")
        one = starts()
        assert not one.has_news(list) and one.process is None
        monkeypatch.setattr(choose, "AHEAD", one)
        monkeypatch.setattr(choose, "compiled_before", lambda kernel: False)
        look_ahead("auto", case8())
        assert one.process is None

    @pytest.mark.parametrize("how", ["missing", "a link", "somebody's file"])
    def test_is_not_started_without_a_lock(self, how: str, starts: Any, folder: Path):
        if how == "missing":
            folder.rmdir()
        elif how == "a link":
            (folder / Lock.NAME).symlink_to(folder / "else")
        else:
            (folder / Lock.NAME).write_text("mine")
        one = starts()
        assert not one.has_news(list)
        assert one.gave_up and one.process is None
        if how == "somebody's file":
            assert (folder / Lock.NAME).read_text() == "mine"

    def test_is_not_started_for_what_cannot_be_told_to_it(self, starts: Any, capsys):
        one, unknown = starts(), SimpleNamespace(scenario=lambda: 0, seed=0)
        assert not one.has_news(lambda: [unknown])
        assert one.gave_up and one.process is None and ahead.at_work() is None
        assert "engine='batch'" in capsys.readouterr().err

    @pytest.mark.parametrize("end", ["killed", "interrupted", "over"])
    def test_ends_with_a_process_that_is_stopped_and_not_with_one_that_ends(
        self, end: str, folder: Path
    ):
        script = (
            "import sys, time\n"
            "from desim_uav.engine import ahead\n"
            "from pathlib import Path\n"
            "ahead.folder = lambda: Path(sys.argv[1])\n"
            f"ahead.PROGRAM = {ASLEEP.format(seconds=20)!r}\n"
            "ahead.AHEAD.has_news(list)\n"
            "print(ahead.AHEAD.process.pid, flush=True)\n"
            f"time.sleep({0 if end == 'over' else 60})\n"
        )
        process = subprocess.Popen(
            [sys.executable, "-W", "error", "-c", script, str(folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdout is not None
        number = int(process.stdout.readline())
        if end == "killed":
            process.kill()
        elif end == "interrupted":
            os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=30)
        if end == "over":
            assert (process.returncode, err) == (0, b"")
            time.sleep(0.5)
            assert is_there(number)
            os.kill(number, signal.SIGTERM)
        until = time.monotonic() + 10
        while is_there(number) and time.monotonic() < until:
            time.sleep(0.02)
        assert not is_there(number)


def is_there(number: int) -> bool:
    """Whether a process runs, and has not merely not been waited for."""
    stat = Path(f"/proc/{number}/stat")
    with suppress(OSError):
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_the_compiler_makes_all_that_is_needed():
    """What it compiles is on disk then: nothing is compiled in a run or an environment."""
    world = case8()
    compiler.compile_for(world.scenario, world.seed)
    with only_from_disk():
        assert choose.on_disk([world], SETTINGS) is not None
        engine = make_engine("auto", world, SETTINGS)
        assert type(engine) is BatchSimulation
        engine.reset(draw(world, 0, 0))
        engine.step([0, 0, 0])
        for make in (UavEnv, UavParallelEnv):
            env = make("case8", CONFIG, world_seed=0)
            assert type(env.session) is CompiledSession
            env.reset(seed=0)
            env.step([0, 0, 0] if make is UavEnv else dict.fromkeys(env.agents, 0))
            env.restore(env.save())
            env.session.state()


@pytest.mark.thorough
def test_the_compiler_meets_what_is_compiled_at_its_first_use(monkeypatch: pytest.MonkeyPatch):
    """Free flight, classes of links and separation, up to the end of the episode."""
    cells = list(compiled_apart._CELLS.values())
    for cell in cells:
        monkeypatch.setattr(cell.value, "value", 0)
    scenario = load(scenario_path("delivery_watch"), ["separation_m=120"])
    compiler.compile_for(scenario, 0)
    filled = {cell.name for cell in cells if cell.value.value}
    assert "desim_uav.rules.separation.end_pairs" in filled
    world, rng = build_world(scenario, 0), np.random.default_rng(5)
    engine = make_engine("batch", world, RunSettings((True,) * scenario.drone_count, False))
    shown = engine.reset(draw(world, 0, 1))
    while not (shown.terminated or shown.truncated):
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    assert {cell.name for cell in cells if cell.value.value} == filled


def test_a_kernel_that_is_not_on_disk_is_not_compiled(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(CodeFile, "load", lambda self, key: None)
    with only_from_disk(), pytest.raises(NotOnDiskError) as told:
        kernel(_twice)(2)
    assert told.value.keeps


def _twice(number: int) -> int:
    return 2 * number
