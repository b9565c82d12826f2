"""What the simulator is checked against: a module a part, whose ``figures`` stand beside theory.

The tests hold them, and ``python analysis/verification.py`` draws the table of all. ``quick`` asks
for fewer replications.
"""
