"""Make the leaderboard of the benchmark from nothing: references, trainings, runs and pages.

    python analysis/leaderboard.py [-j 2] [--list] [--pages] [PART…]

Only what is missing is made, in this order: the references and bounds of all runs, the trained
policies (in runs/leaderboard), the submissions (in analysis/leaderboard), their verification by a
replay, and the pages in docs/benchmark with their figures. After Ctrl-C, what has ended is kept.
With PART, only parts are made whose name contains one of these, such as edge-small or greedy.
--list shows the parts that are missing, and --pages writes the pages of what is there.

PLAN says which tasks, tracks and seeds are flown, and CONTENDERS which policies: a policy more is a
line there. The processor time of each part is kept in analysis/leaderboard/times.csv, and the first
page has its sums.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import leaderboard_pages
import yaml
from leaderboard_pages import Planned, Policy
from leaderboard_times import Times, spent_s

import desim_uav as du
from desim_uav.errors import (
    DesimError,
    PolicyError,
    SimulationError,
    UsageError,
    did_you_mean,
    printable,
)
from desim_uav.experiment.bench.kept import complete, reference_of
from desim_uav.experiment.bench.receipts import DECIDED, add_receipt, digest_of, read_receipts
from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.submission import Submission, read
from desim_uav.experiment.bench.tasks import FAMILIES, TRACKS, BenchTrack, Task, find_task
from desim_uav.experiment.bench.verify import differences, lacking_policy
from desim_uav.experiment.interrupt import end_politely
from desim_uav.experiment.processes import run_each, run_script
from desim_uav.policies.mlp import MlpFile
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.load import loads

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "analysis" / "leaderboard"
PAGES = ROOT / "docs" / "benchmark"
MADE = Path("runs") / "leaderboard"
RECEIPTS, TIMES = "receipts.json", "times.csv"

TRAINED = "{trained}"
"""What stands for the file of a training in the name of a policy."""

GRIDS = tuple(family for family in FAMILIES if family != "dispatch")
"""The tasks whose drones choose among actions, as tables do."""

NETWORKS = {"ppo": ("-S", "world_seed=0"), "ppo_any": ("--worlds", "train")}
"""The learners of networks, by ``policies/ppo.py`` in world 0 or in training worlds; other learners
are those of ``desim-uav train``, which train tables as the task's key ``learning`` says."""

SETTINGS = ("--steps", "400000", "-S", "episode.steps=120")
"""The settings of networks, beside the task's own reward; all others are the defaults of
``policies/ppo.py``."""


@dataclass(frozen=True)
class Field:
    """Runs that are compared: those of the tasks of a size in a track, on its first seeds."""

    size: str
    track: str
    seeds: int


PLAN = (Field("small", "one", 10), Field("medium", "one", 10), Field("small", "any", 32))


@dataclass(frozen=True)
class Contender:
    """A policy of the leaderboard: its name, what ``--policy`` accepts, what it is, where it flies.

    If ``TRAINED`` is in ``policy``, it is trained by a learner in so many trainings.
    """

    name: str
    policy: str
    words: str
    learner: str = ""
    trainings: int = 1
    families: Sequence[str] = FAMILIES
    sizes: Sequence[str] = ("small", "medium")
    tracks: Sequence[str] = tuple(TRACKS)
    plans: bool = False
    """Whether its decisions take so long that they are not made again when it is verified."""

    @property
    def learned(self) -> bool:
        """Whether its numbers were learned, here or before."""
        return TRAINED in self.policy or self.policy.endswith(".npz")


PPO = "a network, trained in the task by [`policies/ppo.py`](../howto/ppo.md)"

