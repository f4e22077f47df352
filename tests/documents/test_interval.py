import math
from collections.abc import Callable

import pytest

from documents.interval import (
    CountingFormatter,
    between,
    bracketed,
    has_width,
    plus_minus,
    significant_decimals,
    with_error,
)


@pytest.mark.parametrize(
    ("number", "ci95", "text"),
    [
        (2140.123, (2134.323, 2145.923), "2140.1 ± 5.8"),
        (1.0, (1.0 - 0.0996, 1.0 + 0.0996), "1.00 ± 0.10"),  # no third figure where it rounds up to a power of ten
        (0.88, (0.39, 0.97), "0.88 (0.39 to 0.97)"),  # both ends, where the halves differ in the printed digits
        (0.88, (0.7501, 1.0100), "0.88 ± 0.13"),
        (5.0, (1.0, 9.08), "5.0 ± 4.0"),  # the halves differ by 0.08, less than a digit
        (0.0, (-10.0, 11.0), "0 ± 10"),  # by one digit
        (-0.0004, (-0.1204, 0.1196), "0.00 ± 0.12"),  # zero has no sign
        (-2.0, (-4.0, 0.0), "−2.0 ± 2.0"),
    ],
)
def test_an_interval_has_two_digits_of_its_half_width(number: float, ci95: tuple[float, float], text: str) -> None:
    assert plus_minus(number, ci95).replace("\u00a0", " ") == text


def test_an_interval_in_brackets_has_no_break_spaces_and_minus_signs() -> None:
    assert bracketed(0.89893, (0.89881, 0.89905)) == "0.89893 (0.89881\u00a0to\u00a00.89905)"
    assert bracketed(8524.4, (8480.4, 8567.9)) == "8524 (8480\u00a0to\u00a08568)"
    assert bracketed(-2267.0, (-3431.0, -1103.0)) == "−2267 (−3431\u00a0to\u00a0−1103)"
    assert plus_minus(0.00695, (0.00581, 0.00731), 100.0) == "0.695 (0.581\u00a0to\u00a00.731)"
    assert between((-3.0, -1.0)) == "−3.0 to −1.0"


@pytest.mark.parametrize("half", [9.4e-7, 0.00012, 0.0996, 0.5, 1.04, 9.96, 43.0, 1234.0])
def test_the_ends_of_an_interval_never_look_the_same(half: float) -> None:
    low, high = between((0.9 - half, 0.9 + half)).replace("−", "-").split(" to ")
    assert float(high) - float(low) == pytest.approx(2 * half, rel=0.06)


def test_a_scale_is_applied_before_rounding_and_a_negative_one_swaps_the_ends() -> None:
    assert bracketed(0.012224, (0.012183, 0.012265), 1e3) == "12.224 (12.183\u00a0to\u00a012.265)"
    assert between((-0.3, -0.1), -1.0) == "0.10 to 0.30"
    assert significant_decimals((-0.09, 0.09)) == 3 and significant_decimals((-0.09, 0.09), 10.0) == 2


@pytest.mark.parametrize("write", [bracketed, plus_minus])
@pytest.mark.parametrize("ci95", [None, (4.8703, 4.8703), (4.8703, math.nextafter(4.8703, 5.0))])
def test_without_a_width_digits_are_as_requested(write: Callable[..., str], ci95: tuple[float, float] | None) -> None:
    assert write(4.8703, ci95) == "5"
    assert write(4.8703, ci95, 10.0, digits=3) == "48.703"
    assert significant_decimals(ci95) == 0 and significant_decimals(ci95, otherwise=3) == 3


@pytest.mark.parametrize(
    ("ends", "is_wide"),
    [((0.0, 0.0), False), ((0.0, 1e-15), True), ((-2.0, -2.0 + 1.8e-12), False), ((-2.0, -2.0 + 2.2e-12), True)],
)
def test_a_width_of_rounding_errors_is_none(ends: tuple[float, float], is_wide: bool) -> None:
    assert has_width(ends) is is_wide


@pytest.mark.parametrize("ends", [(-math.inf, math.inf), (0.0, math.inf)])
def test_an_endless_interval_has_the_requested_digits(ends: tuple[float, float]) -> None:
    assert significant_decimals(ends, otherwise=3) == 3
    assert between((5.0, math.inf)) == "5 to inf"


@pytest.mark.parametrize(
    ("ci95", "text"),
    [
        ((0.8612, 0.8791), "87.0 (86.1\u00a0to\u00a087.9)"),
        ((0.6013, 1.1387), "87 (60\u00a0to\u00a0114)"),
        ((0.86971, 0.87029), "87.0"),
    ],
)
def test_limited_digits_hide_an_interval_that_they_do_not_show(ci95: tuple[float, float], text: str) -> None:
    assert bracketed(0.87, ci95, 100.0, digits=1, is_limited=True) == text


@pytest.mark.parametrize(
    ("censored", "text"),
    [
        (None, "0.70 (0.60 to 0.80)"),
        ("low", "0.70 (up to 0.80)"),
        ("high", "0.70 (0.60 or more)"),
        ("both", "0.70 (interval open)"),
    ],
)
def test_an_end_that_is_a_bound_is_no_figure(censored: str | None, text: str) -> None:
    assert bracketed(0.7, (0.6, 0.8), censored=censored).replace("\u00a0", " ") == text


def test_a_number_with_its_standard_error_has_two_digits_of_the_error_or_six_of_its_own() -> None:
    assert with_error(8514.7, 29.7) == "8515 ± 30"
    assert with_error(-0.2196, 0.00949) == "-0.2196 ± 0.0095"
    assert with_error(8514.74321, 0.0) == "8514.74"


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 frames"), (1, "1 frame"), (1.0, "1 frame"), (2, "2 frames"), (1234.0, "1234 frames")]
)
def test_a_count_has_its_noun_in_singular_or_plural(count: float, text: str) -> None:
    format_text = CountingFormatter().format
    assert format_text("{count:frame} of {load:.1f} N", count=count, load=2) == f"{text} of 2.0 N"
    assert format_text("{count:cue}", count=count) == text.replace("frame", "cue")
