"""The command line: what it prints, where, and the code it ends with."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import typer

import desim_uav
from desim_uav.cli import app
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.experiment import command
from desim_uav.experiment.interrupt import UNLESS_USED, asked_to_stop
from tests.command_line import START, elsewhere, runner, with_plug_ins
from tests.selection import by_default

ROOT = Path(__file__).parents[1]
SHIPPED = [
    *(f"case{k}" for k in range(1, 10)),
    *("charging_age", "delivery_watch", "edge", "festival", "harvest", "interference"),
    *("old_town", "street_canyon", "tiny", "urban_downlink"),
]
SMALL = ("-S", "users.count=12", "-S", "episode.steps=8")
SMALL_SAID = "episode.steps=8-users.count=12"
CONTRACT = (
    *("scenario", "policy", "seed", "episodes", "requests", "suppressed", "qoe1_percent"),
    *("qoe1_feasible_percent", "qoe2_iterations", "qoe3_percent", "qoe3_active_percent"),
    *("crashes", "reward_mean", "run_dir"),
)
PLUG_INS = '''
import os
import signal
import time

from desim_uav.rules.admission import FirstCome
from desim_uav.policies.hover import Hover


class InEpisode(Hover):
    """Does something at the third step of its third episode."""

    def begin(self, world, streams, carried):
        self.episode = getattr(self, "episode", -1) + 1

    def act(self, observation, mask):
        if (self.episode, observation.step) == (2, 3):
            self.do()
        return super().act(observation, mask)


class Interrupted(InEpisode):
    def do(self):
        os.kill(os.getpid(), signal.SIGINT)


class Insisted(InEpisode):
    def do(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.5)  # two signals in one instant are one for the system
        os.kill(os.getpid(), signal.SIGINT)


class Terminated(InEpisode):
    def do(self):
        os.kill(os.getpid(), signal.SIGTERM)


class HungUp(InEpisode):
    def do(self):
        os.kill(os.getpid(), signal.SIGHUP)


class Warned(InEpisode):
    """As batch systems do it; which signal, the environment says."""

    def do(self):
        os.kill(os.getpid(), getattr(signal, os.environ["WARNING"]))


class Killed(InEpisode):
    def do(self):
        os.kill(os.getpid(), signal.SIGKILL)


class Broken(InEpisode):
    def do(self):
        raise KeyError("boom")


class NoNumber(Hover):
    def act(self, observation, mask):
        return "left"


class NoPolicy:
    pass


class Interrupting(FirstCome):
    """An admission rule: Ctrl-C in the middle of the engine."""

    asked = 0

    def scan_rows(self, world, path, state, drone, phase):
        Interrupting.asked += 1
        if Interrupting.asked == 400:
            os.kill(os.getpid(), signal.SIGINT)
        super().scan_rows(world, path, state, drone, phase)


class Flat:
    """A reward without a kernel."""

    def terms(self, *_):
        return {"flat": 1.0}


def function():
    """No class."""
'''


@pytest.fixture
def somewhere(tmp_path, monkeypatch):
    """An empty working folder, with plug-ins that can be imported."""
    yield from with_plug_ins("plugged", PLUG_INS, tmp_path, monkeypatch)


@pytest.fixture
def cli_run(somewhere, capsys, monkeypatch):
    """Run a command in this process."""
    return runner(capsys, monkeypatch)


def app_command(verb):
    """A command as typer has it, or the program itself."""
    program = typer.main.get_command(app)
    return program if verb is None else program.commands[verb]


def runs():
    return sorted(path.name for path in Path("runs").iterdir()) if Path("runs").exists() else []


class TestProgram:
    def test_version(self, cli_run):
        ended = cli_run("--version")
        assert (ended.code, ended.out, ended.err) == (0, f"desim-uav {desim_uav.__version__}\n", "")

    @pytest.mark.parametrize("flag", ["--help", "-h"])
    @pytest.mark.parametrize("verb", [None, "scenarios", "validate", "schema", "run", "qoe"])
    def test_help(self, cli_run, verb, flag):
        ended = cli_run(*([verb] if verb else []), flag)
        assert (ended.code, ended.err) == (0, "")
        assert "Usage: desim-uav" in ended.out

    def test_help_names_every_command_and_option(self, cli_run):
        assert set(re.findall(r"│ (\w+)  ", cli_run("--help").out)) >= {
            *("scenarios", "validate", "schema", "run", "qoe")
        }
        options = cli_run("run", "--help").out
        for option in ("--policy", "--seed", "--world-seed", "--episodes", "--warmup", "-S"):
            assert option in options
        for option in ("--events", "--out", "--engine", "--json", "-q", "SCENARIO"):
            assert option in options
        assert "--by" in cli_run("qoe", "--help").out

    @pytest.mark.parametrize(
        "verb", [None, *(one.callback.__name__ for one in app.registered_commands)]
    )
    def test_help_is_whole_sentences_without_types(self, cli_run, verb, monkeypatch):
        monkeypatch.setenv("COLUMNS", "160")
        text = cli_run(*([verb] if verb else []), "--help").out
        assert "<=" not in text
        if hasattr(typer.core.TyperArgument, "display_type_rich"):  # older ones print TEXT
            for jargon in ("<bool>", "<str>", "<path>", "TEXT", "INTEGER", "BOOLEAN"):
                assert jargon not in text
        command = app_command(verb)
        for parameter in command.get_params(typer.Context(command)):
            said = parameter.help
            assert said[0].isupper() and said.endswith("."), (parameter.name, said)
            assert len(said.split()) > 2, (parameter.name, said)

    @pytest.mark.thorough
    def test_a_shell_completes_commands_and_scenarios(self, somewhere):
        def completed(words):
            environment = os.environ | {
                "_DESIM_UAV_COMPLETE": "complete_bash",
                "COMP_WORDS": f"desim-uav {words}",
                "COMP_CWORD": str(len(words.split())),
            }
            code = "from desim_uav.cli import app; app(prog_name='desim-uav')"
            program = [sys.executable, "-c", code]
            done = subprocess.run(
                program, env=environment, capture_output=True, text=True, check=False
            )
            return done.stdout.split()

        assert completed("comp") == ["compare"]
        assert completed("run ti") == ["tiny"]
        assert "case8.npz" in completed("run tiny --policy ca")

    def test_nothing_asked(self, cli_run):
        ended = cli_run()
        assert ended.code in (0, 2)
        assert "Usage: desim-uav" in ended.out + ended.err

    def test_an_unknown_verb(self, cli_run):
        cli_run("rnu").failed(2, "No such command 'rnu'", "Did you mean 'run'?")

    def test_an_unknown_option(self, cli_run):
        cli_run("run", "tiny", "--sed", 3).failed(2, "No such option: --sed", "--seed")

    def test_help_needs_none_of_the_heavy_packages(self, somewhere):
        code = (
            "import sys; import desim_uav.cli; desim_uav.cli.main.__globals__['_program']()\n"
            "heavy = {'numba', 'numpy', 'pandas', 'pyarrow', 'pydantic', 'simpy', 'matplotlib'}\n"
            "heavy |= {'gymnasium', 'yaml', 'desim_uav.env'}\n"
            "print(sorted(heavy & set(sys.modules)))\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == "[]"

    @pytest.mark.parametrize("unbuffered", by_default([""], ["", "1"]))
    @pytest.mark.parametrize("verb", by_default(["scenarios"], ["schema", "scenarios"]))
    def test_nobody_reads_on(self, somewhere, verb, unbuffered):
        """As in ``desim-uav schema | head -1``: no complaint, whenever the pipe breaks."""
        read_end, write_end = os.pipe()
        os.close(read_end)
        environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
        program = [sys.executable, "-c", START, verb]
        done = subprocess.run(
            program, stdout=write_end, stderr=subprocess.PIPE, env=environment, check=False
        )
        os.close(write_end)
        assert (done.returncode, done.stderr) == (0, b"")

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
    def test_a_full_disk(self, somewhere):
        with Path("/dev/full").open("w") as full:
            program = [sys.executable, "-c", START, "scenarios"]
            done = subprocess.run(
                program, stdout=full, stderr=subprocess.PIPE, text=True, check=False
            )
        assert done.returncode == 1
        assert done.stderr == "desim-uav: [Errno 28] No space left on device\n"


class TestScenarios:
    def test_list(self, cli_run):
        ended = cli_run("scenarios")
        assert (ended.code, ended.err) == (0, "")
        names = [line.split()[0] for line in ended.out.splitlines()]
        assert names == SHIPPED

    def test_json(self, cli_run):
        found = cli_run("scenarios", "--json").json
        assert list(found) == SHIPPED
        assert all(re.fullmatch(r"[A-Z].*\.", about) for about in found.values())

    def test_show_prints_a_file_that_can_be_run(self, cli_run):
        ended = cli_run("scenarios", "--show", "tiny")
        Path("mine.yaml").write_text(ended.out)
        assert ended.out == (ROOT / "scenarios" / "tiny.yaml").read_text()
        assert cli_run("validate", "mine.yaml").code == 0

    def test_show_is_of_shipped_ones_only(self, cli_run):
        Path("tiny").write_text("mine")
        assert cli_run("scenarios", "--show", "tiny").out != "mine"

    def test_show_what_is_not_there(self, cli_run):
        cli_run("scenarios", "--show", "cse5").failed(3, "did you mean 'case5'?", "case9")


class TestValidate:
    def test_all_shipped(self, cli_run):
        ended = cli_run("validate", *SHIPPED)
        assert (ended.code, ended.err) == (0, "")
        assert ended.out.splitlines() == [f"{name}: valid" for name in SHIPPED]

    def test_every_error_of_every_file(self, cli_run):
        Path("one.yaml").write_text("name: one\nsede: 1\ndrones: {count: 0}\n")
        Path("two.yaml").write_text("users: [1]\n")
        ended = cli_run("validate", "one.yaml", "tiny", "two.yaml")
        assert (ended.code, ended.out) == (3, "tiny: valid\n")
        lines = ended.err.splitlines()
        assert len(lines) == 3
        assert all(line.startswith("desim-uav: ") for line in lines)
        assert [sum(f"{name}.yaml" in line for line in lines) for name in ("one", "two")] == [2, 1]

    def test_a_world_that_cannot_be_drawn(self, cli_run):
        overrides = ("map.size_m=[480,480]", "map.cells=[2,40]", "map.obstacles.coverage=[0.7,0.7]")
        flags = [part for override in overrides for part in ("-S", override)]
        ended = cli_run("validate", "case5", *flags, "-S", "stations.radius_m=100")
        assert ended.code == 3
        assert "Traceback" not in ended.err

    def test_overrides(self, cli_run):
        assert cli_run("validate", "tiny", "-S", "episode.steps=2").code == 0
        cli_run("validate", "tiny", "-S", "episode.steps=0").failed(3, "episode.steps=0")

    @pytest.mark.parametrize(
        ("overrides", "reason"),
        [
            (
                ("reward={kind: 'plugged:Flat'}",),
                "reward: 'Flat' is not compiled: it does not work on rows",
            ),
            (
                ("drones.battery.autonomy_min=1000000", "episode.steps=100000"),
                "drones.battery, episode: what a drone may use is too much",
            ),
        ],
    )
    def test_what_only_simpy_can_run(self, cli_run, overrides, reason):
        ended = cli_run("validate", "case8", *(part for one in overrides for part in ("-S", one)))
        assert (ended.code, ended.out) == (0, "case8: valid\n")
        assert ended.err == (
            "desim-uav: case8: only the SimPy engine (--engine des) can run this scenario: "
            f"{reason}\n"
        )

    def test_nothing_to_validate(self, cli_run):
        cli_run("validate").failed(2, "Missing argument")

    def test_what_is_not_there(self, cli_run):
        cli_run("validate", "nope.yaml").failed(3, "nope.yaml: no such file")


def test_schema(cli_run):
    found = cli_run("schema").json
    assert found["type"] == "object"
    assert {"name", "seed", "map", "drones"} <= set(found["properties"])


class TestRun:
    def test_a_table_and_the_folder(self, cli_run):
        ended = cli_run("run", "case6", "-S", "episode.steps=4")
        assert (ended.code, ended.err) == (0, "")
        lines = [line.rstrip() for line in ended.out.splitlines()]
        assert lines[0] == "case6, baseline, seed 0: 1 episode(s), 0 crash(es)"
        assert lines[-1] == "runs/case6-baseline-s0-episode.steps=4"
        rows = [line.split()[0] for line in lines if re.match(r"\s+\w+\s+\d+\s", line)]
        assert rows == ["all", "data_gathering", "edge_computing", "throughput"]

    def test_nothing_is_cut_off_in_a_pipe(self, cli_run, monkeypatch):
        monkeypatch.setenv("COLUMNS", "40")
        name = "a" * 64
        service = f"{name}: {{duration_min: [1], bandwidth_kbps: [96]}}"
        overrides = (f"services={{{service}}}", f"demand={{kind: static, mix: {{{name}: 1}}}}")
        flags = [part for override in overrides for part in ("-S", override)]
        ended = cli_run("run", "case8", *SMALL, *flags)
        assert ended.code == 0
        assert name in ended.out
        assert "…" not in ended.out

    def test_json(self, cli_run):
        ended = cli_run("run", "case8", *SMALL, "--episodes", 2, "--seed", 4, "--json")
        assert (ended.code, ended.err) == (0, "")
        found = ended.json
        assert set(CONTRACT) <= set(found)
        assert found["scenario"] == "case8"
        assert (found["policy"], found["seed"], found["episodes"]) == ("baseline", 4, 2)
        assert found["run_dir"] == f"runs/case8-baseline-s4-{SMALL_SAID}"
        episodes = pd.read_parquet(f"{found['run_dir']}/episodes.parquet")
        assert found["reward_mean"] == pytest.approx(episodes["reward"].mean())
        requests = pd.read_parquet(f"{found['run_dir']}/requests.parquet")
        assert found["requests"] == len(requests)
        assert found["qoe1_percent"] == pytest.approx(100 * requests["qoe1"].mean())
        assert found["qoe2_iterations"] == pytest.approx(requests["qoe2_iterations"].mean())

    def test_the_mean_reward(self, cli_run):
        # Its five steps are worth 0, 0, 1/3, 2/3 and 0 (see the tables of its run).
        found = cli_run("run", "tiny", "--episodes", 3, "--warmup", 2, "--json").json
        assert found["reward_mean"] == pytest.approx(1.0)

    def test_quiet(self, cli_run):
        ended = cli_run("run", "tiny", "-q")
        assert (ended.code, ended.out, ended.err) == (0, "", "")
        assert runs() == ["tiny-baseline-s1"]

    def test_quiet_json_is_json(self, cli_run):
        assert cli_run("run", "tiny", "-q", "--json").json["run_dir"] == "runs/tiny-baseline-s1"

    def test_a_file(self, cli_run):
        Path("mine.yaml").write_text("name: mine\nepisode: {steps: 2}\nusers: {count: 3}\n")
        assert cli_run("run", "mine.yaml", "--json").json["scenario"] == "mine"
        assert runs() == ["mine-baseline-s0"]

    def test_a_folder_with_the_name_of_a_scenario_is_no_scenario(self, cli_run):
        Path("tiny").mkdir()
        assert cli_run("run", "tiny", "-q").code == 0

    def test_a_policy_of_the_working_folder(self, cli_run):
        text = "from desim_uav.policies.hover import Hover\n\nclass Mine(Hover):\n    pass\n"
        Path("policy_beside_me.py").write_text(text)
        ended = cli_run("run", "tiny", "--policy", "policy_beside_me:Mine", "--json")
        assert ended.json["policy"] == "policy_beside_me:Mine"
        assert runs() == ["tiny-policy_beside_me-Mine-s1"]

    def test_a_script(self, cli_run):
        Path("east.csv").write_text("step,drone,action\n0,0,right\n1,0,right\n")
        found = cli_run("run", "tiny", "--policy", "script:east.csv", "--json").json
        steps = pd.read_parquet(Path(found["run_dir"]) / "steps.parquet")
        assert steps["action_taken"].tolist() == ["right", "right", "hover", "hover", "hover"]
        assert steps["x_m"].tolist() == pytest.approx([360, 600, 600, 600, 600])
        assert found["run_dir"] == "runs/tiny-script-east-s1"

    def test_events_and_out(self, cli_run):
        found = cli_run("run", "tiny", "--events", "--out", "mine/first", "--json").json
        assert found["run_dir"] == "mine/first"
        assert Path("mine/first/events.parquet").is_file()
        assert runs() == []

    def test_seeds(self, cli_run):
        assert cli_run("run", "case8", *SMALL, "--seed", 3, "--world-seed", 9, "-q").code == 0
        folder = Path(f"runs/case8-baseline-s3-{SMALL_SAID}-world_seed=9")
        manifest = json.loads((folder / "manifest.json").read_text())
        assert (manifest["seed"], manifest["world_seed"]) == (3, 9)
        assert manifest["command"][:2] == ["desim-uav", "run"]
        assert "world_seed: 9" in (folder / "scenario.yaml").read_text()

    def test_the_same_world_seed_is_the_same_world(self, cli_run):
        for seed in (1, 2):
            how = ("--seed", seed, "--world-seed", 7, "-q", "--out", f"runs/{seed}")
            cli_run("run", "case8", *SMALL, *how)
        worlds = [Path(f"runs/{k}/world.json").read_text() for k in (1, 2)]
        tables = [pd.read_parquet(f"runs/{k}/requests.parquet") for k in (1, 2)]
        assert worlds[0] == worlds[1]
        assert not tables[0].equals(tables[1])

    def test_the_largest_seed(self, cli_run):
        assert cli_run("run", "tiny", "--seed", 2**63 - 1, "--json").json["seed"] == 2**63 - 1

    def test_a_flag_goes_before_an_override(self, cli_run):
        assert cli_run("run", "tiny", "-S", "seed=4", "--seed", 5, "--json").json["seed"] == 5

    def test_the_warm_up_counts_nowhere(self, cli_run):
        flags = (*SMALL, "--episodes", 2, "--warmup", 2, "--events", "--json")
        found = cli_run("run", "case8", *flags).json
        folder = Path(found["run_dir"])
        for name in ("requests", "steps", "episodes", "users", "events", "legs"):
            frame = pd.read_parquet(folder / f"{name}.parquet")
            assert sorted(frame["episode"].unique()) == [-2, -1, 0, 1]
        requests = pd.read_parquet(folder / "requests.parquet")
        assert found["episodes"] == 2
        assert found["requests"] == (requests["episode"] >= 0).sum()
        assert cli_run("qoe", folder, "--json").json == found
        episodes = cli_run("qoe", folder, "--by", "episode", "--json").json["groups"]
        assert [row["episode"] for row in episodes] == [0, 1]

    def test_without_carry_over_the_warm_up_changes_nothing(self, cli_run):
        tables = []
        for warmup in (0, 2):
            found = cli_run("run", "tiny", "--warmup", warmup, "--json").json
            frame = pd.read_parquet(Path(found["run_dir"]) / "requests.parquet")
            tables.append(frame[frame["episode"] >= 0].reset_index(drop=True))
        pd.testing.assert_frame_equal(*tables)

    def test_no_requests_at_all(self, cli_run):
        silent = ("-S", "demand={kind: static, none: 1.0}")
        ended = cli_run("run", "case8", *SMALL, *silent, "--out", "silent")
        assert (ended.code, ended.err) == (0, "")
        found = cli_run("run", "case8", *SMALL, *silent, "--json").json
        assert (found["requests"], found["qoe1_percent"]) == (0, None)
        assert cli_run("qoe", "silent").code == 0
        assert cli_run("qoe", "silent", "--json").json["requests"] == 0
        for by in ("service", "episode", "user", "outcome"):
            assert cli_run("qoe", "silent", "--by", by).code == 0
            assert cli_run("qoe", "silent", "--by", by, "--json").json["groups"] == []


class TestRunRefused:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            ((), ["Missing argument"]),
            (("tiny", "tiny"), ["unexpected extra argument"]),
            (("tiny", "--seed", "x"), ["--seed"]),
            (("tiny", "--seed", "-1"), ["--seed"]),
            (("tiny", "--seed", 2**63), ["--seed"]),
            (("tiny", "--seed", ""), ["--seed"]),
            (("tiny", "--world-seed", "0.5"), ["--world-seed"]),
            (("tiny", "--episodes", 0), ["--episodes"]),
            (("tiny", "--episodes", 10**9), ["--episodes"]),
            (("tiny", "--warmup", -1), ["--warmup"]),
            (("tiny", "--warmup"), ["--warmup", "requires an argument"]),
            (("tiny", "--jsn"), ["No such option: --jsn"]),
            (("tiny", "-S"), ["-S", "requires an argument"]),
            (("tiny", "-S", "seed"), ["override seed: must be key.path=value"]),
            (("tiny", "-S", "=3"), ["override =3"]),
            (("tiny", "-S", ""), ["must be key.path=value"]),
        ],
    )
    def test_usage(self, cli_run, arguments, parts):
        cli_run("run", *arguments).failed(2, *parts)
        assert runs() == []

    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (("tny",), ["tny: neither a file nor a shipped scenario", "did you mean 'tiny'?"]),
            (("nope.yaml",), ["nope.yaml: no such file"]),
            (("deep/nope",), ["deep/nope: no such file"]),
            (("",), ["neither a file nor a shipped scenario"]),
            ((".",), ["."]),
            (("x" * 300,), ["cannot be read"]),
            (("tiny", "-S", "sede=1"), ["override sede=1: unknown key (did you mean 'seed'?)"]),
            (("tiny", "-S", "seed=abc"), ["override seed=abc: must be a whole number"]),
            (("tiny", "-S", "drones.count=[1"), ["override drones.count=[1"]),
            (("tiny", "-S", "drones.count=0"), ["must be at least 1"]),
        ],
    )
    def test_scenario(self, cli_run, arguments, parts):
        cli_run("run", *arguments).failed(3, *parts)
        assert runs() == []

    def test_every_error_of_a_scenario_a_line_each(self, cli_run):
        ended = cli_run("run", "tiny", "-S", "seed=-1", "-S", "episode.steps=0").failed(3)
        assert len(ended.err.splitlines()) == 2

    @pytest.mark.parametrize(
        ("policy", "parts"),
        [
            ("basline", ["unknown policy 'basline' (did you mean 'baseline'?)", "script"]),
            ("", ["unknown policy ''"]),
            ("hover:3", ["policy 'hover:3'"]),
            ("no_such_module:Class", ["ModuleNotFoundError"]),
            ("plugged:Nothing", ["has no 'Nothing'"]),
            ("plugged:function", ["is not a class"]),
            ("plugged:NoPolicy", ["no method 'begin'"]),
            ("script:", ["a script needs its file"]),
            ("script:nope.csv", ["nope.csv: No such file or directory"]),
            ("script:.", ["directory"]),
        ],
    )
    def test_policy(self, cli_run, policy, parts):
        cli_run("run", "tiny", "--policy", policy).failed(4, *parts)
        assert runs() == []

    @pytest.mark.parametrize(
        ("row", "part"),
        [
            ("0,0,rihgt", ".csv:2: action: 'rihgt': not an action (did you mean 'right'?)"),
            ("0,1,right", ".csv:2: drone: 1"),
            ("0,0,up", ".csv:2: action: 'up' is not an action of this scenario"),
            ("-1,0,right", ".csv:2: step: '-1': must be at least 0"),
            ("0,0", ".csv:2: action"),
        ],
    )
    def test_a_script_that_does_not_fit(self, cli_run, row, part):
        script = Path.cwd() / "s.csv"
        script.write_text(f"step,drone,action\n{row}\n")
        cli_run("run", "tiny", "--policy", f"script:{script}").failed(4, part)
        assert runs() == []

    def test_out_is_not_empty(self, cli_run):
        Path("mine").mkdir()
        Path("mine/file").touch()
        cli_run("run", "tiny", "--out", "mine").failed(
            2, "--out mine: the folder is not empty; name another one, or delete it first"
        )

    def test_nothing_is_simulated_without_a_place(self, cli_run, monkeypatch):
        monkeypatch.setattr(command.run, "play", lambda *_: pytest.fail("simulated"))
        Path("file").touch()
        cli_run("run", "tiny", "--out", "file").failed(2, "exists and is not a folder")
        cli_run("run", "tiny", "--out", "file/run").failed(2, "cannot write to")

    @pytest.mark.parametrize(
        ("policy", "part"),
        [
            ("plugged:Broken", "'plugged:Broken' failed in episode 2, step 3: KeyError: 'boom'"),
            ("plugged:NoNumber", "in episode 0, step 0: it returned 'left' for drone 0"),
        ],
    )
    def test_a_policy_that_fails(self, cli_run, policy, part):
        cli_run("run", "tiny", "--policy", policy, "--episodes", 4).failed(1, part)
        assert runs() == []


class TestEngine:
    @pytest.mark.parametrize("case", ["case1", "case9"])
    def test_each_writes_the_same_tables(self, cli_run, monkeypatch, case):
        def played(engine, unused):
            flags = ("--episodes", 2, "--warmup", 1, "--events", "--out", engine, "--json")
            with monkeypatch.context() as patched:
                patched.setattr(unused, "__init__", lambda *_: pytest.fail("the other engine"))
                return cli_run("run", case, *flags, "--engine", engine).json

        found = played("des", BatchSimulation), played("batch", Simulation)
        assert found[0] | {"run_dir": ""} == found[1] | {"run_dir": ""}
        files = sorted(path.name for path in Path("des").iterdir())
        assert {"events.parquet", "legs.parquet"} <= set(files)
        assert files == sorted(path.name for path in Path("batch").iterdir())
        for name in set(files) - {"manifest.json", "SHA256SUMS"}:
            assert Path("des", name).read_bytes() == Path("batch", name).read_bytes(), name
        one, other = (json.loads(Path(e, "manifest.json").read_text()) for e in ("des", "batch"))
        differ = {key for key in one | other if one[key] != other[key]}
        assert differ == {"engine", "played_by", "command", "started", "finished"}
        assert (one["engine"], other["engine"]) == ("des", "batch")
        assert (one["played_by"], other["played_by"]) == ({"des": 2}, {"batch": 2})

    def test_simpy_runs_what_is_not_compiled_unless_an_engine_is_named(self, cli_run):
        own = ("-S", "drones.admission={kind: 'tests.engine.helpers:Loss'}")
        ended = cli_run("run", "case8", *SMALL, *own, "--out", "mine", "-q")
        assert (ended.code, ended.err.count("\n")) == (0, 1)
        assert (
            "the SimPy engine (des) is used, which is slower: drones.admission: 'Loss'" in ended.err
        )
        manifest = json.loads(Path("mine/manifest.json").read_text())
        assert (manifest["engine"], manifest["played_by"]) == ("auto", {"des": 1})

    def test_a_component_without_a_kernel(self, cli_run):
        own = ("-S", "drones.admission={kind: 'plugged:Interrupting'}")
        own += ("-S", "reward={kind: 'plugged:Flat'}")
        ended = cli_run("run", "case8", *SMALL, *own, "--engine", "batch", "--out", "deep/mine")
        ended.failed(3)
        admission, reward = (line.partition("}: ")[2] for line in ended.err.splitlines())
        assert "override drones.admission={" in ended.err and "override reward={" in ended.err
        assert admission.startswith("drones.admission: 'Interrupting' is not compiled: ")
        assert "name 'Interrupting'" in admission or "opcode" in admission
        assert admission.endswith("; --engine des runs it")
        assert reward == (
            "reward: 'Flat' is not compiled: it does not work on rows; --engine des runs it"
        )
        assert cli_run("run", "case8", *SMALL, *own, "--engine", "batch").code == 3
        assert list(Path.cwd().iterdir()) == []

    @pytest.mark.parametrize(
        "command",
        [
            ("run", "tiny"),
            ("train", "tiny"),
            ("compare", "tiny", "--policies", "hover"),
            ("reproduce",),
        ],
    )
    def test_there_is_no_such_engine(self, cli_run, command):
        ended = cli_run(*command, "--engine", "bathc")
        ended.failed(2, "--engine: 'bathc' (did you mean 'batch'?); allowed: auto, des, batch")
        cli_run(*command, "--engine", "").failed(2, "--engine: ''; allowed: auto, des, batch")
        assert list(Path.cwd().iterdir()) == []


class TestInterrupted:
    def test_the_episode_under_way_is_finished_and_kept(self, cli_run):
        ended = cli_run("run", "tiny", "--policy", "plugged:Interrupted", "--episodes", 9, "--json")
        assert ended.code == 130
        assert ended.message == (
            "desim-uav: interrupted; the finished episodes are kept: "
            "runs/tiny-plugged-Interrupted-s1 (--resume goes on)"
        )
        assert ended.json["episodes"] == 3
        folder = Path(ended.json["run_dir"])
        manifest = json.loads((folder / "manifest.json").read_text())
        assert (manifest["interrupted"], manifest["episodes"]) == (True, 3)
        assert manifest["episodes_asked"] == 9
        for name in ("requests", "steps", "episodes", "users"):
            assert set(pd.read_parquet(folder / f"{name}.parquet")["episode"]) == {0, 1, 2}
        assert cli_run("qoe", folder, "--json").json == ended.json

    @pytest.mark.parametrize("policy", ["Interrupted", "Insisted"])
    def test_what_is_kept_is_what_a_shorter_run_gives(self, cli_run, policy):
        """Asked twice, it does not wait for the episode's end."""
        done = 3 if policy == "Interrupted" else 2
        policy = ("--policy", f"plugged:{policy}")
        kept = cli_run("run", "tiny", *policy, "--episodes", 9, "--json").json
        short = cli_run("run", "tiny", *policy, "--episodes", done, "--json").json
        assert kept | {"run_dir": ""} == short | {"run_dir": ""}

    @pytest.mark.parametrize("warmup", [3, 9])
    def test_nothing_is_kept_where_no_counted_episode_has_ended(self, cli_run, warmup):
        flags = ("--policy", "plugged:Interrupted", "--warmup", warmup, "--json")
        cli_run("run", "tiny", *flags).failed(130, "desim-uav: interrupted; nothing is kept")
        assert runs() == []

    def test_in_the_middle_of_the_engine(self, cli_run):
        admission = "drones.admission={kind: 'plugged:Interrupting'}"
        ended = cli_run("run", "case8", *SMALL, "-S", admission, "--episodes", 500, "-q")
        assert ended.code == 130
        assert "the finished episodes are kept" in ended.message
        (folder,) = runs()
        assert folder.startswith("case8-baseline-s0-drones.admission=-kind-plugged-Interrupting")

    @pytest.mark.parametrize("name", UNLESS_USED)
    def test_the_signals_of_batch_systems(self, cli_run, name, monkeypatch):
        monkeypatch.setenv("WARNING", name)
        ended = cli_run("run", "tiny", "--policy", "plugged:Warned", "--episodes", 9, "--json")
        assert (ended.code, ended.json["episodes"]) == (130, 3)

    def test_a_program_keeps_its_own_use_of_them(self, monkeypatch):
        heard = []
        before = signal.signal(signal.SIGUSR1, lambda number, frame: heard.append(number))
        try:
            with asked_to_stop("this") as stop:
                signal.raise_signal(signal.SIGUSR1)
                assert not stop()
                signal.raise_signal(signal.SIGUSR2)
                assert stop()
        finally:
            signal.signal(signal.SIGUSR1, before)
        assert heard == [signal.SIGUSR1]

    @pytest.mark.parametrize(
        "policy", by_default(["Terminated"], ["Interrupted", "Terminated", "HungUp"])
    )
    def test_a_signal(self, somewhere, policy):
        ended = elsewhere("run", "tiny", "--policy", f"plugged:{policy}", "--episodes", 9, "--json")
        assert ended.code == 130
        assert ended.json["episodes"] == 3
        assert ended.err.count("\n") == 1
        assert runs() == [f"tiny-plugged-{policy}-s1"]

    def test_nohup_is_respected(self, cli_run):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        flags = ("--policy", "plugged:HungUp", "--episodes", 4, "--json")
        assert cli_run("run", "tiny", *flags).json["episodes"] == 4

    @pytest.mark.thorough
    def test_killed_for_good(self, cli_run):
        """Nothing that looks like a run, and nothing in the way of the next one."""
        ended = elsewhere("run", "tiny", "--policy", "plugged:Killed", "--episodes", 9)
        assert ended.code == -signal.SIGKILL
        assert len(runs()) == 1
        assert runs()[0].startswith(".unfinished-")
        left = Path("runs") / runs()[0]
        cli_run("qoe", left).failed(4, f"{left}/requests.parquet: no such table")
        again = cli_run("run", "tiny", "--policy", "hover", "--json")
        assert again.json["run_dir"] == "runs/tiny-hover-s1"


