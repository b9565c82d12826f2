"""Services of several stages, worked by hand: each stage follows the one before at once.

The drone of ``test_transfers.hover`` has 1 MHz, and users at ``FAR`` get 1 bit/s/Hz.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from desim_uav import qoe
from desim_uav.engine.base import EpisodeLog
from desim_uav.experiment import tables
from desim_uav.model.random.streams import Purpose, begin_stream, states_of, uniform
from desim_uav.model.rules import Outcome
from desim_uav.world import World
from tests.engine.helpers import Ask, Flight, events, fly, path_of, seen, strip
from tests.engine.test_transfers import FAR, hover

pytestmark = pytest.mark.usefixtures("every_engine")

UBIT, US = 10**12, 10**6
CALL, EXCHANGE, SURVEY, ROUNDS = range(4)
SERVICES = {
    "call": {"kind": "hold", "duration_min": [1], "bandwidth_kbps": [1]},
    "exchange": {"kind": "tests.staged:Exchange"},
    "survey": {"kind": "tests.staged:Survey"},
    "rounds": {"kind": "tests.staged:Rounds"},
}
SHARED = [EXCHANGE, 3 * UBIT, 6 * UBIT]
"""3 Mbit up and 6 Mbit down."""


def world_of(users: Sequence[tuple[float, float]] = (FAR,), **changes: Any) -> World:
    told = {"services": SERVICES, "demand": {"kind": "static", "mix": {"call": 1}}, **changes}
    return hover(list(users), **told)


def log_of(world: World, asks: Mapping[int, Sequence[Ask]], **path: Any) -> EpisodeLog:
    return fly(world, path_of(world, asks, **path))


def of_requests(log: EpisodeLog) -> list[tuple[Any, ...]]:
    """Time, phase, kind, drone, user, request, and the stage that begins."""
    kinds = ("request", "serve", "stop", "stage", "complete", "close")
    return [(*event[:6], event[-1]) for event in seen(log, *kinds)]


def ask(at_s: float, *values: int) -> Ask:
    return (at_s, 0.0, 0.0, *values)


def test_a_stage_follows_the_one_before_at_once() -> None:
    """3 Mbit take 3 s, and 6 Mbit another 6 s."""
    log = log_of(world_of(), {0: [ask(1.0, *SHARED)]})
    assert of_requests(log) == events(
        """
         1000000 5 request  - 0 0
         1000000 7 serve    0 0 0
         4000000 1 stop     0 0 0
         4000000 1 stage    0 0 0 1
         4000000 7 serve    0 0 0
        10000000 1 stop     0 0 0
        10000000 1 complete 0 0 0
        """
    )
    (request,) = log.requests
    assert (request.outcome, request.served_us, request.interruptions) == (
        *(Outcome.COMPLETED, 9 * US, 0),
    )
    assert (request.asked_us, request.asked_ubit, request.sent_ubit) == (0, 9 * UBIT, 9 * UBIT)


def test_each_stage_shares_what_there_is() -> None:
    """A hold takes half of the band from 2 s to 6 s.

    At 2 s 1 Mbit is left of the first stage, which takes until 4 s; then 1 Mbit of the second is
    sent until 6 s, and the other 5 Mbit until 11 s.
    """
    asks = {0: [ask(0.0, *SHARED)], 1: [(2.0, 4.0, 500.0, CALL)]}
    log = log_of(world_of([FAR, FAR]), asks)
    assert [e[0] for e in seen(log, "stage")] == [4 * US]
    assert {r.user: r.t_end_us for r in log.requests} == {0: 11 * US, 1: 6 * US}


def test_a_time_a_volume_and_another_time() -> None:
    """A survey holds 600 kbit/s for 10 s, sends 6 Mbit, and holds 100 kbit/s for 2 s.

    A call for 600 kbit/s waits from 5 s until the first stage has ended. The second one then has
    400 kbit/s for 10 s, and sends the other 2 Mbit in 2 s at 1 Mbit/s.
    """
    survey = [SURVEY, 10 * US, 600_000, 36_000_000, 2 * US, 100_000]
    asks = {0: [ask(0.0, *survey)], 1: [(5.0, 10.0, 600.0, CALL)]}
    log = log_of(world_of([FAR, FAR]), asks)
    assert of_requests(log) == events(
        """
               0 5 request  - 0 0
               0 7 serve    0 0 0
         5000000 5 request  - 1 1
        10000000 1 stop     0 0 0
        10000000 1 stage    0 0 0 1
        10000000 7 serve    0 0 0
        10000000 7 serve    0 1 1
        20000000 1 stop     0 1 1
        20000000 1 complete 0 1 1
        22000000 1 stop     0 0 0
        22000000 1 stage    0 0 0 2
        22000000 7 serve    0 0 0
        24000000 1 stop     0 0 0
        24000000 1 complete 0 0 0
        """
    )
    done = next(r for r in log.requests if r.user == 0)
    assert (done.asked_us, done.asked_ubit, done.sent_ubit) == (12 * US, 6 * UBIT, 6 * UBIT)
    assert done.bandwidth_bps == 100_000, "that of the last stage"


def test_a_later_stage_waits_for_its_rate() -> None:
    """On a disc of 400 kbit/s a second stage of 300 kbit/s waits for a call of 200 kbit/s.

    The first stage (100 kbit/s) ends at 20 s and the call, which began at 10 s, at 50 s. The
    request was made first, but the call has been admitted: 30 s of QoE2.
    """
    world = strip(
        users=((120.0, 120.0), (120.0, 120.0)),
        bandwidth_kbps=400,
        services=SERVICES | {"exchange": SERVICES["call"], "survey": SERVICES["call"]},
        demand={"kind": "static", "mix": {"call": 1}},
    )
    rounds = [ROUNDS, 20 * US, 100_000, 30 * US, 300_000]
    asks = {0: [ask(0.0, *rounds)], 1: [(10.0, 40.0, 200.0, CALL)]}
    log = log_of(world, asks)
    assert of_requests(log)[2:] == events(
        """
        10000000 5 request  - 1 1
        10000000 7 serve    0 1 1
        20000000 1 stop     0 0 0
        20000000 1 stage    0 0 0 1
        50000000 1 stop     0 1 1
        50000000 1 complete 0 1 1
        50000000 7 serve    0 0 0
        80000000 1 stop     0 0 0
        80000000 1 complete 0 0 0
        """
    )
    first = next(r for r in log.requests if r.user == 0)
    assert (first.served_us, first.interruptions) == (50 * US, 1)
    table = tables.requests_table([log], world).set_index("user")
    assert table.loc[0, "qoe2_iterations"] == 0.5
    assert table.loc[0, "requested_s"] == table.loc[0, "served_s"] == 50.0


@pytest.mark.parametrize(
    ("up", "down", "expected"),
    [
        (0, 6, "0 5 stage - 0 0 1 / 6000000 1 complete 0 0 0"),
        (3, 0, "3000000 1 complete 0 0 0"),
    ],
)
def test_a_stage_of_nothing_is_left_out(up: int, down: int, expected: str) -> None:
    world = world_of()
    log = log_of(world, {0: [ask(0.0, EXCHANGE, up * UBIT, down * UBIT)]})
    assert [e for e in of_requests(log) if e[2] in ("stage", "complete")] == events(
        expected.replace(" / ", "\n")
    )
    (request,) = log.requests
    assert request.served_us == (up + down) * US
    row = tables.requests_table([log], world).iloc[0]
    assert (row["qoe1"], row["stages_done"], row["stage_done"]) == (1.0, 2, 0.0)
    assert row["requested_mbit"] == row["delivered_mbit"] == up + down


def test_a_request_goes_on_in_its_stage_with_another_drone() -> None:
    """A user leaves the footprint 2 s into the second stage, and comes back 20 s later."""
    world = world_of(steps=2)
    away = [(0.0, *FAR, 0.0, 0.0), (5.0, 300.0, 1e4, 0.0, 0.0), (25.0, *FAR, 0.0, 0.0)]
    log = log_of(world, {0: [ask(0.0, *SHARED)]}, walks={0: away})
    assert [e[:3] for e in of_requests(log)][1:] == [
        *((0, 7, "serve"), (3 * US, 1, "stop"), (3 * US, 1, "stage"), (3 * US, 7, "serve")),
        *((5 * US, 2, "stop"), (25 * US, 7, "serve")),
        *((29 * US, 1, "stop"), (29 * US, 1, "complete")),
    ]
    (request,) = log.requests
    assert (request.served_us, request.interruptions) == (9 * US, 1)


def test_progress_is_of_stages_and_the_share_of_the_present_one() -> None:
    """A third of the second stage is done when the episode ends: 2 of 3 of two stages."""
    world = world_of()
    asks = {0: [ask(55.0, *SHARED)]}
    log = log_of(world, asks)
    (request,) = log.requests
    assert (request.outcome, request.stage) == (Outcome.UNFINISHED, 1)
    table = tables.requests_table([log], world)
    row = table.iloc[0]
    assert (row["stages"], row["stages_done"]) == (2, 1)
    assert row["stage_done"] == pytest.approx(1 / 3)
    assert row["qoe1"] == pytest.approx(2 / 3)
    assert (row["requested_mbit"], row["delivered_mbit"]) == (9.0, 5.0)
    assert np.isnan(row["requested_s"]) and np.isnan(row["qoe1_feasible"])
    assert row["qoe2_iterations"] == 0.0
    assert qoe.inconsistency(table) is None
    found = tables.events_table([log], world)
    assert found.loc[found["kind"] == "stage", "stage"].tolist() == [1]
    assert found["station"].isna().all()


def test_measures_count_the_stages_that_are_done() -> None:
    """At 60 s a third of the second stage is done. Nobody serves the call of another user."""
    world = world_of([FAR, (0.0, 0.0)], episode={"steps": 2})
    flight = Flight(world)
    engine = flight.engine
    asks = {0: [ask(55.0, *SHARED)], 1: [(119.0, 60.0, 1.0, CALL)]}
    engine.reset(path_of(world, asks))
    engine.step([flight.command("hover")])
    assert engine.measures().qoe1_percent == pytest.approx(100 * 2 / 3)
    engine.step([flight.command("hover")])
    assert engine.measures().qoe1_percent == pytest.approx(100 * (1 + 0) / 2)


def test_what_a_request_draws() -> None:
    """One number for each list, in the order of the lists, after that for the service."""
    lists = {"duration_s": [10, 20], "held_kbps": [600, 700], "bit_min": [36_000_000]}
    lists |= {"confirm_s": [1, 2, 3], "confirm_kbps": [100, 200, 300, 400]}
    services = {"survey": {"kind": "tests.staged:Survey", **lists}, "call": SERVICES["call"]}
    world = world_of([FAR] * 20, services=services, demand={"kind": "static", "mix": {"survey": 1}})
    rows = world.requests(3, 0).rows
    states = states_of(3, Purpose.DEMAND, [0], 20)
    assert rows.shape == (20, 2 + 5)
    values = services["survey"]
    scales = (1e6, 1e3, 1, 1e6, 1e3)
    for user, (due, service, *drawn) in enumerate(rows.tolist()):
        rng = draws_of(states[0, user])
        _, _ = rng(), rng()
        expected = []
        for own, scale in zip(lists, scales, strict=True):
            options: Any = values[own]
            expected.append(round(options[int(rng() * len(options))] * scale))
        assert (due, service, drawn) == (0, 0, expected)


def draws_of(state: Any) -> Any:
    """The uniform numbers of a stream, one by one."""
    from desim_uav.model.random.streams import Stream
    from desim_uav.rowcode.rows import blank

    stream = blank(Stream)
    begin_stream(stream, state.tolist(), 0)
    return lambda: uniform(stream)
