"""The sentences that commands print about a run."""

from __future__ import annotations

from desim_uav.report.text import links_in_words

LINKS = {"link_handovers": 3, "ping_pongs": 1, "outages": 2, "outage_s": 4.5}


def test_a_volume_is_told_only_where_one_was_delivered() -> None:
    """The paper's services ask for times, so "0.0 Mbit delivered" would look like a failure."""
    assert links_in_words(LINKS | {"delivered_mbit": 0.0}) == (
        "3 handover(s) between drones, 1 of them ping-pong(s); 2 outage(s) of 4.5 s in all"
    )
    assert links_in_words(LINKS | {"delivered_mbit": 7.25}).endswith("; 7.2 Mbit delivered")
