"""What comes out of a policy in a scenario."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import pandas as pd

from desim_uav import qoe as measures
from desim_uav.api import arguments
from desim_uav.api.kept import InFolder, Kept, default_place
from desim_uav.api.links_of_run import LinksOfRun
from desim_uav.api.replay import Page, Replay
from desim_uav.api.result_cells import collected, number, table
from desim_uav.errors import UsageError, did_you_mean
from desim_uav.experiment import command
from desim_uav.experiment.replay.again import Source
from desim_uav.experiment.replay.page import make_replay
from desim_uav.report import notebook
from desim_uav.report.text import tables_of
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.schema import Scenario
from desim_uav.typed import typed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOT_MEASURES = (*command.NAMED, "run_dir")


class RunResult(LinksOfRun):
    """What came out of a policy in a scenario, on one seed or several.

    The tables are pandas frames with the columns of a run folder's files (times in seconds from the
    start of the episode). If the run was asked for ``seeds``, a column ``seed`` stands before them.
    Warm-up episodes have negative numbers, and count in no measure.
    """

    def __init__(self, runs: Sequence[Kept], several: bool = False) -> None:
        self._runs = runs
        self._several = several

    # ---- what was run

    @property
    def scenario(self) -> Scenario:
        """The scenario as it was run, on the first seed."""
        return self._runs[0].scenario

    @property
    def policy(self) -> str:
        """The name of the policy."""
        return str(self._runs[0].manifest["policy"])

    @property
    def seeds(self) -> list[int]:
        """The seeds it was run on."""
        return [int(run.manifest["seed"]) for run in self._runs]

    @property
    def world_seeds(self) -> list[int]:
        """The seeds of the worlds it was run in: one for each seed."""
        return [int(run.manifest["world_seed"]) for run in self._runs]

    @property
    def manifests(self) -> list[dict[str, Any]]:
        """For each seed, how the run was made: scenario, seeds, engine, versions and times."""
        return [run.manifest for run in self._runs]

    @property
    def folders(self) -> list[Path]:
        """The run folders, one for each seed, of a run that was written as it went."""
        return [run.folder for run in self._runs if run.folder is not None]

    def __len__(self) -> int:
        """Return the number of seeds."""
        return len(self._runs)

    # ---- what happened

    @cached_property
    def requests(self) -> pd.DataFrame:
        """One row per request: when it came, what was served of it, its QoE1 and QoE2."""
        return self._table("requests")

    @cached_property
    def steps(self) -> pd.DataFrame:
        """One row per step and drone: place, battery, mode, action, reward."""
        return self._table("steps")

    @cached_property
    def access_points(self) -> pd.DataFrame:
        """One row per step and access point. Raises UsageError if the scenario has none."""
        return self._table("access_points")

    @cached_property
    def updates(self) -> pd.DataFrame:
        """One row per update of a sensor. Raises UsageError if no users are sensors."""
        return self._table("updates")

    @cached_property
    def sensors(self) -> pd.DataFrame:
        """One row per episode and sensor: its age. Raises UsageError if no users are sensors."""
        return self._table("sensors")

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """One row per episode: its measures."""
        return self._table("episodes")

    @cached_property
    def users(self) -> pd.DataFrame:
        """The way points of all users' walks."""
        return self._table("users")

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row per event. Raises NoEventsError unless the run was asked for its events."""
        return self._table("events")

    @cached_property
    def legs(self) -> pd.DataFrame:
        """One row per flight of a drone. Raises NoEventsError as ``events`` does."""
        return self._table("legs")

    def _table(self, name: str) -> pd.DataFrame:
        if not self._several:
            return self._runs[0].table(name)
        frames = [run.table(name) for run in self._runs]
        for frame, seed in zip(frames, self.seeds, strict=True):
            frame.insert(0, "seed", seed)
        return pd.concat(frames, ignore_index=True)

    # ---- how good it was

    @overload
    def qoe(self, by: None = None) -> pd.Series: ...

    @overload
    def qoe(self, by: str) -> pd.DataFrame: ...

    @typed
    def qoe(self, by: str | None = None) -> pd.Series | pd.DataFrame:
        """Return the quality of experience: QoE1 to QoE3 and all other measures.

        QoE1 and QoE2 are means over requests, QoE3 and the reward over episodes. With several seeds
        every measure is the mean of the seeds' measures, counts too.

        Args:
            by: None for everything together (a series), or service, episode, user, outcome, seed or
                group (of users) for a frame with a row per group.

        Raises:
            UsageError: ``by`` is not one of these, or the users are not a list of groups.
        """
        if by is None:
            return self.qoe("seed").mean()
        _check_group(by, *measures.GROUPS, "seed")
        if by == "seed":
            rows = [
                {"seed": run.manifest["seed"]}
                | {key: value for key, value in run.summary.items() if key not in NOT_MEASURES}
                for run in self._runs
            ]
            return _numbers(rows, by).set_index(by)
        rows = [row for run in self._runs for row in run.groups(by)]
        if not rows:
            return pd.DataFrame(columns=list(measures.summary(self._runs[0].table("requests"))))
        return _numbers(rows, by).groupby(by).mean()

    def covered_once(self) -> pd.Series:
        """Return the share of users that drones covered at least once, in percent, for each seed.

        It is the mean over the counted episodes. QoE3 is a time average instead. A user who was
        covered for 0 µs does not count.

        Raises:
            NoEventsError: a user had no open request for part of an episode, so requests do not
                tell whether it was covered, and the run has not kept its events.
        """
        shares = {run.manifest["seed"]: _covered_once(run) for run in self._runs}
        return pd.Series(shares, name="covered_once_percent").rename_axis("seed")

    def summaries(self) -> list[dict[str, Any]]:
        """Return for each seed the measures of everything together, and what was run."""
        return [run.summary for run in self._runs]

    @typed
    def groups(self, by: str = "service") -> list[list[dict[str, Any]]]:
        """Return for each seed the measures of each group of requests, see ``qoe``."""
        _check_group(by, *measures.GROUPS)
        return [run.groups(by) for run in self._runs]

    # ---- what to do with it

    @typed
    def save(self, folder: str | Path | None = None) -> list[Path]:
        """Write the run folder that the command line writes; with ``seeds``, one per seed.

        Args:
            folder: Where. It must not exist, or be empty. If the run was asked for ``seeds``, the
                folders ``s0``, ``s1`` and so on are made in it. Without it, the folders are
                ``runs/<scenario>-<policy>-s<seed>``.

        Returns:
            The folders that were written.

        Raises:
            UsageError: nothing can be written there.
        """
        places = [self._place(run, folder) for run in self._runs]
        return [run.save(place) for run, place in zip(self._runs, places, strict=True)]

    def _place(self, run: Kept, folder: str | Path | None) -> RunPlace:
        if folder is None:
            return default_place(run, None)
        out = Path(folder)
        return default_place(run, out / f"s{run.manifest['seed']}" if self._several else out)

    @typed
    def replay(
        self,
        file: str | Path | None = None,
        *,
        beside: RunResult | str | Path | None = None,
        seed: int | None = None,
        episodes: int | str | Sequence[int] | None = None,
        progress: bool = True,
    ) -> Replay:
        """Make the page that plays the run in continuous time; a notebook shows it.

        Args:
            file: Where to write the page, if anywhere.
            beside: A second run of the same scenario, seed and world, or its folder. The page plays
                both in step, side by side.
            seed: The seed to play. Default: the first.
            episodes: The episodes to show, such as ``"0-3,8"``, 0 or ``[0, 1]``. Default: the
                counted ones, as many as 25 MiB hold.
            progress: Show the progress, if the run has to be played again for its events.

        Raises:
            UsageError: there is no such seed or episode, or the file cannot be written.
            NoEventsError: the run has not kept its events, and cannot be played again.
            PolicyError: the two runs differ in scenario, world or episodes.
        """
        seed = self._first(seed)
        runs = [self._of_seed(seed, "seed")]
        if beside is not None:
            second = beside if isinstance(beside, RunResult) else of_folder(beside)
            runs.append(second._of_seed(seed, "beside"))
        with ExitStack() as open_until:
            sources = [open_until.enter_context(run.source()) for run in runs]
            text = arguments.ranges_of("episodes", episodes)
            page = Replay(make_replay(sources, text, progress))
        if file is not None:
            page.save(file)
        return page

    @typed
    def plot(
        self,
        kind: str = "services",
        out: str | Path | None = None,
        *,
        seed: int | None = None,
        **options: Any,
    ) -> Figure:
        """Draw a figure of the run, which a notebook shows.

        Args:
            kind: visits, battery, energy, episodes, services, delay, age, radio or snapshot;
                with several seeds or policies also compare.
            out: A file that ends in .png, .pdf or .svg, if the figure is to be written.
            seed: The seed to draw. Default: the first; for compare, all.
            options: Those of ``desim_uav.plot`` for this kind, such as ``episode`` and ``drone``.

        Raises as ``desim_uav.plot`` does, and UsageError for a seed that the run does not have.
        """
        from desim_uav.api.pictures import plot

        return plot(kind, self if seed is None else self._alone(seed), out, **options)

    @typed
    def film(
        self, file: str | Path | None = None, *, seed: int | None = None, **options: Any
    ) -> Path:
        """Film an episode of the run, and return the file; see ``desim_uav.film``.

        Args:
            file: A file that ends in .gif or .mp4. Default: ``film.gif`` in the folder of the run,
                or in the working folder if the run has none.
            seed: The seed to film. Default: the first.
            options: Those of ``desim_uav.film``, such as ``episode`` and ``speed``.
        """
        from desim_uav.api.pictures import film

        return film(self if seed is None else self._alone(seed), file, **options)

    @typed
    def report(
        self, file: str | Path | None = None, *, title: str | None = None, progress: bool = True
    ) -> Page:
        """Make the page about the run, or about its seeds compared; a notebook shows it.

        Args:
            file: Where to write the page, if anywhere.
            title: The title of the page.
            progress: Show the progress, if the run has to be played again for its events.

        Raises UsageError if the file cannot be written.
        """
        from desim_uav.api.pictures import report_of

        place = None if file is None else Path(file)
        page = report_of([self], title, file=place, progress=progress)
        if place is not None:
            page.save(place)
        return page

    @contextmanager
    def sources(self) -> Iterator[list[Source]]:
        """Have the run of each seed in a folder while something is made of it."""
        with ExitStack() as open_until:
            yield [open_until.enter_context(run.source()) for run in self._runs]

    def _alone(self, seed: int) -> RunResult:
        """Return the result of one seed. Raises UsageError."""
        return RunResult([self._of_seed(seed, "seed")])

    def _of_seed(self, seed: int, argument: str) -> Kept:
        """Return the run on a seed. Raises UsageError, which names the argument."""
        if seed not in self.seeds:
            raise UsageError(f"{argument}: the run has the seeds {self.seeds}, not {seed}")
        return self._runs[self.seeds.index(seed)]

    # ---- what it looks like

    def __repr__(self) -> str:
        qoe = self.qoe()
        counted = int(self.summaries()[0]["episodes"])
        return (
            f"<{self._title()}, {number(counted, 'episode')}: QoE1 {qoe['qoe1_percent']:.1f} %, "
            f"QoE2 {qoe['qoe2_iterations']:.2f} steps, QoE3 {qoe['qoe3_percent']:.1f} %>"
        )

    def _repr_html_(self) -> str:
        summaries = self.summaries()
        counted, crashes = summaries[0]["episodes"], sum(s["crashes"] for s in summaries)
        title = f"{self._title()}: {number(counted, 'episode')}"
        title += " per seed (mean ± half-width of the 95 % interval)" if len(self) > 1 else ""
        of_seeds = {"all": summaries} | self._by_service()
        groups = [collected(rows) | {"service": name} for name, rows in of_seeds.items()]
        title = notebook.heading(f"{title}, {number(crashes, 'crash', 'crashes')}")
        return title + "".join(table(looks, own) for looks, own in tables_of(groups))

    def _title(self) -> str:
        seeds = self.seeds
        seeds_in_words = f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} seeds"
        if len(set(self.world_seeds)) == 1 and self.world_seeds != seeds:
            seeds_in_words += f" in world {self.world_seeds[0]}"
        label = f"{name}: " if (name := self._runs[0].manifest.get("name")) else ""
        return f"{label}{self.scenario.name}, {self.policy}, {seeds_in_words}"

    def _by_service(self) -> dict[str, list[dict[str, Any]]]:
        """The rows of each service, a row per seed that has it."""
        rows_of: dict[str, list[dict[str, Any]]] = {}
        for groups in self.groups("service"):
            for row in groups:
                rows_of.setdefault(row["service"], []).append(row)
        return dict(sorted(rows_of.items()))


def of_folder(folder: str | Path) -> RunResult:
    """Return the run in a folder; its tables are read when they are asked for."""
    return RunResult([InFolder(Path(folder))])


def _check_group(by: str, *allowed: str) -> None:
    """Raise UsageError if ``by`` is not one of those allowed."""
    if by not in allowed:
        raise UsageError(f"by: {by!r}{did_you_mean(by, allowed)}; allowed: {', '.join(allowed)}")


def _covered_once(run: Kept) -> float:
    """Return the mean share of users covered at least once, from events if requests do not tell."""
    episodes, users = run.table("episodes"), run.scenario.user_count
    duration_s = episodes[episodes["episode"] >= 0].set_index("episode")["duration_s"]
    shares = measures.covered_once(run.table("requests"), duration_s, users)
    if shares.isna().any():
        shares = measures.covered_once_by_events(run.table("events"), duration_s, users)
    return float(shares.mean())


def _numbers(rows: Sequence[dict[str, Any]], by: str) -> pd.DataFrame:
    """Put measures into a frame; a mean of nothing is not a number."""
    frame = pd.DataFrame(rows)
    return frame.astype(
        {name: "float64" for name in frame if name != by and frame[name].isna().any()}
    )
