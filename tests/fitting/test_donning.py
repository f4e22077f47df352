"""What is said of a donning beside its figures."""

from __future__ import annotations

import pytest

from fitting.donning import interval_notes
from fitting.uncertainty import Repeat, combine


@pytest.mark.parametrize(("apart", "is_said"), [(2.0, False), (60.0, True)])
def test_two_repeats_whose_interval_holds_zero_are_not_passed_over(apart: float, is_said: bool) -> None:
    damping = combine([Repeat(210.0 + side * apart, 5.0) for side in (-1, 1)])
    assert damping.standard_error < damping.value / 2, "by the standard error alone it is identified"
    notes = interval_notes(damping)
    assert bool(notes) == is_said
    assert all("interval of damping holds zero" in note for note in notes)


def test_a_damping_that_is_not_identified_has_no_interval_to_speak_of() -> None:
    assert interval_notes(None) == ()
