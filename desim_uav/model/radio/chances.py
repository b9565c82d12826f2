"""From which elevation on a user sees a transmitter, and by how much shadowing changes the loss.

Both are drawn for each user, transmitter and cell in which the transmitter is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.draws import draws_of_link
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.model.radio.rings import check_sight
from desim_uav.model.radio.slopes import DEGREES
from desim_uav.model.random.philox import as_normal
from desim_uav.rowcode.compiled_rows import call_for_float
from desim_uav.rowcode.components import Compiled, Function, compiled, ruled
from desim_uav.rowcode.kernels import kernel, part

FINEST_DEG = 1e-12
"""How exactly the elevation is found from which on a user sees a transmitter, in degrees."""


def _p_los(cls: Any, values_at: Any) -> Any:
    """Return the function ``p_los`` of a class of path losses (see ``Function.around``)."""
    p_los = ruled(cls.p_los)

    def chance(values: int, elevation: float) -> float:
        return float(p_los(values_at(values), elevation))

    return chance


P_LOS = Function("p_los", _p_los, (int, float))
"""The function of a path loss that returns the probability of line of sight.

Its arguments are the address of the values and the elevation in degrees."""


class Chance(NamedTuple):
    """A compiled probability of line of sight: the addresses of the function and of its values.

    The addresses hold in this process, and as long as ``kept`` exists.
    """

    p_los: int
    values: int
    kept: Compiled


def compiled_chance(path_loss: RowPathLoss) -> Chance:
    """Compile the probability of line of sight of a path loss.

    Raises ValueError if it does not rise with the elevation, and Numba's errors
    (``components.NOT_COMPILED``).
    """
    check_sight(path_loss)
    code = compiled((P_LOS,), path_loss, ())
    return Chance(code.functions["p_los"], code.values.ctypes.data, code)


class Odds(NamedTuple):
    """How the links to one transmitter are drawn.

    ``key`` (2,) is that of the draws of the episode (``philox.key_of`` for ``Purpose.LINK``), or
    longer if the episode is imagined (``radio.draws``), and ``numbers`` (users,) are those that
    users have in the draws.
    ``transmitter`` is the number in the draws: that of a drone, or -1 - k for access point k, so
    that one more drone does not change the draws of access points. ``shadow_db`` are the standard
    deviations of shadowing with and without line of sight in dB. ``p_los`` and ``values`` are the
    addresses of the probability of line of sight (``Chance``), or 0 if it is not drawn.
    """

    key: NDArray[np.uint64]
    numbers: NDArray[np.int64]
    transmitter: int
    shadow_db: tuple[float, float]
    p_los: int
    values: int


class Draw(NamedTuple):
    """The draws of a link while the transmitter is in a cell.

    With the horizontal distance r and the height difference h, the user sees the transmitter where
    ``upright`` r² <= ``along`` h². The additional losses with and without line of sight are in dB.
    """

    cell: int
    upright: float
    along: float
    los_db: float
    nlos_db: float


@kernel
def draw(odds: Odds, user: int, cell: int) -> Draw:
    """Return the draws of a link while the transmitter is in a cell."""
    uniform, los_word, nlos_word = draws_of_link(
        odds.key, odds.numbers, odds.transmitter, user, cell
    )
    upright = along = 0.0
    if odds.p_los != 0:
        least = least_elevation(odds.p_los, odds.values, uniform)
        if least > 90.0:
            upright, along = 1.0, -1.0
        elif least <= 0.0:
            upright, along = 0.0, 1.0
        else:
            upright = np.sin(least / DEGREES) ** 2
            along = np.cos(least / DEGREES) ** 2
    los_db, nlos_db = odds.shadow_db
    return Draw(cell, upright, along, _shadow(los_db, los_word), _shadow(nlos_db, nlos_word))


@part
def _shadow(deviation_db: float, word: np.uint64) -> float:
    """Return a normal loss in whole 1e-9 dB; this hides how platforms differ in logarithms."""
    if deviation_db == 0.0:
        return 0.0
    return float(np.rint(deviation_db * as_normal(word) * 1e9) * 1e-9)


@kernel
def least_elevation(p_los: int, values: int, uniform: float) -> float:
    """Return from which elevation on a draw is below the probability of line of sight, in degrees.

    It is 0 if it is so everywhere, and inf if it is so nowhere. ``p_los`` and ``values`` are the
    addresses of a ``Chance``.
    """
    low, high = 0.0, 90.0
    if uniform < call_for_float(p_los, (values, low)):
        return 0.0
    if not uniform < call_for_float(p_los, (values, high)):
        return float(np.inf)
    while high - low > FINEST_DEG:
        middle = 0.5 * (low + high)
        if uniform < call_for_float(p_los, (values, middle)):
            high = middle
        else:
            low = middle
    return high
