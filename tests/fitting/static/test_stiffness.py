"""Stiffness without slip: the segments, the interval, and what cannot be distinguished."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats

from fitting.pull.plateaus import Plateau
from fitting.results.codes import FitOutcome
from fitting.static import stiffness
from fitting.static.stiffness import (
    HeldPoints,
    StiffnessFit,
    TangentLaw,
    _bent,
    _fit_trial,
    fit_law,
    fit_stiffness,
    trial_stiffness,
    within,
)
from fitting.uncertainty import NORMAL_95, Estimate

K = 8000.0
NOISE = 2e-5
UP, DOWN = (2.0, 17.0, 32.0, 47.0, 62.0, 77.0), (62.0, 47.0, 32.0, 17.0, 2.0)
STEEP = Estimate(8000.0, 100.0, (7800.0, 8200.0), {"noise": 100.0})
FLAT = Estimate(7000.0, 50.0, (6900.0, 7100.0), {"noise": 50.0})


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
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)
    assert fit.slip == pytest.approx(2e-4 * 65, rel=1e-6)
    assert not fit.slips_again and fit.progressive_slip == 0.0 and fit.law is not None


@pytest.mark.parametrize("cause", ["noise", "codes"])
def test_noise_of_the_force_is_new_in_every_trial_and_what_its_codes_leave_is_not(cause: str) -> None:
    held = [replace(each, force_sd=0.3, codes=0.3 if cause == "codes" else 0.0) for each in _held(UP + DOWN)]
    one, four = fit_stiffness([held], 0.0).stiffness, fit_stiffness([held] * 4, 0.0).stiffness
    assert one.parts[cause] == pytest.approx(one.standard_error, rel=0.2)
    assert four.parts[cause] == pytest.approx(one.parts[cause] / (2 if cause == "noise" else 1))


def test_hanging_the_same_weights_on_again_is_used_as_well() -> None:
    loads = UP + DOWN
    first, again = _held(loads, _slipping(loads)), _held(loads, _slipping(loads, already=2e-4 * 65))
    fit = fit_stiffness([first, again], 0.0)
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)
    assert len(set(fit.trials[1].segment)) == 1


def test_a_cuff_that_slips_under_every_rise_is_read_from_unloading_only() -> None:
    loads = UP + DOWN
    trials = [_held(loads, _slipping(loads) + already) for already in (0.0, 0.005, 0.008)]
    fit = fit_stiffness([*trials, *trials], 0.0)
    assert fit.slips_again
    assert fit.stiffness.value == pytest.approx(K, rel=1e-9)


@pytest.mark.parametrize("friction", [0.5, 4.0])
def test_friction_is_found_from_loading_and_unloading(friction: float) -> None:
    loads = UP + DOWN
    lag = -friction / K * np.sign(np.diff(loads, prepend=loads[0]))
    for seed in range(10):
        fit = fit_stiffness([_held(loads, lag, seed), _held(loads, lag, 100 + seed)], 0.0)
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


def test_a_load_that_only_rises_determines_a_stiffness_only_along_a_line() -> None:
    straight = fit_stiffness([_held(UP, seed=1)], 0.0)
    assert straight.only_rose
    assert straight.stiffness.value == pytest.approx(K, rel=0.01)
    assert fit_stiffness([_held(UP, _slipping(UP))], 0.0).stiffness is None
    for case, trials in {"three loads": [_held(UP[:3])], "no loads": [[]], "no trials": []}.items():
        assert fit_stiffness(trials, 0.0).stiffness is None, case


def _chi_square_of_intervals(shrink: float, fits: int = 80) -> float:
    """Σ z² where z is the error in half-widths of the interval × 1.96, over seeded single trials."""
    loads = UP + DOWN
    total = 0.0
    for seed in range(fits):
        fit = fit_stiffness([_held(loads, _slipping(loads), seed)], 0.0)
        estimate = trial_stiffness(fit.trials[0])
        half = shrink * (estimate.ci95[1] - estimate.ci95[0]) / 2
        total += ((estimate.value - K) / (half / NORMAL_95)) ** 2
    return total


@pytest.mark.slow
def test_the_interval_is_honest_and_half_of_it_would_not_be() -> None:
    low, high = stats.chi2.ppf([0.0005, 0.9995], 80)
    assert _chi_square_of_intervals(1.0) < high
    assert _chi_square_of_intervals(1.0) > low / 4  # the larger of two half-widths is wide, not useless
    assert _chi_square_of_intervals(0.5) > high


def test_a_trial_whose_interval_has_no_end_has_no_stiffness_of_its_own() -> None:
    scattered = _held(UP + DOWN, np.array([0, 9, -9, 8, -8, 9, -9, 7, -9, 8, -6]) * 1e-3)
    fit = fit_stiffness([scattered], 0.0)
    assert fit.trials[0].repeat.estimate.ci95[0] < 0 < fit.trials[0].repeat.estimate.ci95[1]
    assert trial_stiffness(fit.trials[0]) is None


def test_two_held_loads_have_a_slope_whose_errors_are_in_closed_form() -> None:
    """Weights of y / (x_sd² + c² force_sd²): the information of c is w ΔF² / 2."""
    force_sd, codes, c, rise, wait = 0.4, 0.24, 1 / K, 60.0, 12.0
    held = [
        Plateau(wait * i, wait * i + 8, load, force_sd, load / K, NOISE, (load / K, NOISE), codes)
        for i, load in enumerate((2.0, 2.0 + rise))
    ]
    (fit,) = fit_stiffness([held], 0.003, 0.01, creeps=True).trials
    information = rise**2 / 2 / (NOISE**2 + (c * force_sd) ** 2)
    noise = np.sqrt(2 / rise**2 * (NOISE**2 + c**2 * (force_sd**2 - codes**2)))
    assert (fit.repeat.value, fit.repeat.dof) == (pytest.approx(c), 0)
    assert fit.repeat.noise == pytest.approx(noise)
    causes = {"codes": np.sqrt(1 / information - noise**2), "gain": 0.003 * c, "drift": 0.01 * wait / rise * c}
    assert {name: fit.repeat.causes[name] for name in causes} == pytest.approx(causes)
    assert fit.repeat.causes.keys() == {*causes, "settling"}
    assert fit.repeat.common == pytest.approx(np.linalg.norm([*causes.values()]))
    assert fit.offset == pytest.approx(np.zeros(2), abs=1e-6)
    assert fit.x_sd == pytest.approx([np.hypot(NOISE, c * force_sd)] * 2)
    assert fit.outcome is FitOutcome.CONVERGED


def test_a_trial_with_slip_is_the_weighted_regression_of_statsmodels() -> None:
    """Displacement on force and a constant for every part between slips, with the weights of the final slope."""
    api = pytest.importorskip("statsmodels.api")
    loads = UP + DOWN
    random = np.random.default_rng(4)
    held = [
        replace(plateau, force_sd=0.1 + 0.2 * random.random(), displacement_sd=NOISE * (1 + random.random()))
        for plateau in _held(loads, _slipping(loads), 6)
    ]
    (fit,) = fit_stiffness([held], 0.0).trials
    assert fit.segment.tolist() == [0, 1, 2, 3, 4, 5, 5, 5, 5, 5, 5] and fit.repeat is not None
    x = [p.late[0] if i in range(1, 6) else p.displacement for i, p in enumerate(held)]
    x_sd = np.array([p.late[1] if i in range(1, 6) else p.displacement_sd for i, p in enumerate(held)])
    force_sd = np.array([p.force_sd for p in held])
    design = np.column_stack([loads, np.eye(6)[fit.segment]])
    weights = 1 / (x_sd**2 + (fit.repeat.value * force_sd) ** 2)
    oracle = api.WLS(x, design, weights=weights).fit()
    assert fit.repeat.value == pytest.approx(oracle.params[0], rel=1e-6)
    assert fit.repeat.noise == pytest.approx(oracle.bse[0] / np.sqrt(oracle.scale), rel=1e-6)
    assert (fit.repeat.chi_square, fit.repeat.dof) == (pytest.approx(oracle.ssr, rel=1e-6), int(oracle.df_resid))
    assert fit.offset == pytest.approx(-oracle.params[1:][fit.segment] / oracle.params[0], rel=1e-5)
    assert fit.x.tolist() == x


@pytest.mark.parametrize(("reached", "begins"), [(77.29, False), (77.31, True)])
def test_a_load_is_above_all_before_it_if_it_exceeds_them_by_0_3_n(reached: float, begins: bool) -> None:
    first, second = UP + DOWN, (2.0, reached, 2.0)
    slips = _slipping(first + second)
    trials = [_held(first, slips[: len(first)]), _held(second, slips[len(first) :])]
    fit = fit_stiffness(trials, 0.0)
    assert fit.trials[1].segment.tolist() == ([0, 1, 1] if begins else [0, 0, 0])


@pytest.mark.parametrize(
    ("end", "lowest", "is_elastic"),
    [
        (2.29, 20.0, True),
        (2.31, 20.0, False),
        (1.71, 20.0, True),
        (1.69, 20.0, False),
        (2.0, 1.71, True),
        (2.0, 1.69, False),
    ],
)
def test_a_curve_that_returns_to_its_load_within_0_3_n_is_elastic(end: float, lowest: float, is_elastic: bool) -> None:
    """No line and no exponential; a load between that falls below the first interrupts the return."""
    loads = (2.0, 25.0, 40.0, lowest, 60.0, 77.0, end)
    curve = 1e-3 * np.sin(np.array(loads) / 12)
    fit = fit_stiffness([_held(loads, curve)], 0.0)
    assert (len(set(fit.trials[0].segment)) == 1) is is_elastic


@pytest.mark.parametrize(("growth", "is_known"), [(0.01, True), (-0.004, False)])
def test_a_load_that_only_rises_may_stiffen_the_cuff_but_not_soften_it(growth: float, is_known: bool) -> None:
    """The exponential law, whose tangent stiffness is K (1 + growth F). Slip softens, too."""
    loads = np.array(UP)
    fit = fit_stiffness([_held(UP, np.log1p(growth * loads) / (growth * K) - loads / K)], 0.0)
    assert fit.only_rose and (fit.stiffness is not None) is is_known


@pytest.mark.parametrize(("friction", "is_possible"), [(5.0, True), (10.0, False)])
def test_friction_of_a_tenth_of_the_load_may_explain_a_single_unloading_branch(
    friction: float, is_possible: bool
) -> None:
    """All weights off: over 75 N the cuff returns by 75 N less twice the friction, so that it seems to be stiffer."""
    loads = (*UP, 2.0)
    lag = -friction / K * np.sign(np.diff(loads, prepend=loads[0]))
    lag[0] = 0.0
    fit = fit_stiffness([_held(loads, lag)], 0.0)
    apparent = K * 75 / (75 - 2 * friction)
    assert fit.stiffness is not None and fit.stiffness.value == pytest.approx(apparent, rel=1e-6)
    assert fit.loading is not None and fit.loading.value == pytest.approx(K, rel=1e-6)
    assert (fit.if_friction, fit.if_slip is not None) == ((fit.loading, True) if is_possible else (None, False))
    assert fit.stiffness.parts.get("friction", 0.0) == pytest.approx((apparent - K) / np.sqrt(3) * is_possible)
    assert (fit.stiffness.ci95[0] < K) is is_possible


def test_friction_without_noise_is_half_the_distance_of_the_branches() -> None:
    loads = UP + DOWN
    lag = -4.0 / K * np.sign(np.diff(loads, prepend=loads[0]))
    fit = fit_stiffness([_held(loads, lag)] * 2, 0.0)
    assert (fit.friction, fit.slip, fit.slips_again) == (pytest.approx(4.0), 0.0, False)
    assert fit.stiffness is not None and fit.stiffness.value == pytest.approx(K)
    assert fit.trials[0].segment.tolist() == [0, *[1] * 5, *[2] * 5]


@pytest.mark.parametrize(("more", "found"), [(1.6e-4, 0.0), (1.8e-4, 1.8e-4)])
def test_progressive_slip_counts_from_three_standard_errors_on(more: float, found: float) -> None:
    """Two displacements at the end of a hold, each with 4e-5 m: 1.7e-4 m."""
    slipped, again = (_held(UP + DOWN, _slipping(UP + DOWN) + shift) for shift in (0.0, more))
    fit = fit_stiffness([slipped, again], 0.0)
    assert fit.slips_again and fit.progressive_slip == pytest.approx(found)


@pytest.mark.parametrize(
    ("stiffness", "loading", "part"), [(STEEP, FLAT, 1000 / np.sqrt(3)), (FLAT, STEEP, 0.0)], ids=["softer", "stiffer"]
)
def test_with_friction_the_stiffness_is_that_of_loading_and_its_interval_has_both(
    stiffness: Estimate, loading: Estimate, part: float
) -> None:
    fit = StiffnessFit(stiffness, (), 0.0, True, 0.0, 0.0, False, None, loading=loading).with_friction()
    assert fit.stiffness.value == loading.value and fit.stiffness.ci95 == (6900.0, 8200.0)
    assert fit.stiffness.standard_error == pytest.approx(np.hypot(loading.standard_error, part))
    assert fit.stiffness.parts == pytest.approx({"noise": loading.standard_error, "friction": part})
    assert (fit.if_friction, fit.if_slip, fit.slips_again) == (loading, stiffness, False)


@pytest.mark.parametrize(("stiffness", "loading"), [(None, FLAT), (STEEP, None)])
def test_without_a_loading_branch_or_a_stiffness_friction_changes_nothing(
    stiffness: Estimate | None, loading: Estimate | None
) -> None:
    fit = StiffnessFit(stiffness, (), 0.0, True, 0.0, 0.0, False, None, loading=loading)
    assert fit.with_friction() is fit


def test_the_stiffness_of_a_trial_has_the_value_with_friction_in_its_interval() -> None:
    (trial,) = fit_stiffness([_held(UP + DOWN)], 0.0).trials
    alone, widened = trial_stiffness(trial), trial_stiffness(trial, FLAT)
    assert alone is not None and widened is not None
    assert widened.ci95 == (pytest.approx(7000 - NORMAL_95 * 50), alone.ci95[1])
    assert widened.parts["friction"] == pytest.approx(1000 / np.sqrt(3))
    assert widened.standard_error == pytest.approx(np.hypot(alone.standard_error, 1000 / np.sqrt(3)))
    stiffer = trial_stiffness(trial, replace(STEEP, value=9000.0))
    assert stiffer is not None and (stiffer.ci95, stiffer.parts["friction"]) == (alone.ci95, 0.0)


@pytest.mark.parametrize(("rise", "is_known"), [(0.3, False), (0.31, True)])
def test_a_slope_needs_two_loads_of_one_segment_that_differ_by_more_than_0_3_n(rise: float, is_known: bool) -> None:
    fit = _fit_trial(tuple(_held((0.0, rise, 50.0))), np.array([False, False, True]), 0.0, 0.0)
    assert (fit.repeat is not None) is is_known and bool(np.isnan(fit.offset).any()) is not is_known
    assert len(fit.offset) == 3


def _scattered(seed: int, x_sd: float, force_sd: float) -> list[Plateau]:
    """Plateaus of uneven weights far from a line, so that the reweighting converges slowly."""
    random = np.random.default_rng(seed)
    scatter = 3e-3 * random.standard_normal(5)
    return [
        replace(
            plateau,
            end=plateau.start + 8 * random.random(),
            force_sd=force_sd * (0.1, 1, 0.1, 1, 0.1)[i],
            codes=force_sd * (0.05, 0.5, 0.05, 0.5, 0.05)[i],
            displacement_sd=x_sd * (1, 0.1, 1, 0.1, 1)[i],
            late=(plateau.displacement + 3e-3 * random.standard_normal(), NOISE),
            hold=(1.5, 2.4, 9.0, 2.6, 2.0)[i],
        )
        for i, plateau in enumerate(_held((2, 17, 32, 47, 77), scatter))
    ]


def _columns(held: Sequence[Plateau], *names: str) -> tuple[NDArray[np.float64], ...]:
    return tuple(np.array([getattr(plateau, name) for plateau in held]) for name in names)


def _polyfit(
    held: Sequence[Plateau], y: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Slope over the force, constant, and variance of the slope."""
    (force,) = _columns(held, "force")
    (slope, constant), covariance = np.polyfit(force, y, 1, w=np.sqrt(weight), cov="unscaled")
    return float(slope), float(constant), float(covariance[0, 0])


