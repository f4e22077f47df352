"""A small walk of three markers, one of them hidden for a while, one never seen again."""

import numpy as np

from recordings.exchange.sample_tables import MarkerTable

FRAMES = 40
RATE = 100.0


def walk(first: float = 0.0) -> MarkerTable:
    random = np.random.default_rng(5)
    positions = random.normal(0, 100, (FRAMES, 3, 3)) + np.array([[500, 0, 900], [520, 30, 1000], [400, -50, 1100]])
    positions[10:14, 1] = np.nan
    positions[30:, 2] = np.nan
    residuals = np.where(np.isnan(positions[..., 0]), np.nan, 0.4)
    return MarkerTable(
        ("LShoulderTop", "LElbowOut", "cuff_1"), RATE, first + np.arange(FRAMES) / RATE, positions, residuals
    )


def same(found: MarkerTable, expected: MarkerTable, tolerance_mm: float = 0.0) -> bool:
    """Whether labels, rate, times and positions are the same, and the same markers missing."""
    return (
        found.labels == expected.labels
        and found.rate_hz == expected.rate_hz
        and np.allclose(found.time_s, expected.time_s, rtol=0, atol=1e-12)
        and bool((found.missing == expected.missing).all())
        and float(np.nanmax(np.abs(found.positions - expected.positions))) <= tolerance_mm
    )
