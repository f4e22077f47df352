"""Effort per cycle and the best rest length, on curves whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from station.live.pipeline import CycleEffort

LENGTHS = {"0.66 m": 0.66, "0.69 m": 0.69, "worn": 0.72, "0.75 m": 0.75}
PERIOD_S, RATE_HZ = 4.0, 50.0


def run(best_of_cycle: list[float], *, with_gap: bool = False) -> CycleEffort:
    """Raises of the arm by 90 deg; effort is 1 for the slack suit, and 0.8 + 40 (L − best)² for a length L."""
    effort = CycleEffort(["slack", *LENGTHS])
    for k in range(round((len(best_of_cycle) + 1) * PERIOD_S * RATE_HZ)):
        time = k / RATE_HZ
        cycle = min(len(best_of_cycle) - 1, max(0, int((time - PERIOD_S / 2) // PERIOD_S)))
        efforts = {name: 0.8 + 40 * (length - best_of_cycle[cycle]) ** 2 for name, length in LENGTHS.items()}
        solved = {} if with_gap and k % 3 else {"slack": 1.0, **efforts}
        effort.add(time, np.pi / 4 * (1 - np.cos(2 * np.pi * time / PERIOD_S)), solved)
    return effort


def test_the_best_rest_length_is_the_lowest_point_of_the_curve_over_all_cycles() -> None:
    best = run([0.70, 0.71, 0.72]).best(LENGTHS)
    assert best is not None and best.cycles == 3 and best.edge == 0
    assert best.rest_length_m == pytest.approx(0.71, abs=1e-6)
    assert best.sd_m == pytest.approx(np.std([0.70, 0.71, 0.72], ddof=1), abs=1e-6)
    assert best.effort == pytest.approx(0.8 + 40 * np.mean([0.01**2, 0.0, 0.01**2]), abs=1e-6)


def test_a_best_length_beyond_those_tried_is_a_bound() -> None:
    best = run([0.80, 0.80]).best(LENGTHS)
    assert best is not None and (best.edge, best.rest_length_m) == (1, 0.75)
    best = run([0.60, 0.60]).best(LENGTHS)
    assert best is not None and (best.edge, best.rest_length_m) == (-1, 0.66)


def test_recent_effort_is_that_of_the_last_three_cycles() -> None:
    recent = run([0.80, 0.72, 0.72, 0.72]).recent()
    assert recent is not None and recent.cycles == 3
    assert recent.effort["worn"] == pytest.approx(0.8) and recent.effort["slack"] == pytest.approx(1.0)


def test_a_cycle_with_most_frames_unsolved_does_not_count() -> None:
    effort = run([0.70, 0.70], with_gap=True)
    assert effort.cycles == [] and effort.recent() is None and effort.best(LENGTHS) is None


def test_fewer_than_three_lengths_have_no_best_one() -> None:
    assert run([0.70]).best({"worn": 0.72, "0.75 m": 0.75}) is None
