"""The folder of a run: whole or not at all, never over another, and read back with care."""

import errno
import json
import os
import shutil
import threading
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from desim_uav import lock, qoe, run_folder
from desim_uav.checksums import SUMS
from desim_uav.columns import to_frame
from desim_uav.disk import write_at, write_whole
from desim_uav.errors import DesimError, PolicyError, SimulationError, UsageError
from desim_uav.experiment import command
from desim_uav.experiment import run as experiment_run
from desim_uav.experiment.command import read_summary
from desim_uav.experiment.provenance import PACKAGES
from desim_uav.lock import held
from desim_uav.measures.tally import headline
from desim_uav.parquet_file import read_table
from desim_uav.records import EPISODES, REQUESTS, TABLES, USERS
from desim_uav.run_folder import RunDraft, RunPlace
from desim_uav.scenario.load import load, loads, scenario_hash
from desim_uav.shipped import scenario_path
from tests.report.helpers import read_counted
from tests.run_to_folder import run_to_folder

SMALL = ("users.count=12", "episode.steps=8")
FILES = [
    "SHA256SUMS",
    "episodes.parquet",
    "manifest.json",
    "requests.parquet",
    "scenario.yaml",
    "steps.parquet",
]
FILES += ["users.parquet", "world.json"]


@pytest.fixture(autouse=True)
def somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(scenario="tiny", policy="baseline", overrides=(), out=None, **other):
    """Run a scenario (its loaded self, a path or a shipped name); the folder."""
    if isinstance(scenario, str):
        scenario = load(scenario_path(scenario), overrides)
    options = {"episodes": 1, "warmup": 0, "keep_events": False, "command": ["desim-uav"]} | other
    done = run_to_folder(scenario, policy, out=out, **options)
    return Path(done.summary["run_dir"])


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def same_tables(one, other):
    found = [name for name in TABLES if (one / f"{name}.parquet").exists()]
    assert found == [name for name in TABLES if (other / f"{name}.parquet").exists()]
    for name in found:
        frames = [pd.read_parquet(folder / f"{name}.parquet") for folder in (one, other)]
        pd.testing.assert_frame_equal(*frames)


