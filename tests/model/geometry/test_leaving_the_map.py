"""A mobility of one's own whose legs leave the map is refused, naming it, the user and the time."""

from dataclasses import dataclass

import numpy as np
import pytest

from desim_uav.errors import SimulationError
from desim_uav.model.mobility.mobility import Area, Static, Walks, walks_of
from desim_uav.model.rules import US

AREA, HORIZON_US = Area(500.0, 300.0), 100 * US
HOMES = np.array([[10.0, 10.0], [250.0, 150.0]])


@dataclass(frozen=True)
class Own:
    """Legs as they are given, (t_s, x, y, vx, vy) of user 0 and of user 1."""

    first: tuple
    second: tuple = ((0.0, 250.0, 150.0, 0.0, 0.0),)

    def walks(self, homes, streams, area, horizon_us):
        legs = np.array([(t * US, *rest) for t, *rest in (*self.first, *self.second)], float)
        return Walks(legs, np.array([0, len(self.first), len(self.first) + len(self.second)]))


def walked(mobility):
    return walks_of(mobility, HOMES, 0, [0], AREA, HORIZON_US)


@pytest.mark.parametrize(
    ("first", "where"),
    [
        (((0.0, 10.0, 10.0, -1.0, 0.0),), "user 0 is off the map of 500 x 300 m at 100 s"),
        (((0.0, 10.0, 10.0, 0.0, 0.0), (40.0, 10.0, 310.0, 0.0, 0.0)), "at 40 s: (10, 310) m"),
        (((0.0, 10.0, 10.0, 20.0, 0.0), (30.0, 10.0, 10.0, 0.0, 0.0)), "at 30 s: (610, 10) m"),
        (((0.0, np.nan, 10.0, 0.0, 0.0),), "at 0 s: (nan, 10) m"),
    ],
)
def test_where_and_when(first, where):
    with pytest.raises(SimulationError) as caught:
        walked(Own(first))
    message = str(caught.value)
    assert message.startswith(f"users.mobility: '{__name__}:Own': user 0 is")
    assert where in message


def test_the_user_who_is_off_it_first_is_named():
    late, soon = (
        ((0.0, 10.0, 10.0, 10.0, 0.0),),
        ((0.0, 250.0, 150.0, 0.0, 10.0), (20.0, 1, 1, 0, 0)),
    )
    with pytest.raises(SimulationError, match=r"user 1 is off the map .* at 20 s"):
        walked(Own(late, soon))


@pytest.mark.parametrize(
    "first",
    [
        ((0.0, 0.0, 0.0, 5.0, 3.0),),
        ((0.0, -1e-6, 300.0 + 1e-6, 0.0, 0.0),),
        ((0.0, 10.0, 10.0, 0.0, 0.0), (101.0, -900.0, 10.0, 0.0, 0.0)),
    ],
)
def test_walks_up_to_the_edge_and_after_the_end_are_allowed(first):
    (walks,) = walked(Own(first))
    assert len(walks.legs) == len(first) + 1


def test_legs_that_are_none():
    class NoLegs:
        def walks(self, homes, *_):
            return Walks(np.zeros((1, 5)), np.arange(2))

    with pytest.raises(SimulationError, match="one at least for each of 2 users"):
        walked(NoLegs())
    assert len(walked(Static())[0].legs) == 2
