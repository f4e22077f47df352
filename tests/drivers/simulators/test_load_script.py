""""""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import g

from drivers.simulators.cuff_physics import STEP_S
from drivers.simulators.load_script import Trajectory, script_for
from drivers.simulators.settings import Settings

BENCH = Settings()
HOOK_KG = BENCH.rig.hook_n / g


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_weights_go_on_one_by_one_and_come_off_one_by_one() -> None:
    script = script_for("static", BENCH, 0.0, rng())
    t = np.arange(0.0, script.duration, 0.01)
    mass = script.far_end(t)
    held = mass[np.abs(np.diff(mass, append=mass[-1])) < 1e-12]
    steps = np.array([0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]) * BENCH.protocol.static.step_masses_kg[0]
    levels = held[np.flatnonzero(np.diff(held, prepend=-1.0) != 0)]
    assert np.unique(np.round(levels, 6)) == pytest.approx(np.unique(np.round(HOOK_KG + steps, 6)))
    rising = mass[: mass.argmax()]
    assert np.all(np.diff(rising) >= -1e-12)
    assert mass.max() * g == pytest.approx(BENCH.peak_static_n)


def test_every_load_is_held_for_as_long_as_configured_after_a_hand_over_of_tenths_of_a_second() -> None:
    script = script_for("static", BENCH, 0.0, rng())
    t = np.arange(0.0, script.duration, 0.001)
    is_moving = np.abs(np.diff(script.far_end(t))) > 1e-9
    edges = np.flatnonzero(np.diff(is_moving.astype(int)))
    moving_s = np.diff(edges)[::2] * 0.001
    holding_s = np.diff(edges)[1::2] * 0.001
    assert len(moving_s) == 10
    assert np.all((moving_s > 0.2) & (moving_s < 0.71))
    assert np.all(holding_s > BENCH.protocol.static.hold_s - 0.01)


@pytest.mark.parametrize("test", ["static", "dynamic"])
def test_only_the_hook_hangs_before_and_after(test: str) -> None:
    script = script_for(test, BENCH, 0.01, rng())  # type: ignore[arg-type]
    ends = script.far_end(np.array([-1.0, 0.0, 1.9, script.duration - 0.5, script.duration, script.duration + 100]))
    hook = 0.01 + BENCH.rig.hook_n / script.link.stiffness if script.link.is_driven else HOOK_KG
    assert ends == pytest.approx(np.full(6, hook))


def test_the_hand_swings_the_spring_about_the_mean_at_one_hertz_with_natural_jitter() -> None:
    script = script_for("dynamic", BENCH, 0.0, rng())
    t = np.arange(6.0, 26.0, 0.01)
    force = script.far_end(t) * script.link.stiffness
    crossings = t[1:][(force[1:] > 25) & (force[:-1] <= 25)]
    periods = np.diff(crossings)
    assert force.mean() == pytest.approx(25.0, abs=0.7)
    assert np.ptp(force) / 2 == pytest.approx(12.0, rel=0.2)
    assert periods.mean() == pytest.approx(1.0, rel=0.05)
    assert 0.002 < periods.std() < 0.1
    assert force.max() < BENCH.peak_static_n


def test_no_two_trials_are_swung_alike() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    one, other = (script_for("dynamic", BENCH, 0.0, rng(seed)).far_end(t) for seed in (1, 2))
    assert not np.allclose(one, other, atol=1e-3)


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
