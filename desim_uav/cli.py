"""The command line. Imports what a command needs only when it runs."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from desim_uav import __version__
from desim_uav.errors import DesimError, UsageError

app = typer.Typer(
    help="Exact discrete-event simulation of UAV-enabled wireless networks.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Override = Annotated[
    list[str] | None,
    typer.Option("-S", metavar="KEY.PATH=VALUE", help="Set a key of the scenario; repeatable."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no table.")]
Seed = Annotated[
    int | None, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Not the scenario's.")
]
WorldSeed = Annotated[
    int | None, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Draws the world alone.")
]
Counted = Annotated[int, typer.Option(metavar="N", min=1, max=10**6, help="Counted ones.")]
Warmup = Annotated[
    int, typer.Option(metavar="N", min=0, max=10**6, help="Episodes before, counted nowhere.")
]
Seeds = Annotated[int, typer.Option(metavar="N", min=1, max=10**6, help="How many.")]
FirstSeed = Annotated[
    int, typer.Option(metavar="N", min=0, max=2**62, help="The others follow it.")
]


def _an_engine(name: str | None) -> str | None:
    """An engine's name, or none. Raises BadParameter where there is no such engine."""
    from desim_uav.engine.choose import ENGINES

    return name if name is None else _one_of(ENGINES, name, "--engine")


Engine = Annotated[
    str,
    typer.Option(
        metavar="des|batch", callback=_an_engine, help="SimPy or compiled: the same numbers."
    ),
]
EngineIfAny = Annotated[
    str | None,
    typer.Option(
        metavar="des|batch",
        callback=_an_engine,
        help="SimPy or compiled: the same numbers. Compiled, if it can be.",
    ),
]


def main() -> NoReturn:
    """Run the command line; every error a user can mend is one message and an exit code."""
    sys.path.append("")  # the working folder, where users keep their "module:Class" components
    try:
        try:
            app(prog_name="desim-uav")
        finally:
            print(end="", flush=True)
    except DesimError as error:
        _complain(str(error))
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            _complain(str(error))
        _drop_output()
        sys.exit(1)
    except Exception as error:
        if os.environ.get("DESIM_UAV_TRACEBACK"):
            raise
        _complain(
            f"the simulation failed: {type(error).__name__}: {error}\n"
            "(DESIM_UAV_TRACEBACK=1 shows where)"
        )
        sys.exit(1)
    sys.exit(0)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        print(f"desim-uav {__version__}")
        raise typer.Exit
    if context.invoked_subcommand != "doctor":
        _check_environment()


def _check_environment() -> None:
    """Raises UsageError for settings of Numba under which nothing would run."""
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not threads.isdecimal() or int(threads) < 1:
        raise UsageError(f"NUMBA_NUM_THREADS={threads}: must be a whole number from 1 on")
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        raise UsageError(
            "NUMBA_DISABLE_JIT is set: nothing runs without compiled kernels; unset it"
        )


@app.command()
def scenarios(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print the file of this scenario.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the shipped scenarios."""
    from desim_uav import shipped

    if show is not None:
        print(shipped.scenario_path(show).read_text(encoding="utf-8"), end="")
        return
    names = shipped.scenario_names()
    found = [(name, _first_comment(shipped.scenario_path(name))) for name in names]
    if as_json:
        print(json.dumps(dict(found), indent=1))
        return
    for name, about in found:
        print(f"{name:8s} {about}")


@app.command()
def validate(
    files: Annotated[list[str], typer.Argument(metavar="FILE…", help="Files or shipped names.")],
    overrides: Override = None,
) -> None:
    """Check scenario files, every error of each, and that their worlds can be drawn."""
    from desim_uav.errors import ScenarioError
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario
    from desim_uav.world import build_world

    problems: list[str] = []
    for file in files:
        try:
            path = find_scenario(file)
            scenario = load(path, overrides or [])
            _located(path, lambda s=scenario: build_world(s, s.effective_world_seed))
            print(f"{file}: valid")
        except ScenarioError as error:
            problems += error.problems
    if problems:
        raise ScenarioError(*problems)


@app.command()
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from desim_uav.scenario.load import json_schema

    print(json.dumps(json_schema(), indent=1))


@app.command()
def run(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A scenario file, or a shipped name: case5.")
    ],
    policy: Annotated[
        str,
        typer.Option(
            metavar="P",
            help="baseline, random, hover, policy.npz, script:FILE.csv, sb3:FILE.zip or "
            '"package.module:Class".',
        ),
    ] = "baseline",
    seed: Seed = None,
    world_seed: WorldSeed = None,
    episodes: Counted = 1,
    warmup: Warmup = 0,
    overrides: Override = None,
    events: Annotated[bool, typer.Option("--events", help="Keep the event log.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Instead of runs/<name>-<policy>-s<seed>.")
    ] = None,
    engine: Engine = "des",
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run a policy in a scenario, log every request, and print the quality of experience."""
    from desim_uav.experiment.command import run_to_folder
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario

    settings = _settings(overrides, seed, world_seed)
    path = find_scenario(scenario)
    loaded = load(path, settings)
    _end_politely()
    try:
        done = _located(
            path,
            lambda: run_to_folder(
                loaded,
                policy,
                episodes=episodes,
                warmup=warmup,
                keep_events=events,
                out=out,
                command=["desim-uav", *sys.argv[1:]],
                show_progress=not quiet,
                engine=engine,
                say=_complain,
            ),
        )
    except KeyboardInterrupt:
        _complain("interrupted; nothing is kept")
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(done.summary, indent=1))
    elif not quiet:
        from desim_uav.report.text import print_run

        print_run(done.summary, done.by_service)
    if done.interrupted:
        _complain(f"interrupted; the finished episodes are kept: {done.summary['run_dir']}")
        raise typer.Exit(130)


