"""The stages of the requests of an episode, from what they have drawn."""

from __future__ import annotations

from dataclasses import dataclass

from desim_uav.engine.base import ClosedRequest, EpisodeLog
from desim_uav.sample_path import SamplePath
from desim_uav.world import World


@dataclass(frozen=True)
class Part:
    """A stage: so many microseconds or millionths of a bit, with a rate that is held, or none.

    It may go ``up``, in the band of uploads if there is one.
    """

    timed: bool
    amount: int
    bps: int
    shares: bool
    up: bool


def parts_of(world: World, log: EpisodeLog, path: SamplePath | None) -> list[list[Part]]:
    """The stages of each request, by its number; ``path`` is needed only if there are several."""
    return [_parts(world, log, path, request) for request in log.requests]


def _parts(
    world: World, log: EpisodeLog, path: SamplePath | None, request: ClosedRequest
) -> list[Part]:
    service = list(world.scenario.services.values())[request.service]
    stages = service.stages()
    if len(stages) == 1:
        (stage,) = stages
        shares = stage.rate is None
        return [Part(stage.timed, request.required, request.bandwidth_bps, shares, stage.up)]
    assert path is not None
    drawn = dict(zip(service.values(), _drawn(log, path, request), strict=False))
    return [
        Part(
            stage.timed,
            drawn[stage.amount] * (drawn[stage.times] if stage.times else 1) // stage.per,
            drawn[stage.rate] if stage.rate else 0,
            stage.rate is None,
            stage.up,
        )
        for stage in stages
    ]


def _drawn(log: EpisodeLog, path: SamplePath, request: ClosedRequest) -> list[int]:
    """What a request has drawn: the next of its user's, or the one that was due when it came."""
    rows, offsets, _ = path.requests
    own = rows[offsets[request.user] : offsets[request.user + 1]].tolist()
    if path.requests.follows[request.user]:
        of_user = [one.request_id for one in log.requests if one.user == request.user]
        return own[of_user.index(request.request_id)][2:]
    return next(values for due_us, _, *values in own if due_us == request.t_request_us)
