"""Products that leave out zeros are those of whole matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.learning.sparse import slopes_of_sums, sums


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("rows", [0, 1, 7])
@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_products_are_those_of_whole_matrices(kind: Any, rows: int, share: float):
    """With as many numbers that are not 0 as are added at a time, and with more and fewer."""
    rng = np.random.default_rng(rows)
    inputs = (rng.normal(size=(rows, 23)) * (rng.random((rows, 23)) < share)).astype(kind)
    layer, slopes = (rng.normal(size=(n, 5)).astype(kind) for n in (24, rows))
    exact = 1e-5 if kind is np.float32 else 1e-12
    found = sums(inputs, layer)
    assert found.shape == (rows, 5) and found.dtype == kind
    assert np.allclose(found, inputs @ layer[:-1] + layer[-1], atol=exact)
    of_layer = np.full_like(layer, np.nan)
    slopes_of_sums(inputs, slopes, of_layer)
    assert np.allclose(of_layer[:-1], inputs.T @ slopes, atol=exact)
    assert np.allclose(of_layer[-1], slopes.sum(0), atol=exact)


def test_a_layer_for_other_inputs_is_refused():
    """The kernels would read what lies behind the layer."""
    inputs, layer = np.zeros((2, 4), np.float32), np.zeros((4, 3), np.float32)
    with pytest.raises(ValueError, match="4 inputs do not fit a layer of 3"):
        sums(inputs, layer)
    with pytest.raises(ValueError, match="4 inputs do not fit a layer of 3"):
        slopes_of_sums(inputs, np.zeros((2, 3), np.float32), layer)


def test_rows_of_a_larger_array_are_read_as_they_lie():
    """Minibatches and parts of a rollout need not be contiguous."""
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(9, 12)).astype(np.float32)[::2, 1:]
    inputs[:, 2:] = 0.0
    layer = rng.normal(size=(12, 3)).astype(np.float32)
    assert np.allclose(sums(inputs, layer), inputs @ layer[:-1] + layer[-1], atol=1e-5)
