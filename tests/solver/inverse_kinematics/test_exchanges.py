"""Exchanged labels are found from trajectories alone, whichever they are and whatever is hidden."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.inverse_kinematics.exchanges import Exchange, find_exchanges

Array = NDArray[np.float64]
RATE = 100.0


def moving(frames: int = 200, markers: int = 8, seed: int = 1) -> Array:
    """Markers decimetres apart that move together at up to 1.5 m/s, with 0.5 mm of noise."""
    chance = np.random.default_rng(seed)
    time = np.arange(frames) / RATE
    path = 0.3 * np.sin(2 * np.pi * 0.8 * time)[:, None] * np.array([1.0, 0.5, 0.2])
    places = chance.uniform(-0.25, 0.25, (markers, 3))
    return path[:, None] + places + 5e-4 * chance.standard_normal((frames, markers, 3))


def exchanged(observed: Array, one: int, other: int, start: int, stop: int) -> Array:
    changed = observed.copy()
    changed[start:stop, [one, other]] = observed[start:stop, [other, one]]
    return changed


def test_a_trial_without_exchanges_has_none() -> None:
    observed = moving()
    observed[50:80, 2] = np.nan
    assert find_exchanges(observed) == ()


@pytest.mark.parametrize("pair", [(0, 1), (2, 7), (3, 5)])
def test_an_exchange_of_two_tenths_of_a_second_is_found_with_its_frames(pair: tuple[int, int]) -> None:
    assert find_exchanges(exchanged(moving(), *pair, 60, 80)) == (Exchange(pair, 60, 80),)


def test_an_exchange_is_found_across_a_gap_and_beside_another() -> None:
    observed = exchanged(exchanged(moving(), 0, 1, 60, 80), 4, 6, 70, 90)
    observed[58:60, 0] = np.nan
    assert find_exchanges(observed) == (Exchange((0, 1), 60, 80), Exchange((4, 6), 70, 90))


@pytest.mark.parametrize(("start", "stop"), [(150, 200), (0, 50)])
def test_labels_are_taken_to_be_right_in_the_longer_part(start: int, stop: int) -> None:
    assert find_exchanges(exchanged(moving(), 1, 2, start, stop)) == (Exchange((1, 2), start, stop),)


def test_a_marker_that_jumps_away_is_not_exchanged() -> None:
    observed = moving()
    observed[60:80, 3] += [0.1, 0.0, 0.1]
    assert find_exchanges(observed) == ()