class TestWhereItStands:
    def test_named_after_scenario_policy_and_seed(self):
        assert run(policy="hover", overrides=["seed=7"]) == Path("runs/tiny-hover-s7")

    def test_the_next_gets_a_number(self):
        found = [run(policy="hover").name for _ in range(3)]
        assert found == ["tiny-hover-s1", "tiny-hover-s1-2", "tiny-hover-s1-3"]
        assert names("runs") == sorted(found)

    def test_a_gap_is_filled_nothing_is_overwritten(self):
        kept = [run() for _ in range(3)]
        before = (kept[2] / "manifest.json").read_bytes()
        shutil.rmtree(kept[1])
        assert run() == kept[1]
        assert run().name == "tiny-baseline-s1-4"
        assert (kept[2] / "manifest.json").read_bytes() == before

    @pytest.mark.parametrize("taken", ["file", "full folder", "dead link"])
    def test_whatever_has_the_name_stays(self, taken):
        Path("runs").mkdir()
        place = Path("runs/tiny-hover-s1")
        if taken == "file":
            place.write_text("mine")
        elif taken == "full folder":
            place.mkdir()
            (place / "mine").touch()
        else:
            place.symlink_to("nowhere")
        assert run(policy="hover").name == "tiny-hover-s1-2"
        assert place.is_symlink() or place.is_file() or names(place) == ["mine"]

    def test_a_script_gives_the_name_of_its_file(self, somewhere):
        script = somewhere / "deep" / "there and back.csv"
        script.parent.mkdir()
        script.write_text("step,drone,action\n0,0,right\n")
        assert run(policy=f"script:{script}").name == "tiny-script-there-and-back-s1"

    def test_a_very_long_name_is_cut(self, somewhere):
        script = somewhere / ("x" * 240 + ".csv")
        script.write_text("step,drone,action\n0,0,right\n")
        assert (run(policy=f"script:{script}") / "manifest.json").is_file()

    def test_many_at_a_time_all_find_a_place(self):
        count, found, barrier = 8, [], threading.Barrier(8)

        def publish(number):
            place = RunPlace(None, "same")
            with place.draft() as draft:
                draft.write_text("who", str(number))
                barrier.wait()
                found.append((number, place.publish(draft)))

        threads = [threading.Thread(target=publish, args=(k,)) for k in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert names("runs") == sorted(["same", *(f"same-{k}" for k in range(2, count + 1))])
        assert all((folder / "who").read_text() == str(number) for number, folder in found)


class TestOut:
    @pytest.mark.parametrize("out", ["new", "deep/down/new", "./new/", "old/../new"])
    def test_a_new_folder_is_made(self, out):
        Path("old").mkdir()
        assert run(out=Path(out)) == Path(out)
        assert names(out) == FILES

    def test_an_empty_folder_is_filled(self):
        Path("empty").mkdir()
        run(out=Path("empty"))
        assert names("empty") == FILES

    @pytest.mark.parametrize("there", [True, False])
    def test_a_link_is_followed(self, there):
        if there:
            Path("target").mkdir()
        Path("link").symlink_to("target")
        assert run(out=Path("link")) == Path("link")
        assert names("target") == FILES

    def test_absolute(self, somewhere):
        assert run(out=somewhere / "new") == somewhere / "new"

    def test_full(self):
        Path("full").mkdir()
        Path("full/mine").touch()
        with pytest.raises(UsageError, match="--out full: the folder is not empty"):
            run(out=Path("full"))
        assert names("full") == ["mine"]

    def test_even_a_run(self):
        run(out=Path("mine"))
        before = {name: (Path("mine") / name).read_bytes() for name in FILES}
        with pytest.raises(UsageError, match="not empty"):
            run(out=Path("mine"))
        assert {name: (Path("mine") / name).read_bytes() for name in FILES} == before

    def test_a_file(self):
        Path("file").touch()
        with pytest.raises(UsageError, match="--out file: exists and is not a folder"):
            run(out=Path("file"))

    @pytest.mark.parametrize("out", [".", "", "../here"])
    def test_the_working_folder_itself(self, out, monkeypatch):
        Path("here").mkdir()
        monkeypatch.chdir("here")
        with pytest.raises(UsageError, match="this folder cannot be replaced; name a folder in it"):
            run(out=Path(out))

    def test_a_mount_point(self, monkeypatch):
        Path("disk").mkdir()
        monkeypatch.setattr(Path, "is_mount", lambda path: path.name == "disk")
        with pytest.raises(UsageError, match="--out disk: this folder cannot be replaced"):
            run(out=Path("disk"))

    def test_filled_by_another_in_the_meantime(self):
        place = RunPlace(Path("mine"), "name")
        with pytest.raises(UsageError, match=r"cannot write to .*mine"), place.draft() as draft:
            draft.write_text("file", "text")
            Path("mine").mkdir()
            Path("mine/theirs").touch()
            place.publish(draft)
        assert names("mine") == ["theirs"]
        assert names(".") == ["mine"]


class TestUnwritable:
    @pytest.fixture(autouse=True)
    def nothing_is_simulated(self, monkeypatch):
        def simulated(*_):
            pytest.fail("simulated before looking for a place")

        monkeypatch.setattr(command.run, "play", simulated)

    def test_beneath_a_file(self):
        Path("file").touch()
        with pytest.raises(UsageError, match=r"cannot write to .*file: it is not a folder"):
            run(out=Path("file/run"))

    def test_far_beneath_a_file(self):
        Path("file").touch()
        with pytest.raises(UsageError, match=r"--out|cannot write to"):
            run(out=Path("file/deep/run"))

    def test_runs_is_a_file(self):
        Path("runs").touch()
        with pytest.raises(UsageError, match="cannot write to runs: it is not a folder"):
            run()

    def test_a_name_too_long(self):
        with pytest.raises(UsageError, match="--out xxx"):
            run(out=Path("x" * 300))

    def test_a_circle_of_links(self):
        Path("circle").symlink_to("circle")
        with pytest.raises(UsageError, match=r"--out circle|cannot write to"):
            run(out=Path("circle"))

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
    def test_no_permission(self):
        Path("locked").mkdir(mode=0o555)
        with pytest.raises(UsageError, match=r"cannot write to .*locked: Permission denied"):
            run(out=Path("locked/run"))

    def test_a_full_disk(self, monkeypatch):
        def full(*_, **__):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(Path, "mkdir", full)
        with pytest.raises(UsageError, match="cannot write to runs: No space left"):
            run()


class TestInParts:
    """A long run is written as it goes, and read back so."""

    @pytest.fixture
    def two_by_two(self, monkeypatch):
        monkeypatch.setattr(experiment_run, "BATCH", 2)

    def test_the_tables_are_those_of_one_piece(self, monkeypatch, two_by_two):
        options = {"overrides": SMALL, "keep_events": True, "episodes": 4, "warmup": 1}
        parts = run("case8", **options)
        monkeypatch.setattr(experiment_run, "BATCH", 50)
        whole = run("case8", **options)
        assert pq.ParquetFile(parts / "requests.parquet").num_row_groups == 3
        assert pq.ParquetFile(whole / "requests.parquet").num_row_groups == 1
        same_tables(parts, whole)

    def test_what_is_said_of_them_too(self, two_by_two):
        folder = run("case8", overrides=SMALL, episodes=5)
        found, groups = read_summary(folder, "service")
        requests = pd.read_parquet(folder / "requests.parquet")
        expected = headline(requests, pd.read_parquet(folder / "episodes.parquet"))
        assert {name: found[name] for name in expected} == pytest.approx(expected)
        for one, other in zip(groups, qoe.grouped(requests, "service"), strict=True):
            assert one.pop("service") == other.pop("service")
            assert one == pytest.approx(other)

    def test_many_rows_are_put_down_before_many_episodes(self, monkeypatch):
        monkeypatch.setattr(experiment_run, "ROWS", 1)
        folder = run("case8", overrides=SMALL, episodes=3)
        assert pq.ParquetFile(folder / "episodes.parquet").num_row_groups == 3

    def test_a_flipped_bit_is_noticed(self, two_by_two):
        """Values have checksums, page by page, where the folder has none."""
        file = run("case8", overrides=SMALL, episodes=4) / "requests.parquet"
        (file.parent / SUMS).unlink()
        content = file.read_bytes()
        last = pq.ParquetFile(file).metadata.row_group(1)
        for column in (last.column(k) for k in range(last.num_columns)):
            begins = column.dictionary_page_offset or column.data_page_offset
            flipped = bytearray(content)
            flipped[begins + column.total_compressed_size - 2] ^= 16
            file.write_bytes(flipped)
            with pytest.raises(PolicyError, match=r"requests.parquet: not a readable Parquet file"):
                read_summary(file.parent)


class TestWholeOrNotAtAll:
    def test_a_run_leaves_its_folder_and_nothing_else(self):
        run()
        assert names(".") == ["runs"]
        assert names("runs") == ["tiny-baseline-s1"]
        assert names("runs/tiny-baseline-s1") == FILES

    def test_events_only_where_asked(self):
        assert names(run(keep_events=True)) == sorted([*FILES, "events.parquet", "legs.parquet"])

    def test_it_has_the_rights_of_any_new_folder(self):
        mask = os.umask(0o027)
        try:
            folder = run()
        finally:
            os.umask(mask)
        assert folder.stat().st_mode & 0o777 == 0o750
        assert (folder / "manifest.json").stat().st_mode & 0o777 == 0o640

    @pytest.mark.parametrize("failing", [1, 2, 3, 5, 7])
    def test_a_disk_that_fills_up_leaves_nothing(self, failing, monkeypatch):
        calls = iter(range(1, 100))

        def fsync(_):
            if next(calls) == failing:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", fsync)
        with pytest.raises(DesimError, match=r"cannot write \S+ to runs: No space left") as caught:
            run()
        assert caught.value.exit_code == 1
        assert not Path("runs").exists()

    @pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, SystemExit])
    @pytest.mark.parametrize("method", ["write_text", "write_json", "tables", "publish"])
    def test_whatever_ends_the_writing_leaves_nothing(self, error, method, monkeypatch):
        def end(*_):
            raise error

        monkeypatch.setattr(RunPlace if method == "publish" else RunDraft, method, end)
        with pytest.raises(error):
            run()
        assert not Path("runs").exists()

    def test_a_failing_policy_leaves_nothing(self, monkeypatch, somewhere):
        (somewhere / "late_failure.py").write_text(
            "from desim_uav.policies.hover import Hover\n\n"
            "class Late(Hover):\n"
            "    def act(self, observation, mask):\n"
            "        return 1 // (3 - observation.step)\n"
        )
        monkeypatch.syspath_prepend(str(somewhere))
        with pytest.raises(
            SimulationError, match="'late_failure:Late' failed in episode 0, step 3"
        ):
            run(policy="late_failure:Late")
        assert not Path("runs").exists()

    def test_what_a_killed_run_left_is_in_nobodys_way(self):
        stale = Path("runs/.unfinished-abc")
        stale.mkdir(parents=True)
        (stale / "requests.parquet").write_bytes(b"PAR1")
        assert run() == Path("runs/tiny-baseline-s1")
        assert stale.exists()
        with pytest.raises(PolicyError, match=r"requests.parquet: not a readable"):
            read_counted(stale)

    def test_manifest_and_checksums_are_written_last(self, monkeypatch):
        written = []
        original = RunDraft._new_file
        monkeypatch.setattr(
            RunDraft, "_new_file", lambda d, n: (written.append(n), original(d, n))[1]
        )
        run(keep_events=True)
        assert written[-2:] == ["manifest.json", SUMS]
        assert sorted(written) == sorted([*FILES, "events.parquet", "legs.parquet"])


