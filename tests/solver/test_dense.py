"""Compiled linear algebra against NumPy's."""

from typing import Any

import numpy as np

from solver.compiled import compiled_for_python
from solver.dense import invert_part, matrix_times
from solver.redundancy.reduction import CACHE_LINE, aligned

RANDOM = np.random.default_rng(7)


@compiled_for_python
def _run(system: Any, count: int, pivot: Any, matrix: Any, rows: Any, product: Any) -> None:
    invert_part(system, count, pivot)
    matrix_times(matrix, rows, product)


def test_a_part_of_a_matrix_is_inverted_and_a_product_fills_the_first_columns() -> None:
    count, rows, width = 7, 2, 12
    root, B, C = RANDOM.normal(size=(count, count)), RANDOM.normal(size=(rows, count)), RANDOM.normal(size=(rows, rows))
    A = root @ root.T + np.eye(count)
    system = np.zeros((count + rows, width))
    system[:, : count + rows] = np.block([[A, B.T], [B, C]])
    matrix, factor, product = RANDOM.normal(size=(3, 6)), RANDOM.normal(size=(6, 33)), np.full((3, 35), 9.0)
    _run(system, count, np.zeros(width), matrix, factor, product)
    inverse = np.linalg.inv(A)
    expected = np.block([[inverse, inverse @ B.T], [-B @ inverse, C - B @ inverse @ B.T]])
    np.testing.assert_allclose(system[:, : count + rows], expected, atol=1e-12)
    assert not system[:, count + rows :].any()
    np.testing.assert_allclose(product[:, :33], matrix @ factor, atol=1e-13)
    assert (product[:, 33:] == 9.0).all()


def test_aligned_memory_starts_at_a_cache_line() -> None:
    arrays = [aligned(rows, 33) for rows in range(1, 12)]
    assert {array.ctypes.data % CACHE_LINE for array in arrays} == {0}
    assert all(array.flags.c_contiguous and array.shape == (rows, 33) for rows, array in enumerate(arrays, 1))
    assert not any(array.any() for array in arrays)
