"""Slip, friction or an elastic curve: the decisions, from plateaus and regressions with results in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy import stats

from fitting.results.outcome import FitOutcome
from fitting.static.stiffness import (
    StaticFit,
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
)
from fitting.static.tangent import TangentLaw
from fitting.uncertainty import Repeat
from tests.fitting.static.test_stiffness import FLAT, K, _held


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


@pytest.mark.parametrize(
    ("loading", "is_possible"),
    [
        (8192.0, False),
        (math.nextafter(8192.0, 0), True),
        (0.8 * 8192, False),
        (math.nextafter(0.8 * 8192, math.inf), True),
    ],
)
def test_friction_makes_loading_less_steep_by_up_to_twice_a_tenth(loading: float, is_possible: bool) -> None:
    branch = replace(FLAT, value=loading)
    assert (
        _may_be_friction([_scatter(1, 0.0), _fit_of(None)], [_scatter(0, 1e-20), _fit_of(None)], branch) is is_possible
    )


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


@pytest.mark.parametrize(
    ("loads", "returns"),
    [
        ((0, 5, 0.29), True),
        ((0, 5, 0.3), False),
        ((0, 5, -0.29), True),
        ((0, 5, -0.3), False),
        ((0, 0.3, 0), False),
        ((0, 0.31, 0), True),
        ((0, 0.2, -0.2), False),
        ((0, 0.4, 0.2), False),
        ((0, 5, -0.3, 5, 0), False),
        ((0, 5, -0.29, 5, 0), True),
    ],
)
def test_loads_return_within_0_3_n_after_a_rise_of_more(loads: tuple[float, ...], returns: bool) -> None:
    assert _returns(np.array(loads, float)) is returns


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
