"""Digests of the tables of many runs and trainings, made once and never to change.

``digests.json`` holds what two independent engines, each with its own copy of the model's rules,
agreed upon bit for bit before the rules were written once for both. ``python -m tests.frozen``
compares every run with it, and ``--write`` makes it anew, which only a change of the model itself
can justify.
"""
