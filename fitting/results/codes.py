"""Codes of everything that a fit reports on a donning, and of its errors; those on a trial are in trial_codes.py."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum

from documents.message import Code

_ZEROS = "k and c are not affected, as each record has its own zero"
_TANGENT = "k is the mean slope; read the tangent at the load that matters (exponential_law in cuffs.json)"
_WITH_LOAD = (
    " with the load, from {lowest_n_per_m:.0f} N/m at the lowest to {highest_n_per_m:.0f} N/m at the highest held load"
)
_EXPLAINS = "{law} explains {gain:percent .0f} % of the residual of a spring and a damper; "


class Verdict(Code):
    """Which quantities are identified: the quantity, then after a dot the reason."""

    IDENTIFIED = "identified", "stiffness, damping and migration are identified"
    GIVEN = "given", "the figures are given, not fitted"
    NO_STATIC = (
        "stiffness_not_identified.no_static_trial",
        "stiffness and migration are not identified: there is no usable static trial; record one",
    )
    FEW_LOADS = (
        "stiffness_not_identified.few_loads",
        "stiffness is not identified: fewer than three loads were held; hold each load for at least 4 s",
    )
    ONLY_ROSE = (
        "stiffness_not_identified.load_only_rose",
        "stiffness is not identified: the load only rose, and the loads are not on a line, so the cuff may have "
        "slipped; remove the weights before the capture ends",
    )
    STIFFNESS_UNCERTAIN = (
        "stiffness_not_identified.wide_interval",
        "stiffness is not identified: its interval is wider than its value; hang on more weight",
    )
    STIFFNESS_NOT_CONVERGED = (
        "stiffness_not_identified.not_converged",
        "stiffness is not identified: the fit did not converge; check the held loads in the report, and record again",
    )
    NO_DYNAMIC = (
        "damping_not_identified.no_dynamic_trial",
        "damping is not identified: there is no usable dynamic trial; record one",
    )
    LAG = (
        "damping_not_identified.lag",
        "damping is not identified: the uncertainty of the lag between force and markers, times the stiffness, is too "
        "large; record a bounce trial, sample the force at a higher rate, or let QTM start the acquisition (PFI0)",
    )
    DAMPING_UNCERTAIN = (
        "damping_not_identified.noise",
        "damping is not identified: noise makes its interval too wide; pull faster and farther",
    )
    NEGATIVE = (
        "damping_not_identified.negative",
        "damping is not identified: it is negative, and a cuff dissipates energy, so the lag between force and markers "
        "is wrong; record a bounce trial",
    )
    DAMPING_NOT_CONVERGED = (
        "damping_not_identified.not_converged",
        "damping is not identified: the fit did not converge; check the swings in the report, and record again",
    )
    FRICTION = (
        "damping_not_identified.friction",
        "damping is not identified: the cuff has Coulomb friction, which dissipates too and is in the figure; fasten "
        "the cuff tighter, or pull with a larger amplitude",
    )
    SCALE = (
        "stiffness_and_damping_not_identified.gain_error",
        "stiffness and damping are not identified: the load cell reads another force than the protocol's weights "
        "exert; correct the scale of the cell or the planned weights in the configuration, and fit again",
    )
    SKIN = (
        "stiffness_and_damping_not_identified.skin_motion",
        "stiffness and damping are not identified: the anchor markers move relative to each other with the load, and "
        "displacement is measured against them; fix them to bone or to a plate, and record again",
    )
    NOT_UNLOADED = (
        "migration_not_identified.not_unloaded",
        "migration is not identified: the first static trial does not start unloaded, or the last does not end "
        "unloaded",
    )
    MIGRATED_BEFORE = (
        "migration_not_identified.unusable_trial_before",
        "migration is not identified: an earlier static recording of this donning cannot be used, and the cuff may "
        "have migrated in it; don the cuff anew and record again",
    )

    @property
    def quantities(self) -> tuple[str, ...]:
        """Those that are not identified, also if there is a figure."""
        named, is_unidentified, _ = self.partition("_not_identified.")
        return tuple(named.split("_and_")) if is_unidentified else ()


class CauseCode(Code, prefix="cause."):
    """A fault of the rig, or a property of the cuff beyond a spring and a damper."""

    TARE = (
        "cause.tare_with_weight",
        "{name}: ",
        "{unloaded_force_between_records}",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; tare with the bare hook",
    )
    ZERO_DRIFT = (
        "{name}: ",
        "{unloaded_force_between_records}",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; let the cell and its amplifier warm up",
    )
    DISPLACEMENT_ZERO = (
        "{name}: ",
        "{unloaded_place_between_records}: it was moved, or x has another zero there",
        "{start_from_static_zero}, or the force has another zero",
        f"; {_ZEROS}; do not touch cuff and anchor markers between the trials",
    )
    PULL_DIRECTION = "{angle_of_pulls}: k and c are those of two directions; pull along one, with markers on the rope"
    LOOSE_MARKER = (
        "cause.loose_anchor_marker",
        "{marker} moves by {rms_m:mm .1f} mm rms relative to the other anchor markers, which adds to the error of the "
        "displacement; fix it, or remove it from anchor_markers",
    )
    SKIN = (
        "cause.skin_motion",
        "the anchor markers move relative to each other with the load (correlation {correlation:.2f}): skin moves "
        "under one of them, and k is biased; fix that marker to bone or to a plate, and record again",
    )
    GAIN = (
        "cause.gain_error",
        "the load cell reads {gain:.4f} ± {standard_error:.4f} times the force of the protocol's weights: k and c are "
        "{error:percent +.1f} % off, unless the weights are; check the load cell with a known mass",
    )
    LOADS = (
        "cause.other_loads",
        "the loads of the static test are {gain:.4f} ± {standard_error:.4f} times those of the protocol's weights, and "
        "the load cell reads a known mass correctly: other weights were hung, or it is another test; correct the "
        "planned weights, or record the trial again",
    )
    PULLEY = (
        "cause.pulley_friction",
        "friction of the pulley is {friction:percent .1f} ± {standard_error:percent .1f} % of the load; oil it",
    )
    STIFFENING = _EXPLAINS + _TANGENT
    SOFTENING = _EXPLAINS + _TANGENT
    FRICTION = _EXPLAINS + "c depends on amplitude and frequency of the swing; swing as the suit will"
    STANDARD_LINEAR_SOLID = (
        _EXPLAINS
        + "k and c hold at the swing's frequency (complex_stiffness in cuffs.json); swing as fast as the suit will"
    )
    CREEP = (
        _EXPLAINS
        + "k holds after the duration of the holds; hold as long as the suit will, and wait before migration is read"
    )
    SLIP = (
        _EXPLAINS + "k is from the loads without slip; fasten the cuff tighter, or load it once before the first trial"
    )


class FindingCode(Code):
    """The figure of a check D1 to D8; D7 and D8 have two."""

    START = (
        "start_from_static_zero",
        "the dynamic record starts {value:mm .2f} ± {standard_error:mm .2f} mm from the static zero",
        ", of which {migrated_m:mm .2f} mm are migration under the held loads",
        "; with x counted from that zero, F − k x would be off by {force_n:+.1f} N",
    )
    STIFFNESS_RATIO = (
        "dynamic_over_static_stiffness",
        "dynamic stiffness is {value:.3f} ± {standard_error:.3f} times static stiffness "
        "({dynamic_n_per_m:.0f} and {static_n_per_m:.0f} N/m)",
    )
    CURVATURE = (
        "curvature",
        "the held loads lie {value:.1f} ± {standard_error:.1f} N below a straight line in the middle of their range",
    )
    HARMONICS = (
        "harmonics",
        "the residual force is {second_n:.2f} N at twice and {third_n:.2f} N at three times the swing's frequency, and "
        "{standard_error:.2f} N between them",
    )
    DAMPING_POWER = (
        "damping_over_frequency",
        "damping is proportional to the {value:+.2f} ± {standard_error:.2f} power of frequency from {lowest_hz:.2f} to "
        "{highest_hz:.2f} Hz (a damper: 0, friction: −1)",
    )
    ANGLE = "angle_of_pulls", "the cuff moves in directions {value:.0f}° apart under held loads and in swings"
    UNLOADED_FORCE = (
        "unloaded_force_between_records",
        "the unloaded force changes by {value:+.2f} ± {standard_error:.2f} N between the held loads and the swing",
    )
    UNLOADED_POSITION = (
        "unloaded_place_between_records",
        "the unloaded cuff moves by {value:mm +.2f} ± {standard_error:mm .2f} mm between the held loads and the swing",
    )
    FORCE_NOISE = (
        "force_noise_swing_over_rest",
        "the residual of the fit is {value:.2f} times the force noise of the resting cuff",
    )
    MARKER_CORRELATION = (
        "marker_noise_correlation",
        "the residuals of neighbouring marker frames have a correlation of {value:.2f}",
        " (white noise: {white_noise:.0f}): the marker noise is correlated in time, or the law does not describe the "
        "motion",
    )


class NoteCode(Code, prefix="note."):
    """A remark on the figures of a donning."""

    STOPPED_LOADING = (
        "static, repeat {repeat:.0f}: stopped after {count:.0f} of {total:weight}; record it again, and hang "
        "all of them one by one"
    )
    HIDDEN_LOADS = (
        "static, repeat {repeat:.0f}: force or markers are missing while loads are held; check the load cell and the "
        "view of the cameras, and record it again"
    )
    STOPPED_UNLOADING = (
        "static, repeat {repeat:.0f}: stopped after {count:.0f} of {total:weight} were taken off; record it "
        "again, and take all of them off one by one"
    )
    STOPPED_SWINGING = (
        "dynamic, repeat {repeat:.0f}: stopped after {found_s:.0f} of {planned_s:.0f} s of swinging; record it again, "
        "and keep the weight swinging"
    )
    SWING_CUT = (
        "dynamic, repeat {repeat:.0f}: force or markers end after {found_s:.0f} of {planned_s:.0f} s of swinging, "
        "before the capture ends; check the load cell and the mocap system, and record it again"
    )
    SLIPS_AGAIN = (
        "the cuff slips even at loads that it carried before, by {distance_m:mm .2f} mm from the first trial to the "
        "last; stiffness is from the unloading branches only"
    )
    FRICTION_OR_MOVED = (
        "loading and unloading branches differ, but the displacement at the same load is the same in every trial: "
        "there is friction, or the cuff was put back between the trials; stiffness is from the unloading branches "
        "only, which friction makes too stiff; remove the weights one by one"
    )
    SLIP_OR_FRICTION = (
        "all weights were removed at once, so slip and Coulomb friction cannot be distinguished: stiffness is "
        "{slipped_n_per_m:.0f} N/m if the cuff slipped, and down to {rubs_n_per_m:.0f} N/m with friction, and its "
        "interval includes both; remove the weights one by one"
    )
    FRICTION_OR_CREEP = (
        "note.friction",
        "Coulomb friction of ± {friction_n:.1f} N at the cuff, or creep too small to show in the holds: at the same "
        "load the displacement is larger while weights are removed than while they are added; stiffness is the slope "
        "of the branches",
    )
    ONLY_ROSE = (
        "note.load_only_rose",
        "the load only rose; noise or creep explains all of its steps, so no slip is assumed",
    )
    STATIC_STIFFNESS_USED = (
        "the lag is too uncertain to fit damping alone; the stiffness of the held loads was used, which assumes that "
        "static and dynamic stiffness are equal"
    )
    STIFFNESS_RATIO = "note.dynamic_over_static_stiffness", "dynamic stiffness is {ratio:.2f} times static stiffness"
    DAMPING_INTERVAL = (
        "note.damping_interval_holds_zero",
        "the 95 % interval of damping includes zero ({low_n_s_per_m:.0f} to {high_n_s_per_m:.0f} N s/m); record more "
        "dynamic trials, and a bounce if the lag is only declared",
    )
    MIGRATION_INTERVAL = (
        "note.migration_interval_wide",
        "the 95 % interval of migration is wider than its value ({low_m:mm .1f} to {high_m:mm .1f} mm); leave the cuff "
        "unloaded for longer before the capture ends",
    )
    MIGRATED_BEFORE = (
        "note.migration_before_unknown",
        "the cuff migrated by {migration_m:mm .2f} mm from {file} on; its migration in {before}, recorded before, is "
        "unknown",
    )
    MIXED_ORIGIN = (
        "note.simulated_and_other_recordings",
        "fitted from simulated and other recordings together; simulated: {simulated}",
    )
    NOT_CALIBRATED = (
        "lag ({lag_s:ms .2f} ± {lag_sd_s:ms .2f} ms) and gain (± {gain_sd:percent .2g} %) of the load cell are as "
        "declared, not calibrated, and the intervals rely on them; fit with a bounce trial of the session, or record "
        "one with `station record --test bounce`"
    )
    CREEPS = (
        "note.creep",
        "the cuff creeps by {fraction:percent .0f} ± {fraction_half_width:percent .0f} % with a time constant of about "
        "{time_constant_s:.0f} s; stiffness is that {hold_s:.0f} s after a step, and {rest_n_per_m:.0f} ± "
        "{rest_half_width_n_per_m:.0f} N/m at rest",
    )
    YIELDS = (
        "note.yields_under_load",
        "the cuff creeps under held loads, but also slips or has friction, so creep is not identified; stiffness is "
        "that {hold_s:.0f} s after a step",
    )
    STIFFENS = "note.stiffening", "the cuff stiffens" + _WITH_LOAD
    SOFTENS = "note.softening", "the cuff softens" + _WITH_LOAD
    SHORT_HOLDS = (
        "holds of {hold_s:.1f} s are short: the cuff may not rest in them, and their noise is known less well, which "
        "the interval of stiffness includes; hold each load for at least 4 s"
    )
    ZERO_DRIFT = (
        "note.zero_drift_removed",
        "the load cell's zero drifts by {drift_n_per_s:per_minute +.2f} N a minute, which is removed; let it warm up",
    )
    NO_ROPE = (
        "note.direction_of_pull_unknown",
        "no markers on the rope: the pull is taken to be along the displacement of the cuff. A cuff with another "
        "stiffness across yields obliquely, and stiffness and damping along the rope are larger: by up to "
        "{more:percent .0f} % if the stiffnesses differ by a factor of up to {ratio:g}, which the intervals include; "
        "put two markers on the rope",
    )
    PUBLISHED_DAMPING = (
        "by the published method, damping is {damping_n_s_per_m:.0f} N s/m, {left:percent .0f} % of ours: the noise of "
        "velocities that are differences of frames makes the slope over them smaller, by prediction to "
        "{predicted:percent .0f} %"
    )
    KNOWN_MASS = "known mass {mass_kg:g} kg read {found_n:.2f} ± {standard_error_n:.2f} N, of {expected_n:.2f} N ({at})"
    KNOWN_MASS_ZERO_DRIFT = (
        "the load cell's zero drifted by {drift_n:+.2f} N between the first and last reading; fits leave it free"
    )
    KNOWN_MASS_GAIN_DRIFT = (
        "the load cell's gain drifted by {drift:percent +.2f} % between the first and last reading of {mass_kg:g} kg; "
        "half of the drift is included in the uncertainty of the force"
    )
    NO_SHIFT = "note.assessed_without_migration", "migration is not identified: assessed as if the cuff did not migrate"


_WITHOUT_LOADS = (
    Verdict.FEW_LOADS,
    Verdict.ONLY_ROSE,
    Verdict.STIFFNESS_UNCERTAIN,
    Verdict.STIFFNESS_NOT_CONVERGED,
    Verdict.NOT_UNLOADED,
)
_WITHOUT_SWING = (Verdict.NO_DYNAMIC, Verdict.DAMPING_UNCERTAIN, Verdict.DAMPING_NOT_CONVERGED)
EXPLAINED_BY: Mapping[StrEnum, tuple[Verdict, ...]] = {
    NoteCode.STOPPED_LOADING: _WITHOUT_LOADS,
    NoteCode.HIDDEN_LOADS: _WITHOUT_LOADS,
    NoteCode.STOPPED_UNLOADING: (Verdict.ONLY_ROSE, Verdict.NOT_UNLOADED),
    NoteCode.STOPPED_SWINGING: _WITHOUT_SWING,
    NoteCode.SWING_CUT: _WITHOUT_SWING,
}
"""Note on loads or a swing that are missing → verdicts that follow."""


class FitErrorCode(Code):
    """Why a file of the session, a reading of a known mass, a cuff or EMG cannot be used."""

    PROTOCOL_UNREADABLE = "protocol_file.unreadable", "{file} cannot be read: {problem}"
    PROTOCOL_NOT_TOML = "protocol_file.not_toml", "{file} {problem}"
    PROTOCOL_INVALID = "protocol_file.invalid", "{file}: {problem}"
    PROTOCOL_NO_RECORDING = (
        "protocol_file.no_such_recording",
        "{file}: steps_s names {recording}, expected a recording in the same folder; correct the name",
    )
    PROTOCOL_OUTSIDE = (
        "protocol_file.step_outside_trial",
        "{file} names a step of {recording} at {step_s:g} s, expected between {first_s:.1f} and {last_s:.1f} s after "
        "its sync edge; correct the time",
    )
    CUFFS_UNREADABLE = "cuffs_file.unreadable", "{file} cannot be read: {problem}; make one with `station fit`"
    CUFFS_NOT_JSON = "cuffs_file.not_json", "{file} is not a cuffs file: it {problem}; make one with `station fit`"
    CUFFS_MISSING = (
        "cuffs_file.no_cuffs",
        '{file} is not a cuffs file, expected "cuffs" with an entry for every cuff; make one with `station fit`',
    )
    CUFFS_FORMAT = (
        "cuffs_file.unknown_format",
        "{file} has the format {found}, expected {expected:g}; open it with the station that wrote it, or fit the "
        "session again",
    )
    CUFFS_NAME = "cuffs_file.name_is_path", "{file} has a cuff named {cuff}, expected a name that a file can have"
    CUFFS_INVALID = "cuffs_file.invalid", "{file}: {problem}"
    CHECKS_UNREADABLE = "mass_checks.unreadable", "{file} cannot be read: {problem}"
    CHECKS_INVALID = (
        "mass_checks.invalid_line",
        "{file}, line {line:.0f}: expected a reading of a known mass, found {found}",
    )
    CHECK_SHORT = (
        "mass_checks.few_samples",
        "the load cell sent {samples:sample}, expected at least {expected:.0f}",
        " ({device_errors})",
        "; run `station check` to see whether the device answers",
    )
    NOT_IDENTIFIED = (
        "cuff.not_identified",
        "cuff {cuff} has no identified {missing} ({verdict}); measure it, or give a value with its standard error",
    )
    CUFF_IMPOSSIBLE = (
        "cuff.impossible_value",
        "cuff {cuff}: {figure} is {value:g} {unit}, expected {low:g} to {high:g} {unit}; give it in {unit}",
    )
    CUFF_KEY = "cuff.unknown_key", "cuff {cuff} has the key {key}, expected {expected}; rename it or leave it out"
    CUFF_NAME = "cuff.no_name", "a cuff has the keys {keys} and no name; its name is its key in a mapping of cuffs"
    CUFF_TWICE = "cuff.name_twice", "{count:.0f} cuffs have the name {cuff}, expected one; rename or choose one"
    EMG_RATE = (
        "emg.rate_too_low",
        "the sampling rate of the EMG is {rate_hz:.4g} Hz, expected at least {lowest_hz:g} Hz; record it at 1000 "
        "Hz or more",
    )
    EMG_SHORT = "emg.too_short", "the EMG lasts {duration_s:.3g} s, expected at least {least_s:g} s"
    EMG_BAND = (
        "emg.band_above_half_the_rate",
        "the pass band of the EMG goes up to {highest_hz:g} Hz, expected below half of the sampling rate of "
        "{rate_hz:.4g} Hz; record at a higher rate, or lower band_hz",
    )
    EMG_NO_CHANNEL = (
        "emg.no_usable_channel",
        "no EMG channel of {trial} is usable ({findings}); record it again, or export the raw signal",
    )
    EMG_MVC_SHORT = (
        "emg.mvc_too_short",
        "an MVC trial lasts {duration_s:.3g} s, expected at least its window of {window_s:g} s",
    )
    EMG_OTHER_TIME = (
        "emg.no_common_time",
        "EMG from {emg_start_s:g} to {emg_end_s:g} s and activations from {model_start_s:g} to {model_end_s:g} s have "
        "no time in common; use files of the same trial",
    )


class FitOutcome(StrEnum):
    """Outcome of an iteration.

    CONVERGED      its convergence criterion was met
    NOT_CONVERGED  it reached its limit of rounds while its parameters still changed
    NO_SOLUTION    it left the range in which the law describes a cuff, for example with a negative stiffness
    """

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"
    NO_SOLUTION = "no_solution"


NEGLIGIBLE = 0.01
"""Standard errors by which a parameter may change in the last round of a converged fit."""


def worst(outcomes: Iterable[FitOutcome]) -> FitOutcome:
    """The outcome of a fit in several parts, all of which must converge."""
    found = set(outcomes)
    return next(
        (outcome for outcome in (FitOutcome.NO_SOLUTION, FitOutcome.NOT_CONVERGED) if outcome in found), CONVERGED
    )


CONVERGED = FitOutcome.CONVERGED


class Standing(StrEnum):
    """Comparison of a file with the hash recorded when it was written, or of a figure with the fit."""

    AS_RECORDED = "as recorded"
    CHANGED = "changed since"
    MISSING = "missing"
    ADDED = "added since"
    BY_HAND = "given by hand"
    UNRECORDED = "no hash recorded"

    @property
    def is_break(self) -> bool:
        """Whether this breaks the chain of hashes from the report to the recordings."""
        return self in (Standing.CHANGED, Standing.MISSING, Standing.ADDED)
