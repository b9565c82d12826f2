"""Services: how long the requests of users take, and which bandwidth they occupy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from desim_uav.model.rules import US
from desim_uav.registry import register


class Service(Protocol):
    """A service, as two lists of equally likely values (quantiles of a continuous distribution).

    A service that asks for a volume has a method ``volumes_ubit`` instead of ``durations_us``: it
    returns volumes in millionths of a bit, each above 0.
    """

    def durations_us(self) -> NDArray[np.int64]:
        """Return the service times that a request can require, in microseconds, each above 0."""

    def bandwidths_bps(self) -> NDArray[np.int64]:
        """Return the bandwidths that a request can occupy, in bit/s."""


@register("service", "uniform_choice")
@dataclass(frozen=True)
class UniformChoice:
    """A request takes one of the durations and one of the bandwidths, independently of each other.

    All durations are equally likely, and so are all bandwidths.
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

    volume_mbit: Annotated[tuple[Annotated[float, Ge(1e-6), Le(1e6)], ...], MinLen(1)]
    """The volumes that a request can ask for, in Mbit, equally likely."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Gt(0)], ...], MinLen(1)] | None = None
    """The rates that a request can hold under the sharing `held`, in kbit/s, equally likely."""

    def volumes_ubit(self) -> NDArray[np.int64]:
        """Return the volumes in millionths of a bit."""
        return np.array([round(mbit * 10**12) for mbit in self.volume_mbit], np.int64)

    def bandwidths_bps(self) -> NDArray[np.int64]:
        """Return the rates in bit/s; 0 if none are held."""
        return np.array([round(kbps * 1000) for kbps in self.bandwidth_kbps or (0,)], np.int64)


PAPER: dict[str, Service] = {
    "throughput": UniformChoice((1, 2, 3, 4, 5, 6), (96, 160, 200, 320, 750, 1000, 2500)),
    "edge_computing": UniformChoice((3,), (10, 20, 30, 40, 50)),
    "data_gathering": UniformChoice((2,), (24, 48, 72, 96, 192)),
}
"""The three services of the paper."""


@dataclass(frozen=True, eq=False)
class Catalogue:
    """The services of a scenario as arrays, with one row per service in the order of ``names``.

    ``share``: (services,), the cumulative probabilities of the mix. ``durations_us`` and
    ``bandwidths_bps``: (services, widest); row s uses its first ``sizes[s]`` = (durations,
    bandwidths) entries. Services that are ``in_bits`` (services,) ask for volumes, which are in
    ``durations_us`` in millionths of a bit.
    """

    names: tuple[str, ...]
    share: NDArray[np.float64]
    sizes: NDArray[np.int64]
    durations_us: NDArray[np.int64]
    bandwidths_bps: NDArray[np.int64]
    in_bits: NDArray[np.bool_]


def catalogue(services: Mapping[str, Service], mix: Mapping[str, float]) -> Catalogue:
    """Return the services as arrays; ``mix`` maps their names to weights, which are normalised."""
    names = tuple(services)
    weights = np.array([mix.get(name, 0.0) for name in names])
    share = np.cumsum(weights / weights.sum())
    share[np.flatnonzero(weights)[-1] :] = 1.0
    in_bits = np.array([hasattr(service, "volumes_ubit") for service in services.values()])
    required = [
        service.volumes_ubit() if isinstance(service, Transfer) else service.durations_us()
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
