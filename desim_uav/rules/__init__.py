"""What happens: the rules of the model, each written once, as functions over rows.

Both engines run these functions: Python as they stand, Numba as machine code. An engine decides
only when they are called.
"""