class TestManifest:
    def manifest(self, **options):
        return json.loads((run(**options) / "manifest.json").read_text())

    def test_what_reproduces_the_run(self):
        scenario = load(scenario_path("case8"), [*SMALL, "seed=5"])
        found = self.manifest(
            scenario=scenario, policy="random", episodes=2, warmup=1, command=["desim-uav", "run"]
        )
        expected = {
            "scenario": "case8",
            "scenario_hash": scenario_hash(scenario),
            "policy": "random",
            "seed": 5,
            "world_seed": 5,
            "engine": "des",
            "ceilings": ["tallest"] * 3,
            "carry_over": True,
            "warmup": 1,
            "episodes": 2,
            "episodes_asked": 2,
            "interrupted": False,
            "command": ["desim-uav", "run"],
        }
        assert {name: found[name] for name in expected} == expected

    def test_the_baseline_knows_no_ceiling(self):
        assert self.manifest()["ceilings"] == ["none"]

    def test_a_world_seed_of_its_own(self):
        found = self.manifest(overrides=["world_seed=9"])
        assert (found["seed"], found["world_seed"]) == (1, 9)

    def test_versions_and_times(self):
        found = self.manifest()
        assert {"desim-uav", "python", "platform", *PACKAGES} == set(found["versions"])
        times = [datetime.fromisoformat(found[name]) for name in ("started", "finished")]
        assert times == sorted(times)
        assert all(time.tzinfo for time in times)

    def test_the_world(self):
        folder = run("case8", overrides=SMALL)
        world = json.loads((folder / "world.json").read_text())
        keys = ("size_m", "cells", "cell_height_m", "levels_m", "stations", "clusters")
        assert {*keys, "start_cells", "users"} <= set(world)
        assert world["size_m"] == [2400, 2400]
        assert world["cells"] == [10, 10]
        assert (len(world["cell_height_m"]), len(world["cell_height_m"][0])) == (10, 10)
        assert all(len(cell) == 2 for cell in world["start_cells"] + world["stations"])
        assert (len(world["start_cells"]), len(world["stations"])) == (3, 3)
        assert (len(world["users"]), len(world["clusters"])) == (12, 4)


