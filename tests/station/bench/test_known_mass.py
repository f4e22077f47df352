"""Check with a known mass: its reading, its line in the session folder, and its effect on the fit."""

import io
import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from fitting.results.codes import FitErrorCode, NoteCode
from fitting.session import fit_session
from fitting.trial.mass_checks import CHECKS_FILE, check_notes, read_checks, with_mass_checks
from fitting.trial.trial import build_trial
from recordings.samples import Item
from station.bench.check import check_calibration, check_known_mass, inspect_bench
from station.clock import Clock
from station.config import StationConfig, parse_config
from station.fit import fit_session_folder
from station.journal import append_line
from station.messages.bench_messages import CheckCode
from tests.fitting.experiment import Session, published
from tests.refusals import raises_refusal
from tests.station.fake_devices import FakeCapture, FakeDaq

CONFIG = parse_config({"load_cell": {"capacity_kg": 50, "gain_relative_sd": 0.001}}, "t")
NEWTONS_PER_VOLT = 50 * 9.80665 / 5
DUE = date(2028, 1, 1)
CERTIFICATE = {"serial_number": "L7", "calibrated_on": date(2026, 3, 1), "sensitivity_mv_per_v": 2.0}


class _Loaded(FakeDaq):
    """A DAQ with a force of `newtons` and a little noise."""

    newtons = 0.0

    def read(self, timeout_s: float) -> Sequence[Item]:
        items = super().read(timeout_s)
        for item in items:
            if getattr(item, "stream", "") == "/force":
                noise = np.random.default_rng(len(item.values)).standard_normal(item.values.shape)
                item.values[:] = (self.newtons + 0.02 * noise) / NEWTONS_PER_VOLT
        return items


def loaded(newtons: float) -> Callable[..., list[_Loaded]]:
    def devices(config: StationConfig, subject: object, clock: Clock, folder: Path) -> list[_Loaded]:
        daq = _Loaded(clock, FakeCapture(clock, 100.0, 1.0))
        daq.newtons = newtons
        return [daq]

    return devices


def _check(folder: Path, mass: float, newtons: float) -> tuple[int, CheckCode]:
    """Exit code, and code of the result."""
    with redirect_stdout(io.StringIO()) as out:
        code = check_known_mass(CONFIG, folder, mass, None, loaded(newtons), as_json=True, listen_s=0.3)  # type: ignore[arg-type]
    return code, CheckCode(json.loads(out.getvalue())[0]["code"])


def test_a_mass_within_the_tolerance_is_stored_without_the_zero(tmp_path: Path) -> None:
    assert _check(tmp_path, 0, 3.0)[0] == 0
    assert _check(tmp_path, 2, 22.63) == (0, CheckCode.MASS_RIGHT)
    zero, mass = read_checks(tmp_path)
    assert (zero.expected, zero.zero) == (0.0, None)
    assert mass.expected == pytest.approx(19.61, abs=0.01)
    assert mass.found == pytest.approx(19.63, abs=0.05)
    assert mass.zero == pytest.approx(3.0, abs=0.05)
    assert 0 < mass.sd < 0.05
    line = json.loads((tmp_path / CHECKS_FILE).read_text().splitlines()[1])
    assert (line["kind"], line["mass_kg"]) == ("known_mass", 2)


def test_a_mass_outside_the_tolerance_is_wrong_and_without_a_zero_reading_includes_the_zero(tmp_path: Path) -> None:
    assert _check(tmp_path, 2, 19.61)[1] is CheckCode.MASS_WITHOUT_ZERO
    _check(tmp_path, 0, 0.0)
    assert _check(tmp_path, 2, 39.2) == (1, CheckCode.MASS_WRONG)


def test_a_cell_without_samples_is_refused(tmp_path: Path) -> None:
    with raises_refusal(FitErrorCode.CHECK_SHORT, samples=0, expected=6):
        check_known_mass(CONFIG, tmp_path, 2, make_devices=lambda *_: [], listen_s=0.0)
    assert read_checks(tmp_path) == ()


@pytest.mark.parametrize("line", ["{", '{"at": "", "mass_kg": 1}', "[]"])
def test_a_wrong_line_is_refused_and_an_incomplete_one_ignored(tmp_path: Path, line: str) -> None:
    (tmp_path / CHECKS_FILE).write_text(line)
    assert read_checks(tmp_path) == ()
    (tmp_path / CHECKS_FILE).write_text(line + "\n")
    with raises_refusal(FitErrorCode.CHECKS_INVALID, line=1):
        read_checks(tmp_path)


