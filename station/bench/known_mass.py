"""A known mass on the load cell before and after a session: what it should read, what it reads, whether it drifted.

`station check --known-mass 0` reads the empty cell, `--known-mass 2` two kilograms on it; a shunt does as well, as the
mass that it stands for. Each is a line in calibration.jsonl in the session's folder, which the fit inherits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from documents.plain_data import parse_json
from documents.regular_file import read_regular
from fitting.calibration import code_width, level_bias
from fitting.result import SessionFit
from fitting.trial import Trial
from station.bench.check import Line, listen, show_lines
from station.bench.devices import load_cell_for
from station.bench.trial_recorder import MakeDevices
from station.clock import RealClock
from station.config import STANDARD_GRAVITY, StationConfig
from station.journal import LARGEST_JOURNAL, append_line

CHECKS_FILE = "calibration.jsonl"
LISTEN_S = 3.0
BLOCKS = 6
TOLERANCE = 0.01
"""Part of the weight by which a reading may be off, beside its uncertainty and the certificate's."""
ZERO_TOLERANCE = 0.05
"""Part of the cell's capacity that an empty cell may read: every fit leaves the zero free."""
COVERAGE = 3.0
"""Standard uncertainties, as they are told from few blocks."""


class KnownMassError(Exception):
    """The known mass cannot be read, or what was kept of it; one sentence."""


@dataclass(frozen=True)
class MassCheck:
    """One reading. found is without zero, the reading of the empty cell before it, which is 0 where there was none.

    mass [kg]; expected, found, sd (standard uncertainty of found), zero [N]; at: UTC as in the file
    """

    at: str
    mass: float
    expected: float
    found: float
    sd: float
    zero: float | None


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
    force, force_sd = _mean(cell.polarity * cell.newtons_per_unit * answers.force(), list(answers.errors.values()))
    zeros = [check for check in read_checks(folder) if check.mass == 0]
    zero = zeros[-1] if zeros and mass > 0 else None
    expected = mass * STANDARD_GRAVITY
    found, sd = (force - zero.found, math.hypot(force_sd, zero.sd)) if zero else (force, force_sd)
    said = {"mass_kg": mass, "expected_n": expected, "found_n": found, "u_n": sd}
    append_line(folder / CHECKS_FILE, "known_mass", **said, zero_n=zero.found if zero else None)
    allowed = COVERAGE * math.hypot(sd, cell.gain_relative_sd * expected)
    allowed += TOLERANCE * expected if mass else ZERO_TOLERANCE * config.load_cell.capacity_kg * STANDARD_GRAVITY
    good = abs(found - expected) <= allowed
    words = f"{found:.2f} ± {sd:.2f} N, expected {expected:.2f} ± {allowed:.2f} N"
    if mass and zero is None:
        words += "; the zero is in it, run with --known-mass 0 on the empty cell first"
    elif not good:
        words += "; check the mass, load_cell.capacity_kg, full_scale_v and polarity"
    return show_lines([Line(f"{mass:g} kg on the load cell", good, words)], console, as_json=as_json)


def read_checks(folder: Path) -> tuple[MassCheck, ...]:
    """The readings of a session, oldest first; a line torn by a power cut is passed over. Raises KnownMassError."""
    path = folder / CHECKS_FILE
    try:
        text = read_regular(path, LARGEST_JOURNAL).decode("utf-8")
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        raise KnownMassError(f"{path} cannot be read: {error}") from error
    checks = []
    for number, line in enumerate(text[: text.rfind("\n") + 1].split("\n")[:-1], 1):
        try:
            said = parse_json(line)
            zero = None if said["zero_n"] is None else float(said["zero_n"])
            mass, expected, found, sd = (float(said[key]) for key in ("mass_kg", "expected_n", "found_n", "u_n"))
            if mass > 0 and expected <= 0:
                raise ValueError(expected)
            checks.append(MassCheck(str(said["at"]), mass, expected, found, sd, zero))
        except (ValueError, TypeError, KeyError) as error:
            raise KnownMassError(f"{path}, line {number}: expected a known mass, found {line[:60]!r}") from error
    return tuple(checks)


def inherited(trials: Sequence[Trial], checks: Sequence[MassCheck]) -> list[Trial]:
    """The trials with half of the gain's drift in the uncertainty of their force's scale."""
    drifts = [(last.found - first.found) / first.expected for first, last in _drifted(checks) if first.mass > 0]
    half = max((abs(drift) for drift in drifts), default=0.0) / 2
    return [replace(trial, gain_sd=math.hypot(trial.gain_sd, half)) if half else trial for trial in trials]


def listed(fitted: SessionFit, checks: Sequence[MassCheck]) -> SessionFit:
    """The fit with every reading, and every drift between the first and the last of a mass, among its cuffs' notes."""
    notes = tuple(
        f"known mass {each.mass:g} kg read {each.found:.2f} ± {each.sd:.2f} N, of {each.expected:.2f} N ({each.at})"
        for each in checks
    ) + tuple(_drift_in_words(first, last) for first, last in _drifted(checks))
    donnings = {
        name: {donning: replace(fit, notes=fit.notes + notes) for donning, fit in fits.items()}
        for name, fits in fitted.donnings.items()
    }
    return replace(fitted, donnings=donnings)


def _drifted(checks: Sequence[MassCheck]) -> list[tuple[MassCheck, MassCheck]]:
    """The first and the last reading of each mass that differ by more than they are uncertain."""
    pairs = []
    for mass in sorted({check.mass for check in checks}):
        same = [check for check in checks if check.mass == mass and (check.zero is None) == (mass == 0)]
        if len(same) > 1 and abs(same[-1].found - same[0].found) > COVERAGE * math.hypot(same[0].sd, same[-1].sd):
            pairs.append((same[0], same[-1]))
    return pairs


def _drift_in_words(first: MassCheck, last: MassCheck) -> str:
    drift = last.found - first.found
    if first.mass == 0:
        return f"the load cell's zero drifted by {drift:+.2f} N between the first and last reading; fits leave it free"
    return (
        f"the load cell's gain drifted by {100 * drift / first.expected:+.2f} % between the first and last reading of "
        f"{first.mass:g} kg; half of it is in the uncertainty of the force"
    )


def _mean(force: NDArray[np.float64], errors: Sequence[str]) -> tuple[float, float]:
    """Of samples (n,) [N], with its standard uncertainty: from blocks, so that sway counts, and the codes."""
    if len(force) < BLOCKS:
        why = f": {'; '.join(errors)}" if errors else "; see with `station check` whether its device answers"
        raise KnownMassError(f"the load cell sent {len(force)} samples, expected at least {BLOCKS}{why}")
    blocks = [float(block.mean()) for block in np.array_split(force, BLOCKS)]
    codes = level_bias(code_width(force), float(force.std()))
    return float(force.mean()), math.hypot(float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS), codes)
