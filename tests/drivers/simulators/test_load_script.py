from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import g

from drivers.simulators.load_script import script_for
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
