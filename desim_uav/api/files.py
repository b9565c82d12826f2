"""What only the command line offers: scenario files, the installation, and published papers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from desim_uav.api.parameters import verb
from desim_uav.errors import ScenarioError, UsageError, notice

if TYPE_CHECKING:
    from desim_uav.api.kinds import Overrides
    from desim_uav.experiment.doctor import Check
    from desim_uav.experiment.papers.work import Computed, Listed


class KeptPaper(NamedTuple):
    """A paper that has been computed, and its folder."""

    computed: Computed
    folder: Path


@verb
def list_scenarios(show: str | None = None) -> dict[str, str]:
    """List the shipped scenarios.

    In Python, this returns what each is about, by its name; or the text of one.

    Args:
        show: Print the file of this shipped scenario.

    Raises:
        ScenarioError: there is no shipped scenario of this name.
    """
    from desim_uav import shipped

    if show is not None:
        return {show: shipped.scenario_path(show).read_text(encoding="utf-8")}
    texts = list(map(list_scenarios, shipped.scenario_names()))
    return {name: _first_comment(text) for each in texts for name, text in each.items()}


def _first_comment(text: str) -> str:
    first = text.partition("\n")[0]
    return first.lstrip("# ") if first.startswith("#") else ""


@verb
def list_tutorials(copy: str | Path | None = None) -> dict[str, str]:
    """List the tutorials, or copy them as notebooks, which run wherever notebooks run.

    In Python, this returns the title of each by its name, or by the file that was written.

    Args:
        copy: Write the notebooks into DIR. No file is overwritten.

    Raises:
        UsageError: a file is there already, or cannot be written.
    """
    import json

    from desim_uav.disk import file_place, write_at
    from desim_uav.report.notebook_file import notebook_of, title_of
    from desim_uav.shipped import tutorials

    pages = {name: path.read_text(encoding="utf-8") for name, path in tutorials().items()}
    if copy is None:
        return {name: title_of(page) for name, page in pages.items()}
    files = {name: Path(copy) / f"{name}.ipynb" for name in pages}
    places = {name: file_place(file, "--copy") for name, file in files.items()}
    for file in files.values():
        if file.exists():
            raise UsageError(f"--copy {file}: exists already")
    for name, place in places.items():
        content = json.dumps(notebook_of(pages[name]), indent=1, ensure_ascii=False) + "\n"
        write_at(place, content.encode())
    return {str(file): title_of(pages[name]) for name, file in files.items()}


@verb
def validate(files: Sequence[str], overrides: Overrides | None = None) -> Iterator[str]:
    """Check scenario files: print every error of each, and see that their worlds can be drawn.

    For a scenario that only the SimPy engine can run, print a notice with the keys and the reason.
    Components that a file names as module:Class are imported from the working folder, which runs
    their code; --no-plugins refuses them.

    In Python, this yields what is to be printed of each file.

    Args:
        files: Scenario files, or names of shipped scenarios.
        overrides: Set a key of the scenario, as in users.count=60. In a terminal, -S may be
            repeated.

    Raises:
        ScenarioError: a scenario is invalid; it is raised after the last file.
    """
    from desim_uav.engine.choose import lacking_of
    from desim_uav.experiment.interrupt import at_once
    from desim_uav.scenario.doubts import recordings, warn_of
    from desim_uav.scenario.draft import blaming
    from desim_uav.scenario.load import load, override_texts
    from desim_uav.shipped import find_scenario
    from desim_uav.world import build_world

    problems: list[str] = []
    settings = override_texts(overrides or ())
    for file in files:
        try:
            path = find_scenario(file)
            scenario = at_once(load, path, settings)
            with blaming(path, settings):
                world = at_once(build_world, scenario, scenario.effective_world_seed)
            warn_of(scenario)
            for why in at_once(lacking_of, world):
                notice(f"{file}: only the SimPy engine (--engine des) can run this scenario: {why}")
            yield f"{file}: valid"
            yield from (f"{file}: {recording}" for recording in recordings(scenario))
        except ScenarioError as error:
            problems += error.problems
    if problems:
        raise ScenarioError(*problems)


def schema() -> dict[str, Any]:
    """Print the JSON Schema of scenario files, for editors."""
    from desim_uav.scenario.load import json_schema

    return json_schema()


def doctor() -> list[Check]:
    """Check the installation: versions, extras, the compiled code, and what can be written."""
    from desim_uav.experiment.doctor import examine

    return examine()


@verb
def paper(name: str, *, out: str | Path | None = None, progress: bool = True) -> KeptPaper:
    """Compute a published experiment whole, and compare it with what the paper prints.

    Its folder gets the table, the figure, the scenarios, and what the computation took. The exit
    code is 6 if a figure does not hold. Without a name, all papers are listed.

    Args:
        name: The paper, such as al_hourani_2014.
        out: The folder to write to. It must be new or empty. By default it is runs/paper_<name>.
        progress: Show the progress.

    Raises:
        UsageError: there is no such paper, or the folder cannot be written.
    """
    from desim_uav.experiment.papers import work
    from desim_uav.run_folder import RunPlace

    work.check(name)
    place = RunPlace(None if out is None else Path(out), f"paper_{name}")
    computed = work.compute(name, progress)
    return KeptPaper(computed, work.keep(computed, place))


def list_papers() -> list[Listed]:
    """Return the papers: what is compared, and how each command ended when last measured."""
    from desim_uav.experiment.papers import work

    return work.listing()
