"""The sentences of what a fit says, rendered last and here alone; programs go by the codes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from string import Formatter
from types import MappingProxyType
from typing import Any

from fitting.results.codes import CauseCode, FindingCode, NoteCode, Verdict

Figures = Mapping[str, float | str]
"""Name → figure, in SI with the unit in the name."""

_SCALES = {"mm": 1e3, "percent": 100.0, "per_minute": 60.0}
"""Unit in which a template shows a figure of SI: `{shift_m:mm .2f}`."""

_ZEROS = "k and c stand, as each record has a zero of its own"
_TANGENT = "k is the mean slope; read the tangent at the load that matters (exponential_law in cuffs.json)"
_WITH_LOAD = (
    " with the load, from {lowest_n_per_m:.0f} N/m under the lowest to {highest_n_per_m:.0f} N/m under the highest "
    "held load"
)
_EXPLAINS = "{law} explains {gain:percent .0f} % of what a spring and a damper leave over; "

_SENTENCES: Mapping[StrEnum, str | tuple[str, ...]] = {
    Verdict.IDENTIFIED: "stiffness, damping and migration are identified",
    Verdict.GIVEN: "the figures are given, not fitted",
    Verdict.NO_STATIC: (
        "stiffness and migration are not identified: there is no usable static trial; record --test static"
    ),
    Verdict.FEW_LOADS: "stiffness is not identified: fewer than three loads were held; hold each for at least 4 s",
    Verdict.ONLY_ROSE: (
        "stiffness is not identified: the load only rose, not along a line, so the cuff may have slipped; "
        "take the weights off before the capture ends"
    ),
    Verdict.STIFFNESS_UNCERTAIN: (
        "stiffness is not identified: its interval is wider than its value; hang more weight on"
    ),
    Verdict.STIFFNESS_NOT_CONVERGED: (
        "stiffness is not identified: the fit did not converge; check the held loads in the report, and record again"
    ),
    Verdict.DAMPING_NOT_CONVERGED: (
        "damping is not identified: the fit did not converge; check the swings in the report, and record again"
    ),
    Verdict.NO_DYNAMIC: "damping is not identified: there is no usable dynamic trial; record --test dynamic",
    Verdict.LAG: (
        "damping is not identified: what is not known of the lag between force and markers, times the stiffness, "
        "leaves too much of it open; record --test bounce, raise daq.sample_rate_hz or start by PFI0"
    ),
    Verdict.DAMPING_UNCERTAIN: "damping is not identified: noise leaves too much of it open; pull faster and farther",
    Verdict.NEGATIVE: (
        "damping is not identified: it comes out negative, and a cuff takes energy; force and markers are not at the "
        "times that are taken for theirs, record --test bounce"
    ),
    Verdict.SCALE: (
        "stiffness and damping are not identified: the load cell reads another force than the protocol's weights "
        "exert; correct load_cell or protocol.step_masses_kg, and fit again"
    ),
    Verdict.SKIN: (
        "stiffness and damping are not identified: the anchor's markers deform with the load, and the cuff's way is "
        "measured against them; fix them to bone or to a plate, and record again"
    ),
    Verdict.NOT_UNLOADED: (
        "migration is not identified: the first static trial does not start, or the last does not end, unloaded"
    ),
    Verdict.MIGRATED_BEFORE: (
        "migration is not identified: an earlier static recording of this donning cannot be used, and the cuff may "
        "have migrated in it; don the cuff anew and record again"
    ),
    FindingCode.START: (
        "the dynamic record starts {value:mm .2f} ± {standard_error:mm .2f} mm from the static zero",
        ", of which {migrated_m:mm .2f} mm are migration under the held loads",
        "; with x counted from that zero F − k x would be off by {force_n:+.1f} N",
    ),
    FindingCode.STIFFNESS_RATIO: (
        "swinging, the cuff is {value:.3f} ± {standard_error:.3f} times as stiff as under held loads "
        "({dynamic_n_per_m:.0f} against {static_n_per_m:.0f} N/m)"
    ),
    FindingCode.CURVATURE: (
        "the held loads lie {value:.1f} ± {standard_error:.1f} N below a straight line in the middle of their range"
    ),
    FindingCode.HARMONICS: (
        "what the law leaves over holds {second_n:.2f} N at twice and {third_n:.2f} N at three times the swing's "
        "frequency, {standard_error:.2f} N between"
    ),
    FindingCode.DAMPING_POWER: (
        "damping goes with the {value:+.2f} ± {standard_error:.2f} power of frequency from {lowest_hz:.2f} to "
        "{highest_hz:.2f} Hz (a damper: 0, friction: −1)"
    ),
    FindingCode.ANGLE: "the cuff goes {value:.0f}° apart under held loads and in swings",
    FindingCode.UNLOADED_FORCE: (
        "from the held loads to the swing the unloaded force changes by {value:+.2f} ± {standard_error:.2f} N"
    ),
    FindingCode.UNLOADED_PLACE: (
        "from the held loads to the swing the unloaded cuff moves by {value:mm +.2f} ± {standard_error:mm .2f} mm"
    ),
    FindingCode.FORCE_NOISE: "the fit leaves {value:.2f} times the force noise of the resting cuff",
    FindingCode.MARKER_MEMORY: (
        "what the fit leaves of neighbouring marker frames has a correlation of {value:.2f}",
        " (white noise: {white_noise:.0f}): the markers' noise has a memory, or the law does not describe the motion",
    ),
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
        "{unloaded_place_between_records}, as it was moved or x has another zero there",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; leave cuff and anchor markers alone between the trials",
    ),
    CauseCode.PULL_DIRECTION: (
        "{angle_of_pulls}: k and c are those of two directions; pull both along one, with markers on the rope"
    ),
    CauseCode.LOOSE_MARKER: (
        "{marker} moves by {rms_m:mm .1f} mm rms among the other anchor markers: the cuff's way is that much less "
        "sure; fix it, or leave it out of anchor_markers"
    ),
    CauseCode.SKIN: (
        "the anchor markers deform with the load (correlation {correlation:.2f}): skin moves under one, and k is off "
        "by as much; fix that marker to bone or to a plate, and record again"
    ),
    CauseCode.GAIN: (
        "the load cell reads {gain:.4f} ± {standard_error:.4f} newtons for each that the protocol's weights pull with: "
        "k and c are {error:percent +.1f} % off, unless the weights are; hang on a known mass "
        "(station check --known-mass)"
    ),
    CauseCode.PULLEY: (
        "the pulley holds back {friction:percent .1f} ± {standard_error:percent .1f} % of the load; oil it"
    ),
    CauseCode.STIFFENING: _EXPLAINS + _TANGENT,
    CauseCode.SOFTENING: _EXPLAINS + _TANGENT,
    CauseCode.FRICTION: _EXPLAINS
    + "c is what the swing's amplitude and frequency make of it, no damper's; swing as the suit will",
    CauseCode.STANDARD_LINEAR_SOLID: _EXPLAINS
    + "k and c are those of the swing's frequency (complex_stiffness in cuffs.json); swing as fast as the suit will",
    CauseCode.CREEP: _EXPLAINS
    + "k is that of the holds' length; hold as long as the suit will, and wait before migration is read",
    CauseCode.SLIP: _EXPLAINS
    + "k is from where it held; fasten the cuff tighter, or load it once before the first trial",
    NoteCode.SLIPS_AGAIN: (
        "the cuff slips even under loads it carried before, by {distance_m:mm .2f} mm from the first trial to the "
        "last; stiffness is from taking weights off only"
    ),
    NoteCode.RUBS_OR_MOVED: (
        "weights that come off lead the cuff back another way than they led it out, but the same load holds it "
        "where it did before: it rubs, or was put back between the trials; stiffness is from taking weights off "
        "only, which friction makes too high: take them off one by one"
    ),
    NoteCode.SLIP_OR_FRICTION: (
        "weights that all come off at once show one way back, on which a cuff that slipped and one that rubs look "
        "alike: stiffness is {slipped_n_per_m:.0f} N/m if it slipped, and down to {rubs_n_per_m:.0f} if it rubs, which "
        "is in its interval; take them off one by one"
    ),
    NoteCode.RUBS: (
        "the cuff rubs by ± {friction_n:.1f} N, or creeps too little for the holds to show: under the same load it "
        "lies further out when weights come off than when they go on; stiffness is along each way"
    ),
    NoteCode.ONLY_ROSE: (
        "the load only rose; noise or creep explain all of its steps, so no slip is taken to be in them"
    ),
    NoteCode.STATIC_STIFFNESS_USED: (
        "the lag is too uncertain for damping on its own; the stiffness of the held loads was used, which holds if the "
        "cuff is as stiff when it swings"
    ),
    NoteCode.STIFFNESS_RATIO: "the cuff is {ratio:.2f} times as stiff when it swings as under held loads",
    NoteCode.DAMPING_INTERVAL: (
        "the 95 % interval of damping holds zero ({low_n_s_per_m:.0f} to {high_n_s_per_m:.0f} N s/m); record more "
        "dynamic trials, and a bounce if the lag is only declared"
    ),
    NoteCode.MIGRATED_BEFORE: (
        "from {file} on the cuff migrated by {migration_m:mm .2f} mm; how far it had in {before}, recorded before, is "
        "not known"
    ),
    NoteCode.MIXED_ORIGIN: "fitted from simulated and other recordings together; simulated: {simulated}",
    NoteCode.CREEPS: (
        "the cuff creeps: it yields {fraction:percent .0f} ± {fraction_half_width:percent .0f} % more, with a time "
        "constant of about {time_constant_s:.0f} s; stiffness is that {hold_s:.0f} s after a step, and "
        "{rest_n_per_m:.0f} ± {rest_half_width_n_per_m:.0f} N/m when it has come to rest"
    ),
    NoteCode.YIELDS: (
        "the cuff goes on yielding under held loads, but slips or rubs as well: how far it would creep is not known; "
        "stiffness is that {hold_s:.0f} s after a step"
    ),
    NoteCode.STIFFENS: "the cuff stiffens" + _WITH_LOAD,
    NoteCode.SOFTENS: "the cuff softens" + _WITH_LOAD,
    NoteCode.ZERO_DRIFT: (
        "the load cell's zero drifts by {drift_n_per_s:per_minute +.2f} N a minute, which is taken out; let it warm up"
    ),
    NoteCode.KNOWN_MASS: (
        "known mass {mass_kg:g} kg read {found_n:.2f} ± {standard_error_n:.2f} N, of {expected_n:.2f} N ({at})"
    ),
    NoteCode.KNOWN_MASS_ZERO_DRIFT: (
        "the load cell's zero drifted by {drift_n:+.2f} N between the first and last reading; fits leave it free"
    ),
    NoteCode.KNOWN_MASS_GAIN_DRIFT: (
        "the load cell's gain drifted by {drift:percent +.2f} % between the first and last reading of {mass_kg:g} kg; "
        "half of it is in the uncertainty of the force"
    ),
    NoteCode.NO_SHIFT: "migration is not identified: assessed as if the cuff did not migrate",
}
"""Code → its template; of several clauses those are shown whose figures are there."""

_NAMES: Mapping[StrEnum, str] = {
    CauseCode.TARE: "tare with the weight on",
    CauseCode.ZERO_DRIFT: "zero drift of the load cell",
    CauseCode.DISPLACEMENT_ZERO: "zero of the displacement",
    CauseCode.PULL_DIRECTION: "direction of the pull",
    CauseCode.LOOSE_MARKER: "loose anchor marker",
    CauseCode.SKIN: "skin under an anchor marker",
    CauseCode.GAIN: "gain of the load cell",
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
    FindingCode.UNLOADED_PLACE: "unloaded place between records",
    FindingCode.FORCE_NOISE: "force noise, swing over rest",
    FindingCode.MARKER_MEMORY: "memory of the markers' noise",
}


def sentence_of(code: StrEnum, figures: Figures = MappingProxyType({})) -> str:
    """What a code says with its figures, as a clause without capital or full stop. Raises KeyError without figures."""
    template = _SENTENCES[code]
    if isinstance(template, str):
        return _FORMATTER.vformat(template, (), figures)
    return "".join(
        _FORMATTER.vformat(clause, (), figures) for clause in template if fields_of(clause) <= figures.keys()
    )


def name_of(code: CauseCode | FindingCode) -> str:
    """What a cause or a finding is called in a table."""
    return _NAMES[code]


def verdict_text(verdicts: Iterable[Verdict]) -> str:
    """All verdicts as one text."""
    return "; ".join(map(sentence_of, verdicts))


def fields_of(clause: str) -> set[str]:
    """The figures that a clause shows."""
    return {field for _, field, _, _ in _FORMATTER.parse(clause) if field}


class _Scaled(Formatter):
    """Formats a figure of SI in the unit that its place in the template names."""

    def format_field(self, value: Any, format_spec: str) -> str:
        unit, _, form = format_spec.rpartition(" ")
        return format(_SCALES[unit] * value if unit else value, form)


_FORMATTER = _Scaled()
