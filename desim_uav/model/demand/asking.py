"""Demand over rows: models that draw a user's requests one by one, and that can be compiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import SimulationError
from desim_uav.model.catalogue import Catalogue, StageRow, drawn_amount
from desim_uav.model.demand.requests import DRAWN, DUE_US, SERVICE, ManyRequests, Requests
from desim_uav.model.naming import naming
from desim_uav.model.random.streams import Stream, Streams, begin_stream, uniform
from desim_uav.model.services import COMPUTING
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.compiled_registers import held, put_back
from desim_uav.rowcode.compiled_rows import pointer_to
from desim_uav.rowcode.components import (
    Compiled,
    Function,
    ValuesAt,
    call_at,
    compiled_or_none,
    kind_of,
    over_rows,
    remembering,
    ruled,
)
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.packing import attach, packed
from desim_uav.rowcode.rows import (
    Row,
    Table,
    Words,
    blank,
    bound,
    fill,
    is_number,
    number,
    place,
    row,
)
from desim_uav.rowcode.views import View

NOTHING = -1
"""The service of a draw that is no request."""

NO_MORE_US = 2**60
"""The waiting time of users who make no more requests, which is longer than any episode."""


@row
class Asker(Row):
    """A user who makes requests: its number and draws so far, the time left, its present draw.

    ``required_us`` and ``bandwidth_bps`` are the values of the first two lists of the service; of
    its further lists, values are drawn when the request has been made (see ``_draw_others``).
    The askers of a demand model also have the numbers that the model remembers.
    """

    user: int
    draws: int
    left_us: int
    wait_us: int
    service: int
    required_us: int
    bandwidth_bps: int
    stream: Stream


@row
class Offer(Row):
    """The services: the cumulative ``shares`` of the mix, their lists of values and their stages.

    List k of service s has the number ``lists * s + k``. List number n has ``sizes[n]`` equally
    likely values, from ``values[n * longest]`` on; a demand model may also ask for others, from
    ``least[n]`` to ``most[n]``. The stages of service s are those from ``first_stages[s]`` on. No
    volume is delivered faster than at ``most_bps``, in bit/s; 0 if that is not known.
    """

    lists: int
    longest: int
    most_bps: int
    shares: Table[float]
    sizes: Table[int]
    values: Table[int]
    least: Table[int]
    most: Table[int]
    first_stages: Table[int]
    stages: Table[StageRow]


@row
class Asking(Row):
    """The draws of several episodes: where they begin, and the requests that are drawn.

    ``count`` is the number of requests, which may exceed the memory for them (``most`` requests,
    and one more, which those beyond overwrite).
    ``lost`` is the number of the user whose draw is invalid, plus 1; 0 if there is none.
    """

    attached = ("states", "offsets", "asks", "drawn")
    horizon_us: int
    users: int
    most: int
    count: int
    lost: int
    asker: Asker
    states: Table[int]
    offsets: Table[int]
    asks: Table[int]
    drawn: Table[int]


class RowDemand:
    """A demand model over rows, which can be compiled.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    ``remembers`` has the names and types (int or float) of the numbers that a user has besides its
    request; they are 0 at first. If ``after_previous``, waiting times count from the end of a
    request to the next one, else from one request to the next.
    """

    remembers: ClassVar[dict[str, type]] = {}
    after_previous: ClassVar[bool] = True
    asks_from_lists: ClassVar[bool] = False
    """Whether all requests are made by ``ask_for`` and ``ask_for_mix``, and waiting times are not
    below 0, so that they need not be checked. A subclass has to say so itself."""
    plain: ClassVar = ("requests",)
    """The methods of which a subclass overrides one if it makes whole tables of requests."""

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw a user's next request, and the waiting time before it.

        Write ``asker.wait_us``, ``service`` (or NOTHING), ``required_us`` and ``bandwidth_bps``
        (see ``ask_for`` and ``ask_for_mix``). ``asker.user`` is the number of the user, and
        ``asker.draws`` that of the draws before. Draw from ``stream`` only, with ``uniform`` and
        the like from ``model.random.streams``. ``services`` is the Offer. For a service with more
        than two lists of values, the last draws of a request are those of its third list and on.
        """
        raise NotImplementedError

    def from_now(self, now_us: int) -> RowDemand:
        """Return this model as it goes on at a time, from which its times are counted then.

        A model whose draws depend on the time returns one that begins later.
        """
        return self

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return the requests of one episode, with one random stream per user."""
        states = streams.states(users)[np.newaxis]
        return cast(Requests, RowDraws(self, services, horizon_us).of(states)[0])


def from_now(demand: Any, now_us: int) -> Any:
    """Return a demand model as it goes on at a time of the episode."""
    return demand.from_now(now_us) if isinstance(demand, RowDemand) else demand


# ---- what models draw


@rule
def ask_for(asker: Asker, stream: Stream, services: Offer, service: int) -> None:
    """Let a user ask for a service, for one of its service times and with one of its bandwidths.

    In general these are values of its first two lists.
    """
    asker.service = service
    asker.required_us = _value(stream, services, services.lists * service)
    asker.bandwidth_bps = _value(stream, services, services.lists * service + 1)


@rule
def _value(stream: Stream, services: Offer, number: int) -> int:
    """Draw one of the values of a list."""
    k = int(uniform(stream) * services.sizes[number])
    value: int = services.values[services.longest * number + k]
    return value


@rule
def ask_for_mix(asker: Asker, stream: Stream, services: Offer, none: float) -> None:
    """Let a user ask for a service of the mix, or with probability ``none`` for nothing.

    It takes four uniform numbers, of which some may not be used: for whether there is a request,
    for service, duration and bandwidth. They are not drawn if the wait exceeds the time left.
    """
    if asker.wait_us >= asker.left_us:
        return
    asks = uniform(stream) >= none
    which, service = uniform(stream), 0
    for k in range(len(services.shares)):  # without a break, which could not be predicted
        service += int(services.shares[k] <= which)
    ask_for(asker, stream, services, service)
    if not asks:
        asker.service = NOTHING


# ---- the draws of all users

MOST_IDLE = 1000
"""The largest number of draws of a user in which no time passes."""


def _ask_by(
    next_request: Callable[..., None], follow: bool, from_lists: bool
) -> Callable[..., None]:
    """Return a function that writes a user's requests in an episode.

    The function ends at once if a draw is invalid, or if no time passes.
    """

    def ask(demand: Any, asking: Asking, asker: Asker, services: Offer) -> None:
        asks, drawn, lists = asking.asks, asking.drawn, services.lists
        count, most = asking.count, asking.most
        due_us = idle = 0
        asker.left_us = asking.horizon_us
        while True:
            next_request(demand, asker, asker.stream, services)
            asker.draws += 1
            passed_us = asker.wait_us
            if passed_us >= asker.left_us:
                break
            if not (from_lists or _is_sound(asker, services)) or idle > MOST_IDLE:
                asking.lost = 1
                break
            due_us += passed_us
            if asker.service >= 0:
                row = min(count, most)
                asks[DRAWN * row + DUE_US], asks[DRAWN * row + SERVICE] = due_us, asker.service
                first = lists * row
                drawn[first], drawn[first + 1] = asker.required_us, asker.bandwidth_bps
                _draw_others(asker, services, drawn, first)
                least_us = _least_us(asker, services, drawn, first)
                if least_us < 0:
                    asking.lost = 1
                    break
                count += 1
                if follow:
                    passed_us += least_us
                    due_us = 0
            asker.left_us -= passed_us
            idle = 0 if passed_us > 0 else idle + 1
        asking.count = count

    return ask


@rule
def _draw_others(asker: Asker, services: Offer, drawn: Table[int], first: int) -> None:
    """Draw the values of a request beyond the first two, in the order of its lists."""
    for k in range(2, services.lists):
        number, value = services.lists * asker.service + k, 0
        if services.sizes[number] > 0:
            value = _value(asker.stream, services, number)
        drawn[first + k] = value


@rule
def _least_us(asker: Asker, services: Offer, values: Table[int], first: int) -> int:
    """Return the least time in which a request can be served, or -1 if it asks for nothing.

    Its values are those from number ``first`` on. Millionths of a bit are bit/s µs.
    """
    least_us, some = 0, False
    for k in range(services.first_stages[asker.service], services.first_stages[asker.service + 1]):
        stage = services.stages[k]
        amount = drawn_amount(stage, values, first)
        some |= amount > 0
        if stage.timed:
            least_us += amount
        elif stage.line != COMPUTING and services.most_bps > 0:
            least_us += amount // services.most_bps
    return least_us if some else -1


@rule
def _is_sound(asker: Asker, services: Offer) -> Any:
    """Return whether a draw is a request for an existing service, or for nothing."""
    nothing = (asker.service == NOTHING) & (asker.wait_us >= 0)
    exists = (asker.service >= 0) & (asker.service < len(services.shares))
    one = services.lists * asker.service if exists else 0
    request = exists & (asker.required_us >= services.least[one])
    request &= (asker.bandwidth_bps >= 0) & (asker.required_us <= services.most[one])
    request &= asker.bandwidth_bps <= services.most[one + 1]
    return nothing | (request & (asker.wait_us >= 0))


def _anew(asker: Asker) -> Any:
    """Return a row whose numbers are all 0 again."""
    for name, kind in asker.kinds.items():
        if is_number(kind):
            setattr(asker, name, number(kind))
    return asker


def _draw_by(
    ask: Callable[..., None],
    held: Callable[[Any], Any] = _anew,
    put_back: Callable[[Any, Any], None] = lambda asker, held: None,
) -> Callable[..., None]:
    """Return a function that writes all users' requests in some episodes.

    Compiled code works on a copy of an asker whose numbers are 0 (``held``), which is in registers.
    """

    def draw(demand: Any, asking: Asking, services: Offer) -> None:
        users, first = asking.users, 0
        for k in range(len(asking.states) // 4):
            if k % users == 0:
                first = asking.count
            asker = held(asking.asker)
            asker.user = k % users
            begin_stream(asker.stream, asking.states, 4 * k)
            ask(demand, asking, asker, services)
            if asking.lost:
                asking.lost += k % users
                put_back(asking.asker, asker)
                return
            asking.offsets[k + k // users + 1] = asking.count - first

    return draw


def _from_lists(demand: Any) -> bool:
    return bool(vars(demand).get("asks_from_lists", False))


@cache
def _asking_of(demand: Any) -> Any:
    """Return the class of rows for the draws of a class of models."""
    kinds = {**Asking.kinds, "asker": remembering(Asker, demand)}
    return row(type("Asking", (Row,), {"__annotations__": kinds, "attached": Asking.attached}))


def _around(cls: Any, values_at: ValuesAt) -> Any:
    """Return the function ``draw`` of a class of models (see ``Function.around``)."""
    ask = ruled(_ask_by(ruled(cls.next_request), cls.after_previous, _from_lists(cls)))
    draw_all, owner = ruled(_draw_by(ask, held, put_back)), owner_of(cls)
    asking_at, offer_at = pointer_to(_asking_of(cls), owner), pointer_to(Offer, owner)

    def draw(values: int, asking: int, services: int) -> None:
        draw_all(values_at(values), asking_at(asking), offer_at(services))

    return draw


DRAW = Function("draw", _around, (int,) * 3)
"""The function of a model that draws all requests of some episodes.

