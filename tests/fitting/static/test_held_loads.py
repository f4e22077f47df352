"""Static trials whose truth is known: what held loads must give (T5 to T7, T10, T11), and decisions on slip."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from scipy import optimize, stats

from fitting.cuffs.cuffs_file import held_loads_entry
from fitting.pull.plateaus import Plateau, find_plateaus
from fitting.pull.pull import Pull, make_pulls
from fitting.results.codes import FitOutcome, NoteCode
from fitting.static.held_loads import (
    Creep,
    HeldLoads,
    _binned,
    _drift,
    _energy,
    _without_drift,
    fit_creep,
    fit_held_loads,
    fit_migration,
    held_load_notes,
)
from fitting.static.stiffness import (
    StaticFit,
    StiffnessFit,
    TangentLaw,
    _contradict,
    _fit_trials,
    _friction,
    _has_one_curve,
    _is_straight,
    _loading_stiffness,
    _may_be_friction,
    _points,
    _progressive_slip,
    _retraces,
    _returns,
    _slip,
    fit_stiffness,
)
from fitting.uncertainty import Repeat, chi_square_limit, normal_estimate
from tests.fitting.pulls import Held, static_trial
from tests.fitting.static.test_stiffness import FLAT, K, _held

COUNT = 60
SOME = pytest.mark.parametrize("count", [3, pytest.param(20, marks=pytest.mark.slow)])
"""Seeds of a test; those of the slow ones hold the others, which were fitted by then."""
CREEPING = Held(creep=0.15, unloads=True)
SLIPPING = Held(first_slip=25.0, hardening=4000.0, unloads=True)
CREEP = Creep(
    fraction=normal_estimate(0.1, 0.04),
    time_constant=10.0,
    compliance=2e-4,
    stiffness_at_rest=normal_estimate(4545.0, 10.0),
    significance=5.0,
    in_holds=3.0,
    chi_square=8.0,
    dof=10,
    remaining_force=-50.0,
)


@cache
def _reduced(truth: Held, seed: int) -> tuple[tuple[Pull, ...], float]:
    """One trial that was reduced, and how far the cuff has slipped."""
    trial, slip = static_trial(truth, seed)
    reduced, reasons = make_pulls([trial])
    assert reasons == {}
    return tuple(reduced), slip


@cache
def _fit(truth: Held, seed: int) -> HeldLoads:
    return fit_held_loads(_reduced(truth, seed)[0], 0.0)


def _stiffnesses(truth: Held, count: int = COUNT) -> tuple[np.ndarray, np.ndarray]:
    """Values and standard errors (count,) as their intervals have them."""
    found = [_fit(truth, seed).stiffness.stiffness for seed in range(count)]
    assert all(found)
    half = [(each.ci95[1] - each.ci95[0]) / 2 / stats.norm.ppf(0.975) for each in found if each]
    return np.array([each.value for each in found if each]), np.array(half)


@pytest.mark.slow
def test_stiffness_from_loads_that_only_rise_is_unbiased_and_its_interval_honest() -> None:
    """T5: bias below 0.1 %, rmse below 1.3 times the bound of 0.138 %."""
    values, errors = _stiffnesses(Held())
    off = values / Held.stiffness - 1
    assert abs(off.mean()) < 0.1e-2
    assert np.sqrt(np.mean(off**2)) < 1.3 * 0.138e-2
    chi_square = np.sum(((values - Held.stiffness) / errors) ** 2)
    assert chi_square < stats.chi2.ppf(0.9995, COUNT)
    assert 4 * chi_square > stats.chi2.ppf(0.9995, COUNT), "half of the interval would not be honest"


@SOME
@pytest.mark.parametrize("truth", [Held(occlusion=30.0), Held(ghosts=5.0)], ids=["occlusion", "ghosts"])
def test_hidden_markers_and_ghosts_leave_it_nearly_alone(truth: Held, count: int) -> None:
    values, errors = _stiffnesses(truth, count)
    assert np.sqrt(np.mean((values / truth.stiffness - 1) ** 2)) < 1.5 * 1.3 * 0.138e-2
    assert np.sum(((values - truth.stiffness) / errors) ** 2) < stats.chi2.ppf(0.9995, count)


@pytest.mark.slow
def test_slip_reaches_neither_stiffness_nor_migration() -> None:
    """T7: within 0.2 mm of what slipped, inside the interval in nine of ten."""
    values, errors = _stiffnesses(SLIPPING, 30)
    assert np.sum(((values - SLIPPING.stiffness) / errors) ** 2) < stats.chi2.ppf(0.9995, 30)
    for seed in range(30):
        reduced, slip = _reduced(SLIPPING, seed)
        migration = fit_migration([each.plateaus for each in reduced], _fit(SLIPPING, seed).creep)
        assert abs(migration.value - slip) < 0.1e-3
        assert abs(migration.value - slip) < 3.5 * migration.standard_error


@SOME
@pytest.mark.parametrize("unloads", [False, True])
def test_creep_is_flagged_measured_and_led_to_its_rest(unloads: bool, count: int) -> None:
    """T6: flagged every time, the stiffness at rest within its interval; the stiffness is that after the hold."""
    truth = replace(CREEPING, unloads=unloads)
    scores = []
    for seed in range(count):
        held = _fit(truth, seed)
        assert held.creep is not None and held.creep.is_seen
        assert held.stiffness.stiffness.value == pytest.approx(truth.stiffness, rel=0.08)
        assert held_load_notes(held)[0].code is NoteCode.CREEPS
        rest = held.creep.stiffness_at_rest
        scores.append((rest.value - truth.stiffness) / rest.standard_error)
    assert np.sum(np.square(scores)) < 1.5 * stats.chi2.ppf(0.9995, count)


def _codes(held: HeldLoads) -> list[NoteCode]:
    return [note.code for note in held_load_notes(held)]


@SOME
def test_a_cuff_that_does_not_creep_is_not_classified_as_creeping(count: int) -> None:
    for truth in (Held(), Held(unloads=True), SLIPPING):
        for seed in range(count):
            held = _fit(truth, seed)
            assert held.creep is None or not held.creep.is_seen
            assert NoteCode.CREEPS not in _codes(held)
            if truth == Held(unloads=True):
                assert abs(held.stiffness.law.significance) < 4 and held_load_notes(held) == ()


@pytest.mark.parametrize(
    ("yielding", "unloads", "count"),
    [
        (0.3 / 77, True, 1),
        (1 / 77, False, 1),
        (-0.3 / 77, True, 1),
        *(
            pytest.param(yielding, unloads, 3, marks=pytest.mark.slow)
            for yielding in (0.3 / 77, 1 / 77, -0.3 / 77)
            for unloads in (False, True)
        ),
    ],
)
def test_a_cuff_that_bends_is_not_classified_as_creeping_or_slipping(
    yielding: float, unloads: bool, count: int
) -> None:
    truth = Held(yielding=yielding, unloads=unloads)
    for seed in range(count):
        reduced = [pull for again in (0, 50) for pull in _reduced(truth, seed + again)[0]]
        held = fit_held_loads(reduced, 0.0)
        assert _codes(held) == [NoteCode.SOFTENS if yielding > 0 else NoteCode.STIFFENS]
        assert abs(held.stiffness.slip) < 0.5e-3
        assert not held.stiffness.slips_again


@SOME
def test_what_creep_still_recovers_is_no_migration(count: int) -> None:
    """Unloaded for 8 s, a cuff that creeps by 15 % is still 0.1 mm away and has not migrated."""
    for seed in range(count):
        reduced, _ = _reduced(CREEPING, seed)
        plateaus = [each.plateaus for each in reduced]
        away, migration = fit_migration(plateaus), fit_migration(plateaus, _fit(CREEPING, seed).creep)
        assert away and migration
        assert away.value > 0.1e-3
        assert abs(migration.value) < 0.05e-3
        assert migration.parts["creep"] > migration.parts["noise"]


@SOME
def test_a_zero_that_drifts_is_estimated_removed_and_reported(count: int) -> None:
    truth = Held(unloads=True, drift=1.5 / 60)
    values, errors = _stiffnesses(truth, count)
    assert np.sum(((values - truth.stiffness) / errors) ** 2) < stats.chi2.ppf(0.9995, count)
    held = _fit(truth, 1)
    assert abs(held.drift.value - truth.drift) < 3.5 * held.drift.standard_error
    (note,) = held_load_notes(held)
    assert note.code is NoteCode.ZERO_DRIFT
    assert note.figures == {"drift_n_per_s": held.drift.value}
    assert _fit(Held(), 1).drift is None, "drift and stiffness cannot be distinguished if the load only rises"


@SOME
@pytest.mark.parametrize("unloads", [False, True])
def test_the_tangent_stiffness_grows_along_the_exponential_law(unloads: bool, count: int) -> None:
    truth = Held(stiffness=4520.0, stiffening=100.0, unloads=unloads)
    scores = []
    for seed in range(count):
        law = _fit(truth, seed).stiffness.law
        assert law.significance > 10
        for load in (2.0, 40.0, 77.0):
            tangent = law.tangent(load + truth.zero)
            half = (tangent.ci95[1] - tangent.ci95[0]) / 2 / stats.norm.ppf(0.975)
            scores.append((tangent.value - (truth.stiffness + truth.stiffening * load)) / half)
        assert abs(law.stiffening.value - truth.stiffening) < 4 * law.stiffening.standard_error
    assert np.sum(np.square(scores)) < 2 * stats.chi2.ppf(0.9995, 3 * count), (
        "three loads of one fit are not independent"
    )


def test_what_a_slipping_cuff_takes_in_a_cycle_is_the_work_of_its_friction() -> None:
    """Slip s under F = first_slip + hardening s takes ∫ F ds; the hook's share is not counted."""
    held = _fit(SLIPPING, 3)
    _, slip = _reduced(SLIPPING, 3)
    work = (SLIPPING.first_slip - SLIPPING.hook) * slip + SLIPPING.hardening * slip**2 / 2
    assert held.energy.value == pytest.approx(work, rel=0.05)
    assert abs(_fit(Held(unloads=True), 3).energy.value) < 4e-3  # type: ignore[union-attr]


