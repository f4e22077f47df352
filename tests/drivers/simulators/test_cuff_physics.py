"""The simulated cuff against what mechanics says about it, in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.constants import g

from drivers.simulators.cuff_physics import STEP_S, CuffMechanics, SpringDamper, slider_from_migration
from drivers.simulators.settings import PUBLISHED_CUFFS, CuffTruth, SlipLaw

Floats = NDArray[np.float64]

LAW = SlipLaw()
ROPE = SpringDamper(stiffness=20_000.0, damping=30.0, is_driven=False)
SPRING = SpringDamper(stiffness=100.0, damping=0.0, is_driven=True)
NO_SLIP = slider_from_migration(0.0, 77.0, LAW)


def still_body(far_end: Floats) -> Floats:
    """A drive whose body does not move."""
    return np.column_stack([np.zeros((len(far_end), 2)), far_end])


def half_steps(seconds: float) -> Floats:
    return np.arange(2 * round(seconds / STEP_S) + 1) * (STEP_S / 2)


def cuff(k: float = 2500.0, c: float = 140.0, migration: float = 0.0, link: SpringDamper = ROPE) -> CuffMechanics:
    tissue = CuffTruth(stiffness_n_per_m=k, damping_n_s_per_m=c, migration_m=migration)
    return CuffMechanics(tissue, 0.2, slider_from_migration(migration, 77.0, LAW), link)


def hung(mechanics: CuffMechanics, mass: Floats) -> Floats:
    """(n, 3): displacement, slip and load while a mass (2n + 1,) hangs on the cuff, at first 2 N."""
    start = mechanics.at_rest(load=2.0, slip=0.0, base=0.0, base_speed=0.0)
    return mechanics.integrate(start, still_body(mass))[1]


def ramps(*levels_n: float, hold_s: float = 4.0) -> Floats:
    """The masses of these loads, each reached within half a second and held."""
    times = np.concatenate([[0.0], *(i * hold_s + np.array([0.5, hold_s]) for i in range(len(levels_n)))])
    loads = np.concatenate([[2.0], np.repeat(levels_n, 2)])
    t = half_steps(hold_s * len(levels_n))
    return np.interp(t, times, loads) / g


@settings(deadline=None, max_examples=20)
@given(st.floats(500.0, 10_000.0), st.floats(20.0, 300.0), st.floats(3.0, 70.0))
def test_under_a_weight_at_rest_force_is_stiffness_times_displacement(k: float, c: float, load: float) -> None:
    displacement, _, tension = hung(cuff(k, c), ramps(load, hold_s=8.0))[-1]
    assert tension == pytest.approx(load, rel=1e-4)
    assert displacement == pytest.approx(load / k, rel=1e-4)


def test_a_swinging_cuff_without_damping_and_friction_keeps_its_energy() -> None:
    mechanics = CuffMechanics(
        CuffTruth(stiffness_n_per_m=2500, damping_n_s_per_m=0, migration_m=0),
        0.2,
        NO_SLIP,
        SpringDamper(stiffness=5000.0, damping=0.0, is_driven=False),
    )
    mass = 3.0

    def energy(state: object) -> float:
        x, v, _, y, w = (getattr(state, name) for name in ("cuff", "cuff_speed", "slip", "far", "far_speed"))
        springs = 2500 * x**2 / 2 + 5000 * (y - x) ** 2 / 2
        return springs + 0.2 * v**2 / 2 + mass * w**2 / 2 - mass * g * y

    start = mechanics.at_rest(load=20.0, slip=0.0, base=0.0, base_speed=0.0)  # 9.4 N too little for the mass
    end, trajectory = mechanics.integrate(start, still_body(np.full_like(half_steps(5.0), mass)))
    assert np.ptp(trajectory[:, 2]) > 10.0
    assert energy(end) == pytest.approx(energy(start), abs=1e-4)


def test_a_sinusoidal_pull_shows_the_complex_stiffness_of_spring_damper_and_mass() -> None:
    k, c, frequency = 5510.0, 38.0, 3.0
    mechanics = cuff(k, c, link=SPRING)
    omega = 2 * np.pi * frequency
    t = half_steps(6.0)
    start = mechanics.at_rest(load=25.0, slip=0.0, base=0.0, base_speed=0.0)
    far_end = 25.0 / k + (25.0 + 12.0 * np.sin(omega * t)) / SPRING.stiffness
    trajectory = mechanics.integrate(start, still_body(far_end))[1]
    period = round(1 / frequency / STEP_S)
    whole = trajectory[-6 * period :]
    turning = np.exp(-1j * omega * STEP_S * np.arange(len(whole)))
    stiffness = (turning @ whole[:, 2]) / (turning @ whole[:, 0])
    assert stiffness.real == pytest.approx(k - 0.2 * omega**2, rel=2e-3)
    assert stiffness.imag == pytest.approx(c * omega, rel=2e-2)


@pytest.mark.parametrize("name", PUBLISHED_CUFFS)
def test_a_donning_up_to_the_heaviest_load_leaves_the_configured_migration(name: str) -> None:
    truth = PUBLISHED_CUFFS[name]
    mechanics = CuffMechanics(truth, 0.2, slider_from_migration(truth.migration_m, 77.0, LAW), ROPE)
    trajectory = hung(mechanics, ramps(17, 32, 47, 62, 77, 62, 47, 32, 17, 2))
    displacement = trajectory[-1, 0] - 2.0 / truth.stiffness_n_per_m
    assert displacement == pytest.approx(truth.migration_m, rel=0.02)
    assert trajectory[-1, 1] == pytest.approx(truth.migration_m, rel=0.02)


def test_nothing_slips_below_the_limit_and_a_slip_beyond_takes_time() -> None:
    trajectory = hung(cuff(migration=0.02), ramps(LAW.first_slip_n - 4.0, 2.0))
    assert np.all(trajectory[:, 1] == 0)
    trajectory = hung(cuff(migration=0.02), ramps(60))
    speed = np.diff(trajectory[:, 1]) / STEP_S
    assert speed.max() < 0.1
    assert np.count_nonzero(speed > 1e-4) * STEP_S > 0.5


def test_the_cuff_slips_while_the_load_rises_and_never_while_it_falls_or_rises_again() -> None:
    trajectory = hung(cuff(migration=0.02), ramps(60, 2, 55, 2))
    slip = trajectory[:, 1]
    held = round(4.0 / STEP_S)
    assert np.all(np.diff(slip) >= 0)
    assert slip[held - 1] > 0.01
    assert slip[-1] - slip[held] < 1e-6


def test_a_slipped_cuff_is_as_stiff_as_before() -> None:
    trajectory = hung(cuff(k=4000.0, migration=0.012), ramps(77, 62, 47, 32, 17, 2))
    plateaus = trajectory[round(4.0 / STEP_S) - 1 :: round(4.0 / STEP_S)]
    slope = np.diff(plateaus[:, 2]) / np.diff(plateaus[:, 0])
    assert slope == pytest.approx(np.full(5, 4000.0), rel=1e-3)


def test_a_body_that_moves_takes_the_cuff_along_without_stretching_it() -> None:
    mechanics = cuff(link=SPRING)
    t = half_steps(10.0)
    base, base_speed = 0.002 * np.sin(t), 0.002 * np.cos(t)
    start = mechanics.at_rest(load=2.0, slip=0.0, base=0.0, base_speed=0.002)
    far_end = np.full_like(t, 2.0 / 2500 + 2.0 / SPRING.stiffness)
    trajectory = mechanics.integrate(start, np.column_stack([base, base_speed, far_end]))[1]
    load_from_sway = SPRING.stiffness * 0.002
    assert np.abs(trajectory[:, 0] - 2.0 / 2500).max() < 1.5 * load_from_sway / 2500