class TestProcesses:
    @pytest.mark.thorough
    def test_two_at_a_time(self, somewhere):
        program = [sys.executable, "-c", START, "run", "tiny", "--json"]
        both = [subprocess.Popen(program, stdout=subprocess.PIPE, text=True) for _ in range(2)]
        found = [json.loads(process.communicate(timeout=120)[0]) for process in both]
        assert sorted(one["run_dir"] for one in found) == [
            "runs/tiny-baseline-s1",
            "runs/tiny-baseline-s1-2",
        ]
        assert runs() == ["tiny-baseline-s1", "tiny-baseline-s1-2"]

    @pytest.mark.thorough
    def test_progress_is_for_terminals_and_on_stderr(self, somewhere):
        ours, theirs = pty.openpty()
        program = [sys.executable, "-c", START, "run", "tiny", "--episodes", "3", "--json"]
        environment = os.environ | {"TERM": "xterm", "COLUMNS": "80"}
        process = subprocess.Popen(
            program, stdout=subprocess.PIPE, stderr=theirs, text=True, env=environment
        )
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 4096):
                shown += part
        except OSError:  # how Linux says that the other end is closed
            pass
        os.close(ours)
        assert json.loads(process.communicate(timeout=120)[0])["episodes"] == 3
        assert process.returncode == 0
        assert b"3/3" in shown


