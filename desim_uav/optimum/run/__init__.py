"""Bounds that no policy exceeds in a run of several drones with batteries."""