@pytest.mark.parametrize(
    ("seed", "x_sd", "force_sd", "last", "limit"),
    [(4, 3e-4, 3.0, 10, 99), (5, 1e-3, 10.0, 4, 99), (4, 3e-4, 3.0, 5, 5)],
)
def test_a_single_segment_is_the_weighted_straight_line_of_numpy(
    monkeypatch: pytest.MonkeyPatch, seed: int, x_sd: float, force_sd: float, last: int, limit: int
) -> None:
    """polyfit, with the weights of the slope of the round before, until a round changes it by 0.01 standard errors."""
    if limit == last:
        monkeypatch.setattr(stiffness, "MAX_ROUNDS", limit)
    held = _scattered(seed, x_sd, force_sd)
    fit = _fit_trial(tuple(held), np.zeros(5, bool), 0.003, 0.01)
    x, errors, force, force_errors = _columns(held, "displacement", "displacement_sd", "force", "force_sd")
    slope, rounds, change = 0.0, 0, math.inf
    while (rounds < 4 or change > 0.01) and rounds < limit:
        weight, before = 1 / (errors**2 + (slope * force_errors) ** 2), slope
        slope, constant, variance = _polyfit(held, x, weight)
        rounds, change = rounds + 1, abs(slope - before) / math.sqrt(variance)
    noise = math.sqrt(_polyfit(held, x, 1 / (errors**2 + 0.75 * (slope * force_errors) ** 2))[2])
    middle = np.array([(p.start + p.end) / 2 for p in held])
    unsettled = np.array([p.late[0] - p.displacement if p.hold < 2.5 else 0.0 for p in held])
    causes = {
        "codes": math.sqrt(variance - noise**2),
        "gain": 0.003 * slope,
        "drift": 0.01 * abs(_polyfit(held, middle, weight)[0]) * slope,
        "settling": abs(_polyfit(held, unsettled, weight)[0]),
    }
    assert rounds == last and fit.repeat is not None
    assert fit.outcome is (FitOutcome.NOT_CONVERGED if limit == last else FitOutcome.CONVERGED)
    assert fit.repeat.value == pytest.approx(slope, rel=1e-9)
    assert fit.repeat.noise == pytest.approx(noise, rel=1e-7)
    assert fit.repeat.chi_square == pytest.approx(float(weight @ (x - slope * force - constant) ** 2), rel=1e-7)
    assert fit.repeat.causes == pytest.approx(causes, rel=1e-6)
    assert fit.offset == pytest.approx(np.full(5, -constant / slope), rel=1e-7)
    assert fit.x_sd == pytest.approx(np.hypot(errors, slope * force_errors))


