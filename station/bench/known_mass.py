"""A known mass on the load cell before and after a session: read it, keep the reading, say whether it is right.

`station check --known-mass 0` reads the empty cell, `--known-mass 2` two kilograms on it; a shunt does as well, as the
mass that it stands for. The session's fit uses the readings (fitting/mass_checks.py).
"""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from fitting.mass_checks import CHECKS_FILE, MassCheckError, evaluate_reading, read_checks
from station.bench.check import Line, listen, show_lines
from station.bench.devices import load_cell_for
from station.bench.trial_recorder import MakeDevices
from station.clock import RealClock
from station.config import StationConfig
from station.journal import append_line

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
    """Reads the cell, keeps the reading in the folder, prints it; returns 0 if it is as it should be, else 1."""
    answers, _ = listen(config, folder, RealClock(), make_devices, listen_s)
    cell = config.calibration()
    zeros = [check for check in read_checks(folder) if check.mass == 0]
    zero = zeros[-1] if zeros and mass > 0 else None
    try:
        check = evaluate_reading(cell.polarity * cell.newtons_per_unit * answers.force(), mass, zero)
    except MassCheckError as error:
        errors = "; ".join(answers.errors.values())
        raise MassCheckError(
            f"{error}: {errors}" if errors else f"{error}; see with `station check` whether its device answers"
        ) from error
    figures = {"mass_kg": mass, "expected_n": check.expected, "found_n": check.found, "u_n": check.sd}
    append_line(folder / CHECKS_FILE, "known_mass", **figures, zero_n=check.zero)
    tolerance = check.tolerance(cell.gain_relative_sd, config.load_cell.capacity_kg)
    good = abs(check.found - check.expected) <= tolerance
    text = f"{check.found:.2f} ± {check.sd:.2f} N, expected {check.expected:.2f} ± {tolerance:.2f} N"
    if mass and zero is None:
        text += "; the zero is in it, run with --known-mass 0 on the empty cell first"
    elif not good:
        text += "; check the mass, load_cell.capacity_kg, full_scale_v and polarity"
    return show_lines([Line(f"{mass:g} kg on the load cell", text, is_good=good)], console, as_json=as_json)