CONTENDERS = (
    Contender("random", "random", "a random allowed action"),
    Contender("hover", "hover", "stays where it is, and never charges"),
    Contender("baseline", "baseline", "the fixed routes of the paper"),
    Contender(
        *("Q-learning", TRAINED, "a table, trained in the task by `desim-uav train`"),
        *("q_learning", 5, GRIDS),
        tracks=("one",),
    ),
    Contender("tour", "tour", "flies past all sensors again and again", families=("harvest",)),
    Contender(
        *("PPO of case 8", "ppo_case8_any.npz"),
        "a network, trained in other worlds of [case 8](../howto/ppo.md#in-any-world)",
        families=("multi-service",),
    ),
    Contender(
        "greedy",
        "greedy",
        "plans [some steps ahead](../explanation/planners.md#greedy)",
        plans=True,
    ),
    Contender(
        *("planner", "planner_case8.npz"),
        "`greedy` with numbers "
        "[learned in case 8](../howto/expert.md#learn-the-numbers-of-the-planner)",
        families=GRIDS,
        sizes=("small",),
        plans=True,
    ),
    Contender(
        *("dispatcher", "dispatch.npz"),
        "ranks places by numbers [learned](../howto/decisions.md#learn-to-dispatch) in world 0 of "
        "the small task",
        families=("dispatch",),
        plans=True,
    ),
    Contender("PPO", TRAINED, PPO, "ppo", 3, tracks=("one",)),
    Contender("PPO", TRAINED, PPO, "ppo_any", 3, sizes=("small",), tracks=("any",)),
)


@dataclass(frozen=True)
class Training:
    """A training: the task, the learner and the seed."""

    task: Task
    learner: str
    seed: int

    @property
    def name(self) -> str:
        """The name of the training as a part."""
        return f"{self.task.family}-{self.task.size}-{self.learner}-{self.seed}"

    @property
    def file(self) -> Path:
        """The file of the trained policy, which is of this very scenario."""
        return MADE / f"{self.name}-{self.task.scenario_hash[:8]}" / "policy.npz"


@dataclass(frozen=True)
class Entry:
    """A submission: a contender in a task and track, with its first seeds."""

    contender: Contender
    task: Task
    track: BenchTrack

    @property
    def name(self) -> str:
        """The name of the submission's folder."""
        words = "".join(one if one.isalnum() else "-" for one in self.contender.name.lower())
        return f"{_field(self.task, self.track)}-{words}"

    def trainings(self) -> list[Training]:
        """Return the trainings whose policies fly."""
        contender = self.contender
        many = contender.trainings if TRAINED in contender.policy else 0
        return [Training(self.task, contender.learner, seed) for seed in range(many)]

    def policies(self) -> list[str]:
        """Return the policies as ``--policy`` accepts them."""
        policy = self.contender.policy
        return [policy.replace(TRAINED, str(one.file)) for one in self.trainings()] or [policy]

    @property
    def decidable(self) -> bool:
        """Whether the policies that its manifest names are here and decide quickly."""
        there = self.submission()
        return there is not None and not self.contender.plans and not lacking_policy(there)

    def submission(self) -> Submission | None:
        """Return the submission if it is there, of this task, with all seeds and trainings."""
        try:
            there = read(FOLDER / self.name)
        except PolicyError:
            return None
        about, wanted = there.about, (list(self.track.seeds), len(self.policies()))
        whole = (about.seeds, len(about.trainings)) == wanted and not about.interrupted
        return there if whole else None


def _field(task: Task, track: BenchTrack) -> str:
    return f"{task.family}-{task.size}-{track.name}"


def fields() -> Iterator[tuple[Task, BenchTrack]]:
    """Yield the tasks and tracks of the plan, with the seeds that are flown."""
    for field in PLAN:
        track = TRACKS[field.track]
        for family in FAMILIES:
            task = find_task(f"uav-v1/{family}/{field.size}")
            yield task, replace(track, seeds=track.seeds[: field.seeds])


def entries() -> list[Entry]:
    """Return all submissions of the leaderboard, in the order in which they are made."""
    return [
        Entry(contender, task, track)
        for field in PLAN
        for contender in CONTENDERS
        for task, track in fields()
        if (task.size, track.name) == (field.size, field.track)
        and task.family in contender.families
        and task.size in contender.sizes
        and track.name in contender.tracks
    ]