def test_without_noise_a_displacement_has_a_standard_error_of_1e_7_m() -> None:
    held = [replace(plateau, force_sd=0.0, displacement_sd=0.0) for plateau in _held((2.0, 62.0))]
    fit = _fit_trial(tuple(held), np.zeros(2, bool), 0.0, 0.0)
    assert fit.repeat is not None and fit.repeat.noise == pytest.approx(1e-7 * math.sqrt(2) / 60)


def test_a_regression_that_still_changes_after_its_last_round_has_not_converged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stiffness, "NEGLIGIBLE", math.nan)
    fit = fit_stiffness([_held(UP + DOWN)], 0.0)
    assert fit.trials[0].outcome is fit.outcome is FitOutcome.NOT_CONVERGED
    assert fit.stiffness is not None and fit.stiffness.outcome is FitOutcome.CONVERGED


def test_a_drift_that_is_not_given_is_zero() -> None:
    fit = fit_stiffness([_held(UP + DOWN)], 0.0)
    assert fit.stiffness is not None and fit.stiffness.parts["drift"] == fit.stiffness.parts["gain"] == 0.0
    law = fit_stiffness([_held(UP + DOWN)], 0.01).law
    assert law is not None and law.gain_sd == 0.01


def test_a_load_only_rose_if_it_did_in_every_trial() -> None:
    loads, higher = UP + DOWN, (80.0, 95.0)
    slips = _slipping(loads + higher)
    fit = fit_stiffness([_held(loads, slips[: len(loads)]), _held(higher, slips[len(loads) :])], 0.0)
    assert fit.trials[1].repeat is None and not fit.only_rose


