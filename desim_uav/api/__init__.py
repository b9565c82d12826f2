"""The Python interface: a function for each command, and what the functions return.

The command line stands on it. See ``docs/howto/python.md`` for a tour.
"""
