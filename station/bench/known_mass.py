"""Check the load cell with a known mass before and after a session, and keep the reading.

`station check --known-mass 0` reads the empty cell, `--known-mass 2` two kilograms on it; a shunt is entered as the
mass that it represents. The fit of the session uses the readings (fitting/trial/mass_checks.py).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from fitting.results.codes import FitErrorCode
from fitting.trial.mass_checks import CHECKS_FILE, MassCheck, MassCheckError, evaluate_reading, read_checks
from station.bench.check import CheckResult, DeviceSurvey, compare, show_results, survey_devices
from station.bench.devices import devices_for, load_cell_for
from station.bench.trial_recorder import MakeDevices
from station.clock import RealClock
from station.config import StationConfig
from station.journal import append_line, utc_now
from station.messages.codes import CheckCode
from station.messages.message import Message

LISTEN_S = 3.0


def check_known_mass(
    config: StationConfig,
    folder: Path,
    mass: float,
    console: Console | None = None,
    make_devices: MakeDevices = load_cell_for,
    *,
    as_json: bool = False,
    listen_s: float = LISTEN_S,
) -> int:
    """Read the cell, keep the reading in the folder, print it; return 0 if it is within the tolerance, else 1."""
    zeros = [check for check in read_checks(folder) if check.mass == 0]
    check, result = read_known_mass(config, folder, mass, zeros[-1] if zeros else None, make_devices, listen_s)
    write_reading(folder, check)
    return show_results([result], console, as_json=as_json)


def inspect_bench_and_zero(config: StationConfig, folder: Path) -> tuple[list[CheckResult], MassCheck | None]:
    """The check of the bench, and the reading of the cell; None without samples of its force."""
    survey, devices = survey_devices(config, folder, RealClock(), devices_for)
    with suppress(MassCheckError):
        return compare(survey, devices, config, folder), _reading(survey, config, 0.0, None)
    return compare(survey, devices, config, folder), None


def read_known_mass(
    config: StationConfig,
    folder: Path,
    mass: float,
    zero: MassCheck | None,
    make_devices: MakeDevices = load_cell_for,
    listen_s: float = LISTEN_S,
) -> tuple[MassCheck, CheckResult]:
    """Read the mass [kg] on the cell; zero is the last reading of the empty cell. Raises MassCheckError."""
    survey, _ = survey_devices(config, folder, RealClock(), make_devices, listen_s)
    zero, cell = zero if mass > 0 else None, config.calibration()
    check = _reading(survey, config, mass, zero)
    is_right = check.is_right(cell.gain_relative_sd, config.load_cell.capacity_kg)
    tolerance = check.tolerance(cell.gain_relative_sd, config.load_cell.capacity_kg)
    code = CheckCode.MASS_RIGHT if is_right else CheckCode.MASS_WRONG
    code = CheckCode.MASS_WITHOUT_ZERO if mass and zero is None else code
    shown = {"found_n": check.found, "sd_n": check.sd, "expected_n": check.expected, "tolerance_n": tolerance}
    return check, CheckResult(f"{mass:g} kg on the load cell", Message(code, shown), is_good=is_right)


def write_reading(folder: Path, check: MassCheck) -> None:
    """Keep a reading in the session's folder, where the fit reads it. Raises JournalError."""
    figures = {"mass_kg": check.mass, "expected_n": check.expected, "found_n": check.found, "u_n": check.sd}
    append_line(folder / CHECKS_FILE, "known_mass", at=check.at, **figures, zero_n=check.zero)


def _reading(survey: DeviceSurvey, config: StationConfig, mass: float, zero: MassCheck | None) -> MassCheck:
    cell = config.calibration()
    try:
        check = evaluate_reading(cell.polarity * cell.newtons_per_unit * survey.force(), mass, zero)
    except MassCheckError as error:
        errors = "; ".join(map(str, survey.errors.values()))
        device_errors = {"device_errors": errors} if errors else {}
        raise MassCheckError(FitErrorCode.CHECK_SHORT, {**error.reason.figures, **device_errors}) from error
    return replace(check, at=utc_now())
