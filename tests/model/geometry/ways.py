"""Whole ways round obstacles and their times, followed from node to node."""

import numpy as np

from desim_uav.model.geometry import roads as kernels
from desim_uav.model.motion.legs import leg_between


def way_to(prisms, ways, station, x, y):
    """The first node of the shortest way from a place to a station, and the way's length."""
    away_m = np.hypot(*(ways.nodes_m - (x, y)).T)
    return kernels._first_seen(prisms, ways, station, x, y, away_m)


def whole_way(prisms, ways, station, x, y):
    """The places on the shortest way to a station, with both ends: (places, 2); or none."""
    node, _ = way_to(prisms, ways, station, x, y)
    if node < 0:
        return np.empty((0, 2))
    nodes = [node]
    while nodes[-1] != station:
        nodes.append(ways.following[station, nodes[-1]])
    return np.array([(x, y), *ways.nodes_m[nodes]])


def times_along(ways, limits, wind, cruise_mps):
    """The times from all nodes to all stations in µs, or -1, of legs from rest to rest."""
    times_us = np.full(ways.lengths_m.shape, -1)
    for station, lengths_m in enumerate(ways.lengths_m):
        times_us[station, station] = 0
        for node in np.argsort(lengths_m, kind="stable").tolist():
            ahead = ways.following[station, node]
            if ahead >= 0 and times_us[station, ahead] >= 0:
                ends = [(*ways.nodes_m[one].tolist(), ways.altitude_m) for one in (node, ahead)]
                lasts_us = leg_between(limits, wind, cruise_mps, *ends).duration_us
                if lasts_us >= 0:
                    times_us[station, node] = lasts_us + times_us[station, ahead]
    return times_us


def way_home(prisms, ways, *options):
    """The station that is reached first, the first node of the way, and the time in µs."""
    return kernels.way_home(prisms, ways, *options, np.full(len(ways.nodes_m), np.nan))
