import numpy as np
import pytest
from scipy.constants import g

from drivers.simulators.cuff_physics import STEP_S
from drivers.simulators.errors import SimulatorCode
from drivers.simulators.load_script import BouncingMass, Trajectory, script_for
from drivers.simulators.settings import BounceTest, Settings
from tests.drivers.simulators.test_world import go_to, play, world
from tests.refusals import raises_refusal

BENCH = Settings()
HOOK_KG = BENCH.rig.hook_n / g
TEST = BounceTest(mass_kg=2.0, frequency_hz=1.2, damping_ratio=0.01)


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


def test_between_steps_a_trajectory_is_linear_and_it_drops_its_oldest_points() -> None:
    trajectory = Trajectory(kept_s=1.0)
    trajectory.append(rows(0, 100))
    assert trajectory.at(np.array([0.0, 10.25 * STEP_S, 99 * STEP_S]))[:, 0] == pytest.approx([0.0, 10.25, 99.0])
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


# The weight that bounces under the simulated load cell, against the laws it must keep.


def _bounced() -> tuple[BouncingMass, float]:
    bounce = BouncingMass(TEST)
    bounce.hang(0.0)
    return bounce, bounce.begin(10.0)


def test_the_cell_carries_weight_and_inertia_while_no_hand_holds_it_and_the_weight_rests_before_and_after() -> None:
    bounce, _ = _bounced()
    t = np.arange(12.5, 30.0, 1e-3)
    acceleration = np.gradient(np.gradient(bounce.displacement(t), t), t)
    newton = TEST.mass_kg * (g - acceleration)
    np.testing.assert_allclose(bounce.tension(t)[5:-5], newton[5:-5], atol=0.01)
    bounce, end = _bounced()
    still = np.array([0.0, 9.0, 10.0, end + 0.01, end + 60])
    np.testing.assert_allclose(bounce.displacement(still), 0.0, atol=1e-12)
    np.testing.assert_allclose(bounce.tension(still), TEST.mass_kg * g, atol=1e-6)


def test_the_bench_bounces_the_weight_on_request() -> None:
    bench = world(bounce={"mass_kg": 2.0}, mocap={"noise_mm": 0.0, "occlusions_per_minute": 0.0})
    bench.select_trial(None, "bounce")
    capture, t = play(bench)
    assert (capture.trial.cuff, capture.trial.test) == (None, "bounce")
    force = bench.cell_force(t)
    assert force.mean() == pytest.approx(2.0 * g, abs=0.3)
    height = bench.markers(t)[:, bench.labels.index("weight"), 2]
    assert np.corrcoef(force, height)[0, 1] == pytest.approx(-1.0, abs=1e-3)
    bench.select_trial("waist", "static")
    go_to(bench, bench.now() + 5.0)
    assert bench.cell_force(np.array([bench.now()]))[0] == pytest.approx(2.0, abs=0.1), "the hook on the rope"
    np.testing.assert_array_equal(bench.cell_force(t), force)


def test_the_amplifier_is_late_and_off_in_scale() -> None:
    bench = world(bounce={"mass_kg": 2.0}, amplifier={"delay_s": 0.05, "noise_v": 0.0, "zero_v": 0.0, "gain": 1.02})
    bench.select_trial(None, "bounce")
    _, t = play(bench)
    per_newton = bench.settings.amplifier.full_scale_v / (bench.settings.amplifier.capacity_kg * g)
    np.testing.assert_allclose(bench.amplifier_voltage(t), 1.02 * per_newton * bench.cell_force(t - 0.05), rtol=1e-9)


def test_a_bounce_needs_no_cuff_and_a_weight_in_the_settings() -> None:
    bench = world(bounce={})
    with raises_refusal(SimulatorCode.UNKNOWN_TRIAL, "a bounce has no cuff"):
        bench.select_trial("waist", "bounce")
    bench = world()
    with raises_refusal(SimulatorCode.UNKNOWN_TRIAL, "no bounce"):
        bench.select_trial(None, "bounce")


def test_a_cuff_keeps_what_it_slipped_while_the_weight_bounces() -> None:
    bench = world(bounce={})
    bench.select_trial("waist", "static")
    play(bench)
    before = bench.truth()["slip_m"]["waist"]
    bench.select_trial(None, "bounce")
    play(bench)
    bench.select_trial("waist", "static")
    assert bench.truth()["slip_m"]["waist"] == before > 0.001
