"""Random numbers that are functions of counters: one may be drawn at any time, in any order.

The generator is Philox4x64-10 (Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as
1, 2, 3, SC 2011), which NumPy has too: a key of two words and a counter of four words give four
words of 64 random bits.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.rowcode.kernels import kernel, part

Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]

ROUNDS = 10

_HALF = np.uint64(32)
_LOW = np.uint64(0xFFFFFFFF)
_MULTIPLIERS = (np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157))
_STEPS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B))


def key_of(seed: int, purpose: Purpose, episode: int) -> NDArray[np.uint64]:
    """Return the key of a purpose in an episode: the first two words of its stream (entity 0)."""
    generator = Streams(seed, purpose, episode).generator(0)
    key: NDArray[np.uint64] = generator.bit_generator.random_raw(2)
    return key


@part
def _multiplied(one: np.uint64, other: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the upper and the lower 64 bits of a product."""
    a, b = one >> _HALF, one & _LOW
    c, d = other >> _HALF, other & _LOW
    lowest = b * d
    middle = a * d + (lowest >> _HALF)
    carried = b * c + (middle & _LOW)
    return a * c + (middle >> _HALF) + (carried >> _HALF), one * other


@kernel
def philox(key: NDArray[np.uint64], counter: Words) -> Words:
    """Return four words of 64 random bits for a key (2,) and a counter."""
    (w, x, y, z), left, right = counter, key[0], key[1]
    for _ in range(ROUNDS):
        high, low = _multiplied(_MULTIPLIERS[0], w)
        upper, lower = _multiplied(_MULTIPLIERS[1], y)
        w, x, y, z = upper ^ x ^ left, lower, high ^ z ^ right, low
        left += _STEPS[0]
        right += _STEPS[1]
    return w, x, y, z


@kernel
def as_normal(word: np.uint64) -> float:
    """Return 64 random bits as a standard normal number, of which 52 bits are used."""
    return quantile((np.float64(word >> np.uint64(12)) + 0.5) * (1.0 / 4503599627370496.0))


@kernel
def quantile(p: float) -> float:
    """Return the number that a standard normal number does not exceed with probability ``p``.

    ``p`` is between 0 and 1. Relative errors are about 1e-16 (algorithm AS 241, PPND16: Wichura,
    Applied Statistics 37, 1988).
    """
    q = p - 0.5
    if abs(q) <= 0.425:
        return float(q * _central(0.180625 - q * q))
    tail = p if q < 0.0 else 1.0 - p
    r = math.sqrt(-math.log(tail))
    deviation = _near(r - 1.6) if r <= 5.0 else _far(r - 5.0)
    return float(-deviation if q < 0.0 else deviation)


@part
def _central(r: float) -> float:
    above = 2.5090809287301226727e3
    above = above * r + 3.3430575583588128105e4
    above = above * r + 6.7265770927008700853e4
    above = above * r + 4.5921953931549871457e4
    above = above * r + 1.3731693765509461125e4
    above = above * r + 1.9715909503065514427e3
    above = above * r + 1.3314166789178437745e2
    above = above * r + 3.3871328727963666080e0
    below = 5.2264952788528545610e3
    below = below * r + 2.8729085735721942674e4
    below = below * r + 3.9307895800092710610e4
    below = below * r + 2.1213794301586595867e4
    below = below * r + 5.3941960214247511077e3
    below = below * r + 6.8718700749205790830e2
    below = below * r + 4.2313330701600911252e1
    below = below * r + 1.0
    return above / below


@part
def _near(r: float) -> float:
    above = 7.74545014278341407640e-4
    above = above * r + 2.27238449892691845833e-2
    above = above * r + 2.41780725177450611770e-1
    above = above * r + 1.27045825245236838258e0
    above = above * r + 3.64784832476320460504e0
    above = above * r + 5.76949722146069140550e0
    above = above * r + 4.63033784615654529590e0
    above = above * r + 1.42343711074968357734e0
    below = 1.05075007164441684324e-9
    below = below * r + 5.47593808499534494600e-4
    below = below * r + 1.51986665636164571966e-2
    below = below * r + 1.48103976427480074590e-1
    below = below * r + 6.89767334985100004550e-1
    below = below * r + 1.67638483018380384940e0
    below = below * r + 2.05319162663775882187e0
    below = below * r + 1.0
    return above / below


@part
def _far(r: float) -> float:
    above = 2.01033439929228813265e-7
    above = above * r + 2.71155556874348757815e-5
    above = above * r + 1.24266094738807843860e-3
    above = above * r + 2.65321895265761230930e-2
    above = above * r + 2.96560571828504891230e-1
    above = above * r + 1.78482653991729133580e0
    above = above * r + 5.46378491116411436990e0
    above = above * r + 6.65790464350110377720e0
    below = 2.04426310338993978564e-15
    below = below * r + 1.42151175831644588870e-7
    below = below * r + 1.84631831751005468180e-5
    below = below * r + 7.86869131145613259100e-4
    below = below * r + 1.48753612908506148525e-2
    below = below * r + 1.36929880922735805310e-1
    below = below * r + 5.99832206555887937690e-1
    below = below * r + 1.0
    return above / below
