"""What a recording says, in one screen: its own figures, those of the session so far, and whether to keep it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fitting.bounce import BounceTrial, fit_bounce
from fitting.curves import TrialCurves
from fitting.outlying import SLIPPED, find_outliers, has_slipped
from fitting.quality import UnusableTrial, zero_notes
from fitting.result import CuffFit, SessionFit, TrialFit
from fitting.results.codes import Verdict
from fitting.results.rendering import sentence_of
from fitting.trial import RejectedTrial
from fitting.uncertainty import Estimate
from recordings.errors import RecordingError
from station.fit import SessionError, fit_donning_of, read_recording
from station.interval import bracketed, digits_of, rounded
from station.journal import Choice, JournalError, Recorded, read_journal

Grade = Literal["good", "doubtful", "bad"]
REMEDIES = {
    "static": "load the cuff to every step",
    "dynamic": "pull the spring about once a second for the whole test",
}
"""What is to be done differently where a trial gives nothing."""
SHOWN_POINTS = 400


@dataclass(frozen=True)
class Row:
    """One quantity in words: of this trial, of the earlier repeats, and of the donning with this trial in it."""

    quantity: str
    this: str
    earlier: str
    so_far: str


@dataclass(frozen=True)
class Figure:
    """One quantity of this trial with its 95 % interval, in the unit that its name ends with; SI."""

    quantity: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Judgement:
    """advice is what the figures speak for, and reasons say why; the operator decides.

    path is (displacement mm, force N) to draw, marks the numbers of the moments that were marked. doubts are what this
    recording should have told of its donning and did not.
    """

    file: str
    title: str
    advice: Choice
    reasons: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    path: tuple[tuple[float, float], ...]
    marks: int
    figures: tuple[Figure, ...] = ()
    doubts: tuple[str, ...] = ()

    @property
    def grade(self) -> Grade:
        """good only where everything was checked and is right."""
        if self.advice == "redo":
            return "bad"
        return "doubtful" if self.reasons or self.doubts or not self.rows else "good"


QUANTITIES = {
    "stiffness": ("k", 1.0, "N/m", 0),
    "damping": ("c", 1.0, "N s/m", 1),
    "migration": ("migration", 1e3, "mm", 2),
}
SI_NAMES = {"stiffness": "stiffness_n_per_m", "damping": "damping_n_s_per_m", "migration": "migration_m"}


def be_ready() -> None:
    """Importing this module is what takes a worker's time."""


def judge_recording(folder: Path, file: str) -> Judgement:
    """Fit the donning with this recording in it. Never raises: what goes wrong is told, and the recording is safe."""
    marks = 0
    try:
        journal = read_journal(folder)
        recorded = {entry.file: entry for entry in journal.recorded}.get(file)
        reading = read_recording(folder / file)
        marks = reading.marks
        if isinstance(reading, BounceTrial):
            return _judge_bounce(reading, recorded)
        if isinstance(reading, RejectedTrial):
            return Judgement(file, _title(recorded, file), "redo", (reading.reason,), (), (), (), marks)
        fitted = fit_donning_of(folder, reading)
    except (SessionError, JournalError, RecordingError, UnusableTrial) as error:
        return Judgement(file, file, "redo", (str(error),), (), (), (), marks)
    except Exception as error:  # a fault of ours must not hold the operator up
        words = f"the fit failed on it ({type(error).__name__}: {error}); the recording is stored, keep it and tell us"
        return Judgement(file, file, "accept", (words,), (), (), (), marks)
    rejected = [trial.reason for trial in fitted.rejected if trial.file == file]
    of_trial, of_cuff = _find(fitted, file)
    if of_trial is None or of_cuff is None:
        reasons = tuple(rejected) or ("the fit makes no use of this recording",)
        advice: Choice = "redo" if rejected else "accept"
        return Judgement(file, _title(recorded, file), advice, reasons, (), (), (), marks)
    others = [
        each for each in of_cuff.trials if each.test == of_trial.test and each.file != file and each.state == "used"
    ]
    curves = fitted.curves.get(file)
    moved = () if curves is None else zero_notes(of_trial.zero_drift, float(np.ptp(curves.force)))
    reasons = (*_against(recorded, of_trial, others), *moved)
    return Judgement(
        file=file,
        title=_title(recorded, file),
        advice="redo" if reasons else "accept",
        reasons=reasons,
        rows=tuple(_rows(of_trial, others, of_cuff)),
        notes=(
            *(note for note in of_trial.notes if note not in reasons),
            *map(str, of_cuff.notes),
            *(f"so far: {sentence_of(verdict)}" for verdict in of_cuff.verdicts),
        ),
        path=_path(curves),
        marks=marks,
        figures=_figures({name: getattr(of_trial, field) for field, name in SI_NAMES.items()}),
        doubts=_doubts(of_trial, of_cuff),
    )


