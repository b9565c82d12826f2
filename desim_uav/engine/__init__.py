"""Engines, which run episodes: functions of world, sample path, run settings and commands."""
