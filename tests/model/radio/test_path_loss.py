"""Path loss: printed and independently computed figures, bits in both engines, pitfalls."""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import create_model

from desim_uav import registry
from desim_uav.model.radio.functions import elevation_deg, log10
from desim_uav.model.radio.path_loss import (
    ENVIRONMENTS,
    AlHourani,
    FreeSpace,
    LogDistance,
    RowPathLoss,
    free_space_db,
    mean_of,
)
from desim_uav.rowcode.compiled_rows import pointer_to
from desim_uav.rowcode.components import own_kernel, ruled, values_of
from desim_uav.rowcode.packing import packed
from desim_uav.scenario.components import Slot
from desim_uav.scenario.description import described


@dataclass(frozen=True)
class TwoSlopes(RowPathLoss):
    """What a user might write: a loss that rises faster beyond a breakpoint."""

    breakpoint_m: float = 300.0

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        slant_m = math.sqrt(distance_m * distance_m + height_m * height_m)
        beyond = max(0.0, log10(slant_m / self.breakpoint_m))
        return free_space_db(distance_m, height_m, carrier_ghz) + 18.0 * beyond


URBAN = AlHourani("urban")
MODELS = [FreeSpace(), LogDistance(3.76, 35.3), URBAN, TwoSlopes()]

distances = st.floats(0.0, 20_000.0)
heights = st.floats(1.0, 1_000.0)
carriers = st.floats(0.1, 100.0)


class TestAlHourani:
    @pytest.mark.parametrize(
        "environment, printed",
        [
            ("urban", (0.197752, 0.730979, 0.967692, 0.996980, 0.999975)),
            ("dense_urban", (0.102445, 0.372770, 0.755774, 0.941566, 0.997716)),
            ("high_rise", (0.013617, 0.043826, 0.132077, 0.335655, 0.847778)),
        ],
    )
    def test_probability_of_line_of_sight(self, environment, printed):
        model = AlHourani(environment)
        found = [round(model.p_los(angle), 6) for angle in (15.0, 30.0, 45.0, 60.0, 90.0)]
        assert tuple(found) == printed

    @pytest.mark.parametrize(
        "environment, distance_m, height_m, loss_db",
        [
            ("urban", 600.0, 100.0, 112.397596),
            ("urban", 600.0, 40.0, 113.299445),
            ("suburban", 600.0, 100.0, 102.711985),
        ],
    )
    def test_mean_loss_over_the_papers_radius(self, environment, distance_m, height_m, loss_db):
        assert round(AlHourani(environment).mean_db(distance_m, height_m, 2.0), 6) == loss_db

    def test_loss_over_one_metre(self):
        assert round(FreeSpace().los_db(1.0, 0.0, 2.0), 6) == 38.468383

    def test_an_environment_is_its_numbers(self):
        assert AlHourani("suburban").b == 0.43  # 0.429 is common too, and is another model
        own = AlHourani(a=9.61, b=0.16, eta_los_db=1.0, eta_nlos_db=20.0)
        assert own.mean_db(600.0, 100.0, 2.0) == URBAN.mean_db(600.0, 100.0, 2.0)
        assert AlHourani("urban", *ENVIRONMENTS["urban"]) == URBAN

    @pytest.mark.parametrize(
        "numbers, problem",
        [
            ({}, "give an environment, or also a and b and eta_los_db and eta_nlos_db"),
            ({"a": 9.6, "b": 0.28}, "or also eta_los_db and eta_nlos_db"),
            ({"environment": "village"}, "unknown environment 'village'; allowed: suburban"),
            ({"environment": "urban", "b": 0.2}, "b is 0.16 in the environment 'urban', not 0.2"),
            ({"a": 9.6, "b": 0.28, "eta_los_db": 20, "eta_nlos_db": 1}, "excess loss is a loss"),
        ],
    )
    def test_what_is_refused(self, numbers, problem):
        with pytest.raises(ValueError, match=problem):
            AlHourani(**numbers)