class TestRunAgain:
    @pytest.mark.parametrize(
        ("scenario", "policy", "overrides"),
        [
            ("tiny", "hover", ()),
            ("case8", "baseline", SMALL),
            ("case9", "random", (*SMALL, "seed=3", "world_seed=8")),
            ("case6", "random", ("episode.steps=6", "preset=paper", "demand.none=0.25")),
            (
                "case5",
                "hover",
                ("map.obstacles={cells: [[4, 4, 50]]}", "drones.motion.timing=minimum_time"),
            ),
        ],
    )
    def test_the_stored_scenario_gives_the_same_tables(self, scenario, policy, overrides):
        options = {"policy": policy, "episodes": 2, "warmup": 1, "keep_events": True}
        first = run(scenario, overrides=overrides, **options)
        again = run(load(first / "scenario.yaml"), **options)
        assert again != first
        same_tables(first, again)
        for name in ("scenario.yaml", "world.json"):
            assert (first / name).read_bytes() == (again / name).read_bytes()
        manifests = [json.loads((f / "manifest.json").read_text()) for f in (first, again)]
        assert manifests[0]["scenario_hash"] == manifests[1]["scenario_hash"]

    def test_trace_files_are_found_again_from_the_run_folder(self, somewhere, monkeypatch):
        (somewhere / "mine").mkdir()
        (somewhere / "mine" / "requests.csv").write_text(
            "user,t_s,service,required_s,bandwidth_kbps\n0,10,throughput,30,96\n1,70,throughput,60,96\n"
        )
        (somewhere / "mine" / "own.yaml").write_text(
            "name: own\nusers: {count: 2}\ndemand: {kind: trace, file: requests.csv}\n"
            "episode: {steps: 4}\n"
        )
        first = run(load("mine/own.yaml"))
        assert len(pd.read_parquet(first / "requests.parquet")) == 2
        (somewhere / "elsewhere").mkdir()
        first = first.resolve()
        monkeypatch.chdir("elsewhere")
        same_tables(first, run(load(first / "scenario.yaml")))

    def test_another_seed_is_another_run(self):
        requests = [
            pd.read_parquet(run("case8", overrides=(*SMALL, f"seed={seed}")) / "requests.parquet")
            for seed in (0, 1)
        ]
        assert not requests[0].equals(requests[1])

    def test_what_is_logged_changes_nothing(self):
        bare = run("case8", overrides=SMALL)
        full = run("case8", overrides=SMALL, keep_events=True)
        for name in ("events", "legs"):
            (full / f"{name}.parquet").unlink()
        same_tables(bare, full)

    def test_more_episodes_begin_like_fewer(self):
        short, long = (run("case8", overrides=SMALL, episodes=k) for k in (1, 3))
        frames = [pd.read_parquet(f / "requests.parquet") for f in (short, long)]
        pd.testing.assert_frame_equal(frames[0], frames[1][frames[1]["episode"] == 0])


