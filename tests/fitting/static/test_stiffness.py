"""Stiffness without slip: the segments, the interval, and what cannot be distinguished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from fitting.pull.plateaus import Plateau
from fitting.pull.plausibility import require_positive_loads
from fitting.results.codes import RejectionCode
from fitting.static.stiffness import fit_stiffness, trial_stiffness
from fitting.uncertainty import NORMAL_95
from tests.fitting.refusals import raises_refusal

K = 8000.0
NOISE = 2e-5
UP, DOWN = (2.0, 17.0, 32.0, 47.0, 62.0, 77.0), (62.0, 47.0, 32.0, 17.0, 2.0)


def _held(loads: Sequence[float], slips: NDArray[np.float64] | None = None, seed: int | None = None) -> list[Plateau]:
    """Plateaus of a cuff that had slipped so far at each load."""
    random = np.random.default_rng(seed)
    slips = np.zeros(len(loads)) if slips is None else slips
    plateaus = []
    for i, (load, slip) in enumerate(zip(loads, slips, strict=True)):
        x = load / K + slip + (NOISE * random.standard_normal() if seed is not None else 0.0)
        plateaus.append(Plateau(10.0 * i, 10.0 * i + 8, load, 0.01, x, NOISE, (x, 2 * NOISE)))
    return plateaus


def _slipping(loads: Sequence[float], already: float = 0.0) -> NDArray[np.float64]:
    """Slip of 0.2 mm per newton above 12 N, kept when the load falls."""
    return np.maximum.accumulate(np.maximum(already, 2e-4 * (np.array(loads) - 12.0)))


def test_slip_while_the_load_rises_does_not_reach_the_stiffness() -> None:
    loads = UP + DOWN
    fit = fit_stiffness([_held(loads, _slipping(loads))], 0.0)
    assert fit.stiffness is not None
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)
    assert fit.slip == pytest.approx(2e-4 * 65, rel=1e-6)
    assert not fit.slips_again


@pytest.mark.parametrize("cause", ["noise", "codes"])
def test_noise_of_the_force_is_new_in_every_trial_and_what_its_codes_leave_is_not(cause: str) -> None:
    held = [replace(each, force_sd=0.3, codes=0.3 if cause == "codes" else 0.0) for each in _held(UP + DOWN)]
    one, four = fit_stiffness([held], 0.0).stiffness, fit_stiffness([held] * 4, 0.0).stiffness
    assert one is not None
    assert four is not None
    assert one.parts[cause] == pytest.approx(one.standard_error, rel=0.2)
    assert four.parts[cause] == pytest.approx(one.parts[cause] / (2 if cause == "noise" else 1))


def test_hanging_the_same_weights_on_again_is_used_as_well() -> None:
    loads = UP + DOWN
    first, again = _held(loads, _slipping(loads)), _held(loads, _slipping(loads, already=2e-4 * 65))
    fit = fit_stiffness([first, again], 0.0)
    assert fit.stiffness is not None
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)
    assert len(set(fit.trials[1].segment)) == 1


def test_a_cuff_that_slips_under_every_rise_is_read_from_unloading_only() -> None:
    loads = UP + DOWN
    trials = [_held(loads, _slipping(loads) + already) for already in (0.0, 0.005, 0.008)]
    fit = fit_stiffness([*trials, *trials], 0.0)
    assert fit.slips_again
    assert fit.stiffness is not None
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)


def test_a_cuff_put_back_between_trials_has_no_progressive_slip() -> None:
    loads = UP + DOWN
    slipped = _held(loads, _slipping(loads))
    put_back, ratcheting = (
        fit_stiffness([slipped, again], 0.0) for again in (slipped, _held(loads, _slipping(loads) + 5e-3))
    )
    assert put_back.slips_again
    assert put_back.progressive_slip == 0
    assert ratcheting.slips_again
    assert ratcheting.progressive_slip == pytest.approx(5e-3)


@pytest.mark.parametrize("friction", [0.5, 4.0])
def test_friction_is_found_from_loading_and_unloading(friction: float) -> None:
    loads = UP + DOWN
    lag = -friction / K * np.sign(np.diff(loads, prepend=loads[0]))
    for seed in range(10):
        fit = fit_stiffness([_held(loads, lag, seed), _held(loads, lag, 100 + seed)], 0.0)
        assert fit.stiffness is not None
        assert abs(fit.stiffness.value - K) < 4 * fit.stiffness.standard_error < 0.03 * K
        assert fit.friction == pytest.approx(friction, abs=0.2)
        assert fit.slip == 0
        assert not fit.slips_again


@pytest.mark.parametrize("loads", [UP + DOWN, (*UP, 2.0)], ids=["one by one", "all at once"])
@pytest.mark.parametrize("bend", [-0.4, 0.6])
def test_a_cuff_that_bends_in_whatever_way_and_comes_back_has_not_slipped(
    loads: tuple[float, ...], bend: float
) -> None:
    curve = np.array(loads) / K * bend * np.array(loads) / 77
    fits = [fit_stiffness([_held(loads, curve, seed), _held(loads, curve, 100 + seed)], 0.0) for seed in range(20)]
    assert not any(fit.slips_again or fit.friction for fit in fits)
    assert sum(fit.slip != 0 for fit in fits) <= 1, "noise alone is beyond belief once in a thousand"


def test_weights_taken_off_all_at_once_leave_two_plateaus_and_a_stiffness() -> None:
    loads = (*UP, 2.0)
    fit = fit_stiffness([_held(loads, _slipping(loads))], 0.0)
    assert fit.stiffness is not None
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)
    expected = K**2 * np.hypot(NOISE, 2 * NOISE) / 75
    assert fit.stiffness.standard_error == pytest.approx(expected, rel=0.02)


def test_a_load_that_only_rises_determines_a_stiffness_only_along_a_line() -> None:
    straight = fit_stiffness([_held(UP, seed=1)], 0.0)
    assert straight.only_rose
    assert straight.stiffness is not None
    assert straight.stiffness.value == pytest.approx(K, rel=0.01)
    assert fit_stiffness([_held(UP, _slipping(UP))], 0.0).stiffness is None
    assert fit_stiffness([_held(UP[:3])], 0.0).stiffness is None


def test_without_held_loads_nothing_is_determined() -> None:
    assert fit_stiffness([[]], 0.0).stiffness is None
    assert fit_stiffness([], 0.0).stiffness is None


def test_a_hook_and_a_zero_do_not_change_the_stiffness() -> None:
    loads = UP + DOWN
    shifted = [
        Plateau(p.start, p.end, p.force + 7.0, p.force_sd, p.displacement, p.displacement_sd, p.late)
        for p in _held(loads, _slipping(loads))
    ]
    fit = fit_stiffness([shifted], 0.0)
    assert fit.stiffness is not None
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)


def test_the_scale_of_the_load_cell_is_in_the_interval() -> None:
    loads = UP + DOWN
    fit = fit_stiffness([_held(loads)] * 3, 0.004)
    assert fit.stiffness is not None
    assert fit.stiffness.standard_error > 0.004 * K


def _chi_square_of_intervals(shrink: float, fits: int = 80) -> float:
    """Σ z² where z is the error in half-widths of the interval × 1.96, over seeded single trials."""
    loads = UP + DOWN
    total = 0.0
    for seed in range(fits):
        fit = fit_stiffness([_held(loads, _slipping(loads), seed)], 0.0)
        estimate = trial_stiffness(fit.trials[0])
        assert estimate is not None
        half = shrink * (estimate.ci95[1] - estimate.ci95[0]) / 2
        total += ((estimate.value - K) / (half / NORMAL_95)) ** 2
    return total


def test_the_interval_is_honest_and_half_of_it_would_not_be() -> None:
    low, high = stats.chi2.ppf([0.0005, 0.9995], 80)
    assert _chi_square_of_intervals(1.0) < high
    assert _chi_square_of_intervals(1.0) > low / 4  # the larger of two half-widths is wide, not useless
    assert _chi_square_of_intervals(0.5) > high


def test_a_load_cell_of_the_wrong_sign_is_named() -> None:
    falling = [Plateau(0, 8, -load, 0.01, load / K, NOISE, (load / K, NOISE)) for load in UP + DOWN]
    with raises_refusal(RejectionCode.FORCE_POLARITY):
        require_positive_loads(falling)
    require_positive_loads(_held(UP + DOWN))
    require_positive_loads([])


def test_a_trial_whose_interval_has_no_end_has_no_stiffness_of_its_own() -> None:
    scattered = _held(UP + DOWN, np.array([0, 9, -9, 8, -8, 9, -9, 7, -9, 8, -6]) * 1e-3)
    fit = fit_stiffness([scattered], 0.0)
    assert fit.trials[0].repeat is not None
    assert fit.trials[0].repeat.estimate.ci95[0] < 0 < fit.trials[0].repeat.estimate.ci95[1]
    assert trial_stiffness(fit.trials[0]) is None