@app.command()
def train(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A scenario file, or a shipped name: case5.")
    ],
    algorithm: Annotated[
        str | None,
        typer.Option(metavar="A", help="q_learning, sarsa, expected_sarsa or double_q."),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=10**7, help="Not the scenario's.")
    ] = None,
    seed: Seed = None,
    world_seed: WorldSeed = None,
    overrides: Override = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Instead of runs/<name>-<algorithm>-s<seed>.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the folder's checkpoint, if it has one.")
    ] = False,
    checkpoint_every: Annotated[
        int, typer.Option(metavar="N", min=1, max=10**7, help="Episodes between checkpoints.")
    ] = 500,
    engine: EngineIfAny = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Let the drones of a scenario learn; leaves policy.npz, for run --policy."""
    from desim_uav.experiment.progress import training_progress
    from desim_uav.experiment.train import train_to_folder
    from desim_uav.report.text import print_training
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario

    settings = _settings(overrides, seed, world_seed)
    settings += [] if algorithm is None else [f'learning.algorithm="{algorithm}"']
    settings += [] if episodes is None else [f"learning.episodes={episodes}"]
    path = find_scenario(scenario)
    loaded = load(path, settings)
    with training_progress(not quiet, loaded.learning.episodes) as bar:
        done = _located(
            path,
            lambda: train_to_folder(
                loaded,
                out=out,
                resume=resume,
                checkpoint_every=checkpoint_every,
                command=["desim-uav", *sys.argv[1:]],
                engine=engine,
                on_start=bar.start,
                on_episode=bar.advance,
            ),
        )
    if as_json:
        print(json.dumps(done.summary, indent=1))
    elif not quiet:
        print_training(done.summary)
    if done.interrupted:
        _complain(f"interrupted after {done.summary['episodes']} episodes; --resume goes on")
        raise typer.Exit(130)


@app.command()
def optimum(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A scenario file, or a shipped name: case5.")
    ],
    seed: Seed = None,
    world_seed: WorldSeed = None,
    overrides: Override = None,
    as_json: Json = False,
) -> None:
    """Work out how well any policy could do, where users stand still."""
    from desim_uav.experiment.optimum import optimum as best_of
    from desim_uav.report.text import print_optimum
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario

    settings = _settings(overrides, seed, world_seed)
    path = find_scenario(scenario)
    loaded = load(path, settings)
    found = _located(path, lambda: best_of(loaded))
    if as_json:
        print(json.dumps(found, indent=1))
    else:
        print_optimum(found)


@app.command()
def reproduce(
    cases: Annotated[str, typer.Option(metavar="1-9", help="Which, as 1-3,8.")] = "1-9",
    seeds: Annotated[int, typer.Option(metavar="N", min=1, max=10**4, help="From 0 on.")] = 10,
    episodes: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=10**7, help="Of training.")
    ] = None,
    preset: Annotated[
        str, typer.Option(metavar="default|paper|both", help="Train so, or as the paper did.")
    ] = "default",
    jobs: Annotated[int, typer.Option("-j", metavar="N", min=1, max=1000, help="At a time.")] = 1,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Holds what was finished before, too.")
    ] = Path("runs/reproduce"),
    engine: Engine = "batch",
    check: Annotated[
        bool, typer.Option("--check", help="Exit with 6 where a gate does not hold.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Train and evaluate the paper's nine cases, beside what the paper printed."""
    from desim_uav.errors import UsageError
    from desim_uav.experiment import reproduce as table
    from desim_uav.experiment.paper_table import HEADINGS, cells
    from desim_uav.experiment.progress import progress
    from desim_uav.report.paper import print_claims, print_paper_table

    presets: dict[str, list[str | None]] = {
        "default": [None],
        "paper": ["paper"],
        "both": [None, "paper"],
    }
    if preset not in presets:
        raise UsageError(f"--preset {preset}: allowed: {', '.join(presets)}")
    if check and preset == "paper":
        raise UsageError("--check: the gates are of the default training, not of the paper's")
    todo = table.jobs(table.numbers(cases), seeds, episodes, presets[preset])
    with progress(not quiet, len(todo), "jobs", engine) as advance:
        rows = table.run_jobs(todo, out, jobs, advance, engine)
    found = table.report(rows, out, " ".join(["desim-uav", *sys.argv[1:]]))
    if not quiet:
        print_paper_table(HEADINGS, [cells(line) for line in found.table])
        print_claims([(c.text, c.found, c.holds) for c in found.claims])
        print(out / "table.md")
    if check and found.failed:
        _complain("\n".join(f"gate: {claim.text}: {claim.found}" for claim in found.failed))
        raise typer.Exit(6)


