"""Counter-based draws: published vectors, NumPy's own generator, and whether they are random."""

from itertools import pairwise
from statistics import NormalDist

import numpy as np
import pytest

from desim_uav.model.random.philox import as_normal, key_of, philox, quantile
from desim_uav.model.random.streams import Purpose, as_uniform
from desim_uav.rowcode.kernels import maker
from tests.verification.streams import numpys


@maker
def many(key, users, drones, cells):
    """The words of all links, one row each."""
    words = np.empty((users * drones * cells, 4), np.uint64)
    row = 0
    for user in range(users):
        for drone in range(drones):
            for cell in range(cells):
                counter = (np.uint64(cell), np.uint64(user), np.uint64(drone), np.uint64(0))
                words[row] = philox(key, counter)
                row += 1
    return words


@maker
def uniforms(words):
    drawn = np.empty(words.shape)
    for i in range(words.shape[0]):
        for j in range(words.shape[1]):
            drawn[i, j] = as_uniform(words[i, j])
    return drawn


@maker
def normals(words):
    drawn = np.empty(len(words))
    for i in range(len(words)):
        drawn[i] = as_normal(words[i])
    return drawn


def words_of(key, counter):
    found = philox(np.array(key, np.uint64), tuple(np.uint64(word) for word in counter))
    return tuple(int(word) for word in found)


class TestPhilox:
    ALL = 2**64 - 1

    @pytest.mark.parametrize(
        ("key", "counter", "words"),
        [
            (
                (0, 0),
                (0, 0, 0, 0),
                (0x16554D9ECA36314C, 0xDB20FE9D672D0FDC, 0xD7E772CEE186176B, 0x7E68B68AEC7BA23B),
            ),
            (
                (ALL, ALL),
                (ALL, ALL, ALL, ALL),
                (0x87B092C3013FE90B, 0x438C3C67BE8D0224, 0x9CC7D7C69CD777B6, 0xA09CAEBF594F0BA0),
            ),
            (
                (0x452821E638D01377, 0xBE5466CF34E90C6C),
                (0x243F6A8885A308D3, 0x13198A2E03707344, 0xA4093822299F31D0, 0x082EFA98EC4E6C89),
                (0xA528F45403E61D95, 0x38C72DBD566E9788, 0xA5A1610E72FD18B5, 0x57BD43B5E52B7FE6),
            ),
        ],
    )
    def test_the_published_vectors(self, key, counter, words):
        # kat_vectors of Random123, the library of the paper's authors
        assert words_of(key, counter) == words

    def test_the_same_words_as_numpy(self):
        rng = np.random.default_rng(1)
        for _ in range(300):
            key = rng.integers(0, 2**64, 2, np.uint64)
            counter = rng.integers(1, 2**64, 4, np.uint64)  # NumPy counts up by one before it draws
            before = counter - np.array([1, 0, 0, 0], np.uint64)
            theirs = np.random.Philox(key=key, counter=before).random_raw(4)
            assert words_of(key, counter) == tuple(theirs.tolist())

    def test_a_key_is_the_beginning_of_a_stream(self):
        for seed, episode in ((1, 0), (2**40, -3), (7, 6999)):
            raw = numpys(seed, 7, 0, episode).bit_generator.random_raw(2)
            assert key_of(seed, Purpose.LINK, episode).tolist() == raw.tolist()


class TestDraws:
    WORDS = many(key_of(3, Purpose.LINK, 0), 200, 10, 50)

    def test_they_are_uniform(self):
        drawn = uniforms(self.WORDS)
        count = len(drawn)
        for column in range(4):
            seen = np.histogram(drawn[:, column], 256, (0.0, 1.0))[0]
            chi_square = ((seen - count / 256) ** 2).sum() / (count / 256)
            assert abs(chi_square - 255) < 4 * np.sqrt(2 * 255)
        assert abs(drawn.mean(axis=0) - 0.5).max() < 4 / np.sqrt(12 * count)

    def test_they_are_independent(self):
        drawn = uniforms(self.WORDS)
        # Neighbours among users, drones and cells, and the words of one counter.
        links = drawn[:, 0].reshape(200, 10, 50)
        pairs = [(links[1:], links[:-1]), (links[:, 1:], links[:, :-1])]
        pairs += [(links[..., 1:], links[..., :-1])]
        pairs += list(pairwise(drawn.T))
        other = uniforms(many(key_of(3, Purpose.LINK, 1), 200, 10, 50))
        pairs += [(drawn[:, 0], other[:, 0])]
        for one, another in pairs:
            assert abs(np.corrcoef(one.ravel(), another.ravel())[0, 1]) < 4 / np.sqrt(one.size)
            joint = np.histogram2d(one.ravel(), another.ravel(), 16, [(0.0, 1.0)] * 2)[0]
            chi_square = ((joint - one.size / 256) ** 2).sum() / (one.size / 256)
            assert abs(chi_square - 255) < 4 * np.sqrt(2 * 255)

    def test_all_are_different(self):
        assert len(np.unique(self.WORDS)) == self.WORDS.size


class TestNormal:
    def test_quantiles(self):
        # CPython has the same algorithm; its own logarithm may differ in the last bit.
        theirs = NormalDist().inv_cdf
        rng = np.random.default_rng(2)
        shares = np.concatenate([rng.random(2000), 10.0 ** -rng.uniform(0.0, 300.0, 1000)])
        for share in [*shares, 0.5, 0.075, 0.925, 1e-300, 1.0 - 2.0**-53]:
            assert quantile(share) == pytest.approx(theirs(share), rel=1e-14, abs=1e-16)

    def test_no_word_is_infinite(self):
        low, high = as_normal(np.uint64(0)), as_normal(np.uint64(2**64 - 1))
        assert low == -high
        assert low == pytest.approx(NormalDist().inv_cdf(2.0**-53))

    def test_moments(self):
        drawn = normals(TestDraws.WORDS[:, 1])
        count = len(drawn)
        assert abs(drawn.mean()) < 4 / np.sqrt(count)
        assert abs((drawn**2).mean() - 1) < 4 * np.sqrt(2 / count)
        assert abs((drawn**3).mean()) < 4 * np.sqrt(15 / count)
        assert abs((drawn**4).mean() - 3) < 4 * np.sqrt(96 / count)
