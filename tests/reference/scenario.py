"""What a scenario's mapping says of radio, in the terms of the fixed-step simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

from tests.reference.inputs import Association
from tests.reference.radio import (
    CQI,
    MCS,
    MICRO,
    TOWNS,
    AccessPoint,
    Disc,
    Loss,
    Radio,
    al_hourani,
    free_space,
    log_distance,
)

T = TypeVar("T", Disc, Radio)

URBAN = {"kind": "al_hourani", "environment": "urban"}
"""The path loss of a scenario that names none."""


def links_of(scenario: Mapping[str, Any], bandwidth_bps: float) -> list[Disc | Radio]:
    """Return the link of each drone; ``bandwidth_bps`` is that of a disc, which may be inf."""
    drones = scenario["drones"]
    radio = drones.get("radio", {"kind": "disc"})
    if radio["kind"] == "link_classes":
        return [behind(drones, radio_of(radio))] * drones["count"]
    disc = Disc(drones["footprint_radius_m"], bandwidth_bps)
    return [behind(drones, disc)] * drones["count"]


def behind(sender: Mapping[str, Any], link: T) -> T:
    """Return a link with the backhaul of its sender, if this has one."""
    if not sender.get("backhaul"):
        return link
    return replace(link, backhaul_bps=round(1000 * sender["backhaul"]["kbps"]))


def access_points_of(scenario: Mapping[str, Any]) -> list[AccessPoint]:
    """Return the access points of a scenario."""
    return [
        AccessPoint((*point["at_m"], point["height_m"]), behind(point, radio_of(point["radio"])))
        for point in scenario.get("access_points") or ()
    ]


def association_of(scenario: Mapping[str, Any]) -> Association:
    """Return the association of a scenario."""
    given = scenario.get("association", "entered_first")
    if isinstance(given, str):
        return Association(given)
    if given["kind"] != "a3":
        return Association(given["kind"])
    margin_db = given["offset_db"] + given["hysteresis_db"]
    return Association("a3", margin_db, round(given["time_to_trigger_ms"] * 1000))


def radio_of(radio: Mapping[str, Any]) -> Radio:
    """Return a radio with link classes; mean losses without shadowing only."""
    assert radio.get("line_of_sight", "mean") == "mean"
    assert radio.get("shadowing") is None
    interference = radio.get("interference", "none")
    bands = {"none": 0, "co_channel": 1}
    sharing, uplink_mhz = radio.get("sharing", "held"), radio.get("uplink_mhz")
    return Radio(
        power_dbm=radio.get("power_dbm", 30.0),
        bandwidth_hz=round(radio.get("bandwidth_mhz", 5.0) * 1e6),
        noise_figure_db=radio.get("noise_figure_db", 7.0),
        noise_dbm_per_hz=radio.get("noise_dbm_per_hz", -174.0),
        carrier_ghz=radio.get("carrier_ghz", 2.0),
        loss_db=_loss_of(radio.get("path_loss", URBAN)),
        ladder=_ladder_of(radio["classes"]),
        sharing=sharing if isinstance(sharing, str) else sharing["kind"],
        uplink_hz=None if uplink_mhz is None else round(uplink_mhz * 1e6),
        reuse=bands[interference] if isinstance(interference, str) else interference["reuse"],
    )


def _loss_of(given: Mapping[str, Any]) -> Loss:
    if given["kind"] == "free_space":
        return free_space
    if given["kind"] == "log_distance":
        return log_distance(given["exponent"], given["at_1m_db"])
    assert given["kind"] == "al_hourani"
    if "environment" in given:
        return al_hourani(*TOWNS[given["environment"]])
    return al_hourani(given["a"], given["b"], given["eta_los_db"], given["eta_nlos_db"])


def _ladder_of(given: Any) -> tuple[tuple[float, int], ...]:
    if isinstance(given, str):
        return {"cqi": CQI, "mcs": MCS}[given]
    return tuple((one["snr_db"], round(one["bit_s_hz"] * MICRO)) for one in given)
