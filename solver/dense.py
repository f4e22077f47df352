"""Small dense linear algebra for compiled code. Loops, because NumPy expressions take ten times as long to compile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_with_sums_in_any_order

Array = NDArray[np.float64]
Order = NDArray[np.int64]

SMALLEST_PIVOT = 1e-14
LANES = 32
"""Numbers that a compiled loop treats at once; the rest of a row takes as long again."""


@compiled
def inner_product(x: Array, y: Array) -> float:
    """x·y in four independent sums, which the processor computes in parallel."""
    one, two, three, four = 0.0, 0.0, 0.0, 0.0
    whole = len(x) - len(x) % 4
    for i in range(0, whole, 4):
        one += x[i] * y[i]
        two += x[i + 1] * y[i + 1]
        three += x[i + 2] * y[i + 2]
        four += x[i + 3] * y[i + 3]
    for i in range(whole, len(x)):
        one += x[i] * y[i]
    return (one + two) + (three + four)


@compiled
def copy(values: Array, into: Array) -> None:
    for i in range(len(into)):
        into[i] = values[i]


@compiled
def columns_times(M: Array, v: Array, product: Array) -> None:
    """Mᵀ v."""
    for j in range(len(product)):
        product[j] = 0.0
    for i in range(len(v)):
        for j in range(len(product)):
            product[j] += v[i] * M[i, j]


@compiled
def matrix_times(matrix: Array, rows: Array, product: Array) -> None:
    """matrix · rows, in the first columns of a product that may have more; four rows at once, so as to write less."""
    whole = len(rows) - len(rows) % 4
    for i in range(len(matrix)):
        own = product[i]
        for j in range(rows.shape[1]):
            own[j] = 0.0
        for k in range(0, whole, 4):
            a, b, c, d = matrix[i, k], matrix[i, k + 1], matrix[i, k + 2], matrix[i, k + 3]
            one, two, three, four = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
            for j in range(rows.shape[1]):
                own[j] += (a * one[j] + b * two[j]) + (c * three[j] + d * four[j])
        for k in range(whole, len(rows)):
            a, one = matrix[i, k], rows[k]
            for j in range(rows.shape[1]):
                own[j] += a * one[j]


@compiled_with_sums_in_any_order
def rows_times_rows(M: Array, diagonal: Array, R: Array, product: Array) -> None:
    """M · diagonal · Mᵀ + R, symmetric."""
    for i in range(len(M)):
        for j in range(i + 1):
            entry = R[i, j]
            for k in range(len(diagonal)):
                entry += M[i, k] * diagonal[k] * M[j, k]
            product[i, j] = product[j, i] = entry


@compiled
def invert_part(matrix: Array, count: int, pivot: Array) -> None:
    """By Gauss and Jordan, in place, of a symmetric matrix whose first part A of `count` rows is positive definite:

        ( A  Bᵀ )   becomes   (    A⁻¹      A⁻¹ Bᵀ   )
        ( B  C  )             ( −B A⁻¹   C − B A⁻¹ Bᵀ )

    pivot (columns,) is working memory. Where A is singular, the result is huge or not finite.
    """
    for k in range(count):
        inverse = 1.0 / matrix[k, k]
        for j in range(len(pivot)):
            pivot[j] = matrix[k, j] * inverse  # a copy: the compiler vectorises only what cannot overlap
        for i in range(len(matrix)):
            row, share = matrix[i], matrix[i, k]
            for j in range(len(pivot)):
                row[j] -= share * pivot[j]
            matrix[i, k] = -share * inverse
        copy(pivot, matrix[k])
        matrix[k, k] = inverse


@compiled
def factor(matrix: Array, order: Order) -> bool:
    """L U in place with partial pivoting, row k exchanged with order[k] at step k; False if it is singular."""
    count = len(matrix)
    for k in range(count):
        best = k
        for i in range(k + 1, count):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        order[k] = best
        if not abs(matrix[best, k]) > SMALLEST_PIVOT:
            return False
        if best != k:
            for j in range(count):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, count):
            share = matrix[i, k] * inverse
            matrix[i, k] = share
            for j in range(k + 1, count):
                matrix[i, j] -= share * matrix[k, j]
    return True


@compiled
def divide(matrix: Array, order: Order, x: Array) -> None:
    """x becomes the solution of matrix · solution = x, with the factors of the matrix."""
    count = len(x)
    for k in range(count):
        x[k], x[order[k]] = x[order[k]], x[k]
    for k in range(count):
        known = x[k]
        for i in range(k + 1, count):
            x[i] -= matrix[i, k] * known
    for k in range(count - 1, -1, -1):
        rest = x[k]
        for j in range(k + 1, count):
            rest -= matrix[k, j] * x[j]
        x[k] = rest / matrix[k, k]
