"""Link budgets and classes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desim_uav.model.radio.link import (
    LADDERS,
    LinkBudget,
    LinkClass,
    link_classes,
    thresholds_db,
)
from desim_uav.model.radio.links import class_of

THREE = [{"snr_db": 0, "bit_s_hz": 1}, {"snr_db": 5, "bit_s_hz": 2}, {"snr_db": 9, "bit_s_hz": 3}]


class TestBudget:
    def test_noise_by_hand(self):
        assert LinkBudget(30.0, 1.0).noise_dbm == -107.0  # -174 + 60 + 7
        assert LinkBudget(30.0, 10.0, 0.0).noise_dbm == -104.0
        assert LinkBudget(30.0, 1.0, 0.0, -170.0).noise_dbm == -110.0

    def test_snr_by_hand(self):
        budget = LinkBudget(30.0, 1.0)
        assert budget.snr_db(100.0) == 37.0
        assert budget.largest_loss_db(37.0) == 100.0


class TestLadders:
    @pytest.mark.parametrize("name", LADDERS)
    def test_rise_in_both(self, name):
        ladder = [one._asdict() for one in LADDERS[name]]
        assert link_classes(ladder) == LADDERS[name] == link_classes(name)

    def test_the_cqi_table(self):
        assert len(LADDERS["cqi"]) == 15
        assert LADDERS["cqi"][0] == (-6.94, 0.1523) and LADDERS["cqi"][-1] == (19.83, 5.5547)

    def test_no_class_beats_shannons_limit(self):
        for ladder in LADDERS.values():
            for one in ladder:
                assert 2.0**one.bit_s_hz - 1.0 <= 10.0 ** (one.snr_db / 10.0)

    @pytest.mark.parametrize("snr_db, number", [(-9, 0), (0, 1), (4.9, 1), (5, 2), (9, 3), (99, 3)])
    def test_class_of_a_level(self, snr_db, number):
        assert class_of(snr_db, thresholds_db(link_classes(THREE)), 0, 3) == number

    @given(st.floats(-60, 60), st.floats(-60, 60), st.sampled_from(sorted(LADDERS)))
    def test_a_higher_level_is_no_lower_class(self, one, other, name):
        low, high = sorted((one, other))
        thresholds = thresholds_db(LADDERS[name])
        count = len(thresholds)
        assert class_of(low, thresholds, 0, count) <= class_of(high, thresholds, 0, count)


class TestOwn:
    def test_whole_numbers_become_floats(self):
        assert link_classes(THREE)[1] == LinkClass(5.0, 2.0)

    @pytest.mark.parametrize(
        "given, problem",
        [
            (
                "cgi",
                r"unknown classes 'cgi' \(did you mean 'cqi'\?\); allowed: cqi, mcs, or a list",
            ),
            ([], "there must be 1 to 64 classes, not 0"),
            ([THREE[0]] * 65, "there must be 1 to 64 classes, not 65"),
            ([{"snr_db": 1}], "class 1: must have snr_db and bit_s_hz, and nothing else"),
            ([{**THREE[0], "mcs": 1}], "class 1: must have snr_db and bit_s_hz"),
            ([3], "class 1: must have snr_db"),
            ([{"snr_db": "1", "bit_s_hz": 1}], "class 1: snr_db must be a number, not '1'"),
            ([{"snr_db": True, "bit_s_hz": 1}], "class 1: snr_db must be a number, not True"),
            ([{"snr_db": 1, "bit_s_hz": float("nan")}], "class 1: bit_s_hz must be a number"),
            ([{"snr_db": -51, "bit_s_hz": 1}], "class 1: snr_db must be from -50 to 100, not -51"),
            ([{"snr_db": 1, "bit_s_hz": 101}], "class 1: bit_s_hz must be from 0 to 100, not 101"),
            (
                [{"snr_db": 1, "bit_s_hz": 0}],
                "class 1: bit_s_hz must be above 0; no link is class 0",
            ),
            ([THREE[1], THREE[0]], "class 2: snr_db must rise: 0 follows 5"),
            ([THREE[0], THREE[0]], "class 2: snr_db must rise: 0 follows 0"),
            (
                [{"snr_db": 8, "bit_s_hz": 2.5703}, {"snr_db": 9, "bit_s_hz": 2.5664}],
                "class 2: bit_s_hz must rise: 2.5664 follows 2.5703",  # MCS 16 and 17
            ),
        ],
    )
    def test_what_is_refused(self, given, problem):
        with pytest.raises(ValueError, match=problem):
            link_classes(given)
