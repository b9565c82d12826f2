"""How many seeds the tracks have; the command line reads this, so it imports nothing."""

SEEDS = {"one": 10, "any": 32}
"""The number of seeds by track: in track any each has a world of its own."""