class TestReadBack:
    @pytest.fixture
    def folder(self):
        """Without its checksums: what is changed is looked at."""
        folder = run("case8", overrides=SMALL, episodes=2, warmup=1)
        (folder / SUMS).unlink()
        return folder

    def rewrite(self, folder, name, change):
        file = folder / f"{name}.parquet"
        change(pd.read_parquet(file)).to_parquet(file, index=False)

    def test_the_summary_is_that_of_the_run(self, folder):
        done = run_to_folder(
            load(folder / "scenario.yaml"),
            "baseline",
            episodes=2,
            warmup=1,
            keep_events=False,
            out=Path("again"),
            command=[],
        )
        summary, requests = read_counted(Path("again"))
        assert summary == done.summary
        assert summary["requests"] == len(requests)
        assert read_counted(folder)[0] | {"run_dir": "again"} == summary

    def test_the_warm_up_is_counted_nowhere(self, folder):
        summary, requests = read_counted(folder)
        assert summary["episodes"] == 2
        assert set(requests["episode"]) == {0, 1}
        self.rewrite(folder, "requests", lambda f: f[f["episode"] >= 0])
        self.rewrite(folder, "episodes", lambda f: f[f["episode"] >= 0])
        assert read_counted(folder)[0] == summary

    def test_a_folder_whose_name_looks_like_an_address(self, folder, monkeypatch):
        monkeypatch.chdir(folder.parent)
        odd = folder.relative_to(folder.parent).rename("a:b%41#?")
        assert len(read_table(odd, "requests", REQUESTS))

    def test_tables_come_as_they_were_written(self, folder):
        assert len(read_table(folder, "users", USERS).columns) == len(USERS)
        assert list(read_table(folder, "requests", REQUESTS)) == list(REQUESTS)

    def test_more_columns_and_another_order_are_fine(self, folder):
        summary = read_counted(folder)[0]
        self.rewrite(folder, "requests", lambda f: f.assign(mine=1)[["mine", *reversed(f.columns)]])
        assert read_counted(folder)[0] == summary

    @pytest.mark.parametrize("frame", ["none left", "none of the episodes counts"])
    def test_nothing_to_count(self, folder, frame):
        limit = 0 if frame != "none left" else -9
        for name in ("requests", "episodes"):
            self.rewrite(folder, name, lambda f: f[f["episode"] < limit])
        summary = read_counted(folder)[0]
        assert (summary["requests"], summary["episodes"]) == (0, 0)
        assert summary["qoe1_percent"] is summary["qoe3_percent"] is summary["reward_mean"] is None

    def test_no_such_folder(self):
        with pytest.raises(PolicyError, match=r"^nowhere: no such run folder$"):
            read_counted(Path("nowhere"))

    def test_a_file(self):
        Path("file").touch()
        with pytest.raises(PolicyError, match=r"^file: no such run folder$"):
            read_counted(Path("file"))

    def test_a_name_too_long(self):
        with pytest.raises(PolicyError, match=r"^xxx"):
            read_counted(Path("x" * 300))

    def test_a_folder_that_is_no_run(self):
        Path("mine").mkdir()
        with pytest.raises(
            PolicyError, match=r"mine/requests.parquet: no such table; is mine a run"
        ):
            read_counted(Path("mine"))

    @pytest.mark.parametrize("name", ["requests", "episodes"])
    def test_a_missing_table(self, folder, name):
        (folder / f"{name}.parquet").unlink()
        with pytest.raises(PolicyError, match=f"{name}.parquet: no such table"):
            read_counted(folder)

    @pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.999])
    def test_a_truncated_table(self, folder, share):
        file = folder / "requests.parquet"
        content = file.read_bytes()
        file.write_bytes(content[: int(share * len(content))])
        with pytest.raises(
            PolicyError, match=r"requests.parquet: not a readable Parquet file"
        ) as caught:
            read_counted(folder)
        assert len(str(caught.value).splitlines()) == 1

    def test_a_damaged_table(self, folder):
        file = folder / "requests.parquet"
        content = bytearray(file.read_bytes())
        content[20:400] = bytes(380)
        file.write_bytes(content)
        with pytest.raises(PolicyError, match=r"requests.parquet: ") as caught:
            read_counted(folder)
        assert len(str(caught.value).splitlines()) == 1

    def test_a_text_that_is_not_utf8(self, folder):
        """Nothing decodes it before it is needed, so the table is looked at as it is read."""
        file = folder / "requests.parquet"
        table = pq.read_table(file)
        names = pa.array([b"down\xff\xfeload"] * len(table))
        text = pa.Array.from_buffers(pa.string(), len(names), names.buffers())
        place = table.schema.get_field_index("service")
        pq.write_table(table.set_column(place, table.schema.field(place), text), file)
        with pytest.raises(PolicyError, match=r"requests.parquet: .*: a text in it is not UTF-8$"):
            read_counted(folder)

    def test_a_folder_in_place_of_a_table(self, folder):
        (folder / "requests.parquet").unlink()
        (folder / "requests.parquet").mkdir()
        with pytest.raises(PolicyError, match=r"requests.parquet: no such table"):
            read_counted(folder)

    @pytest.mark.parametrize(
        ("name", "change", "problem"),
        [
            ("requests", lambda f: f.drop(columns="qoe1"), "no column 'qoe1'"),
            ("episodes", lambda f: f.drop(columns="crashes"), "no column 'crashes'"),
            ("requests", lambda f: f.assign(qoe1="much"), "column 'qoe1' holds"),
            ("requests", lambda f: f.assign(episode="0"), "column 'episode' holds"),
            ("requests", lambda f: f.assign(user=0.5), "column 'user' holds double, not int64"),
            ("requests", lambda f: f.assign(t_end_s=pd.Timestamp(0)), "column 't_end_s' holds"),
            ("requests", lambda f: f.assign(wait_s=float("inf")), "column 'wait_s' has infinite"),
            ("requests", lambda f: f.assign(drones="0"), "column 'drones' holds"),
            ("episodes", lambda f: f.assign(suppressed=None), "column 'suppressed' has empty"),
        ],
    )
    def test_a_table_of_other_columns_or_types(self, folder, name, change, problem):
        self.rewrite(folder, name, change)
        with pytest.raises(PolicyError, match=f"{name}.parquet: {problem}"):
            read_counted(folder)

    @pytest.mark.parametrize(
        ("content", "problem"),
        [
            (None, "not a readable JSON file: No such file"),
            (b"", "not a readable JSON file: Expecting value"),
            (b"{", "not a readable JSON file"),
            (b"\xff\xfe", "not a readable JSON file: it is not UTF-8"),
            (b"[" * 100_000, "not a readable JSON file"),
            (b"[]", "not the manifest of a run: must be an object"),
            (b"{}", "not the manifest of a run: scenario: missing"),
            (
                b'{"scenario": "a", "policy": "b"}',
                "not the manifest of a run: seed: missing",
            ),
            (
                b'{"scenario": "a", "policy": "b", "seed": NaN}',
                "not the manifest of a run: seed: must be a whole number",
            ),
        ],
    )
    def test_the_manifest(self, folder, content, problem):
        file = folder / "manifest.json"
        file.unlink()
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(PolicyError, match=f"manifest.json: {problem}"):
            read_counted(folder)


