"""Services of several stages, for tests: each is its lists of values and its stages, as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.services import PROCESSOR, Stage

Values = dict[str, NDArray[np.int64]]


def _rounded(values: Sequence[float], unit: float) -> NDArray[np.int64]:
    return np.array([round(value * unit) for value in values], np.int64)


@dataclass(frozen=True)
class Exchange:
    """A volume goes up, and then another one comes down. Both share bandwidth."""

    up_mbit: tuple[float, ...] = (3.0,)
    down_mbit: tuple[float, ...] = (6.0,)

    def values(self) -> Values:
        return {"up": _rounded(self.up_mbit, 1e12), "down": _rounded(self.down_mbit, 1e12)}

    def stages(self) -> tuple[Stage, ...]:
        return (Stage("up", up=True), Stage("down"))


@dataclass(frozen=True)
class Survey:
    """A rate is held for a time, and then what was taken meanwhile is sent; then it is confirmed.

    Of each minute ``bit_min`` are sent. The confirmation holds a rate of its own.
    """

    duration_s: tuple[float, ...] = (10.0,)
    held_kbps: tuple[float, ...] = (600.0,)
    bit_min: tuple[int, ...] = (36_000_000,)
    confirm_s: tuple[float, ...] = (2.0,)
    confirm_kbps: tuple[float, ...] = (100.0,)

    def values(self) -> Values:
        return {
            "duration": _rounded(self.duration_s, 1e6),
            "held": _rounded(self.held_kbps, 1000),
            "bit_min": np.array(self.bit_min, np.int64),
            "confirm": _rounded(self.confirm_s, 1e6),
            "confirm_rate": _rounded(self.confirm_kbps, 1000),
        }

    def stages(self) -> tuple[Stage, ...]:
        return (
            Stage("duration", rate="held", timed=True),
            Stage("duration", times="bit_min", per=60, up=True),
            Stage("confirm", rate="confirm_rate", timed=True),
        )


@dataclass(frozen=True)
class Rounds:
    """A rate is held for one time, and then for another. Both rates are held."""

    first_s: tuple[float, ...] = (20.0,)
    second_s: tuple[float, ...] = (30.0,)
    kbps: tuple[float, ...] = (100.0,)
    second_kbps: tuple[float, ...] = (300.0,)

    def values(self) -> Values:
        return {
            "first": _rounded(self.first_s, 1e6),
            "rate": _rounded(self.kbps, 1000),
            "second": _rounded(self.second_s, 1e6),
            "second_rate": _rounded(self.second_kbps, 1000),
        }

    def stages(self) -> tuple[Stage, ...]:
        return (
            Stage("first", rate="rate", timed=True, up=True),
            Stage("second", rate="second_rate", timed=True),
        )


def staged(held: bool, which: int) -> dict[str, Any]:
    """A service of several stages, some of which are of nothing; ``held``: its rates must be."""
    if held:
        return {
            "kind": "tests.staged:Rounds",
            "first_s": [0.0, 20.0],
            "second_s": [15.0, 60.0],
            "kbps": [100.0, 600.0],
            "second_kbps": [400.0],
        }
    if which % 2:
        volumes = {"up_mbit": [5.0, 30.0], "down_mbit": [0.0, 60.0]}
        return {"kind": "tests.staged:Exchange", **volumes}
    return {
        "kind": "tests.staged:Survey",
        "duration_s": [20.0, 40.0],
        "held_kbps": [200.0],
        "bit_min": [0, 30_000_000],
        "confirm_s": [5.0],
        "confirm_kbps": [300.0],
    }


@dataclass(frozen=True)
class Tandem:
    """A link, a processor and a pause in an ``order`` of the letters l, c and p.

    The link is one of 1 Gbit/s, the processor has a core of 0.1 GHz, and the pause is a rate of 0
    that is held. Each of them takes a fixed time.
    """

    order: str = "lcp"
    link_s: float = 0.3
    core_s: float = 0.8
    pause_s: float = 0.2

    def values(self) -> Values:
        return {
            "l": _rounded([self.link_s], 1e15),
            "c": _rounded([self.core_s], 1e11),
            "p": _rounded([self.pause_s], 1e6),
            "none": np.zeros(1, np.int64),
        }

    def stages(self) -> tuple[Stage, ...]:
        stage_of = {
            "l": Stage("l"),
            "c": Stage("c", resource=PROCESSOR),
            "p": Stage("p", rate="none", timed=True),
        }
        return tuple(stage_of[letter] for letter in self.order)