@app.command()
def qoe(
    run_dir: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="The folder of a run.")],
    by: Annotated[
        str | None, typer.Option(metavar="service|episode|user|outcome", help="Group by.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Print the quality of experience of a finished run."""
    from desim_uav import qoe as measures
    from desim_uav.experiment.command import read_summary

    if by is not None:
        _one_of(measures.GROUPS, by, "--by")
    summary, groups = read_summary(run_dir, by)
    if as_json:
        added = {} if groups is None else {"by": by, "groups": groups}
        print(json.dumps(summary | added, indent=1))
        return
    from desim_uav.report.text import print_groups, print_summary

    if by is None or groups is None:
        print_summary(summary)
    else:
        print_groups(by, groups)


@app.command()
def compare(
    context: typer.Context,
    what: Annotated[
        list[str],
        typer.Argument(metavar="RUN…|SCENARIO", help="Run folders; or a scenario, and --policies."),
    ],
    policies: Annotated[
        str | None,
        typer.Option(metavar="P,Q…", help="Run these; no name can hold a comma."),
    ] = None,
    seeds: Seeds = 10,
    first_seed: FirstSeed = 0,
    episodes: Counted = 20,
    warmup: Warmup = 2,
    overrides: Override = None,
    jobs: Annotated[
        int, typer.Option("-j", "--jobs", metavar="N", min=1, max=1024, help="Runs at a time.")
    ] = 1,
    against: Annotated[
        str | None, typer.Option(metavar="P", help="The policy of reference; else the first.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="The values of each seed.")
    ] = None,
    engine: Engine = "des",
    as_json: Json = False,
) -> None:
    """Compare policies on common seeds: means, 95 % intervals and paired differences."""
    from desim_uav.experiment import compare as comparing
    from desim_uav.experiment.progress import progress
    from desim_uav.run_folder import file_place, write_whole
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario

    if out is not None:
        out = file_place(out)
    if policies is None:
        _refuse_how_to_run(context)
        found = comparing.compare_runs([Path(folder) for folder in what], against)
    else:
        path = find_scenario(comparing.the_scenario(what))
        if any(override.startswith("seed=") for override in overrides or []):
            raise UsageError("-S seed: each replication has its own; say --first-seed and --seeds")
        loaded = load(path, overrides or [])
        names = comparing.policy_names(policies)
        drawn = range(first_seed, first_seed + seeds)
        for warning in comparing.out_of_place(loaded, names, drawn):
            _complain(warning)
        _end_politely()
        try:
            _located(path, lambda: comparing.try_on(loaded, names, drawn, engine))
            with progress(True, len(names) * len(drawn), "runs", engine) as advance:
                found = _located(
                    path,
                    lambda: comparing.compare_policies(
                        loaded,
                        names,
                        drawn,
                        episodes,
                        warmup,
                        against=against,
                        jobs=jobs,
                        engine=engine,
                        on_replication=advance,
                    ),
                )
        except KeyboardInterrupt:
            _complain("interrupted; no run has ended")
            raise typer.Exit(130) from None
    if out is not None:
        write_whole(out, found.as_csv().encode())
    if as_json:
        print(json.dumps(found.content(), indent=1))
    else:
        from desim_uav.report.text import print_comparison

        print_comparison(found.content())
    if found.interrupted:
        _complain("interrupted; what had ended is shown")
        raise typer.Exit(130)


@app.command()
def sweep(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A scenario file, or a shipped name: case5.")
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Takes results/, a Parquet dataset, a row a job.")
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "-S",
            metavar="KEY.PATH=V,W…",
            help="Values of a key: a,b or from:to or from:to:step; repeatable, every combination.",
        ),
    ] = None,
    policies: Annotated[
        str | None,
        typer.Option(metavar="P,Q…", help="Run these; no name can hold a comma. [baseline]"),
    ] = None,
    learn: Annotated[
        bool, typer.Option("--train", help="Train on each seed, and evaluate greedily.")
    ] = False,
    algorithm: Annotated[
        str | None, typer.Option(metavar="A,B…", help="With --train; else the scenario's.")
    ] = None,
    seeds: Seeds = 10,
    first_seed: FirstSeed = 0,
    episodes: Counted = 20,
    warmup: Warmup = 2,
    jobs: Annotated[
        int | None,
        typer.Option(
            "-j", "--jobs", metavar="N", min=1, max=1024, help="At a time. [1; all cores of Ray]"
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on: run what the folder has no row of.")
    ] = False,
    backend: Annotated[
        str, typer.Option(metavar="local|ray", help="Processes, or a Ray cluster.")
    ] = "local",
    address: Annotated[
        str | None,
        typer.Option(metavar="A", help="The Ray cluster's: auto or host:port. [this machine]"),
    ] = None,
    engine: EngineIfAny = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run policies, or train, in every combination of keys' values, on common seeds."""
    from desim_uav.experiment.sweep_command import BACKENDS, Asked, sweep_to_folder
    from desim_uav.shipped import find_scenario

    _end_politely()
    try:
        done = sweep_to_folder(
            find_scenario(scenario),
            Asked(
                overrides or [],
                policies,
                learn,
                algorithm,
                range(first_seed, first_seed + seeds),
                episodes,
                warmup,
                engine,
            ),
            out,
            resume=resume,
            backend=_one_of(BACKENDS, backend, "--backend"),
            workers=jobs,
            address=address,
            command=["desim-uav", *sys.argv[1:]],
            show_progress=not quiet,
            say=_complain,
        )
    except KeyboardInterrupt:
        _complain("interrupted; what had ended is kept; --resume goes on")
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(done.content(), indent=1))
    elif not quiet:
        from desim_uav.report.text import print_sweep

        print_sweep(done.headings(), done.lines())
        print(out / "results")
    if done.failures:
        _complain(done.complaint())
    if done.interrupted:
        _complain(
            f"interrupted; {len(done.rows)} of {len(done.jobs)} jobs are kept; --resume goes on"
        )
    if done.interrupted or done.failures:
        raise typer.Exit(130 if done.interrupted else 1)


@app.command()
def replay(
    run_dir: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="The folder of a run.")],
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Instead of RUN_DIR/replay.html.")
    ] = None,
    episodes: Annotated[
        str | None, typer.Option(metavar="0-9", help="Which, as 0-3,8; else the counted ones.")
    ] = None,
    open_it: Annotated[bool, typer.Option("--open", help="Show it in the browser.")] = False,
    as_json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Write a page that plays a run's episodes in continuous time; any browser opens it."""
    from desim_uav.experiment.replay import write_replay

    done = write_replay(run_dir, html, episodes, not quiet)
    if done.left_out:
        _complain(
            f"{done.file}: it holds episodes {done.episodes[0]} to {done.episodes[-1]}; with the "
            f"{len(done.left_out)} others it would pass 25 MiB: choose some with --episodes"
        )
    if as_json:
        print(json.dumps(done.summary(), indent=1))
    else:
        print(done.file)
    if open_it:
        import webbrowser

        webbrowser.open(done.file.resolve().as_uri())