def test_a_scenario_without_any_request_is_a_run_like_any(somewhere):
    scenario = loads("name: silent\ndemand: {kind: static, none: 1.0}\nepisode: {steps: 3}\n")
    folder = run(scenario, keep_events=True, episodes=2)
    summary, requests = read_counted(folder)
    assert len(requests) == 0
    assert list(requests) == list(to_frame(REQUESTS, []))
    assert summary["requests"] == summary["completed"] == summary["never_served"] == 0
    assert summary["qoe1_percent"] is summary["fairness"] is None
    assert summary["qoe3_percent"] > 0
    assert list(read_table(folder, "episodes", EPISODES)["requests"]) == [0, 0]


class TestHeld:
    def test_a_second_is_told_who_holds_it(self):
        with (
            held(Path("mine")),
            pytest.raises(UsageError, match=f"mine: process {os.getpid()}, since .* is writing"),
            held(Path("mine")),
        ):
            pass
        with held(Path("mine")):
            pass
        assert not list(Path().glob(".*.lock"))

    def test_a_lock_that_was_removed_while_one_waited_for_it_is_no_lock(self, monkeypatch):
        """Whoever had it was done in between: its file is another one now, or none."""
        locked = []

        def flock(file, how):
            locked.append(how)
            if len(locked) == 1:
                Path(".mine.lock").unlink()

        monkeypatch.setattr(lock.fcntl, "flock", flock)
        with held(Path("mine")):
            assert Path(".mine.lock").read_text(encoding="utf-8").startswith("process ")
        assert len(locked) == 2

    @pytest.mark.parametrize(
        "kind", ["link", "dangling link", "hard link", "file", "pipe", "folder"]
    )
    def test_what_stands_in_the_place_of_the_lock_is_left_alone(self, kind):
        """Whoever can write there could otherwise have any file of ours emptied."""
        lock, file = Path(".mine.lock"), Path("dear")
        file.write_text("all my results", encoding="utf-8")
        make = {
            "link": lambda: lock.symlink_to(file),
            "dangling link": lambda: lock.symlink_to("nothing"),
            "hard link": lambda: lock.hardlink_to(file),
            "file": lambda: file.replace(lock),
            "pipe": lambda: os.mkfifo(lock),
            "folder": lock.mkdir,
        }
        make[kind]()
        before = lock.lstat()
        with pytest.raises(UsageError, match=r"mine cannot be locked with .*/\.mine\.lock: "):
            held(Path("mine")).__enter__()
        after = lock.lstat()
        assert after[:7] == before[:7] and after.st_mtime_ns == before.st_mtime_ns  # it was read
        assert not Path("nothing").exists()
        if kind in ("link", "hard link", "file"):
            assert lock.read_text(encoding="utf-8") == "all my results"

    def test_the_lock_of_a_process_that_was_killed_is_no_obstacle(self):
        Path(".mine.lock").write_text("process 1, since yesterday", encoding="utf-8")
        with held(Path("mine")):
            assert str(os.getpid()) in Path(".mine.lock").read_text(encoding="utf-8")

    def test_a_file_system_without_locks(self, monkeypatch):
        def flock(file, how):
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

        monkeypatch.setattr(lock.fcntl, "flock", flock)
        with held(Path("mine")), held(Path("mine")):
            pass

    def test_a_system_without_locks(self, monkeypatch):
        monkeypatch.setattr(lock, "fcntl", None)
        with held(Path("mine")), held(Path("mine")):
            assert not list(Path().glob(".*.lock"))