class TestPitfalls:
    def test_the_angle_is_that_above_the_horizon_and_in_degrees(self):
        assert elevation_deg(0.0, 100.0) == 90.0
        assert elevation_deg(1000.0, 10.0) == pytest.approx(0.5729387, abs=1e-7)
        assert URBAN.p_los(80.0) > 0.99 > URBAN.p_los(10.0)

    def test_excess_loss_is_a_loss(self):
        assert URBAN.los_db(100.0, 50.0, 2.0) == FreeSpace().los_db(100.0, 50.0, 2.0) + 1.0
        assert URBAN.nlos_db(100.0, 50.0, 2.0) == FreeSpace().los_db(100.0, 50.0, 2.0) + 20.0

    def test_the_distance_is_that_in_space(self):
        assert FreeSpace().los_db(300.0, 400.0, 2.0) == FreeSpace().los_db(0.0, 500.0, 2.0)

    def test_the_carrier_is_in_ghz(self):
        step = FreeSpace().los_db(100.0, 0.0, 20.0) - FreeSpace().los_db(100.0, 0.0, 2.0)
        assert step == pytest.approx(20.0, abs=1e-12)

    def test_log_distance(self):
        model = LogDistance(3.76, 35.3)
        assert model.los_db(1.0, 0.0, 2.0) == 35.3
        assert model.nlos_db(60.0, 80.0, 5.0) == pytest.approx(35.3 + 75.2, abs=1e-12)


@settings(deadline=None)
@given(st.sampled_from(MODELS), distances, distances, heights, carriers)
def test_losses_rise_with_the_distance(model, one, other, height_m, carrier_ghz):
    near, far = sorted((one, other))
    for loss_db in (model.los_db, model.nlos_db, model.mean_db):
        assert loss_db(near, height_m, carrier_ghz) <= loss_db(far, height_m, carrier_ghz) + 1e-12


@settings(deadline=None)
@given(st.sampled_from(MODELS), distances, heights, carriers)
def test_the_mean_lies_between(model, distance_m, height_m, carrier_ghz):
    where = (distance_m, height_m, carrier_ghz)
    los_db, nlos_db = model.los_db(*where), model.nlos_db(*where)
    assert los_db - 1e-12 <= model.mean_db(*where) <= nlos_db + 1e-12


def compiled(model: Any) -> Any:
    """All that a model says of a place, as one kernel around its methods over rows."""
    values = values_of(model)
    own_at: Any = pointer_to(type(values))
    los_db, nlos_db, p_los = (
        ruled(getattr(type(model), name)) for name in ("los_db", "nlos_db", "p_los")
    )

    def losses(own, distance_m, height_m, carrier_ghz):
        row = own_at(own)
        los = los_db(row, distance_m, height_m, carrier_ghz)
        nlos = nlos_db(row, distance_m, height_m, carrier_ghz)
        share = p_los(row, elevation_deg(distance_m, height_m))
        return los, nlos, share, mean_of(share, los, nlos)

    block = packed(values)
    made = own_kernel(losses, type(model))
    return lambda *where: (made(block.ctypes.data, *where), block)[0]


@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
def test_python_and_compiled_code_give_the_same_bits(model):
    machine = compiled(model)
    random = np.random.default_rng(18)
    for _ in range(2000):
        where = tuple(random.uniform((0, 1, 0.1), (5000, 500, 60)).tolist())
        share = model.p_los(elevation_deg(*where[:2]))
        found = model.los_db(*where), model.nlos_db(*where), share, model.mean_db(*where)
        assert machine(*where) == found


class TestInAScenario:
    SLOT = Slot("path_loss", "free_space", RowPathLoss)

    def made(self, **keys: Any) -> Any:
        model = create_model("Model", path_loss=(Annotated[Any, self.SLOT], ...))
        return model.model_validate({"path_loss": keys}).path_loss

    def test_kinds(self):
        assert registry.names("path_loss") == [
            "free_space",
            "log_distance",
            "al_hourani",
            "tr36777",
        ]

    def test_written_and_read_again(self):
        model = self.made(kind="al_hourani", environment="urban")
        assert model == URBAN
        assert self.made(**described(model)) == model

    def test_what_is_refused_says_why(self):
        with pytest.raises(ValueError, match="eta_nlos_db must not be below eta_los_db"):
            self.made(kind="al_hourani", a=9.6, b=0.28, eta_los_db=20.0, eta_nlos_db=1.0)
        with pytest.raises(ValueError, match="less than or equal to 10"):
            self.made(kind="log_distance", exponent=11.0, at_1m_db=35.0)