def test_a_drift_of_the_gain_adds_to_the_uncertainty_of_the_scale_and_is_noted(tmp_path: Path) -> None:
    for mass, newtons in ((0, 0.0), (2, 19.61), (0, 2.3), (2, 22.8)):
        _check(tmp_path, mass, newtons)
    checks = read_checks(tmp_path)
    trial = build_trial(*Session(published("hand", weights=(20.0, 40.0), hold=5.0), 3).static(), "a.mcap", "hash")
    (wider,) = with_mass_checks([trial], checks)
    assert trial.gain_sd == 0
    assert wider.gain_sd == pytest.approx(0.89 / 19.61 / 2, rel=0.1)
    notes = fit_session([wider]).with_notes(check_notes(checks)).cuffs["hand"].notes
    assert [note.code for note in notes if note.code is NoteCode.KNOWN_MASS] == [NoteCode.KNOWN_MASS] * 4
    figures = {note.code: note.figures for note in notes}
    assert figures[NoteCode.KNOWN_MASS_ZERO_DRIFT]["drift_n"] == pytest.approx(2.3, abs=0.35)
    assert figures[NoteCode.KNOWN_MASS_GAIN_DRIFT]["drift"] == pytest.approx(0.045, abs=0.005)


def test_the_fit_of_a_folder_uses_its_readings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trial = build_trial(*Session(published("hand", weights=(20.0, 40.0), hold=5.0), 3).static(), "a.mcap", "hash")
    monkeypatch.setattr("station.fit.read_trials", lambda *_: ((trial,), ()))
    (tmp_path / "a.mcap").touch()
    silent = fit_session_folder(tmp_path, None).cuffs["hand"]
    for found in (19.6, 22.6):
        reading = {"mass_kg": 2.0, "expected_n": 19.6, "found_n": found, "u_n": 0.02, "zero_n": 0.1}
        append_line(tmp_path / CHECKS_FILE, "known_mass", **reading)
    fit = fit_session_folder(tmp_path, None).cuffs["hand"]
    assert fit.notes[-1].code is NoteCode.KNOWN_MASS_GAIN_DRIFT
    assert fit.notes[-1].figures["drift"] == pytest.approx(3 / 19.6)
    assert fit.stiffness.standard_error > 1.5 * silent.stiffness.standard_error


@pytest.mark.parametrize(
    ("cell", "today", "code", "age_days", "due_on"),
    [
        (CERTIFICATE, date(2026, 3, 31), CheckCode.CALIBRATION_VALID, 30, "2027-03-01"),
        (CERTIFICATE, date(2027, 3, 1), CheckCode.CALIBRATION_DUE, 365, "2027-03-01"),
        ({**CERTIFICATE, "calibration_valid_days": 10}, date(2026, 3, 20), CheckCode.CALIBRATION_DUE, 19, "2026-03-11"),
        (CERTIFICATE | {"calibration_due_on": DUE}, date(2027, 6, 1), CheckCode.CALIBRATION_VALID, 457, str(DUE)),
        (CERTIFICATE, date(2026, 2, 1), CheckCode.CALIBRATION_IN_FUTURE, -28, "2027-03-01"),
        ({}, date(2026, 2, 1), CheckCode.CALIBRATION_UNKNOWN, None, None),
    ],
)
def test_the_age_of_the_calibration_is_shown_and_its_end(
    cell: dict, today: date, code: CheckCode, age_days: int | None, due_on: str | None
) -> None:
    result = check_calibration(parse_config({"load_cell": cell}, "t"), today)
    assert result.message.code is code
    assert result.is_good == (code in (CheckCode.CALIBRATION_VALID, CheckCode.CALIBRATION_UNKNOWN))
    assert result.is_doubtful == (not cell), "an unknown date cannot be checked"
    figures = result.message.figures
    assert (figures.get("age_days"), figures.get("due_on")) == (age_days, due_on)


def test_the_calibration_of_a_recording_has_the_figures_of_the_certificate() -> None:
    cell = parse_config({"load_cell": {**CERTIFICATE, "gain_relative_sd": 0.002}}, "t").calibration()
    assert (cell.serial_number, cell.capacity_kg, cell.sensitivity_mv_per_v) == ("L7", 50.0, 2.0)
    assert (cell.gain_relative_sd, cell.calibrated_on, cell.calibration_due_on) == (0.002, "2026-03-01", "2027-03-01")


@pytest.mark.parametrize(
    ("newtons", "code", "is_good", "is_doubtful", "grade"),
    [
        (3.0, CheckCode.AT_REST, True, False, "good"),
        *((load, CheckCode.LOADED, True, True, "doubtful") for load in (26.0, -26.0)),
        (10 * NEWTONS_PER_VOLT, CheckCode.SATURATED, False, False, "bad"),
    ],
)
def test_check_shows_the_force_at_rest_doubts_a_loaded_cell_and_refuses_a_saturated_one(
    tmp_path: Path, newtons: float, code: CheckCode, is_good: bool, is_doubtful: bool, grade: str
) -> None:
    results = inspect_bench(CONFIG, tmp_path, loaded(newtons))  # type: ignore[arg-type]
    (at_rest,) = (result for result in results if result.subject == "force at rest")
    assert (at_rest.message.code, at_rest.is_good, at_rest.is_doubtful) == (code, is_good, is_doubtful)
    assert at_rest.grade == grade
    assert at_rest.message.figures["mean_n"] == pytest.approx(newtons, abs=0.2)
    assert code is not CheckCode.SATURATED or at_rest.message.figures["limit"] == pytest.approx(5.0)
