"""Sums that need more than 64 bits, in two words (see ``rows.Wide``): the same in both engines.

Python's whole numbers are not limited, but those of compiled code have 64 bits. The largest values
of all other sums are bounded by what a scenario may have (``engine.compiled.largest_sums``).
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import rule
from desim_uav.rules.rows import Wide

HALF, WORD = 31, 62
"""The bits of half a word and of a word; the rest of its 64 bits is for carries and the sign."""

HALF_MASK, WORD_MASK = 2**HALF - 1, 2**WORD - 1


@rule
def clear(total: Wide) -> None:
    """Set a sum to 0."""
    total.high = total.low = 0


@rule
def add_product(total: Wide, one: int, other: int) -> None:
    """Add the product of two whole numbers, both from 0 to 2^62 - 1, by halves of words."""
    one_high, one_low = one >> HALF, one & HALF_MASK
    other_high, other_low = other >> HALF, other & HALF_MASK
    middle = one_high * other_low + one_low * other_high
    low = ((middle & HALF_MASK) << HALF) + one_low * other_low
    total.high += one_high * other_high + (middle >> HALF) + (low >> WORD)
    low = (low & WORD_MASK) + total.low
    total.high += low >> WORD
    total.low = low & WORD_MASK


def value_of(total: Wide) -> int:
    """Return a sum as one of Python's whole numbers."""
    return (int(total.high) << WORD) + int(total.low)