def unjudged(file: str) -> Judgement:
    """Of a recording whose fit was killed each time: the operator decides by what was seen."""
    words = "the fit of it was killed twice, as a system does that is short of memory; the recording is stored"
    return Judgement(file, file, "accept", (words,), (), (), (), 0)


def _judge_bounce(bounce: BounceTrial, recorded: Recorded | None) -> Judgement:
    """Raises UnusableTrial where the bounce calibrates nothing."""
    fit = fit_bounce(bounce)
    figures = {"lag [ms]": (fit.lag, 1e3), "gain": (fit.gain, 1.0), "zero [N]": (fit.zero, 1.0)}
    rows = tuple(Row(name, _words(found.estimate, scale), "-", "-") for name, (found, scale) in figures.items())
    measured = _figures({"lag_s": fit.lag.estimate, "gain": fit.gain.estimate, "zero_n": fit.zero.estimate})
    title = _title(recorded, bounce.file)
    return Judgement(bounce.file, title, "accept", (), rows, fit.notes, (), bounce.marks, measured)


def _figures(estimates: Mapping[str, Estimate | None]) -> tuple[Figure, ...]:
    return tuple(Figure(name, each.value, *each.ci95) for name, each in estimates.items() if each is not None)


def _find(fitted: SessionFit, file: str) -> tuple[TrialFit | None, CuffFit | None]:
    for donnings in fitted.donnings.values():
        for cuff in donnings.values():
            for trial in cuff.trials:
                if trial.file == file:
                    return trial, cuff
    return None, None


def _against(recorded: Recorded | None, trial: TrialFit, others: Sequence[TrialFit]) -> tuple[str, ...]:
    """Everything that speaks against keeping this recording."""
    reasons = []
    if recorded is not None and not recorded.accepted:
        reasons.append(recorded.sentence)
    if recorded is not None and recorded.lost_samples:
        reasons.append(f"{recorded.lost_samples} samples were lost on the way")
    if trial.state == "unusable":
        reasons.append(trial.reason)
    elif not any(getattr(trial, name) for name in ("stiffness", "damping")):
        reasons.append(f"this {trial.test} trial gives neither stiffness nor damping; {REMEDIES[trial.test]}")
    if trial.migration is not None and has_slipped(trial):
        reasons.append(
            f"the cuff slipped by {1e3 * trial.migration.value:.0f} mm in this trial, more than any cuff should "
            f"({1e3 * SLIPPED:.0f} mm); tighten its straps, don it anew and redo it"
        )
    for outlier in find_outliers(trial, others):
        symbol, scale, unit, digits = QUANTITIES[outlier.quantity]
        reasons.append(
            f"{symbol} is {rounded(scale * outlier.value, digits)} {unit}, the earlier repeats say "
            f"{rounded(scale * outlier.mean, digits)}: {outlier.distance:.0f} standard errors apart"
        )
    return tuple(reasons)


def _doubts(trial: TrialFit, cuff: CuffFit) -> tuple[str, ...]:
    """What is not identified of the donning so far, but for the damping that no dynamic trial has told yet."""
    to_come = (Verdict.NO_DYNAMIC,) if trial.test == "static" else ()
    found = (verdict for verdict in cuff.verdicts if verdict not in (Verdict.IDENTIFIED, *to_come))
    return tuple(map(sentence_of, found))


def _rows(trial: TrialFit, others: Sequence[TrialFit], cuff: CuffFit) -> list[Row]:
    rows = []
    for name, (symbol, scale, unit, _) in QUANTITIES.items():
        earlier = [getattr(each, name) for each in others if getattr(each, name) is not None]
        words = [
            _words(getattr(trial, name), scale),
            ", ".join(rounded(scale * each.value, digits_of(each.ci95, scale)) for each in earlier),
        ]
        rows.append(Row(f"{symbol} [{unit}]", words[0], words[1] or "-", _words(getattr(cuff, name), scale)))
    return rows


def _words(estimate: Estimate | None, scale: float) -> str:
    return "-" if estimate is None else bracketed(estimate.value, estimate.ci95, scale)


def _title(recorded: Recorded | None, file: str) -> str:
    if recorded is None:
        return file
    return f"{recorded.cuff or 'load cell'}, {recorded.test}, repeat {recorded.repeat}"


def _path(curves: TrialCurves | None) -> tuple[tuple[float, float], ...]:
    """Force over displacement, evenly thinned."""
    if curves is None:
        return ()
    force: NDArray[np.float64] = np.interp(curves.marker_time, curves.force_time, curves.force)
    seen = np.flatnonzero(np.isfinite(curves.displacement) & np.isfinite(force))
    chosen = (
        seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), SHOWN_POINTS)).astype(int))] if len(seen) else seen
    )
    return tuple((round(1e3 * float(curves.displacement[i]), 3), round(float(force[i]), 3)) for i in chosen)
