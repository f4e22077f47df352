"""A known mass before and after: its reading, its place in the session's folder, and what the fit makes of a drift."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from fitting.mass_checks import CHECKS_FILE, MassCheckError, read_checks, with_gain_drift, with_mass_checks
from fitting.results.codes import NoteCode
from fitting.session import fit_session
from fitting.trial import build_trial
from recordings.samples import Item
from station.bench.check import calibration_line, look_at_bench
from station.bench.known_mass import check_known_mass
from station.clock import Clock
from station.config import ConfigError, StationConfig, parse_config
from station.fit import fit_session_folder
from station.journal import append_line
from tests.fitting.experiment import Session, published
from tests.station.fake_devices import FakeCapture, FakeDaq

CONFIG = parse_config({"load_cell": {"capacity_kg": 50, "gain_relative_sd": 0.001}}, "t")
NEWTONS_PER_VOLT = 50 * 9.80665 / 5


class _Loaded(FakeDaq):
    """A DAQ whose force reads so many newtons, with a little noise."""

    newtons = 0.0

    def read(self, timeout_s: float) -> Sequence[Item]:
        items = super().read(timeout_s)
        for item in items:
            if getattr(item, "stream", "") == "/force":
                noise = np.random.default_rng(len(item.values)).standard_normal(item.values.shape)
                item.values[:] = (self.newtons + 0.1 * noise) / NEWTONS_PER_VOLT
        return items


def _check(folder: Path, mass: float, newtons: float) -> tuple[int, str]:
    def devices(config: StationConfig, subject: object, clock: Clock, folder: Path) -> list[_Loaded]:
        daq = _Loaded(clock, FakeCapture(clock, 100.0, 1.0))
        daq.newtons = newtons
        return [daq]

    out = io.StringIO()
    code = check_known_mass(
        CONFIG,
        folder,
        mass,
        Console(file=out, width=300),
        devices,
        listen_s=0.3,  # type: ignore[arg-type]
    )
    return code, out.getvalue()


def test_a_mass_that_reads_what_it_weighs_is_kept_without_the_zero(tmp_path: Path) -> None:
    assert _check(tmp_path, 0, 3.0)[0] == 0
    code, said = _check(tmp_path, 2, 22.63)
    assert code == 0
    assert "expected 19.61" in said
    zero, mass = read_checks(tmp_path)
    assert (zero.expected, zero.zero) == (0.0, None)
    assert mass.found == pytest.approx(19.63, abs=0.05)
    assert mass.zero == pytest.approx(3.0, abs=0.05)
    assert 0 < mass.sd < 0.05
    line = json.loads((tmp_path / CHECKS_FILE).read_text().splitlines()[1])
    assert (line["kind"], line["mass_kg"]) == ("known_mass", 2)


def test_a_mass_that_reads_wrong_is_told(tmp_path: Path) -> None:
    _check(tmp_path, 0, 0.0)
    code, said = _check(tmp_path, 2, 39.2)
    assert code == 1
    assert "check the mass, load_cell.capacity_kg" in said


def test_a_mass_without_a_zero_says_so(tmp_path: Path) -> None:
    assert "run with --known-mass 0 on the empty cell first" in _check(tmp_path, 2, 19.61)[1]


def test_a_cell_that_sends_nothing_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(MassCheckError, match="sent 0 samples, expected at least 6"):
        check_known_mass(CONFIG, tmp_path, 2, make_devices=lambda *_: [], listen_s=0.0)
    assert read_checks(tmp_path) == ()


@pytest.mark.parametrize("line", ["{", '{"at": "", "mass_kg": 1}', "[]"])
def test_a_wrong_line_is_named_and_a_torn_one_passed_over(tmp_path: Path, line: str) -> None:
    (tmp_path / CHECKS_FILE).write_text(line)
    assert read_checks(tmp_path) == ()
    (tmp_path / CHECKS_FILE).write_text(line + "\n")
    with pytest.raises(MassCheckError, match="line 1: expected a known mass"):
        read_checks(tmp_path)


def test_a_gain_that_drifted_widens_the_scale_of_the_force_and_is_told_with_all_readings(tmp_path: Path) -> None:
    for mass, newtons in ((0, 0.0), (2, 19.61), (0, 2.3), (2, 22.8)):
        _check(tmp_path, mass, newtons)
    checks = read_checks(tmp_path)
    trial = build_trial(*Session(published("hand", weights=(20.0, 40.0), hold=5.0), 3).static(), "a.mcap", "hash")
    (wider,) = with_gain_drift([trial], checks)
    assert trial.gain_sd == 0
    assert wider.gain_sd == pytest.approx(0.89 / 19.61 / 2, rel=0.1)
    notes = with_mass_checks(fit_session([wider]), checks).cuffs["hand"].notes
    assert [note.code for note in notes if note.code is NoteCode.KNOWN_MASS] == [NoteCode.KNOWN_MASS] * 4
    figures = {note.code: note.figures for note in notes}
    assert figures[NoteCode.KNOWN_MASS_ZERO_DRIFT]["drift_n"] == pytest.approx(2.3, abs=0.35)
    assert figures[NoteCode.KNOWN_MASS_GAIN_DRIFT]["drift"] == pytest.approx(0.045, abs=0.005)


def test_the_fit_of_a_folder_goes_by_what_was_read_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trial = build_trial(*Session(published("hand", weights=(20.0, 40.0), hold=5.0), 3).static(), "a.mcap", "hash")
    monkeypatch.setattr("station.fit.read_trials", lambda *_: ((trial,), ()))
    (tmp_path / "a.mcap").touch()
    silent = fit_session_folder(tmp_path, None).cuffs["hand"]
    for found in (19.6, 22.6):
        said = {"mass_kg": 2.0, "expected_n": 19.6, "found_n": found, "u_n": 0.02, "zero_n": 0.1}
        append_line(tmp_path / CHECKS_FILE, "known_mass", **said)
    fit = fit_session_folder(tmp_path, None).cuffs["hand"]
    assert fit.notes[-1].code is NoteCode.KNOWN_MASS_GAIN_DRIFT
    assert fit.notes[-1].figures["drift"] == pytest.approx(3 / 19.6)
    assert fit.stiffness is not None
    assert silent.stiffness is not None
    assert fit.stiffness.standard_error > 1.5 * silent.stiffness.standard_error


CERTIFICATE = {"serial_number": "L7", "calibrated_on": date(2026, 3, 1), "sensitivity_mv_per_v": 2.0}


@pytest.mark.parametrize(
    ("cell", "today", "is_good", "words"),
    [
        (CERTIFICATE, date(2026, 3, 31), True, "of L7 of 2026-03-01, 30 days old, due on 2027-03-01"),
        (CERTIFICATE, date(2027, 3, 1), False, "365 days old, due on 2027-03-01; have it calibrated"),
        ({**CERTIFICATE, "calibration_valid_days": 10}, date(2026, 3, 20), False, "due on 2026-03-11"),
        ({**CERTIFICATE, "calibration_due_on": date(2028, 1, 1)}, date(2027, 6, 1), True, "due on 2028-01-01"),
        (CERTIFICATE, date(2026, 2, 1), False, "in the future"),
        ({}, date(2026, 2, 1), True, "not known; write load_cell.calibrated_on"),
    ],
)
def test_the_age_of_the_calibration_is_shown_and_its_end(cell: dict, today: date, is_good: bool, words: str) -> None:
    line = calibration_line(parse_config({"load_cell": cell}, "t"), today)
    assert line.is_good == is_good
    assert line.is_doubtful == (not cell), "a date that is not known is not checked"
    assert words in line.found


def test_the_certificate_is_in_what_every_recording_says_of_its_load_cell() -> None:
    cell = parse_config({"load_cell": {**CERTIFICATE, "gain_relative_sd": 0.002}}, "t").calibration()
    assert (cell.serial_number, cell.capacity_kg, cell.sensitivity_mv_per_v) == ("L7", 50.0, 2.0)
    assert (cell.gain_relative_sd, cell.calibrated_on, cell.calibration_due_on) == (0.002, "2026-03-01", "2027-03-01")


def test_a_date_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"load_cell\.calibrated_on"):
        parse_config({"load_cell": {"calibrated_on": "last spring"}}, "t")


def test_check_shows_the_force_at_rest_and_refuses_a_saturated_one(tmp_path: Path) -> None:
    def devices(config: StationConfig, subject: object, clock: Clock, folder: Path) -> list[_Loaded]:
        daq = _Loaded(clock, FakeCapture(clock, 100.0, 1.0))
        daq.newtons = 10 * NEWTONS_PER_VOLT
        return [daq]

    lines = {line.subject: line for line in look_at_bench(CONFIG, tmp_path, devices)}  # type: ignore[arg-type]
    assert not lines["force at rest"].is_good
    assert lines["force at rest"].found.startswith("+980.")
    assert "saturated at 5 V" in lines["force at rest"].found


@pytest.mark.parametrize(("newtons", "is_doubtful"), [(3.0, False), (26.0, True), (-26.0, True)])
def test_a_cell_that_is_loaded_at_rest_is_doubtful(tmp_path: Path, newtons: float, is_doubtful: bool) -> None:
    def devices(config: StationConfig, subject: object, clock: Clock, folder: Path) -> list[_Loaded]:
        daq = _Loaded(clock, FakeCapture(clock, 100.0, 1.0))
        daq.newtons = newtons
        return [daq]

    lines = {line.subject: line for line in look_at_bench(CONFIG, tmp_path, devices)}  # type: ignore[arg-type]
    at_rest = lines["force at rest"]
    assert (at_rest.is_good, at_rest.is_doubtful) == (True, is_doubtful)
    assert ("expected within ±9.8 N with the hook empty" in at_rest.found) == is_doubtful
