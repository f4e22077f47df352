"""The judgement of one recording, from the fit of its donning or the findings on its wearer.

If a trial of a cuff or a bounce ended before the last step of its guide, that is the cause of its verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import bracketed, rounded, significant_decimals
from documents.message import Code, Message, because
from fitting.cuffs.cuff_fit import SLIPPED, CuffFit, SessionFit, TrialFit, find_outliers, has_slipped
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.diagnosis.identification import FittedPull
from fitting.emg.channels import UNUSABLE, UnusableEmg, find_faults
from fitting.errors import UnusableTrial
from fitting.results.codes import EXPLAINED_BY, NoteCode, Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode
from fitting.trial.bounce import BounceTrial, fit_bounce
from fitting.trial.timeline import zero_notes
from fitting.trial.trial import RejectedTrial, Trial
from fitting.uncertainty import Estimate
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.errors import RecordingError
from recordings.manifest import MeasurementProtocol, TestKind
from recordings.reader import Recording, open_recording
from station.config import ProtocolSection
from station.cuff_text import SHOWN
from station.emg.trials import EmgFileError, extract_emg
from station.fit import SessionError, fit_trial_donning, read_recording
from station.journal import Choice, JournalError, Recorded, read_journal
from station.messages.bench_messages import TrialCode
from station.messages.emg_messages import FINDING_TEXT
from station.messages.session_messages import ReasonCode
from station.protocol import BODY_TESTS, describe_trial
from station.session.guide import Cue, guide_for
from station.session.judgement import MISSING, Judgement, Reason, Row, TrialQuantity, notes_at_the_bench

NO_RESULT = {"static": ReasonCode.NO_STATIC_RESULT, "dynamic": ReasonCode.NO_DYNAMIC_RESULT}
LOADS_MISSING: Mapping[Code, ReasonCode] = {
    NoteCode.STOPPED_LOADING: ReasonCode.WEIGHTS_MISSING,
    NoteCode.HIDDEN_LOADS: ReasonCode.LOADS_HIDDEN,
    NoteCode.STOPPED_UNLOADING: ReasonCode.UNLOADING_MISSING,
}
SWINGING_ENDED: Mapping[Code, ReasonCode] = {
    NoteCode.STOPPED_SWINGING: ReasonCode.SWING_SHORT,
    NoteCode.SWING_CUT: ReasonCode.SWING_CUT,
}
GENERAL = (*NO_RESULT.values(), ReasonCode.UNUSABLE)
"""Reasons that state a consequence where the trial ended before its last step."""
SHOWN_POINTS = 400
POINT_S = 0.05
MOST_HIDDEN = 0.1
"""Part of the frames in which a marker may be hidden."""
EMG_BLOCK_S = 0.05
"""Seconds of one RMS of the EMG, as a running trial shows it."""


def judge_recording(folder: Path, file: str) -> Judgement:
    """Fit the donning that includes this recording, or examine the wearer's trial.

    Never raises: an error is a reason, and the recording is safe. Reasons of the recorder come first, because the
    others may follow from them, as a bounce that is too short where the disk was full. Those of a trial whose recorder
    was killed do follow from that, and are notes: they would ask the operator to load the cuff in another way.
    """
    try:
        recorded = {entry.file: entry for entry in read_journal(folder).recorded}.get(file)
    except JournalError as error:
        return Judgement(file, file, "redo", (_unusable(error),))
    judgement = _judge(folder, file, recorded)
    reasons = tuple(_recorder_reasons(recorded))
    if recorded is None or not reasons:
        return _led_by_cause(judgement, recorded, folder / file) if recorded is not None else judgement
    notes = tuple(note for note in judgement.notes if note not in map(str, reasons))
    details = _details_of_kill(recorded)
    if details is not None:
        notes = (details, *map(str, judgement.reasons), *judgement.doubts, *notes)
        return replace(
            judgement, advice="redo", reasons=reasons, notes=tuple(filter(None, notes)), verdicts=(), causes=()
        )
    of_fit = (one for one in judgement.reasons if one.figures.get("reason_code") != RejectionCode.NOT_ACCEPTED)
    return replace(judgement, advice="redo", reasons=(*reasons, *of_fit), notes=notes)


def _judge(folder: Path, file: str, recorded: Recorded | None) -> Judgement:
    """Without the reasons of the recorder."""
    marks = 0
    try:
        if recorded is not None and recorded.test in BODY_TESTS:
            return _judge_wearer(examine_wearer_trial(folder / file), recorded)
        reading = read_recording(folder / file)
        marks = reading.marks
        if not isinstance(reading, Trial):
            return _judge_unfitted(reading, recorded)
        fitted = fit_trial_donning(folder, reading)
    except (SessionError, JournalError, RecordingError, UnusableTrial) as error:
        return Judgement(file, _title(recorded, file), "redo", (_unusable(error),), marks=marks)
    except Exception as error:  # an unexpected error must not stop the operator
        reason = Message(ReasonCode.FIT_FAILED, {"reason": f"{type(error).__name__}: {error}"})
        return Judgement(file, _title(recorded, file), "accept", (reason,), marks=marks)
    trial, cuff = _find(fitted, file)
    if trial is None or cuff is None:
        rejected = tuple(_unusable(trial.reason) for trial in fitted.rejected if trial.file == file)
        advice: Choice = "redo" if rejected else "accept"
        return Judgement(file, _title(recorded, file), advice, rejected or (Message(ReasonCode.NOT_USED),), marks=marks)
    return _judge_trial(trial, cuff, recorded, fitted.pulls.get(file), marks)


def _led_by_cause(judgement: Judgement, recorded: Recorded, path: Path) -> Judgement:
    """Replace reasons and doubts by the step at which the trial ended, where they follow from it.

    The fit counts the weights if it can, so that this verdict and those of later trials state the same number.
    """
    own = [_as_reason(note) for note in judgement.causes if note.figures["file"] == judgement.file]
    is_loaded = recorded.test == "static" and Verdict.NOT_UNLOADED in judgement.verdicts
    if not own and not is_loaded and not any(reason.code in GENERAL for reason in judgement.reasons):
        return judgement
    try:
        cause = own[0] if own else find_unfinished(path)
    except RecordingError:
        return judgement
    if cause is None:
        return judgement
    others = tuple(reason for reason in judgement.reasons if reason.code not in GENERAL)
    general = (reason for reason in judgement.reasons if reason.code in GENERAL)
    followed = (*map(str, general), *(verdict.sentence() for verdict in judgement.verdicts))
    notes = (*followed, *judgement.notes)
    return replace(judgement, advice="redo", reasons=(cause, *others), notes=notes, verdicts=(), causes=())


def _as_reason(note: Note) -> Reason:
    """The reason to redo the trial that the fit found to have ended early."""
    figures = note.figures
    if note.code in SWINGING_ENDED:
        return Message(SWINGING_ENDED[note.code], {name: figures[name] for name in ("found_s", "planned_s")})
    return Message(LOADS_MISSING[note.code], {"found": figures["count"], "planned": figures["total"]})


def _judge_trial(
    trial: TrialFit, cuff: CuffFit, recorded: Recorded | None, fitted: FittedPull | None, marks: int
) -> Judgement:
    others = [
        other
        for other in cuff.trials
        if other.test == trial.test and other.file != trial.file and other.state == "used"
    ]
    zero = () if fitted is None else zero_notes(trial.zero_drift, float(np.ptp(fitted.pull.force)))
    reasons = (*_reasons(trial, cuff, others), *(Message(ReasonCode.ZERO_DRIFT, because(note)) for note in zero))
    shown = set(map(str, reasons))
    return Judgement(
        file=trial.file,
        title=_title(recorded, trial.file),
        advice="redo" if reasons else "accept",
        reasons=reasons,
        rows=tuple(_rows(trial, others, cuff)),
        notes=(
            *(note for note in notes_at_the_bench(trial.notes) if note not in shown),
            *notes_at_the_bench(cuff.notes, trial.test),
        ),
        path=_path(fitted),
        marks=marks,
        figures=_figures({name: getattr(trial, field) for field, name in QUANTITIES.items()}),
        verdicts=_open_verdicts(trial, cuff),
        causes=tuple(note for note in cuff.notes if note.code in EXPLAINED_BY),
    )


def _judge_unfitted(reading: BounceTrial | RejectedTrial, recorded: Recorded | None) -> Judgement:
    """Raises UnusableTrial if a bounce calibrates nothing."""
    if isinstance(reading, BounceTrial):
        return _judge_bounce(reading, recorded)
    title, reason = _title(recorded, reading.file), _unusable(reading.reason)
    return Judgement(reading.file, title, "redo", (reason,), marks=reading.marks)


def _judge_bounce(bounce: BounceTrial, recorded: Recorded | None) -> Judgement:
    """Raises UnusableTrial if the bounce calibrates nothing."""
    fit = fit_bounce(bounce)
    figures = {"lag_s": fit.lag.estimate, "gain": fit.gain.estimate, "zero_n": fit.zero.estimate}
    shown = zip(("lag [ms]", "gain", "zero [N]"), figures.values(), (1e3, 1.0, 1.0), strict=True)
    rows = tuple(
        Row(name, bracketed(found.value, found.ci95, scale, 9, is_limited=True), MISSING, MISSING)
        for name, found, scale in shown
    )
    title, notes = _title(recorded, bounce.file), notes_at_the_bench(fit.notes)
    return Judgement(bounce.file, title, "accept", (), rows, notes, marks=bounce.marks, figures=_figures(figures))


def _judge_wearer(findings: WearerFindings, recorded: Recorded) -> Judgement:
    return Judgement(
        recorded.file,
        _title(recorded, recorded.file),
        "redo" if findings.reasons else "accept",
        findings.reasons,
        tuple(Row(quantity, text, MISSING, MISSING) for quantity, text in findings.quantities.items()),
        findings.notes,
        marks=findings.marks,
        drawing=findings.drawing,
    )


def _unusable(cause: object) -> Reason:
    return Message(ReasonCode.UNUSABLE, because(cause))


def _figures(estimates: Mapping[str, Estimate | None]) -> tuple[TrialQuantity, ...]:
    return tuple(
        TrialQuantity(name, estimate.value, *estimate.ci95)
        for name, estimate in estimates.items()
        if estimate is not None
    )


def _find(fitted: SessionFit, file: str) -> tuple[TrialFit | None, CuffFit | None]:
    for donnings in fitted.donnings.values():
        for cuff in donnings.values():
            for trial in cuff.trials:
                if trial.file == file:
                    return trial, cuff
    return None, None


def _reasons(trial: TrialFit, cuff: CuffFit, others: Sequence[TrialFit]) -> Iterator[Reason]:
    """Reasons to repeat this trial."""
    # An uncertain lag is the same in a repeated trial: only a bounce helps, as the verdict says.
    has_open_lag = trial.test == "dynamic" and Verdict.LAG in cuff.verdicts
    if trial.state == "unusable":
        yield _unusable(trial.reason)
    elif trial.stiffness is None and trial.damping is None and not has_open_lag:
        yield Message(NO_RESULT[trial.test])
    if trial.migration is not None and has_slipped(trial):
        yield Message(ReasonCode.SLIPPED, {"slip_mm": 1e3 * trial.migration.value, "limit_mm": 1e3 * SLIPPED})
    for outlier in () if has_open_lag else find_outliers(trial, others):
        shown = SHOWN[outlier.quantity]
        value, mean = (rounded(shown.scale * one, shown.most_digits) for one in (outlier.value, outlier.mean))
        figures = {"symbol": shown.symbol, "value": value, "mean": mean, "unit": shown.unit}
        yield Message(ReasonCode.OUTLIER, {**figures, "distance": outlier.distance})


def _recorder_reasons(recorded: Recorded | None) -> Iterator[Reason]:
    if recorded is not None and not recorded.accepted:
        yield Message(ReasonCode.NOT_ACCEPTED, {"reason": recorded.sentence})
    if recorded is not None and recorded.lost_samples:
        yield Message(ReasonCode.LOST_SAMPLES, {"samples": recorded.lost_samples})


def _details_of_kill(recorded: Recorded | None) -> str | None:
    """Recovered part of the file of a killed recorder; None if it was not killed."""
    killed = [] if recorded is None else [code for code in recorded.codes if code.code is TrialCode.RECORDER_KILLED]
    return str(killed[0].figures.get("details", "")) if killed else None


def _open_verdicts(trial: TrialFit, cuff: CuffFit) -> tuple[Verdict, ...]:
    """Results of the donning that are not identified so far; after a static trial the dynamic one is still to come."""
    to_come = (Verdict.NO_DYNAMIC,) if trial.test == "static" else ()
    return tuple(verdict for verdict in cuff.verdicts if verdict not in (Verdict.IDENTIFIED, *to_come))


def _rows(trial: TrialFit, others: Sequence[TrialFit], cuff: CuffFit) -> list[Row]:
    rows = []
    for name, shown in SHOWN.items():
        scale, most = shown.scale, shown.most_digits
        earlier = [getattr(other, name) for other in others if getattr(other, name) is not None]
        listed = ", ".join(
            rounded(scale * estimate.value, min(most, significant_decimals(estimate.ci95, scale)))
            for estimate in earlier
        )
        this, so_far = (shown.text(getattr(fit, name), MISSING) for fit in (trial, cuff))
        rows.append(Row(shown.heading, this, listed or MISSING, so_far))
    return rows


def _title(recorded: Recorded | None, file: str) -> str:
    if recorded is None:
        return file
    return describe_trial(recorded.cuff, recorded.test, recorded.repeat, recorded.condition)


def _path(fitted: FittedPull | None) -> tuple[tuple[float, float], ...]:
    """Force over displacement, decimated evenly."""
    if fitted is None:
        return ()
    pull = fitted.pull
    force: NDArray[np.float64] = np.interp(pull.marker_time, pull.force_time, pull.force)
    seen = np.flatnonzero(np.isfinite(pull.displacement) & np.isfinite(force))
    if not len(seen):
        return ()
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), SHOWN_POINTS)).astype(int))]
    return tuple((round(1e3 * float(pull.displacement[i]), 3), round(float(force[i]), 3)) for i in chosen)


def find_unfinished(path: Path) -> Message[ReasonCode] | None:
    """The step at which the recorded trial ended; None for a whole one. Raises RecordingError."""
    recording = open_recording(path)
    return unfinished_step(recording.manifest.test, recording.manifest.protocol, _force(recording))


def unfinished_step(
    test: TestKind, planned: MeasurementProtocol, force: Iterable[tuple[float, float]]
) -> Message[ReasonCode] | None:
    """The step at which the force (s, N) of a trial ended; None after the last step, and if no steps are planned."""
    if test == "static" and not planned.step_masses_kg:
        return None
    known = {"step_masses_kg": planned.step_masses_kg, "hold_s": planned.hold_s, "swing_s": planned.swing_s}
    protocol = ProtocolSection.model_validate({name: value for name, value in known.items() if value is not None})
    guide = guide_for(test, protocol)
    guide.update(force)
    return _static(guide.cue()) if test == "static" else _swing(guide.cue(), protocol.swing_s)


def _static(cue: Cue) -> Message[ReasonCode] | None:
    if cue.is_done:
        return None
    weights, held = (cue.steps - 1) // 2, max(cue.step - 1, 0)
    if held < weights:
        return Message(ReasonCode.WEIGHTS_MISSING, {"found": held, "planned": weights})
    return Message(ReasonCode.UNLOADING_MISSING, {"found": held - weights, "planned": weights})


def _swing(cue: Cue, swing_s: float) -> Message[ReasonCode] | None:
    if cue.step > 1:
        return None
    swung_s = swing_s - cue.left_s if cue.step == 1 and cue.left_s is not None else 0.0
    return Message(ReasonCode.SWING_SHORT, {"found_s": swung_s, "planned_s": swing_s})


def _force(recording: Recording) -> list[tuple[float, float]]:
    track, cell = recording.load("/force"), recording.manifest.load_cell
    if not len(track.values):
        return []
    seconds = (track.device_time_ns - track.device_time_ns[0]) * 1e-9
    chosen = np.unique(np.searchsorted(seconds, np.arange(0.0, float(seconds[-1]), POINT_S)))
    scale = cell.polarity * cell.newtons_per_unit
    return [(float(seconds[at]), scale * float(track.values[at].flat[0])) for at in chosen]


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
    drawing = ""
    if trial.manifest.test == "motion":
        from station.report.wearer_section import motion_drawing  # report and solver: trials of cuffs need neither

        drawing = motion_drawing(path, trial)
    return WearerFindings(
        tuple(reason for part in parts for reason in part.reasons),
        {name: text for part in parts for name, text in part.quantities.items()},
        (*notes_at_the_bench(trial.notes), *(note for part in parts for note in part.notes)),
        trial.marks,
        drawing,
    )


def largest_emg(path: Path) -> dict[str, float]:
    """Largest RMS of every EMG channel with a signal [µV]; empty if the recording has no usable EMG."""
    try:
        emg = extract_emg(read_wearer_trial(path))
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
    from solver.scaling import largest_motion  # as above
    from station.kinematics.marker_checks import MOVING

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
        emg = extract_emg(trial)
        faults = dict(zip(emg.labels, find_faults(emg.values, emg.rate), strict=True))
    except EmgFileError as error:
        return _found(Message(ReasonCode.NO_EMG_CLOCK, because(error)))
    except UnusableEmg as error:
        return _found(notes=(str(error),))
    rms = 1e6 * np.nanstd(emg.values, axis=0)
    texts = [(label, fault, FINDING_TEXT[fault]) for label, found in faults.items() for fault in found]
    return _found(
        *(
            Message(ReasonCode.EMG_UNUSABLE, {"channel": label, "finding": fault.value, "reason": text})
            for label, fault, text in texts
            if fault in UNUSABLE
        ),
        quantities={f"EMG {label} RMS [\u00b5V]": rounded(uv, 0) for label, uv in zip(emg.labels, rms, strict=True)},
        notes=tuple(f"EMG {label}: {text}" for label, fault, text in texts if fault not in UNUSABLE),
    )


def _range(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return f"{rounded(float(np.nanmin(values)), 0)} to {rounded(float(np.nanmax(values)), 0)}"