def test_cuffs_json_gets_all_of_it_in_units() -> None:
    entry = held_loads_entry(_fit(CREEPING, 1))
    assert 3.0 < entry.hold_s < 8.0
    assert entry.creep is not None and entry.creep.is_seen
    assert entry.exponential_law is not None
    forces = [tangent.force_n for tangent in entry.exponential_law.tangents]
    assert forces == pytest.approx(np.linspace(0, 75, 5), abs=0.5)
    (steps,) = entry.steps_s.values()
    np.testing.assert_allclose(steps, 8.0 * np.arange(1, 11), atol=1.0)


def _trial(*held: tuple[float, float]) -> list[Plateau]:
    return [Plateau(0, 8, force, 0.1, x, 3e-5, (x, 3e-5)) for force, x in held]


FIRST = _trial((2.0, 0.0), (60.0, 0.018), (2.0, 0.010))
LAST = _trial((2.0, 0.0105), (60.0, 0.02), (2.2, 0.012))


def test_hooks_without_noise_at_the_end_of_a_range_show_no_drift() -> None:
    clipped = [Plateau(t, t + 6, force, 0.0, 0.0, 1e-5, (0.0, 1e-5)) for t, force in ((0, 10.0), (8, 40.0), (16, 10.0))]
    assert _drift([clipped]) is None
    noisy = [replace(plateau, force=plateau.force + 0.01 * plateau.start, force_sd=0.1) for plateau in clipped]
    drift = _drift([clipped, noisy])
    assert drift is not None and drift.value == pytest.approx(0.01)


