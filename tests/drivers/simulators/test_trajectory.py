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


def test_it_forgets_the_oldest_and_answers_with_the_oldest_it_keeps() -> None:
    trajectory = Trajectory(kept_s=100 * STEP_S)
    for first in range(0, 1000, 50):
        trajectory.append(rows(first, 50))
    assert trajectory.at(np.array([0.0, 950.5, 999.0]) * STEP_S)[:, 2] == pytest.approx([900.0, 950.5, 999.0])


def test_after_a_skip_it_begins_anew() -> None:
    trajectory = Trajectory(kept_s=1.0)
    trajectory.append(rows(0, 10))
    trajectory.skip_to(5000)
    trajectory.append(rows(5000, 10))
    assert trajectory.at(np.array([7.0, 5003.0]) * STEP_S)[:, 0] == pytest.approx([5000.0, 5003.0])
