"""Planned errors and power, compared with the errors that the fits report and with simulated studies."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy import stats

from fitting.dynamic.errors_in_variables import estimate
from fitting.pull.pull import make_pulls
from fitting.static.stiffness import fit_stiffness, trial_stiffness
from fitting.study.cuff_study import Observation, compare
from fitting.study.power import (
    SETTLING,
    ExpectedSpread,
    InstrumentNoise,
    damping_error,
    difference_error,
    held_levels,
    migration_error,
    paired_power,
    stiffness_error,
)
from tests.fitting.pulls import DAMPING, MASS, STIFFNESS, Held, static_trial, swing

NOISE = 5.0


@pytest.mark.parametrize("frequency", [0.7, 1.5])
def test_the_information_of_an_oscillation_agrees_with_the_fit_s_own_standard_error(frequency: float) -> None:
    """The record has three more oscillations of 15 % each, so that the amplitude is that of its variance."""
    record = swing(3, frequency=frequency)
    amplitude = np.sqrt(2) * float(np.std(record.force))
    noise = InstrumentNoise(0.157e-3, 0.25, 100.0, 250.0)
    expected = damping_error((STIFFNESS, DAMPING, MASS), amplitude, frequency, 20.0, noise)
    assert float(estimate(record).known_lag_sd[1]) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("hold", [6.0, 10.0])
def test_the_information_of_held_loads_agrees_with_the_fit_s_own_standard_error(hold: float) -> None:
    """The noise of the displacement is measured on the record; the fit estimates its own from the holds."""
    trial, _ = static_trial(Held(hold=hold, unloads=True, force_noise=0.2, sway=0.0), seed=2)
    (pull,), _ = make_pulls([trial])
    unloaded = pull.displacement[pull.marker_time < hold - 1]
    noise = InstrumentNoise(float(np.std(unloaded)), 0.2, 100.0, 20.0)
    fitted = trial_stiffness(fit_stiffness([pull.plateaus], 0.0).trials[0])
    expected = stiffness_error(8520.0, held_levels([15.0] * 5, is_first=False), hold, noise)
    assert fitted.standard_error == pytest.approx(expected, rel=0.25)


def test_the_first_trial_of_a_donning_counts_from_the_largest_load_down() -> None:
    assert held_levels([10.0, 5.0], is_first=True).tolist() == [15.0, 10.0, 0.0]
    assert held_levels([10.0, 5.0], is_first=False).tolist() == [0.0, 10.0, 15.0, 10.0, 0.0]


def test_a_longer_hold_and_a_faster_swing_have_smaller_errors() -> None:
    noise = InstrumentNoise(2e-4, 0.3, 100.0, 250.0)
    levels = held_levels([15.0] * 5, is_first=True)
    assert stiffness_error(5500.0, levels, 11.5, noise) == pytest.approx(
        stiffness_error(5500.0, levels, 6.5, noise) / np.sqrt(2)
    )
    assert damping_error((5500.0, 120.0, 0.2), 12.0, 1.5, 20.0, noise) < damping_error(
        (5500.0, 120.0, 0.2), 12.0, 0.7, 20.0, noise
    )
    assert migration_error(5500.0, 6.5, noise) == pytest.approx(np.sqrt(2 * 2e-4**2 / 500), rel=0.02)


def test_noise_of_the_force_alone_has_the_error_of_a_mean_load() -> None:
    """50 averaged samples of 0.3 N at 6.5 s: u = 0.3 / (√50 k), and k² u / √Σ(F − F̄)² with Σ(F − F̄)² = 200."""
    noise = InstrumentNoise(0.0, 0.3, 100.0, 10.0)
    mean_load = 0.3 / np.sqrt(10.0 * (6.5 - SETTLING))
    levels = np.array([0.0, 10.0, 20.0])
    assert stiffness_error(400.0, levels, 6.5, noise) == pytest.approx(400.0 * mean_load / np.sqrt(200.0))
    assert migration_error(400.0, 6.5, noise) == pytest.approx(np.sqrt(2) * mean_load / 400.0)


@pytest.mark.parametrize("hold", [SETTLING, SETTLING - 0.5])
def test_a_hold_without_an_averaged_part_is_refused(hold: float) -> None:
    noise = InstrumentNoise(2e-4, 0.3, 100.0, 250.0)
    with pytest.raises(ValueError, match="too short"):
        stiffness_error(5500.0, np.array([0.0, 10.0]), hold, noise)
    with pytest.raises(ValueError, match="too short"):
        migration_error(5500.0, hold, noise)
    assert migration_error(5500.0, SETTLING + 0.5, noise) > 0


def test_the_error_of_the_damping_is_the_spread_of_noisy_complex_amplitudes() -> None:
    """Drawn with a cuff whose spring, mass and damper all count: c is Im(F / X) / ω of each draw."""
    stiffness, damping, mass, frequency, duration = 200.0, 30.0, 1.5, 1.5, 20.0
    omega = 2 * np.pi * frequency
    gain = stiffness - mass * omega**2 + 1j * omega * damping
    noise = InstrumentNoise(4e-4, 0.3, 100.0, 250.0)
    generator = np.random.default_rng(1)

    def drawn(sd: float, rate: float) -> np.ndarray:
        return sd * np.sqrt(2 / (duration * rate)) * (generator.standard_normal((20_000, 2)) @ [1, 1j])

    ratio = (12.0 + drawn(noise.force, 250.0)) / (12.0 / gain + drawn(noise.displacement, 100.0))
    expected = float(np.std(ratio.imag)) / omega
    planned = damping_error((stiffness, damping, mass), 12.0, frequency, duration, noise)
    assert planned == pytest.approx(expected, rel=0.03)


def test_the_power_is_the_part_of_simulated_studies_that_find_the_difference() -> None:
    spread, noise = ExpectedSpread(volunteer_by_cuff=10.0, donning=12.0, repeat=6.0), 5.0
    volunteers, donnings, repeats, difference, studies = 9, 2, 3, 14.0, 4000
    rng = np.random.default_rng(5)
    shape = (studies, volunteers, 2, donnings)
    values = np.array([0.0, difference])[:, None] + spread.volunteer_by_cuff * rng.standard_normal((*shape[:3], 1))
    values = values + spread.donning * rng.standard_normal(shape) + noise * rng.standard_normal(shape)
    values = values + (spread.repeat * rng.standard_normal((*shape, repeats))).mean(axis=-1)
    means = values.mean(axis=-1)
    found = stats.ttest_rel(means[:, :, 1], means[:, :, 0], axis=1).pvalue < 0.05
    error = difference_error(spread, noise, volunteers, donnings, repeats)
    assert float(found.mean()) == pytest.approx(paired_power(difference, error, volunteers, 0.05), abs=0.03)


@pytest.mark.parametrize(
    ("volunteers", "donnings", "repeats", "expected"),
    [(1, 1, 1, 2 * (4 + 9 + 16 + 25)), (5, 2, 4, 2 * (4 + 38 / 2) / 5)],
)
def test_the_error_of_a_mean_difference_averages_each_variance_over_what_repeats_it(
    volunteers: int, donnings: int, repeats: int, expected: float
) -> None:
    spread = ExpectedSpread(volunteer_by_cuff=2.0, donning=3.0, repeat=4.0)
    assert difference_error(spread, 5.0, volunteers, donnings, repeats) == pytest.approx(np.sqrt(expected))
    not_stated = difference_error(ExpectedSpread(2.0, 3.0), 5.0, 1, 1, 1)
    assert not_stated == pytest.approx(np.sqrt(2 * (4 + 9 + 25))), "repeats differ by the noise alone"


@pytest.mark.parametrize("difference", [0.0, 0.4, -2.0])
@pytest.mark.parametrize("volunteers", [3, 12])
@pytest.mark.parametrize("significance", [0.05, 0.5])
def test_the_power_is_that_of_statsmodels(difference: float, volunteers: int, significance: float) -> None:
    """Both tails count: at a significance of 50 %, the difference is often found with the wrong sign."""
    power = pytest.importorskip("statsmodels.stats.power").TTestPower()
    effect = abs(difference) / 1.5 / np.sqrt(volunteers)
    assert paired_power(difference, 1.5, volunteers, significance) == pytest.approx(
        power.power(effect, volunteers, significance, alternative="two-sided")
    )


@pytest.mark.slow
def test_the_power_is_the_part_of_studies_in_which_the_interval_of_the_study_leaves_zero_out() -> None:
    """The same with the mixed model of `station study` in place of the paired test."""
    rng, count, difference = np.random.default_rng(8), 400, 12.0
    spread = ExpectedSpread(volunteer_by_cuff=10.0, donning=12.0, repeat=6.0)
    found = 0
    for _ in range(count):
        effect = compare([*_drawn(rng, spread, difference)], "0", "1").difference
        found += effect is not None and not effect.ci95[0] <= 0.0 <= effect.ci95[1]
    error = difference_error(spread, NOISE / np.sqrt(2), 8, 2, 2)
    assert found / count == pytest.approx(paired_power(difference, error, 8, 0.05), abs=0.07)


def _drawn(rng: np.random.Generator, spread: ExpectedSpread, difference: float) -> Iterator[Observation]:
    for volunteer in range(8):
        shared = 20.0 * rng.standard_normal()
        for cuff in range(2):
            own = shared + cuff * difference + spread.volunteer_by_cuff * rng.standard_normal()
            for donning in range(2):
                centre = own + spread.donning * rng.standard_normal()
                for repeat in range(2):
                    value = centre + spread.repeat * rng.standard_normal() + NOISE * rng.standard_normal()
                    yield Observation(
                        value, NOISE, 0.0, str(volunteer), "A", str(volunteer), str(donning), repeat, str(cuff)
                    )
