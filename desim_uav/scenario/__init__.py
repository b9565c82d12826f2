"""Scenario files: YAML 1.2 in, a frozen ``Scenario`` out, every error with its place."""
