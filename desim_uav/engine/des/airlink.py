"""The air link: who is covered, who is attached to whom, and who is served.

Coverage changes at crossings; attachment and admission follow, once in an instant, when all its
crossings, arrivals and requests are known (``_settle``).
"""

from __future__ import annotations

from operator import attrgetter

from desim_uav.engine.base import Measures, measured
from desim_uav.engine.des.agenda import Due, key
from desim_uav.engine.des.crossings import Crossing, Crossings
from desim_uav.engine.des.journal import Journal
from desim_uav.engine.des.radio import Radio
from desim_uav.engine.des.request import Request
from desim_uav.errors import SimulationError
from desim_uav.model.motion import Leg
from desim_uav.model.rules import Phase
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

Sweep = tuple[Radio, int, list[Crossing]]
"""A radio, the number of its sweep, and the crossings to come in it, the next one last."""

Service = tuple[Request, int]
"""A request and its stamp while it is served."""

# An enum member is looked up slowly in Python 3.11; these stand in the busiest lines.
COMPLETION, EXIT, ENTRY = Phase.COMPLETION, Phase.EXIT, Phase.ENTRY
REQUEST, ATTACHMENT, RECORD = Phase.REQUEST, Phase.ATTACHMENT, Phase.RECORD
COVERAGE, ADMISSION = Phase.COVERAGE, Phase.ADMISSION

REQUEST_KEY, SETTLE_KEY, LATE_KEY = key(REQUEST, user=0), key(ATTACHMENT), key(COVERAGE)


def _entered_first(covering: dict[int, int]) -> int:
    """The drone whose footprint was entered first; ties: the lowest index."""
    return min(covering, key=lambda drone: (covering[drone], drone))