class TestQoe:
    @pytest.fixture
    def folder(self, cli_run):
        cli_run("run", "case8", *SMALL, "--episodes", 2, "--warmup", 1, "--out", "mine", "-q")
        return Path("mine")

    def test_text(self, cli_run, folder):
        ended = cli_run("qoe", folder)
        assert (ended.code, ended.err) == (0, "")
        shown = dict(line.split(maxsplit=1) for line in ended.out.splitlines())
        assert set(CONTRACT) <= set(shown)
        found = cli_run("qoe", folder, "--json").json["reward_mean"]
        assert found > 0
        assert float(shown["reward_mean"]) == pytest.approx(found, rel=1e-5)

    def test_json(self, cli_run, folder):
        found = cli_run("qoe", folder, "--json").json
        assert set(CONTRACT) <= set(found)
        assert found["run_dir"] == "mine"

    @pytest.mark.parametrize("by", ["service", "episode", "user", "outcome"])
    def test_by(self, cli_run, folder, by):
        ended = cli_run("qoe", folder, "--by", by)
        found = cli_run("qoe", folder, "--by", by, "--json").json
        assert (ended.code, ended.err) == (0, "")
        assert cli_run("qoe", folder, "--json").json.items() <= found.items()
        assert found["by"] == by
        assert sum(row["requests"] for row in found["groups"]) == found["requests"]
        rows = [line.split() for line in ended.out.splitlines()]
        for group in found["groups"]:
            assert [str(group[by]), str(group["requests"])] in [row[:2] for row in rows]

    def test_by_what_is_no_group(self, cli_run, folder):
        cli_run("qoe", folder, "--by", "servce").failed(
            2,
            "--by",
            "(did you mean 'service'?)",
            "allowed: service, episode, user, group, outcome",
        )

    def test_covered_once(self, cli_run, folder):
        plain = cli_run("qoe", folder, "--json").json
        found = cli_run("qoe", folder, "--covered-once", "--json").json
        share = found.pop("covered_once_percent")
        assert found == plain
        assert found["qoe3_percent"] < share <= 100
        text = cli_run("qoe", folder, "--covered-once").out
        assert f"covered_once_percent     {share:.6g}\n" in text
        cli_run("qoe", folder, "--covered-once", "--by", "user").failed(2, "not with --by")

    def test_no_folder_given(self, cli_run):
        cli_run("qoe").failed(2, "Missing argument")

    def test_no_run(self, cli_run):
        cli_run("qoe", "nope").failed(4, "desim-uav: nope: no such run folder")
        cli_run("qoe", ".").failed(4, "requests.parquet: no such table; is . a run folder?")

    @pytest.mark.parametrize("flags", [(), ("--json",), ("--by", "user")])
    @pytest.mark.parametrize("name", ["requests.parquet", "episodes.parquet", "manifest.json"])
    def test_a_damaged_file_is_named(self, cli_run, folder, name, flags):
        file = folder / name
        content = file.read_bytes()
        file.write_bytes(content[: len(content) // 2])
        cli_run("qoe", folder, *flags).failed(
            4, f"desim-uav: mine/{name}: the file has changed since it was"
        )
        (folder / "SHA256SUMS").unlink()
        cli_run("qoe", folder, *flags).failed(4, f"desim-uav: mine/{name}: not a readable")
        file.unlink()
        cli_run("qoe", folder, *flags).failed(4, f"desim-uav: mine/{name}: ")
