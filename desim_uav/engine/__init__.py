"""Engines: deterministic functions of (world, sample path, run settings, commands)."""