def main() -> int:
    """Make what is missing; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-j", dest="jobs", type=int, default=1, help="parts at a time")
    parser.add_argument("--list", action="store_true", help="only list what is missing")
    parser.add_argument("--pages", action="store_true", help="only write the pages")
    parser.add_argument("parts", nargs="*", metavar="PART", help="make only parts with such names")
    asked = parser.parse_args()
    end_politely()
    try:
        unlike = make(asked.parts, asked.jobs, only_list=asked.list, only_pages=asked.pages)
    except DesimError as error:
        print(printable(f"leaderboard.py: {error}"), file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("leaderboard.py: interrupted; what has ended is kept", file=sys.stderr)
        return 130
    print(*unlike, sep="\n", end="\n" if unlike else "", file=sys.stderr)
    return 6 if unlike else 0


def make(parts: Sequence[str], jobs: int, *, only_list: bool, only_pages: bool) -> list[str]:
    """Make the parts that are missing, or list them, or only write the pages.

    Returns in what submissions differ from their replay. Raises UsageError if no submission has
    such a name.
    """
    listed = entries()
    words = [word for one in listed for word in (one.name, *one.name.split("-"))]
    lost = [part for part in parts if not any(_asked(one, [part]) for one in listed)]
    if lost:
        told = ", ".join(f"{part}{did_you_mean(part, words)}" for part in lost)
        raise UsageError(f"{told}: no part of the leaderboard has such a name")
    chosen = [one for one in listed if _asked(one, parts)]
    if jobs < 1:
        raise UsageError(f"-j {jobs}: must be at least 1")
    missing = [one for one in chosen if one.submission() is None]
    if only_list:
        print(*(one.name for one in missing), sep="\n")
        return []
    times, unlike = Times(FOLDER / TIMES), list[str]()
    if not only_pages:
        _refer(chosen, jobs, times)
        needed = {training: None for one in missing for training in one.trainings()}
        untrained = [one for one in needed if not one.file.exists()]
        _each(trained, untrained, jobs, times, "training")
        _each(flown, missing, jobs, times, "runs")
        unlike = _verify(chosen, jobs, times)
    _write(times)
    return unlike


def _write(times: Times) -> None:
    """Write the pages of the submissions that are there."""
    since_s, planned = spent_s(), {one: one.submission() for one in entries()}
    there = [submission for submission in planned.values() if submission is not None]
    plan = [
        Planned(one.task, one.track.name, one.contender.name, submission is not None)
        for one, submission in planned.items()
    ]

    def costs() -> str:
        times.add("pages", "pages", spent_s() - since_s, anew=True)
        return leaderboard_pages.costs(plan, times)

    policies = {one.name: Policy(one.words, one.learned) for one in CONTENDERS}
    leaderboard_pages.write(PAGES, there, _checks(), policies, costs)
    print(f"{PAGES}: {len(there)} of {len(planned)} submissions")


def _asked(entry: Entry, parts: Sequence[str]) -> bool:
    return not parts or any(part in entry.name for part in parts)


def _refer(chosen: Sequence[Entry], jobs: int, times: Times) -> None:
    """Compute the references and bounds that are missing, or whose time is unknown."""
    for task, track in dict.fromkeys((one.task, one.track) for one in chosen):
        name, kind = _field(task, track), "references"
        anew = (kind, name) not in times.all()
        if not anew and all(reference_of(task, track, seed) for seed in track.seeds):
            continue
        since_s = spent_s()
        try:
            complete([task], [track], jobs, anew=anew)
        finally:
            times.add(kind, name, spent_s() - since_s)
        print(f"references of {name}: {spent_s() - since_s:.1f} s of processor time", flush=True)


def _each(
    function: Callable[[Any], float],
    work: Sequence[Training | Entry],
    jobs: int,
    times: Times,
    kind: str,
) -> None:
    """Make parts, print each that has ended, and keep its processor time."""
    with closing(run_each(function, [(one,) for one in work], jobs)) as ended:
        for count, (number, part_s) in enumerate(ended, 1):
            name = work[number].name
            times.add(kind, name, part_s, anew=True)
            print(f"{kind} {count} of {len(work)}: {name}: {part_s:.1f} s", flush=True)


def trained(training: Training) -> float:
    """Train a policy, and return the processor time that it took, in seconds.

    The file has its name only after the training. Raises SimulationError if that fails.
    """
    since_s, task, learner = spent_s(), training.task, training.learner
    new = MADE / "new" / training.name
    shutil.rmtree(new, ignore_errors=True)
    if learner in NETWORKS:
        new.mkdir(parents=True)
        options = ["--seed", str(training.seed), "--out", str(new / "policy.npz")]
        options += [*SETTINGS, *NETWORKS[learner], *own_reward(task)]
        words = [str(ROOT / "policies" / "ppo.py"), str(task.path), *options]
        code, said = run_script(words)
        if code != 0:
            raise SimulationError(f"{training.name}: {said.strip() or 'it has failed'}")
    else:
        du.train(
            task.path, algorithm=learner, seed=training.seed, world_seed=0, progress=False
        ).save(new)
    shutil.rmtree(training.file.parent, ignore_errors=True)
    shutil.move(new, training.file.parent)
    return spent_s() - since_s


def own_reward(task: Task) -> list[str]:
    """Return the options by which a network is trained on the task's own reward."""
    reward = yaml.safe_load(task.path.read_text(encoding="utf-8"))["reward"]
    return ["-S", f"reward={json.dumps(reward)}"]