def test_a_folder_that_cannot_be_made_when_its_file_is_written():
    """It could have been when that was looked at; what was made on the way is gone again."""
    Path("new").mkdir()
    Path("new/file").write_text("", encoding="utf-8")
    with pytest.raises(DesimError, match=r"cannot write new/file/more/x\.csv: "):
        write_at(Path("new/file/more/x.csv"), b"")
    assert [path.name for path in Path("new").iterdir()] == ["file"]


@pytest.mark.parametrize("write", ["draft", "whole"])
def test_no_link_is_followed_under_a_name_of_a_draft(write, monkeypatch, somewhere):
    """Even if somebody knew the name before."""
    monkeypatch.setattr(run_folder.uuid, "uuid4", lambda: SimpleNamespace(hex="known"))
    Path("dear").write_text("all my results", encoding="utf-8")
    if write == "draft":
        with pytest.raises(DesimError, match="File exists"), RunPlace(None, "x").draft() as draft:
            (draft.path / "world.json").symlink_to(Path("dear").absolute())
            draft.write_json("world.json", {})
    else:
        Path(".file-known").symlink_to("dear")
        with pytest.raises(DesimError, match="File exists"):
            write_whole(Path("file"), b"")
    assert Path("dear").read_text(encoding="utf-8") == "all my results"