Its arguments are the addresses of the model's values, of the Asking and of the Offer.
"""


@dataclass(frozen=True, eq=False)
class RowDraws:
    """The draws of a demand model over rows, with ``room`` for so many requests of a user."""

    demand: RowDemand
    services: Catalogue
    horizon_us: int
    most_bps: int = 0
    """No volume is delivered faster, in bit/s; 0 if that is not known."""
    room: list[int] = field(default_factory=lambda: [16], init=False)

    @cached_property
    def _compiled(self) -> Compiled | None:
        return compiled_or_none("demand", self.demand, (DRAW,), self.services.names)

    @cached_property
    def _offer(self) -> Offer:
        own = self.services
        _, lists, longest = own.values.shape
        arrays = (own.share, own.sizes, own.values, own.least, own.most)
        tables = (Table(array.reshape(-1).tolist()) for array in arrays)
        stages = Table(fill(StageRow, stage) for service in own.stages for stage in service)
        numbers = (lists, longest, self.most_bps)
        return fill(Offer, (*numbers, *tables, Table(own.first_stages), stages))

    @cached_property
    def _packed_offer(self) -> Words:
        return packed(self._offer)

    def of(self, states: NDArray[np.uint64]) -> ManyRequests:
        """Draw the requests of episodes from the states of random streams (episodes, users, 4).

        Raises SimulationError if a draw is invalid.
        """
        episodes, users, _ = states.shape
        most = episodes * users * self.room[0]
        offsets = np.zeros((episodes, users + 1), np.int64)
        while True:
            asks = np.empty((most + 1, DRAWN), np.int64)
            drawn = np.empty((most + 1, self.services.draws), np.int64)
            asking = self._draw(states, offsets, asks, drawn)
            if asking.lost:
                raise SimulationError(f"demand: {kind_of(self.demand)!r}: {_what_is_wrong(asking)}")
            if asking.count <= most:
                return ManyRequests(asks, drawn, offsets, self.demand.after_previous)
            most = asking.count
            self.room[0] = most * 5 // (episodes * users * 4) + 2  # some more for later episodes

    def _draw(
        self,
        states: NDArray[np.uint64],
        offsets: NDArray[np.int64],
        asks: NDArray[np.int64],
        drawn: NDArray[np.int64],
    ) -> Any:
        """Draw the requests, and return the Asking."""
        model: Any = type(self.demand)
        code, cls, users = self._compiled, _asking_of(model), states.shape[1]
        block = np.zeros(cls.words, np.int64)
        asking: Any = blank(cls) if code is None else View(block, cls)
        asking.horizon_us, asking.users, asking.most = self.horizon_us, users, len(asks) - 1
        if code is None:
            asking.states = Table(states.reshape(-1).tolist())
            asking.offsets = offsets.reshape(-1)
            asking.asks, asking.drawn = asks.reshape(-1), drawn.reshape(-1)
            demand, owner = over_rows(self.demand, self.services.names), owner_of(model)
            if owner:
                bound(asking, self._offer)
            flags = model.after_previous, _from_lists(model)
            draw = naming(owner, _draw_by(_ask_by(model.next_request, *flags)))
            draw(demand, asking, self._offer)
            return asking
        states = np.ascontiguousarray(states)
        for name, array in zip(cls.attached, (states, offsets, asks, drawn), strict=True):
            attach(block, cls, name, array)
        values, offer = code.values, self._packed_offer
        call_at(code.functions["draw"], (place(values), place(block), place(offer)))
        return asking


def _what_is_wrong(asking: Asking) -> str:
    """Return a description of the invalid draw of a user."""
    user, asker = asking.lost - 1, asking.asker
    asked = f"{asker.service}, {asker.required_us} µs, {asker.bandwidth_bps} bit/s"
    draws = f"wait {asker.wait_us} µs, service {asked}"
    if asker.draws > MOST_IDLE:
        return f"no time passes between the requests of user {user} ({draws})"
    return f"user {user} drew what is no request: {draws}"
