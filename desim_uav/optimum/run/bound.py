"""Upper bounds of QoE3 and QoE1 in a run of several drones, on given sample paths.

docs/explanation/bounds.md proves them. They hold for every policy, including policies that know the
sample paths. With carry-over, the drones may begin in any state that a run can reach; without it,
they begin each episode at their starting cells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from desim_uav.drone_type import DroneType
from desim_uav.model.demand.demand import Continuous
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.optimum.run.alone import ANYWHERE, FORBIDDEN, alone_of, refuse_unbounded
from desim_uav.optimum.run.battery import FINEST
from desim_uav.optimum.run.covered import Covered
from desim_uav.optimum.run.legs import shares_of
from desim_uav.optimum.run.prices import Fleet, Prices, SamePrices, lowest_bound
from desim_uav.optimum.run.schedule import TURNS, TeamSchedule, refuse_unscheduled
from desim_uav.optimum.run.served import Served, asked_in
from desim_uav.sample_path import draw
from desim_uav.world import World

ROUNDS = 200
"""The number of times that the prices of users are changed."""

TRIED = 40
"""The rounds after which QoE1 is given up if its bound is still 100 %."""

COVERED_PRICE, SERVED_PRICE = 0.5, 0.05
"""The prices of covering and of serving any user for a step, at first."""

SLACK_US = 2
"""By how much rounding may change the time of a step for which a drone covers a user."""


@dataclass(frozen=True)
class RunBound:
    """Upper bounds of QoE3 and QoE1, in percent, that no policy exceeds in a run.

    ``crash_free_at_most_percent`` is a bound of QoE3 for policies whose drones do not crash.
    ``qoe1_at_most_percent`` is None if the run has no requests. ``schedule_qoe3_percent`` is the
    QoE3 of a schedule without crashes that was made with knowledge of the sample paths, or None if
    no schedule was looked for, or none without a crash was found.
    """

    episodes: int
    qoe3_at_most_percent: float
    crash_free_at_most_percent: float
    qoe1_at_most_percent: float | None
    schedule_qoe3_percent: float | None

    @property
    def gap_percent(self) -> float | None:
        """The difference between the bound without crashes and the schedule, in percent of this."""
        if not self.schedule_qoe3_percent:
            return None
        return 100.0 * (self.crash_free_at_most_percent / self.schedule_qoe3_percent - 1.0)


class BoundedRun:
    """A run of a world on the sample paths of a seed, without warm-up.

    Raises ScenarioError if the model is not the paper's, and UsageError, with the key, if the run
    cannot be bounded for another reason.
    """

    def __init__(
        self,
        world: World,
        seed: int,
        episodes: int,
        rounds: int = ROUNDS,
        on_work: Callable[[], None] = lambda: None,
    ) -> None:
        refuse_other_models(world.scenario, several_types=True)
        self.world, self.rounds, self.on_work = world, rounds, on_work
        self.paths = [draw(world, seed, episode) for episode in range(episodes)]
        steps = world.scenario.episode.steps
        self.steps = steps * episodes
        self.stretch = self.steps if world.scenario.episode.carry_over else steps
        for kind in _kinds(world):
            refuse_unbounded(kind, world.step_us, self.stretch)
        if world.scenario.users_stay:
            walks, steps_each = [self.paths[0].walks], 1
        else:
            walks, steps_each = [path.walks for path in self.paths], steps
        self.kinds = [
            (kind, shares_of(world, kind, walks, steps_each, on_work)) for kind in _kinds(world)
        ]
        self.fleet = self.fleet_with()
        self.slack = self.fleet.drones * SLACK_US / world.step_us
        self._prices: Prices | None = None

    def fleet_with(self, toll: float = 0.0, finest: int = 1) -> Fleet:
        """Return the drones, whose crashes cost ``toll`` (see ``alone_of``)."""
        types = [
            SamePrices(
                alone_of(kind, self.world.step_us, self.stretch, toll, finest),
                shares,
                _starts(self.world, kind),
            )
            for kind, shares in self.kinds
        ]
        return Fleet(types, self.stretch)

    def bound(self, schedule: bool = True) -> RunBound:
        """Return the bounds; ``schedule`` says whether to look for a good schedule too."""
        if schedule:
            for kind, _ in self.kinds:
                refuse_unscheduled(self.world, kind, self.stretch)
        qoe3 = self.qoe3()
        limited = any(kind.limited for kind, _ in self.kinds)
        same = all(type(own) is Continuous for own in self.world.scenario.demands)
        return RunBound(
            len(self.paths),
            100.0 * qoe3,
            100.0 * (min(qoe3, self.qoe3(crash_price=None)) if limited else qoe3),
            100.0 * qoe3 if same else self._qoe1_percent(),
            self.schedule() if schedule else None,
        )

    def qoe3(self, crash_price: float | None = 0.0) -> float:
        """Return a bound of QoE3, as a share, less a price for each crash per drone and episode.

        With ``crash_price=None`` it is a bound for policies whose drones do not crash.
        """
        users = len(self.world.homes)
        each = users * self.world.scenario.episode.steps / self.fleet.drones
        toll = FORBIDDEN if crash_price is None else crash_price * each
        start, rounds = np.full((self.steps, users), COVERED_PRICE), self.rounds
        if self._prices is not None:
            start, rounds = self._prices, -(-rounds // 2)
        bound, self._prices = self._lowest(self.fleet_with(toll), start, rounds)
        fine = self.fleet_with(toll, FINEST)
        if any(len(one.alone.charge) > len(two.alone.charge) for one, two in self._pairs(fine)):
            bound = min(bound, self._lowest(fine, self._prices, 1)[0])
        return min(1.0, bound + self.slack)

    def _pairs(self, fine: Fleet) -> list[tuple[SamePrices, SamePrices]]:
        """Return each type with fine units of its battery, and with coarse ones."""
        return list(zip(fine.types, self.fleet.types, strict=True))

    def _lowest(self, fleet: Fleet, prices: Prices, rounds: int) -> tuple[float, Prices]:
        """Return a bound of QoE3, without the slack for rounding, and the prices that prove it."""
        left = rounds

        def go_on(lowest: float) -> bool:
            nonlocal left
            left -= 1
            self.on_work()
            return left > 0

        return lowest_bound(Covered(), fleet, prices, go_on)

    def qoe1(self) -> float | None:
        """Return a bound of QoE1, as a share, or None if there are no requests.

        As no policy serves more than everything, it is at most 1.
        """
        requests = [path.requests for path in self.paths]
        chains = asked_in(requests, self.world.scenario.episode.steps, self.world.step_us)
        if not len(chains.required):
            return None
        prices, rounds = np.full((self.steps, len(self.world.homes)), SERVED_PRICE), 0

        def go_on(lowest: float) -> bool:
            nonlocal rounds
            rounds += 1
            self.on_work()
            return rounds < self.rounds and (rounds < TRIED or lowest < 1.0)

        bound, _ = lowest_bound(Served(chains), self.fleet, prices, go_on)
        # Each request may be served for a little longer in each step of its episode.
        longer = self.slack * self.world.scenario.episode.steps
        return min(1.0, bound + longer / float(chains.required.min()))

    def _qoe1_percent(self) -> float | None:
        share = self.qoe1()
        return None if share is None else 100.0 * share

    def schedule(self, turns: int = TURNS) -> float | None:
        """Return the QoE3, in percent, of a schedule that knows the sample paths.

        It is None if a drone of the schedule crashes, because no station is near enough.
        """
        reached: list[float] = []
        crashes = 0
        episodes = self.stretch // self.world.scenario.episode.steps
        for number in range(self.steps // self.stretch):
            team = TeamSchedule(self.world, self.kinds, number * self.stretch, self.stretch)
            team.improve(turns, self.on_work)
            played = team.play(self.paths[number * episodes : (number + 1) * episodes])
            reached, crashes = reached + played[0], crashes + played[1]
        return None if crashes else float(np.mean(reached))


def _kinds(world: World) -> Sequence[DroneType]:
    """Return the types of drones that differ, or the only type of all drones."""
    return world.types if world.scenario.differing else [world.only_type]


def _starts(world: World, kind: DroneType) -> list[tuple[int, int]]:
    """Return how many drones of a type begin in which cell."""
    own = [
        start
        for drone, start in enumerate(world.starts)
        if world.type_of(drone) is kind or not world.scenario.differing
    ]
    if world.scenario.episode.carry_over:
        return [(ANYWHERE, len(own))]
    ny = world.grid.cells[1]
    return sorted(Counter(ix * ny + iy for ix, iy in own).items())
