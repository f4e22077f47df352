"""How far the mean of a hold errs where the noise of the markers outlasts the half seconds it is taken over."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

BATCH = 0.5
"""Seconds."""
LONG_HOLD = 6
"""Half seconds of a hold that can tell whether noise outlasts them."""
CORRELATED = 2.0
"""Standard errors by which neighbours must be alike to be believed."""
CORRELATIONS = np.linspace(0.0, 0.7, 15)


def batch_means(time: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of values (n,) at time (n,) [s] over half seconds, without those that few samples were seen in."""
    batch = ((time - time[0]) / BATCH).astype(np.intp)
    count = np.bincount(batch)
    return np.asarray((np.bincount(batch, values) / np.maximum(count, 1))[count > 0.5 * count.max()])


def slow_noise(holds: Sequence[NDArray[np.float64]]) -> float:
    """The error of a mean over a second, from the half seconds' means of all holds together: one hold has too few.

    Each hold is taken without its parabola, which may be creep. What is left is held against first-order autoregressive
    noise that went through the same: the correlation r of its neighbours that explains theirs, and its variance v, by
    moments. Means of such noise have the variance v (1 + r) / (1 - r) / n.
    0 where fewer than two holds last long enough.
    """
    long = [means for means in holds if len(means) >= LONG_HOLD]
    if len(long) < 2:
        return 0.0
    keeps = [_without_parabola(len(means)) for means in long]
    rests = [keep @ means for keep, means in zip(keeps, long, strict=True)]
    of_all = sum(float(rest @ rest) for rest in rests)
    of_neighbours = sum(float(rest[1:] @ rest[:-1]) for rest in rests)
    expected = np.array([_moments(keeps, r) for r in CORRELATIONS])
    if of_all == 0:
        return 0.0
    pairs = sum(len(means) - 1 for means in long)
    ratio = of_neighbours / of_all
    if ratio - expected[0, 1] / expected[0, 0] < CORRELATED / math.sqrt(pairs):
        ratio = expected[0, 1] / expected[0, 0]
    r = float(np.interp(ratio, expected[:, 1] / expected[:, 0], CORRELATIONS))
    variance = of_all / float(np.interp(r, CORRELATIONS, expected[:, 0]))
    return math.sqrt(BATCH * variance * (1 + r) / (1 - r))


def _without_parabola(count: int) -> NDArray[np.float64]:
    basis, _ = np.linalg.qr(np.vander(np.arange(count), 3))
    return np.asarray(np.eye(count) - basis @ basis.T)


def _moments(keeps: Sequence[NDArray[np.float64]], r: float) -> tuple[float, float]:
    """Expected sums of squares and of neighbours' products of such noise of variance 1, as much as each hold keeps."""
    covariances = [keep @ r ** np.abs(np.subtract.outer(*2 * [np.arange(len(keep))])) @ keep for keep in keeps]
    return sum(float(np.trace(each)) for each in covariances), sum(float(np.trace(each, 1)) for each in covariances)
