"""Findings on a pose or a motion of the wearer: visible markers, stillness or cycles, force of the cord, EMG."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from documents.interval import rounded
from fitting.emg.channels import UNUSABLE, UnusableEmg, find_faults
from fitting.errors import UnusableTrial
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.errors import RecordingError
from solver.scaling import largest_motion
from station.emg.emg_json import FINDING_TEXT
from station.emg.trials import EmgFileError, emg_of
from station.kinematics.marker_checks import MOVING
from station.messages.codes import ReasonCode
from station.messages.message import Message
from station.report.wearer_section import motion_drawing
from station.session.judgement import notes_at_the_bench

MOST_HIDDEN = 0.1
"""Part of the frames in which a marker may be hidden."""


@dataclass(frozen=True)
class WearerFindings:
    """reasons to repeat the trial; quantities as text by name and unit; marks is the number of the operator's marks;
    drawing: the figure of a motion as HTML, as the report has it.
    """

    reasons: tuple[Message[ReasonCode], ...]
    quantities: Mapping[str, str]
    notes: tuple[str, ...]
    marks: int
    drawing: str = ""


def examine_wearer_trial(path: Path) -> WearerFindings:
    """Raises UnusableTrial and RecordingError."""
    trial = read_wearer_trial(path)
    parts = (_markers(trial), _pose(trial), _motion(trial), _cord(trial), _emg(trial))
    return WearerFindings(
        tuple(reason for part in parts for reason in part.reasons),
        {name: text for part in parts for name, text in part.quantities.items()},
        (*notes_at_the_bench(trial.notes), *(note for part in parts for note in part.notes)),
        trial.marks,
        motion_drawing(path, trial) if trial.manifest.test == "motion" else "",
    )


EMG_BLOCK_S = 0.05
"""Seconds of one RMS of the EMG, as a running trial shows it."""


def largest_emg(path: Path) -> dict[str, float]:
    """Largest RMS of every EMG channel with a signal [µV]; empty if the recording has no usable EMG."""
    try:
        emg = emg_of(read_wearer_trial(path))
    except (UnusableTrial, RecordingError, EmgFileError):
        return {}
    length = max(1, round(EMG_BLOCK_S * emg.rate))
    blocks = emg.values[: len(emg.values) // length * length].reshape(-1, length, len(emg.labels))
    spreads = np.std(blocks, axis=1)
    largest = 1e6 * np.max(spreads, axis=0, initial=0.0, where=np.isfinite(spreads))
    return {label: round(float(uv), 1) for label, uv in zip(emg.labels, largest, strict=True) if uv > 0}


def _found(
    *reasons: Message[ReasonCode], quantities: Mapping[str, str] | None = None, notes: tuple[str, ...] = ()
) -> WearerFindings:
    return WearerFindings(reasons, quantities or {}, notes, 0)


def _markers(trial: WearerTrial) -> WearerFindings:
    hidden = trial.hidden()
    worst = max(hidden, key=lambda label: hidden[label])
    quantities = {"duration [s]": rounded(float(trial.time[-1]), 1)}
    if hidden[worst] > 0:
        quantities["frames without marker"] = f"{100 * hidden[worst]:.1f} % ({worst})"
    named = ", ".join(label for label, part in hidden.items() if part > MOST_HIDDEN)
    if not named:
        return _found(quantities=quantities)
    figures: dict[str, float | str] = {"markers": named, "limit_percent": 100 * MOST_HIDDEN}
    return _found(Message(ReasonCode.MARKERS_HIDDEN, figures), quantities=quantities)


def _pose(trial: WearerTrial) -> WearerFindings:
    if trial.manifest.test != "pose":
        return _found()
    places = trial.markers[:, [trial.labels.index(label) for label in trial.body.body]]
    marker, moved = largest_motion(trial.body.body, places)
    quantities = {"largest movement [mm]": f"{rounded(1e3 * moved, 1)} ({marker})"}
    if moved <= MOVING:
        return _found(quantities=quantities)
    figures: dict[str, float | str] = {"marker": marker, "range_mm": 1e3 * moved, "highest_mm": 1e3 * MOVING}
    return _found(Message(ReasonCode.POSE_MOVES, figures), quantities=quantities)


def _motion(trial: WearerTrial) -> WearerFindings:
    if trial.manifest.test != "motion" or trial.elevation is None or not np.isfinite(trial.elevation).any():
        return _found()
    quantities = {"elevation [deg]": _range(np.degrees(trial.elevation))}
    if trial.manifest.condition == "mvc":
        return _found(quantities=quantities)
    found, planned = len(trial.cycles), trial.manifest.protocol.cycles
    quantities["cycles"] = f"{found}" if planned is None else f"{found} of {planned}"
    if planned is None or found >= planned:
        return _found(quantities=quantities)
    return _found(Message(ReasonCode.CYCLES_MISSING, {"found": found, "planned": planned}), quantities=quantities)


def _cord(trial: WearerTrial) -> WearerFindings:
    if not trial.body.is_cord_measured or not len(trial.force):
        return _found()
    return _found(quantities={"cord force, zero not removed [N]": _range(trial.force)})


def _emg(trial: WearerTrial) -> WearerFindings:
    if trial.manifest.emg is None:
        return _found()
    try:
        emg = emg_of(trial)
        faults = dict(zip(emg.labels, find_faults(emg.values, emg.rate), strict=True))
    except EmgFileError as error:
        return _found(Message(ReasonCode.NO_EMG_CLOCK, {"text": str(error)}))
    except UnusableEmg as error:
        return _found(notes=(str(error),))
    rms = 1e6 * np.nanstd(emg.values, axis=0)
    texts = [(label, fault, FINDING_TEXT[fault]) for label, found in faults.items() for fault in found]
    return _found(
        *(
            Message(ReasonCode.EMG_UNUSABLE, {"channel": label, "finding": fault.value, "text": text})
            for label, fault, text in texts
            if fault in UNUSABLE
        ),
        quantities={f"EMG {label} RMS [\u00b5V]": rounded(uv, 0) for label, uv in zip(emg.labels, rms, strict=True)},
        notes=tuple(f"EMG {label}: {text}" for label, fault, text in texts if fault not in UNUSABLE),
    )


def _range(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return f"{rounded(float(np.nanmin(values)), 0)} to {rounded(float(np.nanmax(values)), 0)}"
