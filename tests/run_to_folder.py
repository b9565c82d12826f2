"""A run that is written to a folder, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from desim_uav.experiment.command import Done, How, place_of, prepare, write_run
from desim_uav.policies.base import PolicyLike
from desim_uav.scenario.schema import Scenario


def run_to_folder(
    scenario: Scenario,
    policy: PolicyLike,
    *,
    episodes: int,
    warmup: int,
    keep_events: bool,
    out: Path | None,
    command: Sequence[str],
    engine: str = "des",
    say: Callable[[str], None] = lambda notice: None,
    advance: Callable[[], None] = lambda: None,
) -> Done:
    """Run a policy and write the run folder.

    ``engine`` is auto, des or batch. Errors in the scenario, the policy or ``out`` are raised
    before anything is written. The first Ctrl-C ends the run after the current episode, a second
    one at once; finished episodes are kept. Raises KeyboardInterrupt, and keeps nothing, if no
    counted episode has ended.
    """
    prepared = prepare(scenario, policy, engine, keep_events)
    place = place_of(scenario, policy, out)
    if prepared.notice:
        say(prepared.notice)
    how = How(episodes, warmup, keep_events, engine, command)
    return write_run(prepared, how, place, advance)
