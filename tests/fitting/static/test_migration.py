"""What did not come back."""

from __future__ import annotations

import pytest

from fitting.pull.plateaus import Plateau
from fitting.static.migration import fit_migration


def _trial(*held: tuple[float, float]) -> list[Plateau]:
    return [Plateau(0, 8, force, 0.1, x, 3e-5, (x, 3e-5)) for force, x in held]


def test_migration_runs_from_the_first_start_to_the_last_end() -> None:
    first = _trial((2.0, 0.0), (60.0, 0.018), (2.0, 0.010))
    last = _trial((2.0, 0.0105), (60.0, 0.02), (2.2, 0.012))
    found = fit_migration([first, last])
    assert found is not None
    assert found.value == pytest.approx(0.012)
    assert found.standard_error == pytest.approx(3e-5 * 2**0.5)
    alone = fit_migration([last])
    assert alone is not None
    assert alone.value == pytest.approx(0.0015)


def test_a_trial_that_ends_loaded_determines_no_migration() -> None:
    assert fit_migration([_trial((2.0, 0.0), (30.0, 0.01), (60.0, 0.02))]) is None
    assert fit_migration([_trial((60.0, 0.01), (2.0, 0.0))]) is None


def test_one_held_load_or_none_determines_no_migration() -> None:
    assert fit_migration([_trial((2.0, 0.0))]) is None
    assert fit_migration([[]]) is None
    assert fit_migration([]) is None
