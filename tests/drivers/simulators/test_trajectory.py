from __future__ import annotations

import numpy as np
import pytest

from drivers.simulators.cuff_physics import STEP_S
from drivers.simulators.trajectory import Trajectory


def rows(first: int, count: int) -> np.ndarray:
    return np.repeat(np.arange(first, first + count, dtype=float)[:, None], 3, axis=1)


def test_between_steps_it_is_linear() -> None:
    trajectory = Trajectory(kept_s=1.0)
    trajectory.append(rows(0, 100))
    assert trajectory.at(np.array([0.0, 10.25 * STEP_S, 99 * STEP_S]))[:, 0] == pytest.approx([0.0, 10.25, 99.0])


def test_it_drops_the_oldest_points_and_returns_the_oldest_kept_one() -> None:
    trajectory = Trajectory(kept_s=100 * STEP_S)
    for first in range(0, 1000, 50):
        trajectory.append(rows(first, 50))
    assert trajectory.at(np.array([0.0, 950.5, 999.0]) * STEP_S)[:, 2] == pytest.approx([900.0, 950.5, 999.0])


@pytest.mark.parametrize("kept_s", [0.1, 10.0])
def test_it_holds_its_last_point_until_the_next_one_and_keeps_earlier_ones(kept_s: float) -> None:
    trajectory = Trajectory(kept_s)
    trajectory.append(rows(0, 10))
    trajectory.hold_until(5000)
    trajectory.append(rows(5000, 10))
    asked = [4999.0, 5003.0] if kept_s < 1 else [7.0, 2000.0, 4999.0, 5003.0]
    expected = [9.0, 5003.0] if kept_s < 1 else [7.0, 9.0, 9.0, 5003.0]
    assert trajectory.at(np.array(asked) * STEP_S)[:, 0] == pytest.approx(expected)
