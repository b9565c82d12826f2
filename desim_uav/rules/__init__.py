"""The rules of the model, which say what happens; each is written once, as a function over rows.

Both engines run these functions: the SimPy engine as plain Python, and the compiled engine as
machine code that Numba makes from the same source. An engine decides only when a rule is called.
"""