def test_creep_is_no_progressive_slip() -> None:
    trials = [_held(UP + DOWN, _slipping(UP + DOWN) + already) for already in (0.0, 5e-3)]
    assert fit_stiffness(trials, 0.0).progressive_slip == pytest.approx(5e-3)
    assert fit_stiffness(trials, 0.0, creeps=True).progressive_slip == 0.0


LAW = TangentLaw(2.0, 1 / K, 0.008, np.array([[4e-12, -3e-9], [-3e-9, 9e-6]]), 1.0, 40, 0.02)


@pytest.mark.parametrize("force", [2.0, 40.0])
def test_errors_of_the_exponential_law_are_propagated_along_the_slope_of_its_figures(force: float) -> None:
    """b is ρ κ, the tangent is κ (1 + ρ (F − 2 N)); their slopes over 1/κ and ρ are finite differences."""

    def figures(slope: float, growth: float) -> NDArray[np.float64]:
        return np.array([growth / slope, (1 + growth * (force - 2)) / slope])

    sides = [[(LAW.slope * (1 + i * s), LAW.growth * (1 + j * s)) for s in (1e-5, -1e-5)] for i, j in ((1, 0), (0, 1))]
    steps = 2e-5 * np.array([LAW.slope, LAW.growth])
    slopes = np.array([figures(*up) - figures(*down) for up, down in sides]).T / steps
    expected = np.sqrt(np.diag(slopes @ LAW.covariance @ slopes.T))
    b, tangent = LAW.stiffening, LAW.tangent(force)
    assert [b.value, tangent.value] == pytest.approx(figures(LAW.slope, LAW.growth))
    assert [b.standard_error, tangent.parts["noise"]] == pytest.approx(expected)
    assert tangent.parts["gain"] == pytest.approx(0.02 * tangent.value)
    assert tangent.standard_error == pytest.approx(math.hypot(*tangent.parts.values()))
    assert LAW.significance == pytest.approx(0.008 / 3e-3)


