"""Check the load cell with a known mass before and after a session, and keep the reading.

`station check --known-mass 0` reads the empty cell, `--known-mass 2` two kilograms on it; a shunt is entered as the
mass that it represents. The fit of the session uses the readings (fitting/trial/mass_checks.py).
"""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from fitting.results.codes import FitErrorCode
from fitting.trial.mass_checks import CHECKS_FILE, MassCheckError, evaluate_reading, read_checks
from station.bench.check import CheckResult, show_results, survey_devices
from station.bench.devices import load_cell_for
from station.bench.trial_recorder import MakeDevices
from station.clock import RealClock
from station.config import StationConfig
from station.journal import append_line
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
    survey, _ = survey_devices(config, folder, RealClock(), make_devices, listen_s)
    cell = config.calibration()
    zeros = [check for check in read_checks(folder) if check.mass == 0]
    zero = zeros[-1] if zeros and mass > 0 else None
    try:
        check = evaluate_reading(cell.polarity * cell.newtons_per_unit * survey.force(), mass, zero)
    except MassCheckError as error:
        errors = "; ".join(map(str, survey.errors.values()))
        device_errors = {"device_errors": errors} if errors else {}
        raise MassCheckError(FitErrorCode.CHECK_SHORT, {**error.reason.figures, **device_errors}) from error
    figures = {"mass_kg": mass, "expected_n": check.expected, "found_n": check.found, "u_n": check.sd}
    append_line(folder / CHECKS_FILE, "known_mass", **figures, zero_n=check.zero)
    tolerance = check.tolerance(cell.gain_relative_sd, config.load_cell.capacity_kg)
    is_good = check.is_right(cell.gain_relative_sd, config.load_cell.capacity_kg)
    code = CheckCode.MASS_RIGHT if is_good else CheckCode.MASS_WRONG
    code = CheckCode.MASS_WITHOUT_ZERO if mass and zero is None else code
    shown = {"found_n": check.found, "sd_n": check.sd, "expected_n": check.expected, "tolerance_n": tolerance}
    result = CheckResult(f"{mass:g} kg on the load cell", Message(code, shown), is_good=is_good)
    return show_results([result], console, as_json=as_json)
