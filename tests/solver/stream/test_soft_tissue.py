"""Standard deviations of a live posture beside markers that move over the bone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import ModelError
from tests.solver.stream.streams import FIRST, FRAMES, INTERVAL, NAMES, clean, raised, seen, solver, stream

Array = NDArray[np.float64]
SIZE = 2e-3
AT = 30
"""The frame that is judged: those of the lag follow."""


def skin(random: np.random.Generator) -> Array:
    """(frames, markers, 3) of SIZE: sinusoids of 0.1 to 2 Hz, as of the simulated person."""
    shape = (40, 1, len(NAMES), 3)
    phase = random.uniform(0, 2 * np.pi, shape)
    angle = 2 * np.pi * random.uniform(0.1, 2.0, shape) * INTERVAL * np.arange(FRAMES)[:, None, None] + phase
    return np.asarray(SIZE * (random.standard_normal(shape) * np.sin(angle)).sum(axis=0) / np.sqrt(20))


def covered(draws: int, **options: float) -> Array:
    """(3,) share of q, q̇ and q̈ that are within 1.96 standard deviations of the truth."""
    truth = np.array([raised()[FIRST + AT], *np.gradient(raised()[FIRST : FIRST + FRAMES], INTERVAL, axis=0)[[AT]]])
    hits = []
    for draw in range(draws):
        markers = clean() + skin(np.random.default_rng(draw))
        frame = stream(markers[: AT + 16], solver({}, **options))[AT]
        state, deviations = np.array([frame.coordinates, frame.speeds]), frame.standard_deviations[:2]
        hits.append((np.abs(state - truth) < 1.96 * deviations)[:, np.isfinite(deviations[0])])
    return np.asarray(np.mean(hits, axis=(0, 2)))


def test_a_posture_over_moving_skin_is_covered_at_the_stated_size() -> None:
    position, speed = covered(12, soft_tissue_m=SIZE)
    assert 0.9 < position < 0.99
    assert speed > 0.9


def test_by_default_the_published_size_is_assumed() -> None:
    assert covered(2)[0] == 1.0


def test_without_soft_tissue_the_noise_of_the_cameras_remains() -> None:
    frames = stream(seen()[:20], solver({}, soft_tissue_m=0.0))
    others = stream(seen()[:20], solver({}, soft_tissue_m=SIZE))
    assert (frames[3].standard_deviations[0] < others[3].standard_deviations[0]).any()
    np.testing.assert_allclose(frames[3].coordinates, others[3].coordinates, rtol=0, atol=1e-8)


@pytest.mark.parametrize("wrong", [-1e-3, np.nan, np.ones(2)])
def test_a_wrong_size_is_refused(wrong: float) -> None:
    with pytest.raises(ModelError) as refused:
        solver({}, soft_tissue_m=wrong)
    assert refused.value.code is SolverCode.WRONG_NOISE