@pytest.mark.parametrize(("dof", "quantile"), [(29, stats.t.ppf(0.975, 29)), (30, stats.norm.ppf(0.975))])
def test_a_tangent_has_student_s_interval_below_30_degrees_of_freedom(dof: int, quantile: float) -> None:
    tangent = replace(LAW, dof=dof, gain_sd=0.0).tangent(40.0)
    assert tangent.ci95[1] - tangent.value == pytest.approx(quantile * tangent.parts["noise"], rel=1e-6)


def _bent_points(growth: float, scatter: float = 0.0) -> HeldPoints:
    """Held loads of two groups of the exponential law with 1/κ = 1 / K, and uneven errors."""
    random = np.random.default_rng(8)
    force = np.array([*UP, *DOWN])
    x = np.log1p(growth * (force - 2)) / (growth * K) + np.repeat([0.0, 3e-3], [6, 5])
    x_sd = NOISE * random.uniform(0.5, 2.0, 11)
    return HeldPoints(force, x + scatter * x_sd * random.standard_normal(11), x_sd, np.repeat([0, 1], [6, 5]))


@pytest.mark.parametrize("scatter", [0.2, 5.0])
@pytest.mark.parametrize("growth", [-0.006, 0.03])
def test_the_exponential_law_is_that_of_scipy_s_curve_fit(growth: float, scatter: float) -> None:
    """With an offset for each group; the covariance is scaled by χ² / dof only where that exceeds 1."""
    points = _bent_points(growth, scatter)

    def law(force: NDArray[np.float64], slope: float, bend: float, *offsets: float) -> NDArray[np.float64]:
        return slope * np.log1p(bend * (force - 2)) / bend + np.array(offsets)[points.group]

    start = [1 / K, growth, 0.0, 3e-3]
    tight = {"ftol": 1e-14, "xtol": 1e-14}
    best, covariance = optimize.curve_fit(law, points.force, points.x, start, points.x_sd, absolute_sigma=True, **tight)
    chi_square = float(np.sum(((points.x - law(points.force, *best)) / points.x_sd) ** 2))
    found = fit_law(points, 0.01)
    assert found is not None and found.outcome is FitOutcome.CONVERGED
    assert (found.reference_force, found.dof, found.gain_sd) == (2.0, 7, 0.01)
    assert [found.slope, found.growth] == pytest.approx(best[:2], rel=1e-4)
    assert found.chi_square == pytest.approx(chi_square, rel=1e-6) and (chi_square > 7) is (scatter > 1)
    np.testing.assert_allclose(found.covariance, covariance[:2, :2] * max(1.0, chi_square / 7), rtol=2e-3)


