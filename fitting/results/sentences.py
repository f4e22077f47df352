"""Sentences of all codes, with their figures; those on a trial are in trial_sentences.py. Programs use the codes.

A template shows an SI figure in the unit that it names: `{shift_m:mm .2f}`. A template of several clauses shows those
clauses whose figures are given.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any

from documents.interval import CountingFormatter
from fitting.results.codes import (
    EXPLAINED_BY,
    CauseCode,
    FindingCode,
    FitErrorCode,
    NoteCode,
    RejectionCode,
    TensorCode,
    TrialNoteCode,
    Verdict,
)
from fitting.results.trial_sentences import GAIN_MISTAKES, REJECTIONS, TENSORS, TRIAL_NOTES, Templates

_ZEROS = "k and c are not affected, as each record has its own zero"
_TANGENT = "k is the mean slope; read the tangent at the load that matters (exponential_law in cuffs.json)"
_WITH_LOAD = (
    " with the load, from {lowest_n_per_m:.0f} N/m at the lowest to {highest_n_per_m:.0f} N/m at the highest held load"
)
_EXPLAINS = "{law} explains {gain:percent .0f} % of the residual of a spring and a damper; "

_VERDICTS: Templates = {
    Verdict.IDENTIFIED: "stiffness, damping and migration are identified",
    Verdict.GIVEN: "the figures are given, not fitted",
    Verdict.NO_STATIC: "stiffness and migration are not identified: there is no usable static trial; record one",
    Verdict.FEW_LOADS: "stiffness is not identified: fewer than three loads were held; hold each load for at least 4 s",
    Verdict.ONLY_ROSE: (
        "stiffness is not identified: the load only rose, and the loads are not on a line, so the cuff may have "
        "slipped; remove the weights before the capture ends"
    ),
    Verdict.STIFFNESS_UNCERTAIN: (
        "stiffness is not identified: its interval is wider than its value; hang on more weight"
    ),
    Verdict.STIFFNESS_NOT_CONVERGED: (
        "stiffness is not identified: the fit did not converge; check the held loads in the report, and record again"
    ),
    Verdict.DAMPING_NOT_CONVERGED: (
        "damping is not identified: the fit did not converge; check the swings in the report, and record again"
    ),
    Verdict.NO_DYNAMIC: "damping is not identified: there is no usable dynamic trial; record one",
    Verdict.LAG: (
        "damping is not identified: the uncertainty of the lag between force and markers, times the stiffness, is too "
        "large; record a bounce trial, sample the force at a higher rate, or let QTM start the acquisition (PFI0)"
    ),
    Verdict.DAMPING_UNCERTAIN: "damping is not identified: noise makes its interval too wide; pull faster and farther",
    Verdict.NEGATIVE: (
        "damping is not identified: it is negative, and a cuff dissipates energy, so the lag between force and markers "
        "is wrong; record a bounce trial"
    ),
    Verdict.FRICTION: (
        "damping is not identified: the cuff has Coulomb friction, which dissipates too and is in the figure; fasten "
        "the cuff tighter, or pull with a larger amplitude"
    ),
    Verdict.SCALE: (
        "stiffness and damping are not identified: the load cell reads another force than the protocol's weights "
        "exert; correct the scale of the cell or the planned weights in the configuration, and fit again"
    ),
    Verdict.SKIN: (
        "stiffness and damping are not identified: the anchor markers move relative to each other with the load, and "
        "displacement is measured against them; fix them to bone or to a plate, and record again"
    ),
    Verdict.NOT_UNLOADED: (
        "migration is not identified: the first static trial does not start unloaded, or the last does not end unloaded"
    ),
    Verdict.MIGRATED_BEFORE: (
        "migration is not identified: an earlier static recording of this donning cannot be used, and the cuff may "
        "have migrated in it; don the cuff anew and record again"
    ),
}

_FINDINGS: Templates = {
    FindingCode.START: (
        "the dynamic record starts {value:mm .2f} ± {standard_error:mm .2f} mm from the static zero",
        ", of which {migrated_m:mm .2f} mm are migration under the held loads",
        "; with x counted from that zero, F − k x would be off by {force_n:+.1f} N",
    ),
    FindingCode.STIFFNESS_RATIO: (
        "dynamic stiffness is {value:.3f} ± {standard_error:.3f} times static stiffness "
        "({dynamic_n_per_m:.0f} and {static_n_per_m:.0f} N/m)"
    ),
    FindingCode.CURVATURE: (
        "the held loads lie {value:.1f} ± {standard_error:.1f} N below a straight line in the middle of their range"
    ),
    FindingCode.HARMONICS: (
        "the residual force is {second_n:.2f} N at twice and {third_n:.2f} N at three times the swing's frequency, and "
        "{standard_error:.2f} N between them"
    ),
    FindingCode.DAMPING_POWER: (
        "damping is proportional to the {value:+.2f} ± {standard_error:.2f} power of frequency from {lowest_hz:.2f} to "
        "{highest_hz:.2f} Hz (a damper: 0, friction: −1)"
    ),
    FindingCode.ANGLE: "the cuff moves in directions {value:.0f}° apart under held loads and in swings",
    FindingCode.UNLOADED_FORCE: (
        "the unloaded force changes by {value:+.2f} ± {standard_error:.2f} N between the held loads and the swing"
    ),
    FindingCode.UNLOADED_POSITION: (
        "the unloaded cuff moves by {value:mm +.2f} ± {standard_error:mm .2f} mm between the held loads and the swing"
    ),
    FindingCode.FORCE_NOISE: "the residual of the fit is {value:.2f} times the force noise of the resting cuff",
    FindingCode.MARKER_CORRELATION: (
        "the residuals of neighbouring marker frames have a correlation of {value:.2f}",
        " (white noise: {white_noise:.0f}): the marker noise is correlated in time, or the law does not describe the "
        "motion",
    ),
}

_CAUSES: Templates = {
    CauseCode.TARE: (
        "{name}: ",
        "{unloaded_force_between_records}",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; tare with the bare hook",
    ),
    CauseCode.ZERO_DRIFT: (
        "{name}: ",
        "{unloaded_force_between_records}",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; let the cell and its amplifier warm up",
    ),
    CauseCode.DISPLACEMENT_ZERO: (
        "{name}: ",
        "{unloaded_place_between_records}: it was moved, or x has another zero there",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; do not touch cuff and anchor markers between the trials",
    ),
    CauseCode.PULL_DIRECTION: (
        "{angle_of_pulls}: k and c are those of two directions; pull along one, with markers on the rope"
    ),
    CauseCode.LOOSE_MARKER: (
        "{marker} moves by {rms_m:mm .1f} mm rms relative to the other anchor markers, which adds to the error of the "
        "displacement; fix it, or remove it from anchor_markers"
    ),
    CauseCode.SKIN: (
        "the anchor markers move relative to each other with the load (correlation {correlation:.2f}): skin moves "
        "under one of them, and k is biased; fix that marker to bone or to a plate, and record again"
    ),
    CauseCode.GAIN: (
        "the load cell reads {gain:.4f} ± {standard_error:.4f} times the force of the protocol's weights: k and c are "
        "{error:percent +.1f} % off, unless the weights are; check the load cell with a known mass"
    ),
    CauseCode.LOADS: (
        "the loads of the static test are {gain:.4f} ± {standard_error:.4f} times those of the protocol's weights, and "
        "the load cell reads a known mass correctly: other weights were hung, or it is another test; correct the "
        "planned weights, or record the trial again"
    ),
    CauseCode.PULLEY: (
        "friction of the pulley is {friction:percent .1f} ± {standard_error:percent .1f} % of the load; oil it"
    ),
    CauseCode.STIFFENING: _EXPLAINS + _TANGENT,
    CauseCode.SOFTENING: _EXPLAINS + _TANGENT,
    CauseCode.FRICTION: _EXPLAINS + "c depends on amplitude and frequency of the swing; swing as the suit will",
    CauseCode.STANDARD_LINEAR_SOLID: _EXPLAINS
    + "k and c hold at the swing's frequency (complex_stiffness in cuffs.json); swing as fast as the suit will",
    CauseCode.CREEP: _EXPLAINS
    + "k holds after the duration of the holds; hold as long as the suit will, and wait before migration is read",
    CauseCode.SLIP: _EXPLAINS
    + "k is from the loads without slip; fasten the cuff tighter, or load it once before the first trial",
}

_NOTES: Templates = {
    NoteCode.STOPPED_LOADING: (
        "static, repeat {repeat:.0f}: stopped after {count:.0f} of {total:weight}; record it again, and hang "
        "all of them one by one"
    ),
    NoteCode.STOPPED_UNLOADING: (
        "static, repeat {repeat:.0f}: stopped after {count:.0f} of {total:weight} were taken off; record it "
        "again, and take all of them off one by one"
    ),
    NoteCode.STOPPED_SWINGING: (
        "dynamic, repeat {repeat:.0f}: stopped after {found_s:.0f} of {planned_s:.0f} s of swinging; record it again, "
        "and keep the weight swinging"
    ),
    NoteCode.SLIPS_AGAIN: (
        "the cuff slips even at loads that it carried before, by {distance_m:mm .2f} mm from the first trial to the "
        "last; stiffness is from the unloading branches only"
    ),
    NoteCode.FRICTION_OR_MOVED: (
        "loading and unloading branches differ, but the displacement at the same load is the same in every trial: "
        "there is friction, or the cuff was put back between the trials; stiffness is from the unloading branches "
        "only, which friction makes too stiff; remove the weights one by one"
    ),
    NoteCode.SLIP_OR_FRICTION: (
        "all weights were removed at once, so slip and Coulomb friction cannot be distinguished: stiffness is "
        "{slipped_n_per_m:.0f} N/m if the cuff slipped, and down to {rubs_n_per_m:.0f} N/m with friction, and its "
        "interval includes both; remove the weights one by one"
    ),
    NoteCode.FRICTION_OR_CREEP: (
        "Coulomb friction of ± {friction_n:.1f} N at the cuff, or creep too small to show in the holds: at the same "
        "load the displacement is larger while weights are removed than while they are added; stiffness is the slope "
        "of the branches"
    ),
    NoteCode.ONLY_ROSE: "the load only rose; noise or creep explains all of its steps, so no slip is assumed",
    NoteCode.STATIC_STIFFNESS_USED: (
        "the lag is too uncertain to fit damping alone; the stiffness of the held loads was used, which assumes that "
        "static and dynamic stiffness are equal"
    ),
    NoteCode.STIFFNESS_RATIO: "dynamic stiffness is {ratio:.2f} times static stiffness",
    NoteCode.DAMPING_INTERVAL: (
        "the 95 % interval of damping includes zero ({low_n_s_per_m:.0f} to {high_n_s_per_m:.0f} N s/m); record more "
        "dynamic trials, and a bounce if the lag is only declared"
    ),
    NoteCode.MIGRATION_INTERVAL: (
        "the 95 % interval of migration is wider than its value ({low_m:mm .1f} to {high_m:mm .1f} mm); leave the cuff "
        "unloaded for longer before the capture ends"
    ),
    NoteCode.MIGRATED_BEFORE: (
        "the cuff migrated by {migration_m:mm .2f} mm from {file} on; its migration in {before}, recorded before, is "
        "unknown"
    ),
    NoteCode.MIXED_ORIGIN: "fitted from simulated and other recordings together; simulated: {simulated}",
    NoteCode.CREEPS: (
        "the cuff creeps by {fraction:percent .0f} ± {fraction_half_width:percent .0f} % with a time constant of about "
        "{time_constant_s:.0f} s; stiffness is that {hold_s:.0f} s after a step, and {rest_n_per_m:.0f} ± "
        "{rest_half_width_n_per_m:.0f} N/m at rest"
    ),
    NoteCode.YIELDS: (
        "the cuff creeps under held loads, but also slips or has friction, so creep is not identified; stiffness is "
        "that {hold_s:.0f} s after a step"
    ),
    NoteCode.STIFFENS: "the cuff stiffens" + _WITH_LOAD,
    NoteCode.SOFTENS: "the cuff softens" + _WITH_LOAD,
    NoteCode.SHORT_HOLDS: (
        "holds of {hold_s:.1f} s are short: the cuff may not rest in them, and their noise is known less well, which "
        "the interval of stiffness includes; hold each load for at least 4 s"
    ),
    NoteCode.ZERO_DRIFT: (
        "the load cell's zero drifts by {drift_n_per_s:per_minute +.2f} N a minute, which is removed; let it warm up"
    ),
    NoteCode.NO_ROPE: (
        "no markers on the rope: the pull is taken to be along the displacement of the cuff. A cuff with another "
        "stiffness across yields obliquely, and at an angle stiffness along the rope is larger by its inverse "
        "cosine (2 % at 10°, 10 % at 25°), which the interval does not include; put two markers on the rope"
    ),
    NoteCode.PUBLISHED_DAMPING: (
        "by the published method, damping is {damping_n_s_per_m:.0f} N s/m, {left:percent .0f} % of ours: the noise of "
        "velocities that are differences of frames makes the slope over them smaller, by prediction to "
        "{predicted:percent .0f} %"
    ),
    NoteCode.NOT_CALIBRATED: (
        "lag ({lag_s:ms .2f} ± {lag_sd_s:ms .2f} ms) and gain (± {gain_sd:percent .2g} %) of the load cell are as "
        "declared, not calibrated, and the intervals rely on them; fit with a bounce trial of the session, or record "
        "one with `station record --test bounce`"
    ),
    NoteCode.KNOWN_MASS: (
        "known mass {mass_kg:g} kg read {found_n:.2f} ± {standard_error_n:.2f} N, of {expected_n:.2f} N ({at})"
    ),
    NoteCode.KNOWN_MASS_ZERO_DRIFT: (
        "the load cell's zero drifted by {drift_n:+.2f} N between the first and last reading; fits leave it free"
    ),
    NoteCode.KNOWN_MASS_GAIN_DRIFT: (
        "the load cell's gain drifted by {drift:percent +.2f} % between the first and last reading of {mass_kg:g} kg; "
        "half of the drift is included in the uncertainty of the force"
    ),
    NoteCode.NO_SHIFT: "migration is not identified: assessed as if the cuff did not migrate",
}

_REFUSALS: Templates = {
    FitErrorCode.PROTOCOL_UNREADABLE: "{file} cannot be read: {problem}",
    FitErrorCode.PROTOCOL_NOT_TOML: "{file} {problem}",
    FitErrorCode.PROTOCOL_INVALID: "{file}: {problem}",
    FitErrorCode.PROTOCOL_NO_RECORDING: (
        "{file}: steps_s names {recording}, expected a recording in the same folder; correct the name"
    ),
    FitErrorCode.PROTOCOL_OUTSIDE: (
        "{file} names a step of {recording} at {step_s:g} s, expected between {first_s:.1f} and {last_s:.1f} s after "
        "its sync edge; correct the time"
    ),
    FitErrorCode.CUFFS_UNREADABLE: "{file} cannot be read: {problem}; make one with `station fit`",
    FitErrorCode.CUFFS_NOT_JSON: "{file} is not a cuffs file: it {problem}; make one with `station fit`",
    FitErrorCode.CUFFS_MISSING: (
        '{file} is not a cuffs file, expected "cuffs" with an entry for every cuff; make one with `station fit`'
    ),
    FitErrorCode.CUFFS_FORMAT: (
        "{file} has the format {found}, expected {expected:g}; open it with the station that wrote it, or fit the "
        "session again"
    ),
    FitErrorCode.CUFFS_NAME: "{file} has a cuff named {cuff}, expected a name that a file can have",
    FitErrorCode.CUFFS_INVALID: "{file}: {problem}",
    FitErrorCode.CHECKS_UNREADABLE: "{file} cannot be read: {problem}",
    FitErrorCode.CHECKS_INVALID: "{file}, line {line:.0f}: expected a reading of a known mass, found {found}",
    FitErrorCode.CHECK_SHORT: (
        "the load cell sent {samples:sample}, expected at least {expected:.0f}",
        " ({device_errors})",
        "; run `station check` to see whether the device answers",
    ),
    FitErrorCode.CUFF_IMPOSSIBLE: (
        "cuff {cuff}: {figure} is {value:g} {unit}, expected {low:g} to {high:g} {unit}; give it in {unit}"
    ),
    FitErrorCode.CUFF_KEY: "cuff {cuff} has the key {key}, expected {expected}; rename it or leave it out",
    FitErrorCode.CUFF_TWICE: "{count:.0f} cuffs have the name {cuff}, expected one; rename or choose one",
    FitErrorCode.CUFF_NAME: "a cuff has the keys {keys} and no name; its name is its key in a mapping of cuffs",
    FitErrorCode.NOT_IDENTIFIED: (
        "cuff {cuff} has no identified {missing} ({verdict}); measure it, or give a value with its standard error"
    ),
    FitErrorCode.EMG_RATE: (
        "the sampling rate of the EMG is {rate_hz:.4g} Hz, expected at least {lowest_hz:g} Hz; record it at 1000 "
        "Hz or more"
    ),
    FitErrorCode.EMG_SHORT: "the EMG lasts {duration_s:.3g} s, expected at least {least_s:g} s",
    FitErrorCode.EMG_BAND: (
        "the pass band of the EMG goes up to {highest_hz:g} Hz, expected below half of the sampling rate of "
        "{rate_hz:.4g} Hz; record at a higher rate, or lower band_hz"
    ),
    FitErrorCode.EMG_NO_CHANNEL: (
        "no EMG channel of {trial} is usable ({findings}); record it again, or export the raw signal"
    ),
    FitErrorCode.EMG_MVC_SHORT: (
        "an MVC trial lasts {duration_s:.3g} s, expected at least its window of {window_s:g} s"
    ),
    FitErrorCode.EMG_OTHER_TIME: (
        "EMG from {emg_start_s:g} to {emg_end_s:g} s and activations from {model_start_s:g} to {model_end_s:g} s have "
        "no time in common; use files of the same trial"
    ),
}

SENTENCES: Templates = {
    **_VERDICTS,
    **_FINDINGS,
    **_CAUSES,
    **_NOTES,
    **_REFUSALS,
    **TRIAL_NOTES,
    **REJECTIONS,
    **TENSORS,
    **GAIN_MISTAKES,
}
"""Code → its template."""

NAMES: Mapping[StrEnum, str] = {
    CauseCode.TARE: "tare with the weight on",
    CauseCode.ZERO_DRIFT: "zero drift of the load cell",
    CauseCode.DISPLACEMENT_ZERO: "zero of the displacement",
    CauseCode.PULL_DIRECTION: "direction of the pull",
    CauseCode.LOOSE_MARKER: "loose anchor marker",
    CauseCode.SKIN: "skin under an anchor marker",
    CauseCode.GAIN: "gain of the load cell",
    CauseCode.LOADS: "loads of the static test",
    CauseCode.PULLEY: "friction of the pulley",
    CauseCode.STIFFENING: "stiffening",
    CauseCode.SOFTENING: "softening",
    CauseCode.FRICTION: "friction",
    CauseCode.STANDARD_LINEAR_SOLID: "standard linear solid",
    CauseCode.CREEP: "creep",
    CauseCode.SLIP: "slip",
    FindingCode.START: "start from the static zero",
    FindingCode.STIFFNESS_RATIO: "dynamic over static stiffness",
    FindingCode.CURVATURE: "curvature",
    FindingCode.HARMONICS: "harmonics",
    FindingCode.DAMPING_POWER: "damping over frequency",
    FindingCode.ANGLE: "angle of the pulls",
    FindingCode.UNLOADED_FORCE: "unloaded force between records",
    FindingCode.UNLOADED_POSITION: "unloaded position between records",
    FindingCode.FORCE_NOISE: "force noise, swing over rest",
    FindingCode.MARKER_CORRELATION: "correlation of the marker noise",
}


Figures = Mapping[str, float | str]
"""Name → figure, in SI with the unit in the name."""


@dataclass(frozen=True)
class Note:
    """A code with its figures, in SI with the unit in the name; str() is the sentence."""

    code: NoteCode | TrialNoteCode | RejectionCode | TensorCode | FitErrorCode
    figures: Figures = field(default_factory=dict)

    def __str__(self) -> str:
        return sentence_of(self.code, self.figures)

    def to_plain(self) -> dict[str, object]:
        """The code and its figures, as JSON."""
        return {"code": self.code, "figures": dict(self.figures)}


_SCALES = {"mm": 1e3, "ms": 1e3, "percent": 100.0, "per_minute": 60.0, "ppm": 1e6}
"""Unit in which a template shows an SI figure (`{shift_m:mm .2f}`) → factor."""


def sentence_of(code: StrEnum, figures: Figures = MappingProxyType({})) -> str:
    """A code with its figures as a clause without capital or full stop. Raises KeyError if a figure is missing."""
    template = SENTENCES[code]
    if isinstance(template, str):
        return _FORMATTER.vformat(template, (), figures)
    return "".join(
        _FORMATTER.vformat(clause, (), figures) for clause in template if fields_of(clause) <= figures.keys()
    )


def name_of(code: CauseCode | FindingCode) -> str:
    """The name of a cause or a finding in a table."""
    return NAMES[code]


def verdict_sentences(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> tuple[str, ...]:
    """The verdicts as sentences. A note on a trial that ended early leads and replaces those that it explains."""
    verdicts = tuple(verdicts)
    causes = [note for note in notes if set(EXPLAINED_BY.get(note.code, ())) & set(verdicts)]
    explained = {verdict for note in causes for verdict in EXPLAINED_BY[note.code]}
    return (*map(str, causes), *(sentence_of(verdict) for verdict in verdicts if verdict not in explained))


def verdict_text(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> str:
    """All verdicts as one text."""
    return "; ".join(verdict_sentences(verdicts, notes))


def fields_of(clause: str) -> set[str]:
    """The figures that a clause shows."""
    return {field for _, field, _, _ in _FORMATTER.parse(clause) if field}


class _Scaled(CountingFormatter):
    """Formats an SI figure in the unit that the template names, and a code as its sentence."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, StrEnum):
            return sentence_of(value)
        unit, _, form = format_spec.rpartition(" ")
        return (
            super().format_field(_SCALES[unit] * value, form)
            if unit in _SCALES
            else super().format_field(value, format_spec)
        )


_FORMATTER = _Scaled()
