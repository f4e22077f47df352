from __future__ import annotations

import numpy as np

from solver.multibody.load_wrenches import LoadWrenches, on_all_bodies

RANDOM = np.random.default_rng(31)
SPARSE = LoadWrenches(
    RANDOM.normal(size=(4, 5, 6)), np.array([0, 0, 1, 2, 2]), np.array([1, 3, 0, 3, 2]), loads=3, bodies=4
)


def test_a_dense_array_has_each_wrench_in_its_place_and_zeros_elsewhere() -> None:
    dense = SPARSE.dense()
    assert dense.shape == (4, 3, 4, 6)
    for k, (load, body) in enumerate(zip(SPARSE.load, SPARSE.body, strict=True)):
        assert np.array_equal(dense[:, load, body], SPARSE.values[:, k])
    assert np.count_nonzero(dense) == SPARSE.values.size


def test_the_total_is_that_of_the_dense_array() -> None:
    factors = RANDOM.normal(size=(4, 3))
    expected = np.einsum("fl,flbi->fbi", factors, SPARSE.dense())
    assert np.allclose(SPARSE.total(factors), expected, rtol=0, atol=1e-14)


def test_a_dense_array_comes_back_as_it_was() -> None:
    dense = RANDOM.normal(size=(2, 3, 4, 6))
    assert np.array_equal(on_all_bodies(dense).dense(), dense)