@pytest.mark.parametrize(("growth", "limit"), [(-0.95, -0.9), (25.0, 20.0)])
def test_a_law_bends_so_far_that_the_tangent_falls_to_a_tenth_or_grows_by_20_times(growth: float, limit: float) -> None:
    found = fit_law(_bent_points(growth / 75))
    assert found is not None and found.growth * 75 == pytest.approx(limit, abs=1e-4)


@pytest.mark.parametrize("growth", [0.0, 1e-300, -1e-12, 1e-7])
def test_a_law_that_hardly_bends_is_its_series(growth: float) -> None:
    load = np.array([0.0, 15.0, 75.0])
    np.testing.assert_allclose(_bent(load, growth), load - growth * load**2 / 2, rtol=1e-10)


def test_values_are_relative_to_the_weighted_mean_of_their_group_and_a_group_may_be_empty() -> None:
    found = within(np.array([1.0, 3.0, 7.0]), np.array([0, 2, 2]), np.array([0.5, 0.3, 0.1]))
    assert found == pytest.approx([0.0, -1.0, 3.0])


def test_a_law_needs_three_loads_of_a_group_and_a_degree_of_freedom_and_a_positive_slope() -> None:
    def fit(force: Sequence[float], group: Sequence[int], sign: float = 1.0) -> TangentLaw | None:
        loads = np.array(force)
        return fit_law(HeldPoints(loads, sign * loads / K, np.full(len(loads), NOISE), np.array(group)))

    assert fit([], []) is fit([2, 40, 77], [0, 0, 0]) is None
    assert fit([2, 40, 2, 40, 2, 40], [0, 0, 1, 1, 2, 2]) is None, "no curvature in two loads"
    assert fit([40, 40, 40, 40], [0, 0, 0, 0]) is None
    assert fit([2, 30, 60, 77], [0] * 4, sign=-1.0) is None
    assert fit([2, 40, 77] * 2, [0, 0, 0, 1, 1, 1]) is not None and fit([2, 2.2, 2.4, 2.6], [0] * 4) is not None
    straight = fit([2, 30, 60, 77], [0] * 4)
    assert straight is not None and straight.growth == pytest.approx(0.0, abs=1e-6)
    assert (straight.dof, straight.gain_sd) == (1, 0.0)
    assert straight.slope == pytest.approx(1 / K)