@app.command()
def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN_DIR…", help="Folders of runs.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.html", help="Instead of RUN_DIR/report.html, or report.html."),
    ] = None,
    title: Annotated[str | None, typer.Option(metavar="T", help="Of the page.")] = None,
    against: Annotated[
        str | None, typer.Option(metavar="P", help="The policy of reference; else the first.")
    ] = None,
) -> None:
    """Write a page on a run, or on several compared, that needs no network and no server."""
    from desim_uav.experiment.report import report as write_report

    print(write_report(runs, out, title, against))


@app.command()
def plot(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="training, compare, visits, policy, battery, episodes, services or snapshot.",
        ),
    ],
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…", help="The folder of a run or training; for policy also a table."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help=".png, .pdf or .svg; else RUN/KIND.png."),
    ] = None,
    episode: Annotated[
        int | None, typer.Option(metavar="N", help="visits, battery, services, snapshot: this one.")
    ] = None,
    minute: Annotated[
        float | None, typer.Option(metavar="M", min=0, help="snapshot: then; else at the end.")
    ] = None,
    drone: Annotated[
        int | None, typer.Option(metavar="D", min=0, help="visits, policy, battery: this one.")
    ] = None,
    window: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="training: episodes of a running mean.")
    ] = None,
    battery_min: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="policy: minutes left; else half.")
    ] = None,
    level: Annotated[
        int | None, typer.Option(metavar="K", min=0, help="policy: from 0, the lowest.")
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="P", help="compare: the policy of reference.")
    ] = None,
) -> None:
    """Draw a figure of runs, trainings or a learned policy."""
    from desim_uav.experiment.plot import plot as draw

    asked: dict[str, Any] = {"episode": episode, "minute": minute, "drone": drone, "window": window}
    asked |= {"battery_min": battery_min, "level": level, "against": against}
    print(draw(kind, runs, out, asked))


