"""What did not come back."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fitting.pull.plateaus import Plateau
from fitting.static.creep import Creep
from fitting.static.migration import fit_migration
from fitting.uncertainty import normal_estimate


def _trial(*held: tuple[float, float]) -> list[Plateau]:
    return [Plateau(0, 8, force, 0.1, x, 3e-5, (x, 3e-5)) for force, x in held]


def test_migration_runs_from_the_first_start_to_the_last_end() -> None:
    first = _trial((2.0, 0.0), (60.0, 0.018), (2.0, 0.010))
    last = _trial((2.0, 0.0105), (60.0, 0.02), (2.2, 0.012))
    found = fit_migration([first, last])
    assert found is not None
    assert found.value == pytest.approx(0.012)
    assert found.standard_error == pytest.approx(3e-5 * 2**0.5)
    assert found.ci95 == pytest.approx((0.012 - 8.31544e-5, 0.012 + 8.31544e-5), abs=1e-9), "1.95996 standard errors"
    assert found.parts == {"noise": found.standard_error}
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


CREEP = Creep(
    fraction=normal_estimate(0.1, 0.04),
    time_constant=10.0,
    compliance=2e-4,
    stiffness_at_rest=normal_estimate(4545.0, 10.0),
    significance=5.0,
    in_holds=3.0,
    chi_square=8.0,
    dof=10,
    remaining_force=(-40.0, -50.0, -60.0),
)


FIRST = _trial((2.0, 0.0), (60.0, 0.018), (2.0, 0.010))
LAST = _trial((2.0, 0.0105), (60.0, 0.02), (2.2, 0.012))


@pytest.mark.parametrize(
    ("trials", "to_come"), [([FIRST, LAST], 50.0), ([FIRST, FIRST, LAST], 60.0), ([FIRST, LAST, []], 50.0)]
)
def test_the_creep_still_to_recover_after_the_last_hold_is_no_slip(trials: list[list[Plateau]], to_come: float) -> None:
    """1/5000 m/N, a tenth of it creep. Its relative error is that of the fraction, 0.4, and 0.3."""
    found = fit_migration(trials, CREEP)
    assert found is not None
    assert found.value == pytest.approx(0.012 - 2e-5 * to_come)
    assert found.parts == pytest.approx({"noise": 3e-5 * 2**0.5, "creep": 1e-5 * to_come})
    assert found.standard_error == pytest.approx((2 * 3e-5**2 + (1e-5 * to_come) ** 2) ** 0.5)


def test_creep_that_is_not_measured_is_left_out() -> None:
    assert fit_migration([FIRST], replace(CREEP, significance=3.0)) == fit_migration([FIRST])