class AirLink:
    """Coverage, attachment, admission and service of all users in one episode.

    By user: ``covering`` maps each drone whose footprint holds it to its time of entry,
    ``attached`` is the drone that holds it since ``since_us``, ``open`` its open request.
    ``open_requests`` counts these by service. ``_in_service`` has, of each user who is served, what
    it was served before, less the time at which that began, and what it needs.
    """

    def __init__(
        self, world: World, journal: Journal, path: SamplePath, crossings: Crossings
    ) -> None:
        """Nobody covered, nothing asked."""
        self.world = world
        self.log = journal.log
        self.events = journal.log.events
        self.agenda = journal.agenda
        self.end_us, self.step_us = world.horizon_us, world.step_us
        self.admission = world.scenario.drones.admission
        self.crossings = crossings
        crossings.begin(path.walks)
        services, users = len(world.services.names), len(world.homes)
        drones = range(world.scenario.drones.count)
        self.radios = [Radio(drone, world.bandwidth_bps, services) for drone in drones]
        self.covering: list[dict[int, int]] = [{} for _ in range(users)]
        self.attached: list[Radio | None] = [None] * users
        self.since_us = [0] * users
        self.open: list[Request | None] = [None] * users
        self.open_requests = [0] * services
        self.opened = 0
        self._closed_qoe1 = 0.0
        self._loose: list[int] = []
        self._affected: set[int] = set()
        self._settling = False
        self._unserved_us = self._attached_us = 0
        self._attached_users = 0
        self._in_service: dict[int, tuple[int, int]] = {}
        self._shares = [0.0] * users

    # ---- coverage

    def track(self, radio: Radio, flight: Leg, span_us: int, phase: Phase) -> None:
        """Foresee all crossings of a serving drone's leg of ``span_us``, from now on.

        Those of this very instant happen at once, in ``phase``; of the others the next one is on
        the agenda, which holds one crossing a drone however many users there are.
        """
        radio.sweep += 1
        now_us = self.agenda._now
        found = self.crossings.of(flight, now_us, span_us, fresh=not radio.on)
        radio.on = True
        while found and found[-1][0] == now_us:
            _, user, enters = found.pop()
            if enters:
                self._enter(radio, user, now_us, phase)
            else:
                self._leave(radio, user, now_us, phase)
        if found:
            self._await_next((radio, radio.sweep, found))
        if self._loose or self._affected:
            self._settle_after(phase)

    def _await_next(self, sweep: Sweep) -> None:
        radio, _, ahead = sweep
        t_us, user, enters = ahead[-1]
        place = (radio.entry_key if enters else radio.exit_key) + user
        self.agenda.call(self._on_crossing, sweep, t_us, place)

    def _on_crossing(self, sweep: Sweep) -> None:
        radio, number, ahead = sweep
        if radio.sweep == number:
            now_us, user, enters = ahead.pop()
            if ahead:
                self._await_next(sweep)
            if enters:
                self._enter(radio, user, now_us, ENTRY)
            else:
                self._leave(radio, user, now_us, EXIT)
            if self._loose or self._affected:
                self._settle_after(ENTRY)

    def _enter(self, radio: Radio, user: int, now_us: int, phase: Phase) -> None:
        self.covering[user][radio.index] = now_us
        if self.events is not None:
            self.events.append((now_us, phase, "enter", radio.index, user, -1, -1))
        request = self.open[user]
        if request is not None:
            radio.asking[request.service] += 1
        if self.attached[user] is None:
            self._loose.append(user)

    def _leave(self, radio: Radio, user: int, now_us: int, phase: Phase) -> None:
        del self.covering[user][radio.index]
        if self.events is not None:
            self.events.append((now_us, phase, "exit", radio.index, user, -1, -1))
        request = self.open[user]
        if request is not None:
            radio.asking[request.service] -= 1
        if self.attached[user] is radio:
            self._detach(radio, user, now_us, phase)

    def silence(self, radio: Radio, phase: Phase) -> None:
        """The drone stops serving: its footprint is gone."""
        if not radio.on:
            return
        radio.on = False
        radio.sweep += 1
        now_us = self.agenda._now
        for user, covering in enumerate(self.covering):
            if radio.index in covering:
                self._leave(radio, user, now_us, phase)
        self._settle_after(phase)

    # ---- attachment and admission

    def _detach(self, radio: Radio, user: int, now_us: int, phase: Phase) -> None:
        request = self.open[user]
        since_us = self.since_us[user]
        if request is not None:
            request.count_attached(since_us, now_us)
            if request.serving < 0:
                radio.waiting.remove(request)
            else:
                self._stop(request, now_us, phase)
                if radio.waiting:
                    self._affected.add(radio.index)
        self._attached_us += now_us
        self.attached[user] = None
        self._attached_users -= 1
        radio.attached_users -= 1
        if self.events is not None:
            self.events.append((now_us, phase, "detach", radio.index, user, -1, -1))
        if self.covering[user]:
            self._loose.append(user)

    def _attach(self, radio: Radio, user: int, now_us: int, phase: Phase) -> None:
        self.attached[user] = radio
        self.since_us[user] = now_us
        self._attached_us -= now_us
        self._attached_users += 1
        radio.attached_users += 1
        if self.events is not None:
            self.events.append((now_us, phase, "attach", radio.index, user, -1, -1))
        request = self.open[user]
        if request is not None:
            radio.queue_up(request)
            self._affected.add(radio.index)

    def _settle_after(self, phase: Phase) -> None:
        """See to it that whoever is loose gets attached, and affected queues get scanned.

        That is the matter of the attachment phase; at once, if nothing else of this instant comes
        before. Where commands are the cause, ``settle_commanded`` does it after all of them.
        """
        if (self._loose or self._affected) and not self._settling and phase <= ATTACHMENT:
            if self.agenda.is_next(SETTLE_KEY):
                self._settle(ATTACHMENT, ATTACHMENT)
            else:
                self._settling = True
                self.agenda.call(self._on_settle, None, self.agenda._now, SETTLE_KEY)

    def _on_settle(self, _: None) -> None:
        self._settling = False
        self._settle(ATTACHMENT, ATTACHMENT)

    def settle_commanded(self) -> None:
        """All commands of this instant are given: coverage, then admission, follow them."""
        if self._loose or self._affected:
            self._settle(COVERAGE, ADMISSION)

    def _settle(self, attachment: Phase, admission: Phase) -> None:
        """Attach whoever is loose, to the drone entered first; then scan the affected queues."""
        now_us = self.agenda._now
        if self._loose:
            for user in self._loose:
                covering = self.covering[user]
                if covering and self.attached[user] is None:
                    first = _entered_first(covering) if len(covering) > 1 else next(iter(covering))
                    self._attach(self.radios[first], user, now_us, attachment)
            self._loose.clear()
        if self._affected:
            affected = sorted(self._affected) if len(self._affected) > 1 else self._affected
            for index in affected:
                self._scan(self.radios[index], now_us, admission)
            self._affected.clear()

    def _scan(self, radio: Radio, now_us: int, phase: Phase) -> None:
        """One admission scan of a drone's queue."""
        waiting = radio.waiting
        if not waiting:
            return
        served, refused = self.admission.scan(tuple(waiting), radio.free_bps)
        for request in served:
            waiting.remove(request)
            self._serve(radio, request, now_us, phase)
        for request in refused:
            waiting.remove(request)
            self._close(request, now_us, phase, "refuse")

    def _serve(self, radio: Radio, request: Request, now_us: int, phase: Phase) -> None:
        user, bandwidth_bps = request.user, request.bandwidth_bps
        if bandwidth_bps > radio.free_bps:
            raise SimulationError(
                f"admission {type(self.admission).__name__!r} served more than a drone's bandwidth"
            )
        radio.free_bps -= bandwidth_bps
        radio.served[request.service] += 1
        radio.used_bps += bandwidth_bps
        request.start(radio.index, now_us)
        self._in_service[user] = request.served_us - now_us, request.required_us
        self._unserved_us += now_us
        if self.events is not None:
            self.events.append((now_us, phase, "serve", radio.index, user, request.request_id, -1))
        done_us = now_us + request.required_us - request.served_us
        if done_us <= self.end_us:
            done = (request, request.stamp)
            self.agenda.call(self._on_completion, done, done_us, radio.completion_key + user)

    def _stop(self, request: Request, now_us: int, phase: Phase) -> None:
        radio = self.radios[request.serving]
        user, bandwidth_bps = request.user, request.bandwidth_bps
        elapsed_us = request.stop(now_us)
        del self._in_service[user]
        self._unserved_us -= now_us
        self._shares[user] = request.served_us / request.required_us
        self.log.bandwidth_us_bps += elapsed_us * bandwidth_bps
        radio.free_bps += bandwidth_bps
        radio.used_bps -= bandwidth_bps
        radio.served[request.service] -= 1
        if self.events is not None:
            self.events.append((now_us, phase, "stop", radio.index, user, request.request_id, -1))

    # ---- requests

    def ask(
        self,
        user: int,
        service: int,
        required_us: int,
        bandwidth_bps: int,
        think_us: int = 0,
        again: Due | None = None,
    ) -> None:
        """A user's request opens now; ``again`` will happen ``think_us`` after its end, if ever."""
        now_us = self.agenda._now
        request = Request(
            self.opened, user, service, now_us, required_us, bandwidth_bps, think_us, again
        )
        self.opened += 1
        self.open[user] = request
        self.open_requests[service] += 1
        self._unserved_us -= now_us
        for index in self.covering[user]:
            self.radios[index].asking[service] += 1
        if self.events is not None:
            self.events.append((now_us, REQUEST, "request", -1, user, request.request_id, -1))
        radio = self.attached[user]
        if radio is not None:
            radio.queue_up(request)
            self._affected.add(radio.index)
            self._settle_after(REQUEST)

    def _on_completion(self, service: Service) -> None:
        request, stamp = service
        if request.stamp == stamp:
            now_us = self.agenda._now
            radio = self.radios[request.serving]
            self._stop(request, now_us, COMPLETION)
            self._close(request, now_us, COMPLETION, "complete")
            if radio.waiting:
                self._affected.add(radio.index)
                self._settle_after(COMPLETION)

    def _close(self, request: Request, now_us: int, phase: Phase, kind: str) -> None:
        user = request.user
        radio = self.attached[user]
        if radio is not None:
            request.count_attached(self.since_us[user], now_us)
        request.close(now_us)
        self._closed_qoe1 += request.served_us / request.required_us
        self._shares[user] = 0.0
        self._unserved_us += now_us
        self.open[user] = None
        self.open_requests[request.service] -= 1
        for index in self.covering[user]:
            self.radios[index].asking[request.service] -= 1
        self.log.requests.append(request)
        holder = -1 if radio is None else radio.index
        if self.events is not None:
            self.events.append((now_us, phase, kind, holder, user, request.request_id, -1))
        if request.again is not None:
            again_us = now_us + request.think_us
            if again_us < self.end_us:
                self.agenda.add(request.again, again_us, REQUEST_KEY + user)
            request.again = None

    def measures(self) -> Measures:
        """The quality of experience so far, open requests by what they have had so far.

        The time for which n of something lasted is n * now, less the sum of their beginnings, plus
        that of their ends. The shares are added in the order of their users: a sum of floats is
        another in another order.
        """
        now_us, opened = self.agenda._now, self.opened
        shares, in_service = self._shares, self._in_service
        for user, (before_us, required_us) in in_service.items():
            shares[user] = (before_us + now_us) / required_us
        qoe1 = self._closed_qoe1
        for share in shares:
            qoe1 += share
        unserved = opened - len(self.log.requests) - len(in_service)
        unserved_us = self._unserved_us + unserved * now_us
        attached_us = self._attached_us + self._attached_users * now_us
        lasted_us = len(shares) * now_us
        return measured(
            (
                100 * qoe1 / opened if opened else None,
                unserved_us / self.step_us / opened if opened else None,
                100 * attached_us / lasted_us if lasted_us else None,
            )
        )

    def end(self) -> None:
        """The episode ends: every open request closes, attachments and coverage clear."""
        now_us = self.agenda._now
        for request in self.open:
            if request is not None:
                if request.serving >= 0:
                    self._stop(request, now_us, RECORD)
                self._close(request, now_us, RECORD, "close")
        for user, covering in enumerate(self.covering):
            for index in sorted(covering):
                self._leave(self.radios[index], user, now_us, RECORD)
        for radio in self.radios:
            radio.waiting.clear()
            radio.on = False
        self.log.attached_us = self._attached_us
        self.log.requests.sort(key=attrgetter("request_id"))
