"""Noise measured on line, beside the noise that was drawn and the estimate over the whole record."""

from __future__ import annotations

import numpy as np

from solver.inverse_kinematics.uncertainty import estimate_marker_noise
from solver.stream.marker_noise import ASSUMED, LEAST, RunningMarkerNoise

INTERVAL, FRAMES = 0.01, 1200


def test_the_noise_of_every_marker_is_found_while_it_moves() -> None:
    chance, time = np.random.default_rng(2), INTERVAL * np.arange(FRAMES)
    drawn = np.array([2e-4, 6e-4, 2e-3])
    path = np.stack([0.3 * np.sin(3 * time), 0.2 * np.cos(2 * time), 0.1 * time], axis=1)
    positions = path[:, None] + drawn[:, None] * chance.standard_normal((FRAMES, 3, 3))
    positions[300:310, 1] = np.nan
    positions[500:, 0] += 0.3  # a jump is no noise
    running = RunningMarkerNoise(3)
    assert (running.standard_deviation == ASSUMED).all()
    for k in range(FRAMES):
        running.add(time[k], positions[k])
    np.testing.assert_allclose(running.standard_deviation, drawn, rtol=0.15)
    np.testing.assert_allclose(running.standard_deviation, estimate_marker_noise(positions, INTERVAL), rtol=0.15)


def test_uneven_frames_do_not_count_and_no_marker_is_without_noise() -> None:
    running, uneven = RunningMarkerNoise(1), RunningMarkerNoise(1)
    chance, time = np.random.default_rng(3), 0.0
    for k in range(FRAMES):
        running.add(k * INTERVAL, np.zeros((1, 3)))
        time += INTERVAL * chance.choice([1.0, 1.6])
        uneven.add(time, chance.standard_normal((1, 3)))
    assert LEAST <= running.standard_deviation[0] < 2e-4
    assert uneven.standard_deviation[0] == ASSUMED
