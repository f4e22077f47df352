"""The weight that bounces under the simulated load cell, against the laws it must keep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import g

from drivers.simulators.errors import SimulatorCode
from drivers.simulators.load_script import BouncingMass
from drivers.simulators.settings import BounceTest
from tests.drivers.simulators.refusals import raises_refusal
from tests.drivers.simulators.test_world import go_to, play, world

TEST = BounceTest(mass_kg=2.0, frequency_hz=1.2, damping_ratio=0.01)


def _bounced() -> tuple[BouncingMass, float]:
    bounce = BouncingMass(TEST)
    bounce.hang(0.0)
    return bounce, bounce.begin(10.0)


def test_while_no_hand_holds_it_the_cell_carries_weight_and_inertia() -> None:
    bounce, _ = _bounced()
    t = np.arange(12.5, 30.0, 1e-3)
    acceleration = np.gradient(np.gradient(bounce.displacement(t), t), t)
    newton = TEST.mass_kg * (g - acceleration)
    np.testing.assert_allclose(bounce.tension(t)[5:-5], newton[5:-5], atol=0.01)


def test_it_hangs_at_rest_before_and_after() -> None:
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
