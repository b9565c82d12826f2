"""Batteries, charging, and the power that flight takes."""
