"""Services: how long the requests of users take, and which bandwidth they occupy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from desim_uav.model.rules import US
from desim_uav.registry import register

MICROBITS = 10**12
"""The millionths of a bit in a megabit."""


class Hold(Protocol):
    """A service whose requests hold a rate for a time.

    It is two lists of equally likely values, such as quantiles of a continuous distribution.
    """

    def durations_us(self) -> NDArray[np.int64]:
        """Return the service times that a request can require, in microseconds, each above 0."""

    def bandwidths_bps(self) -> NDArray[np.int64]:
        """Return the bandwidths that a request can occupy, in bit/s."""


@runtime_checkable
class Volume(Protocol):
    """A service whose requests ask for a volume, as two lists of equally likely values."""

    def volumes_ubit(self) -> NDArray[np.int64]:
        """Return the volumes that a request can ask for, in millionths of a bit, each above 0."""

    def bandwidths_bps(self) -> NDArray[np.int64]:
        """Return the rates that a request can hold, in bit/s; zeros if none are held."""


@register("service", "uniform_choice")
@register("service", "hold")
@dataclass(frozen=True)
class UniformChoice:
    """A request takes one of the durations and one of the bandwidths, independently of each other.

    All durations are equally likely, and so are all bandwidths. This kind has two names, `hold` and
    `uniform_choice`.
    """

    duration_min: Annotated[tuple[Annotated[float, Gt(0)], ...], MinLen(1)]
    """The service times a request can require, in minutes, equally likely."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Ge(0)], ...], MinLen(1)]
    """The bandwidths a request can occupy, in kbit/s, equally likely."""

    def durations_us(self) -> NDArray[np.int64]:
        """Return the durations in microseconds."""
        return np.array([round(minutes * 60 * US) for minutes in self.duration_min], np.int64)

    def bandwidths_bps(self) -> NDArray[np.int64]:
        """Return the bandwidths in bit/s."""
        return np.array([round(kbps * 1000) for kbps in self.bandwidth_kbps], np.int64)


@register("service", "transfer")
@dataclass(frozen=True)
class Transfer:
    """A request asks for a volume, and ends when this has been delivered.

    All volumes are equally likely. Its rate is what the drones' ``radio.sharing`` gives it; under
    ``held`` it holds one of the rates of ``bandwidth_kbps``, all equally likely.
    """

    volume_mbit: Annotated[tuple[Annotated[float, Ge(1e-12), Le(1e6)], ...], MinLen(1)]
    """The volumes that a request can ask for, in Mbit, equally likely."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Ge(0.001)], ...], MinLen(1)] | None = None
    """The rates that a request can hold, in kbit/s, equally likely: for the sharing `held` only."""

    def volumes_ubit(self) -> NDArray[np.int64]:
        """Return the volumes in millionths of a bit."""
        return np.array([round(mbit * MICROBITS) for mbit in self.volume_mbit], np.int64)

    def bandwidths_bps(self) -> NDArray[np.int64]:
        """Return the rates in bit/s; 0 if none are held."""
        return np.array([round(kbps * 1000) for kbps in self.bandwidth_kbps or (0,)], np.int64)


PAPER: dict[str, Hold | Volume] = {
    "throughput": UniformChoice((1, 2, 3, 4, 5, 6), (96, 160, 200, 320, 750, 1000, 2500)),
    "edge_computing": UniformChoice((3,), (10, 20, 30, 40, 50)),
    "data_gathering": UniformChoice((2,), (24, 48, 72, 96, 192)),
}
"""The three services of the paper."""


@dataclass(frozen=True, eq=False)
class Catalogue:
    """The services of a scenario as arrays, with one row per service in the order of ``names``.

    ``share``: (services,), the cumulative probabilities of the mix. ``in_bits``: (services,),
    whether a service asks for volumes instead of service times. ``required`` and
    ``bandwidths_bps``: (services, widest); row s uses its first ``sizes[s]`` = (required,
    bandwidths) entries. What is required is in microseconds, or in millionths of a bit.
    """

    names: tuple[str, ...]
    share: NDArray[np.float64]
    sizes: NDArray[np.int64]
    required: NDArray[np.int64]
    bandwidths_bps: NDArray[np.int64]
    in_bits: NDArray[np.bool_]


def catalogue(services: Mapping[str, Hold | Volume], mix: Mapping[str, float]) -> Catalogue:
    """Return the services as arrays; ``mix`` maps their names to weights, which are normalised."""
    names = tuple(services)
    weights = np.array([mix.get(name, 0.0) for name in names])
    share = np.cumsum(weights / weights.sum())
    share[np.flatnonzero(weights)[-1] :] = 1.0
    in_bits = np.array([isinstance(service, Volume) for service in services.values()])
    required = [
        service.volumes_ubit() if isinstance(service, Volume) else service.durations_us()
        for service in services.values()
    ]
    bandwidths = [service.bandwidths_bps() for service in services.values()]
    sizes = np.array([[len(r), len(b)] for r, b in zip(required, bandwidths, strict=True)])
    return Catalogue(names, share, sizes, _padded(required), _padded(bandwidths), in_bits)


def _padded(rows: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    table = np.zeros((len(rows), max(len(row) for row in rows)), np.int64)
    for target, row in zip(table, rows, strict=True):
        target[: len(row)] = row
    return table
