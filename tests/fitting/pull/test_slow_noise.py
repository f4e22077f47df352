"""Noise that outlasts half a second: one hold has too few half seconds to tell, all together have enough."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from fitting.pull.plateaus import BATCH, find_plateaus, slow_noise

LOADS = np.array([2.0, 17, 32, 47, 62, 77, 62, 47, 32, 17, 2])
STIFFNESS, NOISE = 8520.0, 0.15e-3


def _coloured(seed: int, count: int, memory: float) -> np.ndarray:
    """count frames at 100 Hz of first-order autoregressive noise with a memory [s]."""
    a = np.exp(-0.01 / memory) if memory else 0.0
    white = np.random.default_rng(seed).standard_normal(count + 1000)
    return NOISE * lfilter([np.sqrt(1 - a * a)], [1.0, -a], white)[1000:]


def _scores(memory: float, hold: float, runs: int = 40) -> np.ndarray:
    """Errors of the held displacements and of where each hold ended, in their standard errors: (holds, 2)."""
    time, frames = np.arange(0, hold * len(LOADS), 0.005), np.arange(0, hold * len(LOADS), 0.01)
    force = LOADS[np.minimum(time / hold, len(LOADS) - 1).astype(int)]
    way = LOADS[np.minimum(frames / hold, len(LOADS) - 1).astype(int)] / STIFFNESS
    scores = []
    for seed in range(runs):
        found = find_plateaus(time, force, 0.0, frames, way + _coloured(seed, len(frames), memory))
        assert len(found) == len(LOADS)
        for each in found:
            true = each.force / STIFFNESS
            scores.append([(each.displacement - true) / each.displacement_sd, (each.late[0] - true) / each.late[1]])
    return np.array(scores)


@pytest.mark.parametrize(("memory", "hold"), [(0.0, 5.0), (0.05, 5.0), (0.5, 8.0)])
def test_errors_of_held_displacements_are_what_they_claim(memory: float, hold: float) -> None:
    spread = _scores(memory, hold).std(axis=0)
    assert (spread > 0.6).all()
    assert (spread < 1.15).all()


def test_white_noise_errs_as_white_noise_does() -> None:
    holds = [np.random.default_rng(seed).standard_normal(14) for seed in range(200)]
    assert slow_noise(holds) == pytest.approx(np.sqrt(BATCH), rel=0.05)


def test_creep_within_holds_is_no_noise() -> None:
    creep = np.exp(-np.arange(14) * BATCH / 15.0)
    noise = [1e-3 * np.random.default_rng(seed).standard_normal(14) for seed in range(11)]
    with_creep, without = slow_noise([creep + each for each in noise]), slow_noise(noise)
    assert with_creep == pytest.approx(without, rel=0.5)


def test_few_or_short_holds_do_not_determine_the_noise() -> None:
    assert slow_noise([np.arange(14.0)]) == 0.0
    assert slow_noise([np.arange(5.0)] * 8) == 0.0
    assert slow_noise([np.zeros(14)] * 8) == 0.0
