"""The invariants of an episode, checked after every event, with formulas of their own."""