def steps_of(entry: Entry) -> int | None:
    """Return the decision epochs of a training; None if nothing is trained here."""
    trainings = entry.trainings()
    if not trainings:
        return None
    if trainings[0].learner in NETWORKS:
        about = MlpFile(trainings[0].file).about["training"]
        return int(about["steps_done"] // loads(about["scenario_yaml"]).drone_count)
    scenario = entry.task.scenario(TRACKS["one"])
    return scenario.learning.episodes * scenario.episode.steps


def flown(entry: Entry) -> float:
    """Make a submission, and return the processor time that it took, in seconds."""
    since_s, policies, steps = spent_s(), entry.policies(), steps_of(entry)
    new, folder = MADE / "new" / entry.name, FOLDER / entry.name
    shutil.rmtree(new, ignore_errors=True)
    command = ["desim-uav", "bench", "run", entry.task.name, "--track", entry.track.name]
    command += [word for policy in policies for word in ("--policy", policy)]
    command += ["--seeds", str(len(entry.track.seeds)), "--name", entry.contender.name]
    command += [] if steps is None else ["--training-steps", str(steps)]
    submit(
        *(entry.task, entry.track, policies, RunPlace(new, new.name)),
        name=entry.contender.name,
        seeds=entry.track.seeds,
        training_steps=steps,
        command=command,
    )
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(new, folder)
    return spent_s() - since_s


def _checks() -> dict[str, str]:
    """Return how submissions were verified, by their digests."""
    return read_receipts(FOLDER / RECEIPTS) if (FOLDER / RECEIPTS).exists() else {}


def _verify(chosen: Sequence[Entry], jobs: int, times: Times) -> list[str]:
    """Replay the submissions without a receipt, and note those that are verified.

    Policies that can decide again do so. Returns every difference.
    """
    unlike = list[str]()
    checks = _checks()
    work = [
        one
        for one in chosen
        if (check := checks.get(digest_of(FOLDER / one.name))) is None
        or (check != DECIDED and one.decidable)
    ]
    with closing(run_each(replayed, [(one,) for one in work], jobs)) as ended:
        for count, (number, (part_s, listed)) in enumerate(ended, 1):
            name = work[number].name
            unlike += [f"{name}: {line}" for line in listed]
            if not listed:
                add_receipt(FOLDER / RECEIPTS, FOLDER / name, decided=work[number].decidable)
            times.add("verification", name, part_s, anew=True)
            print(f"verified {count} of {len(work)}: {name}: {part_s:.1f} s", flush=True)
    return unlike


def replayed(entry: Entry) -> tuple[float, list[str]]:
    """Verify a submission; return the processor time and the differences from its replay.

    They include those from what its policies decide now, if they can decide again.
    """
    since_s = time.process_time()
    listed = differences(read(FOLDER / entry.name), decide=entry.decidable)
    return time.process_time() - since_s, listed


if __name__ == "__main__":
    sys.exit(main())