def test_quiet_hooks_at_one_code_of_a_converter_show_their_drift_with_the_error_of_the_code() -> None:
    time, code = np.arange(0.0, 24.0, 0.01), 0.5
    force = np.repeat([10.0, 40.0, 10.5], len(time) // 3)
    held = find_plateaus(time, force, code, time, force / 8000)
    drift = _drift([held])
    span = (held[2].start + held[2].end - held[0].start - held[0].end) / 2
    assert drift is not None
    assert (drift.value, drift.standard_error) == pytest.approx((code / span, math.sqrt(2 / 12) * code / span))


def test_migration_runs_from_the_first_start_to_the_last_end() -> None:
    found = fit_migration([FIRST, LAST])
    assert found.value == pytest.approx(0.012)
    assert found.standard_error == pytest.approx(3e-5 * 2**0.5)
    assert found.ci95 == pytest.approx((0.012 - 8.31544e-5, 0.012 + 8.31544e-5), abs=1e-9), "1.95996 standard errors"
    assert found.parts == {"noise": found.standard_error}
    alone = fit_migration([LAST])
    assert alone.value == pytest.approx(0.0015)


def test_a_last_hold_that_is_too_short_to_rest_adds_its_distance_from_rest() -> None:
    """0.4 mm from its mean to its end, with 0.03 mm of noise at each of the two ends."""
    (*before, last) = FIRST
    found = fit_migration([[*before, replace(last, late=(0.0096, 3e-5), hold=2.0)]])
    assert found.parts == pytest.approx({"noise": 3e-5 * 2**0.5, "settling": 0.4e-3})
    assert found.standard_error == pytest.approx((2 * 3e-5**2 + 0.4e-3**2) ** 0.5)


@pytest.mark.parametrize(
    "trials",
    [
        [_trial((2.0, 0.0), (30.0, 0.01), (60.0, 0.02))],  # ends loaded
        [_trial((60.0, 0.01), (2.0, 0.0))],  # begins loaded
        [_trial((2.0, 0.0))],
        [[]],
        [],
    ],
)
def test_without_two_loads_that_begin_and_end_low_no_migration_is_determined(trials: list[list[Plateau]]) -> None:
    assert fit_migration(trials) is None


@pytest.mark.parametrize(
    ("trials", "to_come"), [([FIRST, LAST], 50.0), ([FIRST, FIRST, LAST], 60.0), ([FIRST, LAST, []], 50.0)]
)
def test_the_creep_still_to_recover_after_the_last_hold_is_no_slip(trials: list[list[Plateau]], to_come: float) -> None:
    """1/5000 m/N, a tenth of it creep. Its relative error is that of the fraction, 0.4, and 0.3."""
    found = fit_migration(trials, replace(CREEP, remaining_force=-to_come))
    assert found.value == pytest.approx(0.012 - 2e-5 * to_come)
    assert found.parts == pytest.approx({"noise": 3e-5 * 2**0.5, "creep": 1e-5 * to_come})
    assert found.standard_error == pytest.approx((2 * 3e-5**2 + (1e-5 * to_come) ** 2) ** 0.5)


def test_creep_that_is_not_measured_is_left_out() -> None:
    assert fit_migration([FIRST], replace(CREEP, significance=3.0)) == fit_migration([FIRST])


def _fit_of(
    repeat: Repeat | None,
    loads: Sequence[float] = (),
    x: Sequence[float] = (),
    sd: Sequence[float] = (),
    segment: Sequence[int] = (),
    offset: Sequence[float] = (),
) -> StaticFit:
    return StaticFit(
        tuple(_held(loads)), np.array(segment, np.intp), np.array(offset), repeat, np.array(x), np.array(sd)
    )


def _scatter(dof: int, chi_square: float) -> StaticFit:
    return _fit_of(Repeat(2.0**-13, 2.0**-20, chi_square=chi_square, dof=dof))


@pytest.mark.parametrize(
    ("noise", "limit"), [(3.0, 12.0), (5.0, 4.5), (4.9, 4.5)], ids=["more data", "equal data", "almost equal data"]
)
@pytest.mark.parametrize("side", [-1, 1])
def test_reloading_contradicts_unloading_from_three_standard_errors_of_their_difference(
    noise: float, limit: float, side: int
) -> None:
    """√(5² − 3²) = 4, and at least 0.3 of 5."""
    one = [_fit_of(Repeat(20.0, noise)), _fit_of(None)]
    limit = max(limit, 3 * math.sqrt(25 - noise**2))
    below, above = ([_fit_of(Repeat(20.0 + side * limit * part, 5.0)), _fit_of(None)] for part in (0.999, 1.001))
    assert not _contradict(one, below) and _contradict(one, above)
    assert not _contradict(one, [_fit_of(None)]) and not _contradict([_fit_of(None)], above)


def test_loads_are_on_a_line_up_to_the_chi_square_that_one_in_a_thousand_exceeds() -> None:
    """With two degrees of freedom: −2 ln 0.001."""
    limit = -2 * math.log(0.001)
    assert _is_straight([_scatter(2, 0.999 * limit)]) and not _is_straight([_scatter(2, 1.001 * limit)])
    assert _is_straight([_scatter(1, 0.5 * limit), _fit_of(None), _scatter(1, 0.499 * limit)])
    assert not _is_straight([_scatter(1, 0.5 * limit), _scatter(1, 0.501 * limit)])
    assert not _is_straight([_scatter(1, 0.0)]) and not _is_straight([])


@pytest.mark.parametrize(
    ("dof", "part", "growth", "outcome", "only_rose", "is_curve"),
    [
        (2, 0.999, 0.0, FitOutcome.CONVERGED, False, True),
        (2, 1.001, 0.1, FitOutcome.CONVERGED, False, False),
        (2, 0.999, 0.1, FitOutcome.CONVERGED, True, True),
        (2, 0.999, 0.0, FitOutcome.CONVERGED, True, False),
        (2, 0.999, 0.1, FitOutcome.NOT_CONVERGED, False, False),
        (1, 0.999, 0.1, FitOutcome.CONVERGED, False, False),
    ],
)
def test_a_cuff_has_one_curve_if_the_law_converged_and_fits(
    dof: int, part: float, growth: float, outcome: FitOutcome, only_rose: bool, is_curve: bool
) -> None:
    law = TangentLaw(0.0, 1 / K, growth, np.eye(2), -2 * math.log(0.001) * part, 2, 0.0, outcome)
    assert _has_one_curve([_scatter(dof, 1e3), _fit_of(None)], law, only_rose=only_rose) is is_curve
    assert not _has_one_curve([_scatter(dof, 1e3)], None, only_rose=only_rose)
    assert _has_one_curve([_scatter(dof, 0.0)], None, only_rose=only_rose) is (dof == 2)


def test_friction_is_half_the_distance_of_two_branches_of_two_loads_in_every_trial() -> None:
    def trial(rising: float, falling: float) -> StaticFit:
        return _fit_of(None, (2, 17, 32, 17, 2), offset=(90, rising - 1, rising + 1, falling + 1, falling - 1))

    assert _friction([trial(4, -2)]) == pytest.approx(3.0)
    assert _friction([trial(4, -2), trial(2, 0)]) == pytest.approx(2.0)
    assert _friction([trial(4, -2), trial(1, 1)]) == 0.0
    assert _friction([trial(4, -2), _fit_of(None, (2, 17, 32, 2), offset=(0, 4, 4, -2))]) == 0.0
    assert _friction([_fit_of(None, (2, 17, 2, 1), offset=(0, 4, -2, -2))]) == 0.0
    assert _friction([_fit_of(None, (2, 2.5, 3, 2.5, 2), offset=(0, 4, 4, -2, -2))]) == pytest.approx(3.0)
    assert _friction([]) == 0.0


def test_a_loading_branch_counts_if_every_trial_has_a_single_unloading_branch() -> None:
    loading = [_fit_of(Repeat(2.0**-13, 1e-6)), _fit_of(None)]
    one, two = _fit_of(None, (2, 17, 16.71, 2)), _fit_of(None, (2, 17, 16.69, 2))
    found = _loading_stiffness([one, one], loading)
    assert found is not None and found.value == pytest.approx(8192)
    assert _loading_stiffness([one, two], loading) is None
    assert _loading_stiffness([_fit_of(None, (17, 0, -0.3))], loading) == found
    assert _loading_stiffness([one], [_fit_of(None)]) is None


def test_friction_makes_loading_less_steep_by_up_to_twice_a_tenth() -> None:
    one, steeper, flatter = 8192.0, math.nextafter(8192.0, 0), math.nextafter(0.8 * 8192, math.inf)
    fits = [_scatter(1, 0.0), _fit_of(None)], [_scatter(0, 1e-20), _fit_of(None)]
    for loading, is_possible in ((one, False), (steeper, True), (0.8 * 8192, False), (flatter, True)):
        assert _may_be_friction(*fits, replace(FLAT, value=loading)) is is_possible, loading


def test_slip_is_certain_on_one_line_with_previous_loads_or_along_a_curve() -> None:
    """One degree of freedom: the square of the normal quantile of 0.9995."""
    branch, limit = replace(FLAT, value=8000.0), stats.norm.ppf(0.9995) ** 2
    assert _may_be_friction([_scatter(1, 0.0)], [_scatter(1, 0.999 * limit)], branch)
    assert not _may_be_friction([_scatter(1, 0.0)], [_scatter(1, 1.001 * limit)], branch)
    assert not _may_be_friction([_scatter(2, 0.0)], [_scatter(1, 0.0)], branch)
    assert not _may_be_friction([_fit_of(None)], [_scatter(1, 0.0)], branch)


@pytest.mark.parametrize(("more", "is_slip"), [(1.49e-4, False), (1.51e-4, True)])
def test_progressive_slip_is_at_the_highest_load_of_all_trials(more: float, is_slip: bool) -> None:
    """Standard errors of 3e-5 and 4e-5 m: three times 5e-5 m. The loads differ by 0.5 N."""
    first = [replace(p, late=(p.late[0], 3e-5)) for p in _held((2, 32, 77), np.array([0, 0, -1]))]
    last = [replace(p, late=(p.late[0], 4e-5)) for p in _held((2, 32.5, 62), np.array([-1, more, -1]))]
    found = _progressive_slip([[], first, _held((2, 32.2), np.ones(2)), last, []], K)
    assert found == pytest.approx(more if is_slip else 0.0, rel=1e-9)


@pytest.mark.parametrize(("part", "is_elastic"), [(0.999, True), (1.001, False)])
def test_a_cuff_is_elastic_if_displacements_at_the_same_load_agree(part: float, is_elastic: bool) -> None:
    """The loads differ by 0.2 N. With two differences, χ² is below −2 ln 0.001."""
    repeat, apart = Repeat(0.5, 0.1), 5 * math.sqrt(-math.log(0.001) * part)
    first = _fit_of(repeat, (2, 17, 2.2), (1.0, 50.0, 1.1 + apart), (3.0, 9.0, 4.0))
    second = _fit_of(repeat, (2, 17, 1.8), (1.0, 50.0, 0.9 - apart), (4.0, 9.0, 3.0))
    assert _retraces([first, second]) is is_elastic
    assert not _retraces([first, replace(second, repeat=None)])
    assert not _retraces([first, _fit_of(repeat, (2, 17), (1, 2), (1, 1))]) and not _retraces([])


def test_loads_return_within_0_3_n_after_a_rise_of_more() -> None:
    for loads in ((0, 5, 0.29), (0, 5, -0.29), (0, 0.31, 0), (0, 5, -0.29, 5, 0)):
        assert _returns(np.array(loads, float)) is True, loads
    for loads in ((0, 5, 0.3), (0, 5, -0.3), (0, 0.3, 0), (0, 0.2, -0.2), (0, 0.4, 0.2), (0, 5, -0.3, 5, 0)):
        assert _returns(np.array(loads, float)) is False, loads


def test_every_segment_of_every_trial_has_its_own_offset_in_the_law() -> None:
    first = _fit_of(None, (2, 17, 32), (1, 2, 3), (7, 8, 9), (0, 1, 1))
    points = _points([first, _fit_of(None), replace(first, segment=np.array([0, 0, 1]))])
    assert points.group.tolist() == [0, 1, 1, 2, 2, 3]
    assert points.force.tolist() == [2, 17, 32] * 2
    assert (points.x.tolist(), points.x_sd.tolist()) == ([1, 2, 3] * 2, [7, 8, 9] * 2)
    assert len(_points([]).group) == 0


def test_slip_is_the_sum_of_the_steps_between_segments() -> None:
    fit = _fit_of(None, segment=(0, 1, 1, 2))
    held = _held((2, 17, 5, 32), np.array([1, 3, 3.5, 8]))
    assert _slip(replace(fit, plateaus=tuple(held)), K) == pytest.approx(2 + 4.5)
    assert _slip(_fit_of(None), K) == 0.0


def test_segments_begin_at_rises_or_at_turns() -> None:
    def segments(loads: Sequence[float], slips: Literal["every rise", "at turns"]) -> list[int]:
        (fit,) = _fit_trials([_held(loads)], 0.0, 0.0, slips)
        return [int(number) for number in fit.segment]

    assert segments((2, 17, 10, 12), "every rise") == [0, 1, 1, 2]
    assert segments((0, 0.3, 0.61), "every rise") == [0, 0, 1]
    assert segments((2, 17, 2, 17, 32), "at turns") == [0, 1, 2, 3, 3]


def _cycle(forces: Sequence[float], x: Sequence[float], shift: float = 0.0) -> list[Plateau]:
    """Holds of 6 s every 10 s, the last of 8 s, with uneven errors."""
    held, last = [], len(forces) - 1
    for i, (force, d) in enumerate(zip(forces, x, strict=True)):
        start, error = 10.0 * i + 3, 1e-5 * (i + 2)
        held.append(Plateau(start, start + (8 if i == last else 6), force + shift, 0.1 * (i + 1), d, error, (d, 0.0)))
    return held


def test_the_drift_of_the_zero_is_the_weighted_mean_of_what_the_bare_hook_gains_and_is_removed() -> None:
    """From the middle of the first hold to that of the last: 31 s, and 21 s of a shorter trial."""
    long, short = _cycle((2, 40, 20, 3.55), [0.0] * 4), _cycle((2, 40, 2.21), [0.0] * 3)
    (one, other), errors = (0.05, 0.01), np.array([math.hypot(0.1, 0.4) / 31, math.hypot(0.1, 0.3) / 21])
    alone = _drift([long])
    assert alone is not None
    assert (alone.value, alone.standard_error) == (pytest.approx(one), pytest.approx(errors[0]))
    both = _drift([long, [], short, _cycle((2, 40), [0.0] * 2), _cycle((2, 20, 40), [0.0] * 3)])
    weights = errors**-2 / np.sum(errors**-2)
    assert both is not None and both.value == pytest.approx(weights @ [one, other])
    assert both.standard_error == pytest.approx(max(np.sum(errors**-2) ** -0.5, (one - other) / 2))
    alike = _drift([long, long])
    assert alike is not None and alike.standard_error == pytest.approx(errors[0] / math.sqrt(2))
    assert _drift([_cycle((40, 20, 2), [0.0] * 3)]) is _drift([]) is None
    held = _cycle((2, 40, 20, 3.55), [0.0] * 4)
    assert [plateau.force for plateau in _without_drift(held, 0.05)] == pytest.approx([2, 39.5, 19, 2.0])
    assert _without_drift(held, 0.0) == tuple(held) and _without_drift([], 0.05) == ()


def test_the_energy_of_a_cycle_is_the_area_of_its_polygon_and_its_error_that_of_its_corners() -> None:
    """Over a path that closes, the area is the trapezoidal sum, whose slopes are finite differences."""
    forces, x = np.array([2.0, 20.0, 50.0, 30.0, 10.0, 2.0]), 1e-3 * np.array([0.0, 1.0, 6.0, 5.5, 4.0, 0.0])

    def area(corners: np.ndarray) -> float:
        force, x = corners.reshape(2, -1)
        return float(np.trapezoid(force - force[0], x))

    corners = np.concatenate([forces, x])
    errors = np.concatenate([0.1 * np.arange(1, 7), 1e-5 * np.arange(2, 8)])
    slopes = optimize.approx_fprime(corners, area, 1e-7)
    one = _energy([_cycle(forces, x, shift=5.0)])
    assert one is not None and one.value == pytest.approx(area(corners))
    assert one.standard_error == pytest.approx(float(np.linalg.norm(slopes * errors)), rel=1e-4)
    three = _energy([_cycle((2, 20, 2.5), (0, 1e-3, 4e-4), shift=5.0)])
    assert three is not None and three.value == pytest.approx(9e-3 - 18.5 / 2 * 6e-4), "also if the cuff has slipped"
    mean = _energy(
        [_cycle(forces, x), [], _cycle(forces, 1.1 * x), _cycle((2, 20), (0, 1)), _cycle((2, 5, 50), [0] * 3)]
    )
    assert mean is not None and mean.value == pytest.approx(1.05 * area(corners))
    assert mean.standard_error == pytest.approx(0.05 * area(corners)), "the spread exceeds the errors"
    twice = _energy([_cycle(forces, x)] * 2)
    assert twice is not None and twice.standard_error == pytest.approx(one.standard_error / math.sqrt(2))
    assert _energy([_cycle((50, 20, 2), [0] * 3)]) is _energy([]) is None


@pytest.mark.parametrize(
    ("changes", "is_seen", "is_measured"),
    [
        ({}, True, True),
        ({"significance": 4.0}, False, False),
        ({"significance": 4.01}, True, True),
        ({"fraction": normal_estimate(0.01, 0.1)}, False, False),
        ({"fraction": normal_estimate(0.0101, 0.1)}, True, True),
        ({"in_holds": 2.0}, False, False),
        ({"in_holds": 2.01}, True, True),
        ({"chi_square": 0.999 * chi_square_limit(10)}, True, True),
        ({"chi_square": 1.001 * chi_square_limit(10), "in_holds": 3.01}, True, False),
        ({"chi_square": 1.001 * chi_square_limit(10), "in_holds": 3.0}, False, False),
        ({"dof": 0, "in_holds": 3.01}, True, False),
    ],
)
def test_creep_is_significant_beyond_its_limits(changes: dict[str, object], is_seen: bool, is_measured: bool) -> None:
    creep = replace(CREEP, **changes)  # type: ignore[arg-type]
    assert (creep.is_seen, creep.is_measured) == (is_seen, is_measured)


def _held_result(growth: float = 0.0, **changes: object) -> HeldLoads:
    """Two held loads of 2 and 62 N, whose law has a standard error of the growth of 0.001 / N."""
    law = TangentLaw(2.0, 1 / K, growth, np.diag([1e-14, 1e-6]), 1.0, 40, 0.0)
    trial = _fit_of(Repeat(1 / K, 1e-6), (2.0, 62.0), (0, 0), (1, 1), (0, 0), (0, 0))
    fit = StiffnessFit(None, (trial,), 0.0, False, 0.0, 0.0, False, law)
    return replace(HeldLoads(fit), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("held", "codes"),
    [
        (_held_result(), []),
        (_held_result(duration=4.0), []),
        (_held_result(duration=3.99), [NoteCode.SHORT_HOLDS]),
        (_held_result(growth=0.003), []),
        (_held_result(growth=0.0031), [NoteCode.STIFFENS]),
        (_held_result(growth=-0.0031), [NoteCode.SOFTENS]),
        (_held_result(creep=CREEP), [NoteCode.CREEPS]),
        (_held_result(creep=replace(CREEP, dof=0, in_holds=4.0)), [NoteCode.YIELDS]),
        (_held_result(creep=replace(CREEP, significance=3.0)), []),
        (_held_result(drift=normal_estimate(1 / 60, 1e-3)), []),
        (_held_result(drift=normal_estimate(-1.01 / 60, 1e-3)), [NoteCode.ZERO_DRIFT]),
        (_held_result(drift=normal_estimate(0.03, 0.01)), []),
        (_held_result(drift=normal_estimate(0.0301, 0.01)), [NoteCode.ZERO_DRIFT]),
        (HeldLoads(StiffnessFit(None, (_fit_of(None),), 0.0, False, 0.0, 0.0, False, None), duration=1.0), []),
    ],
)
def test_notes_of_held_loads_begin_beyond_their_limits(held: HeldLoads, codes: list[NoteCode]) -> None:
    assert _codes(held) == codes


def test_notes_and_tangents_have_the_figures_of_the_fit() -> None:
    held = _held_result(growth=0.01, creep=CREEP, hold=5.0, duration=3.0)
    assert (held.has_loads, held.highest) == (True, 62.0)
    assert replace(held, stiffness=replace(held.stiffness, trials=(*held.stiffness.trials, _fit_of(None)))).has_loads
    short, creeps, stiffens = held_load_notes(held)
    assert short.figures == {"hold_s": 3.0}
    figures = {"fraction": 0.1, "fraction_half_width": 1.96 * 0.04, "time_constant_s": 10.0, "hold_s": 5.0}
    assert creeps.figures == pytest.approx(figures | {"rest_n_per_m": 4545.0, "rest_half_width_n_per_m": 19.6})
    assert stiffens.figures == pytest.approx({"lowest_n_per_m": K, "highest_n_per_m": 1.6 * K})
    loads = [load for load, _ in held.tangents]
    assert loads == pytest.approx([0, 15, 30, 45, 60])
    assert [tangent.value for _, tangent in held.tangents] == pytest.approx([K * (1 + 0.01 * load) for load in loads])
    assert replace(held, stiffness=replace(held.stiffness, law=None)).tangents == ()
    (yields,) = held_load_notes(_held_result(creep=replace(CREEP, dof=0, in_holds=4.0), hold=5.0))
    assert yields.figures == {"hold_s": 5.0}
    (drifts,) = held_load_notes(_held_result(drift=normal_estimate(0.05, 0.01)))
    assert drifts.figures == {"drift_n_per_s": 0.05}


def _stepped(loads: Sequence[float], halves: Sequence[int], x: Sequence[float], sd: Sequence[float]) -> Pull:
    """Held loads [N] for halves of a second each, and the displacement [m] in each half second; sd of each hold [m].

    Ten frames a second in the middle of the samples of the load, which changes exactly at one of these.
    """
    starts = 0.5 * np.cumsum([0, *halves])
    frames = 0.05 + 0.1 * np.arange(5 * len(x))
    means = [float(np.mean(part)) for part in np.split(np.array(x), np.cumsum(halves)[:-1])]
    plateaus = [
        Plateau(float(start), float(end) - 0.02, load, 0.1, mean, error, (mean, error))
        for start, end, load, mean, error in zip(starts, starts[1:], loads, means, sd, strict=False)
    ]
    return replace(
        _reduced(CREEPING, 1)[0][0],
        force_time=0.05 * np.arange(10 * len(x) + 2),
        force=np.array([*np.repeat(loads, 10 * np.array(halves)), loads[-1], loads[-1]], float),
        marker_time=frames,
        displacement=np.repeat(x, 5).astype(float),
        plateaus=tuple(plateaus),
    )


def _fit_in(pull: Pull, segment: Sequence[int]) -> StaticFit:
    return replace(_fit_of(None, segment=segment), plateaus=pull.plateaus)


def _filtered(loads: Sequence[float], halves: Sequence[int], time_constant: float) -> tuple[list[float], float]:
    """The force behind a low-pass, at rest under the first load: in every half second, and its mean over the last hold
    at 20 samples a second.
    """
    y, found, last = loads[0], [], math.nan
    for load, count in zip(loads, halves, strict=True):
        found += [load + (y - load) * math.exp(-(half + 0.5) / 2 / time_constant) for half in range(count)]
        last = load + (y - load) * float(np.mean(np.exp(-np.arange(10 * count) / 20 / time_constant)))
        y = load + (y - load) * math.exp(-count / 2 / time_constant)
    return found, last


MANY = [4, 3, 2, 3], [3, 4, 3]
ALONE = [1] * 20
UP_AND_DOWN = [2.0 + 10 * min(i, 20 - i) for i in range(20)]


@pytest.mark.parametrize("part", [1e-6, 1e-4], ids=["errors as stated", "errors understated"])
@pytest.mark.parametrize(
    ("trials", "segments"),
    [
        ((((2.0, 30.0, 60.0, 25.0), MANY[0]), ((3.0, 50.0, 4.0), MANY[1])), ((0, 0, 1, 1), (0, 0, 0))),
        (((UP_AND_DOWN[:18], [1, 3] + [1] * 16),), ((0,) * 4 + tuple(range(1, 15)),)),
        (((UP_AND_DOWN[:19], [1, 2] + [1] * 17),), ((0,) * 4 + tuple(range(1, 16)),)),
        (((UP_AND_DOWN, ALONE),), ((0,) * 4 + tuple(range(1, 17)),)),
    ],
    ids=["two trials", "one degree of freedom", "none within holds", "single half seconds"],
)
def test_creep_is_the_regression_on_the_exact_response_of_a_low_pass(
    trials: Sequence[tuple[Sequence[float], Sequence[int]]], segments: Sequence[Sequence[int]], part: float
) -> None:
    """Of SciPy, with an offset of every segment, on half seconds. A trial without a hold in between changes nothing."""
    random, truth = np.random.default_rng(4), [_filtered(*trial, 8.0)[0] for trial in trials]
    pulls, rows = [], []
    for number, ((loads, halves), segment, y) in enumerate(zip(trials, segments, truth, strict=True)):
        hold = np.repeat(np.arange(len(loads)), halves)
        x = np.array(loads)[hold] / K + 0.3 / K * np.array(y) + 1e-3 * np.array(segment)[hold]
        x += part * random.standard_normal(len(x))
        sd = 2.0 ** -(18 + np.arange(len(loads)) % 3)
        pulls.append(_stepped(loads, halves, x, sd))
        error = (sd * np.sqrt(halves))[hold]
        parts = 100 * number + np.array(segment)[hold], 100 * number + hold
        rows.append(np.array([*parts, np.array(loads)[hold], x, error]))
    segment, hold, load, x, x_sd = np.hstack(rows)
    fits = [_fit_in(pull, numbers) for pull, numbers in zip(pulls, segments, strict=True)]
    found = fit_creep([pulls[0], pulls[0], *pulls[1:]], [fits[0], _fit_of(None), *fits[1:]])
    assert found is not None and found.outcome is FitOutcome.CONVERGED
    offsets = (segment[:, None] == np.unique(segment)).astype(float)

    def lagged(log: float) -> np.ndarray:
        return np.concatenate([_filtered(*trial, math.exp(log))[0] for trial in trials])

    def best(log: float) -> tuple[np.ndarray, float]:
        return _least_squares(np.column_stack([load, lagged(log), offsets]), x, x_sd)

    bounds = math.log(2), math.log(60)
    log = optimize.minimize_scalar(lambda log: best(log)[1], bounds=bounds, method="bounded", options={"xatol": 1e-9}).x
    (compliance, extra, *_), chi_square = best(log)
    assert found.time_constant == pytest.approx(math.exp(log), rel=1e-4)
    assert (found.compliance, found.fraction.value) == pytest.approx((compliance, extra / compliance), rel=1e-4)
    dof = len(x) - offsets.shape[1] - 3
    assert (found.chi_square, found.dof) == (pytest.approx(chi_square, rel=1e-5, abs=1e-5), dof)
    scale = max(1.0, chi_square / max(dof, 1))
    slope = (lagged(log + 1e-5) - lagged(log - 1e-5)) / 2e-5
    columns = np.column_stack([load, lagged(log), extra * slope, offsets]) / x_sd[:, None]
    slopes = np.array([[-extra / compliance**2, 1 / compliance], [-1 / (compliance + extra) ** 2] * 2])
    errors = np.linalg.norm(slopes @ np.linalg.pinv(columns)[:2], axis=1) * math.sqrt(scale)
    assert [found.fraction.standard_error, found.stiffness_at_rest.standard_error] == pytest.approx(errors, rel=1e-4)
    without = _least_squares(np.column_stack([load, offsets]), x, x_sd)[1]
    assert found.significance == pytest.approx(math.sqrt((without - chi_square) / scale), rel=1e-4)
    last = trials[-1][0][-1] - _filtered(*trials[-1], math.exp(log))[1]
    assert found.remaining_force == pytest.approx(last, rel=1e-4)
    holds = (hold[:, None] == np.unique(hold)).astype(float)
    if len(x) == holds.shape[1]:
        assert found.in_holds == 0, "every load was held for half a second"
        return
    (slope, *_), least = _least_squares(np.column_stack([lagged(log), holds]), x, x_sd)
    dof = len(x) - holds.shape[1] - 1
    variance = (max(1.0, least / dof) if dof else 1.0) / _least_squares(holds, lagged(log), x_sd)[1]
    assert found.in_holds == pytest.approx(slope / math.sqrt(variance), rel=1e-4)


def _least_squares(columns: np.ndarray, x: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, float]:
    """The factors of the columns, and χ²."""
    size = np.linalg.norm(columns, axis=0)
    factors = np.linalg.lstsq(columns / size / sd[:, None], x / sd)[0] / size
    return factors, float(np.sum(((x - columns @ factors) / sd) ** 2))


@pytest.mark.parametrize(("gain", "is_removed"), [(0.424, False), (0.425, True), (-0.425, True)])
def test_a_drift_of_the_zero_is_removed_if_it_exceeds_three_standard_errors(gain: float, *, is_removed: bool) -> None:
    """Of two forces with errors of 0.1 N: 0.4243 N, in 16 s between the middles of the first and the last hold."""
    loads = 2.0, 30.0, 60.0, 30.0, 2.0 + gain
    pull = _stepped(loads, [8] * 5, np.repeat([2.0, 30.0, 60.0, 30.0, 2.0], 8) / K, [1e-5] * 5)
    held = fit_held_loads([pull], 0.01)
    assert held.drift is not None and held.drift.value == pytest.approx(gain / 16)
    rate, rate_sd = (gain / 16, 0.1 * math.sqrt(2) / 16) if is_removed else (0.0, 0.0)
    (trial,) = held.stiffness.trials
    assert [plateau.force for plateau in trial.plateaus] == pytest.approx(loads - rate * 4 * np.arange(5))
    expected = fit_stiffness([trial.plateaus], 0.01, rate_sd).stiffness
    assert expected is not None and held.stiffness.stiffness is not None
    assert held.stiffness.stiffness.parts == pytest.approx(expected.parts)


def test_holds_are_timed_from_the_step_before_them() -> None:
    """The first has none. Read after 3, 4.5 and 9 s; held for 4, 5 and 12 s. A trial without holds changes nothing."""
    pull = _stepped((2.0, 30.0, 60.0, 30.0), [8] * 4, np.repeat([2.0, 30.0, 60.0, 30.0], 8) / K, [1e-5] * 4)
    assert (fit_held_loads([pull], 0.0).hold, fit_held_loads([pull], 0.0).duration) == (0.0, math.inf)
    timed = [
        replace(p, step=(p.start + p.end) / 2 - after, hold=hold)
        for p, after, hold in zip(pull.plateaus[1:], (3.004, 4.5, 8.996), (4.0, 5.0, 12.0), strict=True)
    ]
    trial, empty = replace(pull.trial, file="timed"), replace(pull.trial, file="empty")
    pulls = [replace(pull, trial=trial, plateaus=(pull.plateaus[0], *timed)), pull]
    held = fit_held_loads([*pulls, replace(pull, trial=empty, plateaus=())], 0.0)
    assert (held.hold, held.duration) == (pytest.approx(5.5), 5.0)
    assert held.steps == {"timed": (2.99, 5.49, 4.99), pull.trial.file: (), "empty": ()}


@pytest.mark.parametrize("loads", [(2.0, 30.0, 60.0, 30.0, 2.0), (2.0, 17.0, 32.0, 47.0, 62.0)])
def test_creep_that_explains_the_holds_is_no_slip(loads: tuple[float, ...]) -> None:
    """Loads are on no line, because the cuff is still creeping when the next one is held."""
    halves = [16] * 5
    y = np.array(_filtered(loads, halves, 8.0)[0])
    random = np.random.default_rng(1)
    x = (np.repeat(loads, halves) + 0.2 * y) / K + 4e-5 * random.standard_normal(80)
    pull = _stepped(loads, halves, x, [1e-5] * 5)
    held = fit_held_loads([pull], 0.0)
    assert held.creep is not None and held.creep.is_measured
    assert held.creep.fraction.value == pytest.approx(0.2, abs=3 * held.creep.fraction.standard_error)
    (trial,) = held.stiffness.trials
    assert trial.segment.tolist() == [0] * 5
    assert held.stiffness == fit_stiffness([pull.plateaus], 0.0, creeps=True) != fit_stiffness([pull.plateaus], 0.0)


def test_slip_with_creep_is_slip_and_creep_is_sought_between_slips() -> None:
    loads, halves = (2.0, 30.0, 60.0, 30.0, 2.0), [16] * 5
    random = np.random.default_rng(1)
    x = np.repeat(loads, halves) / K + np.repeat([0, 2e-3, 5e-3, 5e-3, 5e-3], halves)
    pull = _stepped(loads, halves, x + 4e-5 * random.standard_normal(80), [1e-5] * 5)
    held = fit_held_loads([pull], 0.0)
    (trial,) = held.stiffness.trials
    assert trial.segment.tolist() == [0, 1, 2, 2, 2]
    assert held.stiffness == fit_stiffness([pull.plateaus], 0.0)
    assert held.creep is not None and not held.creep.is_seen
    assert held.creep == fit_creep([pull], [trial])


def test_creep_does_not_depend_on_the_unit_of_the_force() -> None:
    loads, halves = np.array([2.0, 30.0, 60.0]), [8] * 3
    x = (np.repeat(loads, halves) + 0.2 * np.array(_filtered(loads.tolist(), halves, 8.0)[0])) / K
    pulls = [_stepped((unit * loads).tolist(), halves, x, [2.0**-16] * 3) for unit in (1.0, 1e-9)]
    newtons, other = (fit_creep([pull], [_fit_in(pull, [0] * 3)]) for pull in pulls)
    assert newtons is not None and other is not None
    assert (newtons.fraction.value, newtons.time_constant) == pytest.approx((0.2, 8.0), rel=1e-3)
    assert (other.fraction.value, other.time_constant) == pytest.approx((0.2, 8.0), rel=1e-3)
    assert 1e-9 * other.compliance == pytest.approx(newtons.compliance)


def test_pulls_without_a_held_load_have_no_result() -> None:
    (pull,) = _reduced(CREEPING, 1)[0]
    assert fit_creep([pull], [_fit_of(None)]) is None
    pull = replace(pull, plateaus=())
    for held in (fit_held_loads([pull], 0.0), fit_held_loads([], 0.0)):
        assert not held.has_loads and held_load_notes(held) == () and held.tangents == ()
        assert (held.stiffness.stiffness, held.creep, held.energy, held.drift) == (None, None, None, None)
        assert (held.hold, held.duration, held.steps) == (0.0, math.inf, {})


@pytest.mark.parametrize(
    ("loads", "x", "segment"),
    [
        *(([load] * 5, np.arange(40) / K, [0] * 5) for load in (0.0, 30.0)),
        *(((2.0, 30.0, 60.0), c * np.repeat([2.0, 30.0, 60.0], 8), [0] * 3) for c in (0.0, -1 / K)),
        *(
            (loads, np.repeat(loads, 8) / K + 1e-5 * np.random.default_rng(2).standard_normal(24), [0, 1, 2])
            for loads in ((2.1, 30.7, 60.3), (3.3, 17.9, 32.8), (2.7, 2.7, 2.7))
        ),
    ],
    ids=[
        "no load",
        "one load",
        "no motion",
        "motion against the load",
        *(f"a load in a segment {i}" for i in range(3)),
    ],
)
def test_creep_is_not_identified(loads: Sequence[float], x: np.ndarray, segment: Sequence[int]) -> None:
    """Uneven errors are no powers of two: a weighted mean of equal values differs from them by rounding."""
    for sd in ([1e-5, 3e-5, 7e-5, 1e-5, 1e-5][: len(loads)], [2.0**-16] * len(loads)):
        pull = _stepped(loads, [8] * len(loads), x, sd)
        assert fit_creep([pull], [_fit_in(pull, segment)]) is None


def test_a_spring_without_creep_has_a_fraction_and_a_significance_of_zero() -> None:
    pull = _stepped((2.0, 30.0, 60.0), [8] * 3, (np.repeat([2.0, 30.0, 60.0], 8) / K).tolist(), [2.0**-16] * 3)
    creep = fit_creep([pull], [_fit_in(pull, [0] * 3)])
    assert creep is not None
    assert (creep.fraction.value, creep.significance, creep.in_holds) == pytest.approx((0, 0, 0), abs=1e-6)


def test_load_and_low_pass_that_coincide_do_not_determine_creep() -> None:
    """Loads held for hours."""
    pull = _stepped((2.0, 30.0, 60.0), [8] * 3, (np.repeat([2.0, 30.0, 60.0], 8) / K).tolist(), [2.0**-16] * 3)
    late = [replace(p, start=p.start + 3600 * i, end=p.end + 3600 * i) for i, p in enumerate(pull.plateaus)]
    shift = np.repeat([0.0, 3600.0, 7200.0], 40)
    times = [0.0, 4.0, 4.05, 3600.0, 3608.0, 3608.05, 7300.0]
    pull = replace(
        pull,
        force_time=np.array(times),
        force=np.array([2.0, 2.0, 30.0, 30.0, 30.0, 60.0, 60.0]),
        marker_time=pull.marker_time + shift,
        plateaus=tuple(late),
    )
    assert fit_creep([pull], [_fit_in(pull, [0] * 3)]) is None


def test_half_seconds_of_a_hold_count_if_more_than_half_of_their_frames_are_seen() -> None:
    time = 0.125 + np.array([9.9, 10.0, 10.1, 10.2, 10.3, 10.5, 10.6, 11.0, 11.1, 11.2, 11.5, 11.6, 11.7, 11.8])
    x = [9.0, 1.0, 2.0, 3.0, 6.0, 7.0, 8.0, 4.0, 5.0, 6.0, 1.0, math.nan, 2.0, 9.0]
    pull = replace(_reduced(CREEPING, 1)[0][0], marker_time=time, displacement=np.array(x))
    plateau = Plateau(10.125, 11.825, 40.0, 0.1, 0.0, 0.3, (0.0, 0.3))
    bins = _binned(pull, replace(_fit_of(None, segment=[3, 5]), plateaus=(plateau, replace(plateau, force=50.0))))
    assert bins.time == pytest.approx([10.275, 11.225] * 2)
    assert bins.x == pytest.approx([3.0, 5.0] * 2)
    assert bins.sd == pytest.approx(0.3 * np.sqrt([11 / 4, 11 / 3] * 2))
    assert bins.force.tolist() == [40.0, 40.0, 50.0, 50.0]
    assert (bins.segment.tolist(), bins.hold.tolist()) == ([3, 3, 5, 5], [0, 0, 1, 1])


@pytest.mark.parametrize(("time_constant", "found"), [(1.0, 2.0), (2.5, 2.5), (50.0, 50.0), (90.0, 60.0)])
def test_a_time_constant_is_sought_from_2_to_60_seconds(time_constant: float, found: float) -> None:
    loads, halves = (2.0, 30.0, 60.0, 30.0, 2.0), [16] * 5
    x = (np.repeat(loads, halves) + 0.2 * np.array(_filtered(loads, halves, time_constant)[0])) / K
    pull = _stepped(loads, halves, x, [1e-5] * 5)
    creep = fit_creep([pull], [_fit_in(pull, [0] * 5)])
    assert creep is not None and creep.time_constant == pytest.approx(found, rel=1e-3)
    if found == time_constant:
        assert (creep.compliance, creep.fraction.value) == pytest.approx((1 / K, 0.2), rel=1e-3)


@pytest.mark.parametrize(("last", "is_fitted"), [(4.95, True), (4.45, False)])
def test_creep_needs_twenty_half_seconds(last: float, *, is_fitted: bool) -> None:
    """Ten of the first hold, ten or nine of the second."""
    pulls = [_reduced(CREEPING, 1)[0][0]]
    first, second = pulls[0].plateaus[:2]
    plateaus = (replace(first, end=first.start + 4.95), replace(second, end=second.start + last))
    fits = [replace(_fit_of(None, segment=[0, 0]), plateaus=plateaus)]
    assert (fit_creep(pulls, fits) is not None) is is_fitted
    alone = replace(_fit_of(None, segment=[0]), plateaus=(replace(first, end=first.start + 10.5),))
    assert fit_creep(pulls, [alone]) is None, "one load"
