"""Sentences on a single trial: reasons why it cannot be used, and notes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from fitting.results.codes import GainMistake, RejectionCode, TensorCode, TrialNoteCode

_AGAIN = "record the trial again"
_ONLY_DAMAGE = (
    "the file is damaged ({damage}",
    " and {more:.0f} more",
    "), so nothing else in it is diagnosed; restore it from a copy, or record the trial again",
)
_REST = "the force at rest changes by {drift_n:+.2f} N from start to end, expected at most {limit_n:.2f} N"
_FREQUENT = "samples per cycle of {frequency_hz:.2f} Hz, expected at least {expected:g}"
_CABLE = " {count:time} for less than 20 ms, at {at}; ignored, check the cable"

Templates = Mapping[StrEnum, str | tuple[str, ...]]
"""Code → its template, or the clauses of its template."""

REJECTIONS: Templates = {
    RejectionCode.RECORDED_AGAIN: "recorded again as {file}",
    RejectionCode.NOT_ACCEPTED: "the trial was not accepted when it was recorded: {outcome}",
    RejectionCode.SET_ASIDE: "set aside by the operator: {reason}",
    RejectionCode.OTHER_TRIAL: (
        "a copy by its name, and by its content cut or of another trial; the original is used, delete the copy"
    ),
    RejectionCode.DAMAGED: _ONLY_DAMAGE,
    RejectionCode.UNREADABLE: "{problem}",
    RejectionCode.IS_BOUNCE: "{file} is a bounce, which calibrates the load cell; give a trial of a cuff",
    RejectionCode.IS_WEARER_TRIAL: ("{file} is a {test} of the wearer and no pull on a cuff; it is for `station ik`"),
    RejectionCode.NO_CUFF: "{file} is a recording without a cuff; give the test a cuff",
    RejectionCode.NO_BOUNCE: "{file} is a recording without a bounce; its manifest has no weight",
    RejectionCode.NO_BODY: ("{file} is not a pose or motion of the wearer; its manifest has no markers of a body"),
    RejectionCode.EMG_NO_CLOCK: (
        "EMG cannot be aligned with the markers: {reason}, and no clock offset was measured; record the sync line with "
        "the amplifier, or record the trial again"
    ),
    RejectionCode.OTHER_MARKERS: (
        "its markers are not those of the donning's first trial; use one configuration in a donning"
    ),
    RejectionCode.NO_SAMPLES: (
        "the recording has no samples of {stream}; check the bench to see whether its device answers"
    ),
    RejectionCode.NUMBERS_GO_BACK: (
        f"the sample numbers of {{stream}} go back or repeat at sample {{sample:.0f}}, expected increasing numbers; "
        f"{_AGAIN}"
    ),
    RejectionCode.NO_OVERLAP: (
        "force ends {force_end_s:.2f} s and markers end {marker_end_s:.2f} s after the sync edge, with "
        "{samples:sample} "
        f"and {{frames:frame}} in {{both_s:.2f}} s of both, expected at least {{expected_s:g}} s; {_AGAIN}"
    ),
    RejectionCode.NO_FRAMES: ("the recording has no marker frame after the sync edge; check that QTM was capturing"),
    RejectionCode.MISSING_MARKERS: (
        "the recording has no marker {missing}, only {present}; correct the labels in QTM or in the cuff's section of "
        "the configuration"
    ),
    RejectionCode.SYNC_NOT_FINITE: (
        "the sync line has no finite samples; check the sync channel's wiring and record again"
    ),
    RejectionCode.SYNC_NEVER_RISES: (
        "the sync line never rises above {threshold_v:g} V (highest {highest_v:.2f} V); check the cable from QTM's "
        "sync output and the configured threshold"
    ),
    RejectionCode.SYNC_RISES_AGAIN: (
        "the sync line rises {count:time} (at {at}), expected once; set QTM's output to one pulse for the whole "
        "capture and record again"
    ),
    RejectionCode.SYNC_INVERTED: (
        "wrong polarity: the sync line starts at {level_v:.2f} V, expected below {threshold_v:g} V until the capture "
        "starts, and is low for {gap_s:.2f} s from {fell_s:.2f} s on; set QTM's output to active high, or swap the two "
        "wires"
    ),
    RejectionCode.SYNC_STARTS_HIGH: (
        "the sync line starts at {level_v:.2f} V, expected below {threshold_v:g} V until the capture starts; check "
        "that QTM's output is active high and that the station is armed before the capture"
    ),
    RejectionCode.FORCE_NOT_FINITE: (
        f"force has {{count:.0f}} of {{total:.0f}} samples that are not finite numbers; {_AGAIN}"
    ),
    RejectionCode.FORCE_MISSING: (
        "the force is missing in {share:percent .0f} % of the marker frames, expected at most {limit:percent .0f} %; "
        "check the connection of the load cell and its rate, and record again"
    ),
    RejectionCode.FORCE_SATURATED: (
        "force is saturated in {count:.0f} of {total:.0f} samples (at {limit:.4g} {unit}); check wiring, "
        "input range, capacity of the cell and the amplifier's zero"
    ),
    RejectionCode.FORCE_CONSTANT: (
        "force reads {value:g} in all {total:.0f} samples, expected noise and load; check the load cell"
    ),
    RejectionCode.FORCE_STUCK_MOVING: (
        "force reads {force_n:.2f} N without change for {duration_s:.1f} s from {start_s:.1f} s on while the cuff "
        "moves: "
        f"the converter or its stream hung; check the amplifier and its cable, and {_AGAIN}"
    ),
    RejectionCode.FORCE_STUCK_QUIET: (
        "force reads {force_n:.2f} N without change for {duration_s:.1f} s from {start_s:.1f} s on although its "
        "noise is "
        f"{{noise_n:.2g}} N: the converter or its stream hung; check the amplifier and its cable, and {_AGAIN}"
    ),
    RejectionCode.FORCE_POLARITY: (
        "force falls from {before_n:.1f} N to {after_n:.1f} N when the load is added, expected a rise; "
        "reverse the polarity of the cell in the configuration"
    ),
    RejectionCode.STEPS_APART: (
        "force and displacement are not on one clock: their steps are {offset_s:+.1f} s apart, positive if the "
        "displacement is later; check the sync line, or import the files with this lag (`--lag-s`)"
    ),
    RejectionCode.ZERO_DRIFT: (
        _REST
        + " (load_cell.zero_drift_relative_limit); look for a load that was left on or a loose mount, let the load "
        f"cell and its amplifier warm up, and {_AGAIN}"
    ),
    RejectionCode.ANCHOR_HIDDEN: (
        "the anchor has {count:.0f} visible marker(s) of {markers}, expected at least {expected:.0f} that are not "
        "collinear; put more markers on the anchoring body"
    ),
    RejectionCode.ANCHOR_COLLINEAR: (
        "the anchor markers {markers} are collinear (spread across the line {width_m:mm .1f} mm, expected at least "
        "{expected_m:mm g} mm), so rotation about the line is not defined; move one aside"
    ),
    RejectionCode.CUFF_HIDDEN: "the cuff markers {markers} are hidden at the start; check the cameras' view",
    RejectionCode.MARKERS_HIDDEN: (
        "anchor or cuff markers are hidden in {hidden:percent .0f} % of the frames, expected at most {limit:percent "
        ".0f} %; check the cameras' view and record again"
    ),
    RejectionCode.MARKERS_FROZEN: (
        "the markers do not change at all for {duration_s:.1f} s from {start_s:.1f} s on while the force changes; "
        "check that QTM was measuring, and record again"
    ),
    RejectionCode.DISPLACEMENT_UNIT: (
        "the cuff moves by {rms_m:.3g} m rms, expected between {least_m:g} and {most_m:g} m; check that the markers "
        "are in millimetres"
    ),
    RejectionCode.NO_MOTION: "the cuff does not move with the force; check that the rope was loaded",
    RejectionCode.FEW_LOADS: "fewer than three loads were held; hold each load for at least 4 s",
    RejectionCode.NOT_UNLOADED: (
        "the static trial does not start unloaded, or does not end unloaded, so migration is not identified from it"
    ),
    RejectionCode.SHORT: "the trial lasts {duration_s:.1f} s, too short for an oscillation",
    RejectionCode.NO_SWING: "the force does not swing for more than a few seconds; pull longer, about once a second",
    RejectionCode.FEW_CYCLES: ("the force swings for {cycles:.1f} cycles, expected at least {expected:g}; pull longer"),
    RejectionCode.FEW_SAMPLES: (f"force has {{samples:.1f}} {_FREQUENT}; pull slower or sample faster"),
    RejectionCode.SWING_HIDDEN: (
        "the markers are hidden or missing in most of the dynamic pull; check the cameras' view"
    ),
    RejectionCode.SMALL_MOTION: (
        "the cuff moves by ± {amplitude_m:mm .2f} mm, expected at least {expected:g} times the marker noise of "
        "{noise_m:mm .2f} mm; pull with more force"
    ),
    RejectionCode.SLIPS_ON: (
        "the cuff slips by {distance_m:mm .2f} mm during the swing and does not settle, an apparent damping of "
        "{damping_n_s_per_m:.0f} N s/m; fasten it tighter or pull with less force"
    ),
    RejectionCode.INDISTINCT: (
        "the cuff does not move as the force does, so stiffness and damping cannot be distinguished; check that the "
        "cuff's markers are on the cuff, and record again"
    ),
    RejectionCode.BOUNCE_FEW_CYCLES: (
        "the weight bounces {cycles:.1f} times, expected at least {expected:g}; let it bounce for half a minute"
    ),
    RejectionCode.BOUNCE_FEW_SAMPLES: (
        f"force has {{samples:.1f}} {_FREQUENT}; use a heavier weight or a softer spring, or sample faster"
    ),
    RejectionCode.BOUNCE_HIDDEN: (
        "marker {marker} is seen in {seen:percent .0f} % of the bounce, expected at least {expected:percent g} %; "
        "check the cameras' view and the label of the marker"
    ),
    RejectionCode.BOUNCE_STILL: (
        "marker {marker} moves by ± {amplitude_m:mm .2f} mm with the force, expected at least {expected:g} times its "
        "noise of {noise_m:mm .2f} mm; check that it is on the weight"
    ),
    RejectionCode.BOUNCE_GAPS: (
        "the bounce has {count:interval} of {length_s:.1f} s without a gap in force or marker, expected at least "
        "2; let it bounce longer in view of the cameras"
    ),
    RejectionCode.BOUNCE_POLARITY: (
        "the load cell reads {force_n:.1f} N under {mass_kg:g} kg, expected a positive force; reverse the "
        "polarity of the cell in the configuration"
    ),
    RejectionCode.BOUNCE_NOT_CONVERGED: (
        "the lag of the bounce is not identified: the fit did not converge; let the weight bounce freely in view of "
        "the cameras, and record again"
    ),
}

TRIAL_NOTES: Templates = {
    TrialNoteCode.DAMAGED: _ONLY_DAMAGE,
    TrialNoteCode.INCOMPLETE: "{missing}",
    TrialNoteCode.ASSIGNED: "assigned to this trial by the operator; recorded as {recorded_as}",
    TrialNoteCode.WINDOW: "only {start_s:.2f} to {end_s:.2f} s of the trial are used",
    TrialNoteCode.FORCE_LOST: (
        "force samples were lost {count:time}, {total_s:.2f} s in all, at most {longest_s:.2f} s at a time"
    ),
    TrialNoteCode.FRAMES_LOST: (
        "marker frames were lost {count:time}, {total_s:.2f} s in all, at most {longest_s:.2f} s at a time"
    ),
    TrialNoteCode.ZERO_DRIFT: (
        _REST + "; look for a load that was left on, and let the load cell and its amplifier warm up"
    ),
    TrialNoteCode.FORCE_MISSING: (
        "the force is missing in {share:percent .0f} % of the marker frames, which are left out"
    ),
    TrialNoteCode.MARKERS_HIDDEN: "anchor or cuff markers are hidden in {hidden:percent .0f} % of the frames",
    TrialNoteCode.GHOSTS: "marker positions that jumped or were exchanged were left out: {markers}",
    TrialNoteCode.LOOSE_MARKER: (
        "{marker} moves by {rms_m:mm .1f} mm rms relative to the other anchor markers: it is loose, skin moves under "
        "it, or its label is exchanged with that of a cuff marker; fix it, or remove it from anchor_markers"
    ),
    TrialNoteCode.SKIN: (
        "the anchor markers move relative to each other with the load (rms {rms_m:mm .2f} mm, correlation "
        "{correlation:.2f}): skin moves under a marker, or a label is exchanged with that of a cuff marker, and the "
        "stiffness may be biased"
    ),
    TrialNoteCode.LEAN: (
        "the body leaned {lean_m:mm .1f} mm with the load; displacement is relative to the anchor, but stand still or "
        "lean against a support"
    ),
    TrialNoteCode.TURNS: (
        "the cuff turns or bends with the load: its markers move apart by {apart_m:mm .1f} mm, and displacement is "
        "that of their mean; put them around the point where the rope pulls"
    ),
    TrialNoteCode.SYNC_CERTIFICATE: (
        "start and stop edge: offset {offset_of_both_edges_s:.4f} s",
        "start edge alone: offset {offset_of_start_edge_s:.4f} s",
        " ± {offset_sd_s:ms .2f} ms, ",
        "clock ratio not identified, assumed {assumed_drift:ppm +.0f} ± {drift_sd:ppm .0f} ppm",
        "clock ratio not identified, between {lowest_drift:ppm +.0f} and {highest_drift:ppm +.0f} ppm",
        "clock ratio {drift:ppm +.0f} ppm (95 % CI {low:ppm +.0f} to {high:ppm +.0f} ppm)",
        "; standard error of the time {time_sd_s:ms .2f} ms: {force_sd_n:.2f} N at {force_rate_n_per_s:.0f} N/s, or "
        "{displacement_sd_m:mm .3f} mm at {speed_m_per_s:mm .0f} mm/s",
    ),
    TrialNoteCode.SYNC_BOUNCES: "bounce: the sync line crosses its threshold again at an edge" + _CABLE,
    TrialNoteCode.SYNC_DIPS: "glitch: the sync line is low during the capture" + _CABLE,
    TrialNoteCode.SYNC_SPIKES: "glitch: the sync line is high outside the capture" + _CABLE,
    TrialNoteCode.SYNC_EARLY: (
        "early edge: the sync line rises {rest_s:.2f} s after its first sample, expected 2 s of rest before it; start "
        "the capture only when the station is armed"
    ),
    TrialNoteCode.SYNC_BEFORE_FRAMES: (
        "early edge: the sync line rose {early_s:.2f} s before the first frame, by the frames' number and by their "
        "arrival; the lag is uncertain by as much, set QTM's sync output to measurement time"
    ),
    TrialNoteCode.SYNC_LOW: "the sync line is low where the capture began; check its cable",
    TrialNoteCode.SYNC_NO_STOP: (
        "the sync line has not fallen when the recording ends: the start edge alone gives the time, and the clock "
        "ratio is assumed to be 0 ± 50 ppm; let the capture end before the recording"
    ),
    TrialNoteCode.SYNC_SHORT: (
        "no stop edge: the sync line is high for {duration_s:ms .0f} ms only, not for the capture; set QTM's output to "
        "measurement time"
    ),
    TrialNoteCode.SYNC_ARRIVAL: (
        "frame numbers put the capture's start {late_s:+.2f} s from the sync edge by the host's clock; markers are "
        "aligned by arrival time (± {standard_error_s:ms .0f} ms), too coarse for damping of a stiff cuff"
    ),
    TrialNoteCode.SYNC_CONTRADICTION: (
        "stop edge and number of frames disagree: the sync line fell ",
        "{before_end_s:ms .1f} ms before the last frame",
        "{between_frames_s:ms .1f} ms between two frames",
        ", more than clocks {limit:ppm .0f} ppm apart explain; the lag is uncertain by as much, check QTM's frame rate "
        "and its sync output",
    ),
    TrialNoteCode.SYNC_MISSING_FRAMES: (
        "the sync line fell several frames after the last received one: frames are missing at the end; the start edge "
        "alone gives the time"
    ),
    TrialNoteCode.CLOCKS_OR_FRAMES: (
        "clock ratio not identified: the stop edge needs a drift beyond that of crystals ({limit:ppm .0f} ppm), or "
        "{frames:.0f} missing frame(s) at the end; record a trial of another duration to distinguish the two"
    ),
    TrialNoteCode.CLOCKS_OPEN: (
        "clock ratio not identified: the capture is too short for the sampling interval and the stop edge's position "
        "in the last frame, which allow more than ±{limit:ppm .0f} ppm; record longer, or declare sync.stop_edge "
        "(docs/calibration.md)"
    ),
    TrialNoteCode.EMG_HOST_CLOCK: (
        "EMG is aligned with the markers within {standard_error_s:ms .0f} ms by the computers' clocks alone: {reason}; "
        "connect the sync line to the amplifier to measure a lag between EMG and motion"
    ),
    TrialNoteCode.EMG_NO_SYNC: "the amplifier does not record the sync line",
    TrialNoteCode.EMG_LEFT_OUT: "EMG and analog inputs are left out: {reason}",
    TrialNoteCode.ANOTHER_LINE: (
        "the rope pulls {angle_deg:.0f}° away from the donning's first line; the trial counts in three dimensions only"
    ),
    TrialNoteCode.TURNED: (
        "the cuff moves {angle_deg:.0f}° away from its direction in the donning's first {test} trial, and both count "
        "along one line; put two markers on the rope, which distinguish a turned pull from a cuff that slips sideways"
    ),
    TrialNoteCode.LOAD_FALLS: (
        "the load falls by {fall_n:.1f} N where {mass_kg:g} kg ({weight_n:.1f} N) and more are to be added; "
        "reverse the polarity of the cell in the configuration, or begin with the bare hook"
    ),
    TrialNoteCode.NO_WEIGHT: "no load step of the plan was added; the first is {weight_n:.1f} N",
    TrialNoteCode.WEIGHT_GAIN: (
        "the load rises by {rise_n:.1f} N where {mass_kg:g} kg ({weight_n:.1f} N) are added, {gain:.4f} ± "
        "{standard_error:.4f} times as much, {mistake}; correct the scale of the cell or the planned weights"
    ),
    TrialNoteCode.PULLEY: (
        "the same weights read {hysteresis:percent +.0f} % more while they are removed than while they are added: "
        "friction of the pulley is {friction:percent .0f} % of the load (± {standard_error:percent .1f} %); oil it "
        "(the cell reads the force at the cuff, so the fit is not affected)"
    ),
    TrialNoteCode.WRONG_LOAD: (
        "the load held from {start_s:.1f} s on is {found_n:.1f} N above the hook, expected {expected_n:.1f} N "
        "({count:weight}); correct the weights or the step's time in protocol.toml"
    ),
    TrialNoteCode.FEW_WEIGHTS: "the trial has {count:.0f} of {total:weight} of the plan",
    TrialNoteCode.ONE_BRANCH: (
        "all weights are removed at once: from a single unloading branch, slip and friction cannot be distinguished; "
        "remove them one by one"
    ),
    TrialNoteCode.START_LEFT_OUT: (
        "the cuff slipped or crept by {distance_m:mm .2f} mm in the first {cycles:.0f} cycle(s), which are left out"
    ),
    TrialNoteCode.POLARITY: (
        "the force falls by {fall_n:.1f} N from rest to the swing, and a rope only pulls: the sign of the load cell is "
        "wrong, reverse its polarity in the configuration; k and c of a swing are not affected"
    ),
    TrialNoteCode.SMALL_MOTION: (
        "the cuff moves by ± {amplitude_m:mm .2f} mm, only {ratio:.1f} times the marker noise, which the error of c "
        "includes; pull with more force"
    ),
    TrialNoteCode.DISAGREES: (
        "{method} gives a {quantity} of {other:.0f} ± {other_standard_error:.0f} {unit}, the fit {value:.0f} ± "
        "{standard_error:.0f} {unit}, more than {limit:g} standard errors apart: F = k x + c ẋ does not describe all "
        "of this record"
    ),
    TrialNoteCode.CHECK_NOT_CONVERGED: "{method} did not converge on this record, and does not check the fit",
    TrialNoteCode.COLOURED: (
        "the marker noise is correlated in time ({correlation:.2f} between neighbouring frames); check the mocap "
        "system's smoothing and the markers' hold on the cuff"
    ),
    TrialNoteCode.NOT_CONVERGED: (
        "the fit of damping did not converge: its figures still changed at the limit of rounds; check that the markers "
        "are on the cuff, and record again"
    ),
    TrialNoteCode.BOUNCE_GAIN: (
        "{file}: the load cell reads {gain:.3f} times the force of {mass_kg:g} kg, {mistake}; the lag is used, the "
        "gain is not"
    ),
    TrialNoteCode.BOUNCES_NOT_CONVERGED: (
        "the spread between the bounces is not identified: its iteration did not converge; record the bounces again"
    ),
    TrialNoteCode.BOUNCE_TARED: "{file}: the load cell was tared with the weight on; tare it with nothing on",
}

TENSORS: Templates = {
    TensorCode.NO_ROPE: "{quantity} in three dimensions needs two markers on the rope (rope_markers) and {test} trials",
    TensorCode.ROPE_HIDDEN: "{quantity} in three dimensions needs the rope's markers, hidden in most of {file}",
    TensorCode.ROPE_HIDDEN_IN_HOLD: (
        "stiffness in three dimensions needs the rope's markers in every hold; check the cameras' view"
    ),
    TensorCode.ONE_LINE: (
        "{quantity} in three dimensions needs pulls that span space, and the {test} trials pull along one line, which "
        "determines 3 of 6 entries; record two more directions, 30° or more towards {missing}"
    ),
    TensorCode.ONE_PLANE: (
        "{quantity} in three dimensions needs pulls that span space, and the {test} trials pull in one plane "
        "({directions:direction}), which determines 5 of 6 entries; record one more direction, 30° or more "
        "towards {missing}"
    ),
    TensorCode.EQUAL_LOADS: (
        "stiffness in three dimensions is not identified: the loads of some pull do not differ; hang on more weight"
    ),
    TensorCode.NOT_POSITIVE: (
        "{quantity} in three dimensions is not identified: its smallest eigenvalue is {eigenvalue:.0f} ± "
        "{half_width:.0f}, expected above 0; pull farther apart or with more weight"
    ),
    TensorCode.NO_SWING: "damping in three dimensions is not identified: in {file} {reason}",
    TensorCode.NOT_CONVERGED: (
        "{quantity} in three dimensions is not identified: the fit did not converge; pull with more force"
    ),
}

GAIN_MISTAKES: Templates = {
    GainMistake.CAPACITY_DOUBLED: "as if the configured capacity were twice the cell's",
    GainMistake.CAPACITY_HALVED: "as if the configured capacity were half the cell's",
    GainMistake.CAPACITY_TENFOLD: "as if the configured capacity were ten times the cell's",
    GainMistake.CAPACITY_TENTH: "as if the configured capacity were a tenth of the cell's",
    GainMistake.CAPACITY_25_LB: "as if the cell were one of 25 lb and not of 10 kg, or the reverse",
    GainMistake.POUNDS_FOR_KILOGRAMS: "as if pounds were taken for kilograms",
    GainMistake.KILOGRAMS_FOR_POUNDS: "as if kilograms were taken for pounds",
    GainMistake.NEWTONS_FOR_POUNDS: "as if newtons were taken for pounds",
    GainMistake.POUNDS_FOR_NEWTONS: "as if pounds were taken for newtons",
    GainMistake.NEWTONS_FOR_KILOGRAMS: "as if newtons were taken for kilograms",
    GainMistake.KILOGRAMS_FOR_NEWTONS: "as if kilograms were taken for newtons",
    GainMistake.UNKNOWN: (
        "which no common mistake explains; check capacity and full scale of the cell, and the weights"
    ),
}