@app.command()
def video(
    run_dir: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="The folder of a run.")],
    gif: Annotated[Path | None, typer.Option(metavar="FILE.gif", help="An endless one.")] = None,
    mp4: Annotated[
        Path | None, typer.Option(metavar="FILE.mp4", help="H.264 (needs the extra video).")
    ] = None,
    episode: Annotated[
        int | None, typer.Option(metavar="N", help="Else the first that counts.")
    ] = None,
    fps: Annotated[float, typer.Option(metavar="N", min=1, max=60, help="Frames a second.")] = 12,
    speed: Annotated[
        float, typer.Option(metavar="N", min=0.1, max=3600, help="Simulated seconds in a second.")
    ] = 120,
    width: Annotated[
        int, typer.Option(metavar="N", min=160, max=1920, help="In pixels; height is 3/4 of it.")
    ] = 800,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Film an episode of a run, in continuous time."""
    from desim_uav.experiment.plot import film

    made = film(
        run_dir,
        gif,
        mp4,
        episode=episode,
        fps=fps,
        speed=speed,
        width=width,
        show_progress=not quiet,
    )
    for place in made:
        print(place)


@app.command()
def doctor(as_json: Json = False) -> None:
    """Look at what is installed, what fits together and what can be written, in plain words."""
    from desim_uav.experiment.doctor import as_content, examine
    from desim_uav.report.text import print_findings

    findings = examine()
    content = as_content(findings)
    if as_json:
        print(json.dumps(content, indent=1))
    else:
        print_findings([(f.verdict, f.what, f.words) for f in findings])
    if not content["healthy"]:
        raise typer.Exit(1)


def _refuse_how_to_run(context: typer.Context) -> None:
    """Finished runs are as they are. Raises UsageError for an option that says how to run."""
    for option in ("seeds", "first_seed", "episodes", "warmup", "overrides", "jobs", "engine"):
        source = context.get_parameter_source(option)
        if source is not None and source.name == "COMMANDLINE":
            flag = {"overrides": "-S", "jobs": "-j"}.get(option, "--" + option.replace("_", "-"))
            raise UsageError(f"{flag} goes with a scenario and --policies, not with finished runs")


def _one_of(allowed: Collection[str], word: str, option: str) -> str:
    """The word. Raises BadParameter where it is none of those allowed."""
    from desim_uav.registry import did_you_mean

    if word not in allowed:
        raise typer.BadParameter(
            f"{word!r}{did_you_mean(word, allowed)}; allowed: {', '.join(allowed)}",
            param_hint=option,
        )
    return word


def _settings(overrides: list[str] | None, seed: int | None, world_seed: int | None) -> list[str]:
    """What the command line sets of a scenario."""
    settings = list(overrides or [])
    settings += [] if seed is None else [f"seed={seed}"]
    settings += [] if world_seed is None else [f"world_seed={world_seed}"]
    return settings


def _located(path: Path, action: Any) -> Any:
    """Run ``action``; a scenario error found only in drawing the world gets its file's name."""
    from desim_uav.errors import ScenarioError

    try:
        return action()
    except ScenarioError as error:
        raise ScenarioError(*(f"{path}: {problem}" for problem in error.problems)) from error


def _complain(problems: str) -> None:
    """Say what is wrong on stderr."""
    for problem in problems.splitlines():
        print(f"desim-uav: {problem}", file=sys.stderr)


def _drop_output() -> None:
    """Nobody takes what is still to be printed: send it nowhere, or Python complains at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _end_politely() -> None:
    """Make ``kill`` and a lost terminal end a run as Ctrl-C does, unless they are ignored."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


def _first_comment(path: Path) -> str:
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    return first.lstrip("# ") if first.startswith("#") else ""
