"""Readings of a known mass before and after a session: their uncertainty, the drift between them, and its effect.

`station check --known-mass` appends each reading to calibration.jsonl in the session's folder, where the fit reads it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures
from documents.plain_data import parse_json
from documents.regular_file import read_regular
from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode, NoteCode
from fitting.results.sentences import Note
from fitting.trial.calibration import code_width, level_bias
from recordings.standard_gravity import g

if TYPE_CHECKING:  # the recorder starts without the modules of a trial
    from fitting.trial.trial import Trial

CHECKS_FILE = "calibration.jsonl"
LARGEST_FILE = 16 << 20
"""Bytes."""
BLOCKS = 6
TOLERANCE = 0.01
"""Tolerated error, as part of the weight, in addition to the uncertainty of reading and certificate."""
ZERO_TOLERANCE = 0.05
"""Tolerated reading of the empty cell, as part of its capacity; every fit has a free zero."""
COVERAGE = 3.0
"""Coverage factor of the tolerance; the standard uncertainty is estimated from few blocks."""


class MassCheckError(CodedError):
    """A reading of a known mass is missing or cannot be read."""


@dataclass(frozen=True)
class MassCheck:
    """One reading of a known mass [kg].

    expected, found  [N]; found is without zero
    sd               [N] standard uncertainty of found
    zero             [N] previous reading of the empty cell, None without one
    at               UTC as in the file
    """

    at: str
    mass: float
    expected: float
    found: float
    sd: float
    zero: float | None

    def tolerance(self, gain_sd: float, capacity_kg: float) -> float:
        """Tolerated error [N], for a relative standard uncertainty of the scale and a capacity of the cell."""
        allowed = COVERAGE * math.hypot(self.sd, gain_sd * self.expected)
        return allowed + (TOLERANCE * self.expected if self.mass else ZERO_TOLERANCE * capacity_kg * g)

    def is_right(self, gain_sd: float, capacity_kg: float = 0.0) -> bool:
        """Whether the reading is within its tolerance; the capacity matters for the empty cell alone."""
        return abs(self.found - self.expected) <= self.tolerance(gain_sd, capacity_kg)


def evaluate_reading(force: NDArray[np.float64], mass: float, zero: MassCheck | None) -> MassCheck:
    """The reading of samples (n,) [N] under a mass [kg]; zero is that of the empty cell. Raises MassCheckError."""
    found, sd = _mean(force)
    if zero is not None:
        found, sd = found - zero.found, math.hypot(sd, zero.sd)
    return MassCheck("", mass, mass * g, found, sd, zero.found if zero else None)


def read_checks(folder: Path) -> tuple[MassCheck, ...]:
    """The readings of a session, oldest first. A last line cut by a power failure is ignored. Raises MassCheckError."""
    path = folder / CHECKS_FILE
    try:
        text = read_regular(path, LARGEST_FILE).decode("utf-8")
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        figures: Figures = {"file": str(path), "problem": str(error)}
        raise MassCheckError(FitErrorCode.CHECKS_UNREADABLE, figures) from error
    checks = []
    for number, line in enumerate(text[: text.rfind("\n") + 1].split("\n")[:-1], 1):
        try:
            entry = parse_json(line)
            zero = None if entry["zero_n"] is None else float(entry["zero_n"])
            mass, expected, found, sd = (float(entry[key]) for key in ("mass_kg", "expected_n", "found_n", "u_n"))
            if mass > 0 and expected <= 0:
                raise ValueError(expected)
            checks.append(MassCheck(str(entry["at"]), mass, expected, found, sd, zero))
        except (ValueError, TypeError, KeyError) as error:
            figures = {"file": str(path), "line": number, "found": repr(line[:60])}
            raise MassCheckError(FitErrorCode.CHECKS_INVALID, figures) from error
    return tuple(checks)


def with_mass_checks(trials: Sequence[Trial], checks: Sequence[MassCheck]) -> list[Trial]:
    """The trials with half of the drift of the gain in the uncertainty of their scale, and whether it was checked."""
    drifts = [(last.found - first.found) / first.expected for first, last in _drifted(checks) if first.mass > 0]
    half = max((abs(drift) for drift in drifts), default=0.0) / 2
    loaded = [check for check in checks if check.mass > 0 and check.zero is not None]

    def checked(trial: Trial) -> Trial:
        is_right = bool(loaded) and all(check.is_right(trial.gain_sd) for check in loaded)
        return replace(trial, gain_sd=math.hypot(trial.gain_sd, half), is_gain_checked=is_right)

    return [checked(trial) for trial in trials]


def check_notes(checks: Sequence[MassCheck]) -> tuple[Note, ...]:
    """Notes on every reading, and on the drift between the first and the last reading of a mass."""
    return (*map(_reading_note, checks), *(_drift_note(first, last) for first, last in _drifted(checks)))


def _drifted(checks: Sequence[MassCheck]) -> list[tuple[MassCheck, MassCheck]]:
    """First and last reading of every mass for which they differ significantly."""
    pairs = []
    for mass in sorted({check.mass for check in checks}):
        same = [check for check in checks if check.mass == mass and (check.zero is None) == (mass == 0)]
        if len(same) > 1 and abs(same[-1].found - same[0].found) > COVERAGE * math.hypot(same[0].sd, same[-1].sd):
            pairs.append((same[0], same[-1]))
    return pairs


def _reading_note(check: MassCheck) -> Note:
    figures: Figures = {
        "mass_kg": check.mass,
        "found_n": check.found,
        "standard_error_n": check.sd,
        "expected_n": check.expected,
        "at": check.at,
    }
    return Note(NoteCode.KNOWN_MASS, figures)


def _drift_note(first: MassCheck, last: MassCheck) -> Note:
    drift = last.found - first.found
    if first.mass == 0:
        return Note(NoteCode.KNOWN_MASS_ZERO_DRIFT, {"drift_n": drift})
    return Note(NoteCode.KNOWN_MASS_GAIN_DRIFT, {"drift": drift / first.expected, "mass_kg": first.mass})


def _mean(force: NDArray[np.float64]) -> tuple[float, float]:
    """Mean of samples (n,) [N] and its standard uncertainty, from block means (which include sway) and quantisation."""
    if len(force) < BLOCKS:
        raise MassCheckError(FitErrorCode.CHECK_SHORT, {"samples": len(force), "expected": BLOCKS})
    blocks = [float(block.mean()) for block in np.array_split(force, BLOCKS)]
    codes = level_bias(code_width(force), float(force.std()))
    return float(force.mean()), math.hypot(float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS), codes)
