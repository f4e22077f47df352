"""Codes on trials: why one cannot be used, notes, reasons for no tensor."""

from __future__ import annotations

from documents.message import Code

_AGAIN = "record the trial again"
_ONLY_DAMAGE = (
    "the file is damaged ({damage}",
    " and {more:.0f} more",
    "), so nothing else in it is diagnosed; restore it from a copy, or record the trial again",
)
_REST = "the force at rest changes by {drift_n:+.2f} N from start to end, expected at most {limit_n:.2f} N"
_FREQUENT = "samples per cycle of {frequency_hz:.2f} Hz, expected at least {expected:g}"
_SPIKES = "{count:.0f} of {total:.0f} force samples are spikes of up to {most_n:.0f} N"
_PLUG = "check plug, cable and shield of the load cell"
_LOST = " were lost {count:time}, {total_s:.2f} s in all, at most {longest_s:.2f} s at a time"
_STUCK = "force reads {force_n:.2f} N without change for {duration_s:.1f} s from {start_s:.1f} s on "
_HUNG = f"the converter or its stream hung; check the amplifier and its cable, and {_AGAIN}"
_CABLE = " {count:time} for less than 20 ms, at {at}; ignored, check the cable"


class RejectionCode(Code, prefix="rejected."):
    """Why a recording is not used: it is unusable, or another recording replaces it."""

    RECORDED_AGAIN = "recorded again as {file}"
    NOT_ACCEPTED = "the trial was not accepted when it was recorded: {outcome}"
    SET_ASIDE = "set aside by the operator: {reason}"
    OTHER_TRIAL = (
        "a copy by its name, and by its content cut or of another trial; the original is used, delete the copy"
    )
    DAMAGED = _ONLY_DAMAGE
    UNREADABLE = "{problem}"
    IS_BOUNCE = "{file} is a bounce, which calibrates the load cell; give a trial of a cuff"
    IS_WEARER_TRIAL = "{file} is a {test} of the wearer and no pull on a cuff; it is for `station ik`"
    NO_CUFF = "{file} is a recording without a cuff; give the test a cuff"
    NO_BOUNCE = "{file} is a recording without a bounce; its manifest has no weight"
    NO_BODY = "{file} is not a pose or motion of the wearer; its manifest has no markers of a body"
    EMG_NO_CLOCK = (
        "rejected.emg_without_clock",
        "EMG cannot be aligned with the markers: {reason}, and no clock offset was measured; record the sync line with "
        "the amplifier, or record the trial again",
    )
    OTHER_MARKERS = "its markers are not those of the donning's first trial; use one configuration in a donning"
    NO_SAMPLES = "the recording has no samples of {stream}; check the bench to see whether its device answers"
    NUMBERS_GO_BACK = (
        f"the sample numbers of {{stream}} go back or repeat at sample {{sample:.0f}}, expected increasing numbers; "
        f"{_AGAIN}"
    )
    NO_OVERLAP = (
        "force ends {force_end_s:.2f} s and markers end {marker_end_s:.2f} s after the sync edge, with {samples:sample}"
        f" and {{frames:frame}} in {{both_s:.2f}} s of both, expected at least {{expected_s:g}} s; {_AGAIN}"
    )
    NO_FRAMES = "the recording has no marker frame after the sync edge; check that QTM was capturing"
    MISSING_MARKERS = (
        "the recording has no marker {missing}, only {present}; correct the labels in QTM or in the cuff's section of "
        "the configuration"
    )
    SYNC_NOT_FINITE = "the sync line has no finite samples; check the sync channel's wiring and record again"
    SYNC_NEVER_RISES = (
        "the sync line never rises above {threshold_v:g} V (highest {highest_v:.2f} V); check the cable from QTM's "
        "sync output and the configured threshold"
    )
    SYNC_RISES_AGAIN = (
        "the sync line rises {count:time} (at {at}), expected once; set QTM's output to one pulse for the whole "
        "capture and record again"
    )
    SYNC_INVERTED = (
        "wrong polarity: the sync line starts at {level_v:.2f} V, expected below {threshold_v:g} V until the capture "
        "starts, and is low for {gap_s:.2f} s from {fell_s:.2f} s on; set QTM's output to active high, or swap the two "
        "wires"
    )
    SYNC_STARTS_HIGH = (
        "the sync line starts at {level_v:.2f} V, expected below {threshold_v:g} V until the capture starts; check "
        "that QTM's output is active high and that the station is armed before the capture"
    )
    FORCE_NOT_FINITE = f"force has {{count:.0f}} of {{total:.0f}} samples that are not finite numbers; {_AGAIN}"
    LABELS_EXCHANGED = (
        "the labels {anchor} of the anchor and {cuff} of the cuff are exchanged in the whole trial: the anchor bends "
        "by {rms_m:mm .1f} mm rms as labelled, and by {exchanged_m:mm .1f} mm with them exchanged; correct them in the "
        "mocap system, and record or import again"
    )
    LITTLE_IN_COMMON = (
        "force and cuff are both known in {share:percent .0f} % of the marker frames, expected at least "
        "{limit:percent .0f} %; check the connection of the load cell and what hides the markers, and record again"
    )
    FORCE_MISSING = (
        "the force is missing in {share:percent .0f} % of the marker frames, expected at most {limit:percent .0f} %; "
        "check the connection of the load cell and its rate, and record again"
    )
    FORCE_SPIKES = f"{_SPIKES}; {_PLUG}, and {_AGAIN}"
    FORCE_SATURATED = (
        "force is saturated in {count:.0f} of {total:.0f} samples (at {limit:.4g} {unit}); check wiring, "
        "input range, capacity of the cell and the amplifier's zero"
    )
    FORCE_CONSTANT = "force reads {value:g} in all {total:.0f} samples, expected noise and load; check the load cell"
    FORCE_STUCK_MOVING = "rejected.force_stuck_while_moving", f"{_STUCK}while the cuff moves: {_HUNG}"
    FORCE_STUCK_QUIET = (
        "rejected.force_stuck_without_noise",
        f"{_STUCK}although its noise elsewhere is {{noise_n:.2g}} N: {_HUNG}",
    )
    FORCE_NOISE = (
        "rejected.force_noise_alone",
        "force is noise about {force_n:.2f} N while the cuff moves by {travel_m:mm .1f} mm; check that the load cell "
        f"is in the rope and connected, and {_AGAIN}",
    )
    FORCE_POLARITY = (
        "force falls from {before_n:.1f} N to {after_n:.1f} N when the load is added, expected a rise; "
        "reverse the polarity of the cell in the configuration"
    )
    FORCE_DRIFTS = (
        "the force drifts by {drift_n_per_s:+.2f} N/s for {duration_s:.0f} s while the cuff rests; let the load cell "
        f"and its amplifier warm up, check their supply, and {_AGAIN}"
    )
    STEPS_APART = (
        "force and displacement are not on one clock: the displacement follows the force by {offset_s:+.1f} s; "
        "check the sync line, or import the files with this lag (`--lag-s`)"
    )
    ZERO_DRIFT = (
        _REST
        + " (load_cell.zero_drift_relative_limit); look for a load that was left on or a loose mount, let the load "
        f"cell and its amplifier warm up, and {_AGAIN}"
    )
    ANCHOR_HIDDEN = (
        "the anchor has {count:.0f} visible marker(s) of {markers}, expected at least {expected:.0f} that are not "
        "collinear; put more markers on the anchoring body"
    )
    ANCHOR_COLLINEAR = (
        "the anchor markers {markers} are collinear (spread across the line {width_m:mm .1f} mm, expected at least "
        "{expected_m:mm g} mm), so rotation about the line is not defined; move one aside"
    )
    CUFF_HIDDEN = (
        "rejected.cuff_hidden_at_start",
        "the cuff markers {markers} are hidden at the start; check the cameras' view",
    )
    MARKERS_HIDDEN = (
        "anchor or cuff markers are hidden in {hidden:percent .0f} % of the frames, expected at most {limit:percent "
        ".0f} %; check the cameras' view and record again"
    )
    MARKERS_FROZEN = (
        "the markers do not change at all for {duration_s:.1f} s from {start_s:.1f} s on while the force changes; "
        "check that QTM was measuring, and record again"
    )
    DISPLACEMENT_UNIT = (
        "the cuff moves by {rms_m:.3g} m rms, expected between {least_m:g} and {most_m:g} m; check that the markers "
        "are in millimetres"
    )
    NO_MOTION = "the cuff does not move with the force; check that the rope was loaded"
    FEW_LOADS = "fewer than three loads were held; hold each load for at least 4 s"
    NOT_UNLOADED = (
        "the static trial does not start unloaded, or does not end unloaded, so migration is not identified from it"
    )
    SHORT = "the trial lasts {duration_s:.1f} s, too short for an oscillation"
    NO_SWING = "the force does not swing for more than a few seconds; pull longer, about once a second"
    FEW_CYCLES = "the force swings for {cycles:.1f} cycles, expected at least {expected:g}; pull longer"
    FEW_SAMPLES = (
        "rejected.few_samples_per_cycle",
        f"force has {{samples:.1f}} {_FREQUENT}; pull slower or sample faster",
    )
    SWING_HIDDEN = "the markers are hidden or missing in most of the dynamic pull; check the cameras' view"
    FEW_FRAMES = (
        "the markers have {rate_hz:.4g} frames a second, expected at least {expected_hz:.4g}; raise QTM's frame rate"
    )
    SMALL_MOTION = (
        "the cuff moves by ± {amplitude_m:mm .2f} mm, expected at least {expected:g} times the marker noise of "
        "{noise_m:mm .2f} mm; pull with more force"
    )
    SLIPS_ON = (
        "rejected.slips_throughout",
        "the cuff slips by {distance_m:mm .2f} mm during the swing and does not settle, an apparent damping of "
        "{damping_n_s_per_m:.0f} N s/m; fasten it tighter or pull with less force",
    )
    INDISTINCT = (
        "rejected.stiffness_and_damping_indistinct",
        "the cuff does not move as the force does, so stiffness and damping cannot be distinguished; check that the "
        "cuff's markers are on the cuff and that force and markers are on one clock, and record again",
    )
    BOUNCE_FEW_CYCLES = (
        "the weight bounces {cycles:.1f} times, expected at least {expected:g}; let it bounce for half a minute"
    )
    BOUNCE_FEW_SAMPLES = (
        "rejected.bounce_few_samples_per_cycle",
        f"force has {{samples:.1f}} {_FREQUENT}; use a heavier weight or a softer spring, or sample faster",
    )
    BOUNCE_HIDDEN = (
        "rejected.bounce_marker_hidden",
        "marker {marker} is seen in {seen:percent .0f} % of the bounce, expected at least {expected:percent g} %; "
        "check the cameras' view and the label of the marker",
    )
    BOUNCE_STILL = (
        "rejected.bounce_marker_still",
        "marker {marker} moves by ± {amplitude_m:mm .2f} mm with the force, expected at least {expected:g} times its "
        "noise of {noise_m:mm .2f} mm; check that it is on the weight",
    )
    BOUNCE_GAPS = (
        "the bounce has {count:interval} of {length_s:.1f} s without a gap in force or marker, expected at least "
        "2; let it bounce longer in view of the cameras"
    )
    BOUNCE_POLARITY = (
        "the load cell reads {force_n:.1f} N under {mass_kg:g} kg, expected a positive force; reverse the "
        "polarity of the cell in the configuration"
    )
    BOUNCE_NOT_CONVERGED = (
        "the lag of the bounce is not identified: the fit did not converge; let the weight bounce freely in view of "
        "the cameras, and record again"
    )


class TrialNoteCode(Code):
    """A remark on a single trial: its subject, then after a dot the remark."""

    DAMAGED = "recording.damaged", *_ONLY_DAMAGE
    INCOMPLETE = "recording.incomplete", "{missing}"
    ASSIGNED = "recording.assigned", "assigned to this trial by the operator; recorded as {recorded_as}"
    WINDOW = "recording.window", "only {start_s:.2f} to {end_s:.2f} s of the trial are used"
    FORCE_LOST = "force.samples_lost", "force samples" + _LOST
    FORCE_SPIKES = "force.spikes", f"{_SPIKES} and are left out; {_PLUG}"
    FORCE_MISSING = (
        "force.missing",
        "the force is missing in {share:percent .0f} % of the marker frames, which are left out",
    )
    ZERO_DRIFT = (
        "force.zero_drift",
        _REST + "; look for a load that was left on, and let the load cell and its amplifier warm up",
    )
    FRAMES_LOST = "markers.frames_lost", "marker frames" + _LOST
    MARKERS_HIDDEN = "markers.hidden", "anchor or cuff markers are hidden in {hidden:percent .0f} % of the frames"
    GHOSTS = "markers.ghosts", "marker positions that jumped or were exchanged were left out: {markers}"
    LOOSE_MARKER = (
        "markers.loose_anchor_marker",
        "{marker} moves by {rms_m:mm .1f} mm rms relative to the other anchor markers: it is loose, skin moves under "
        "it, or its label is exchanged with that of a cuff marker; fix it, or remove it from anchor_markers",
    )
    SKIN = (
        "markers.skin_motion",
        "the anchor markers move relative to each other with the load (rms {rms_m:mm .2f} mm, correlation "
        "{correlation:.2f}): skin moves under a marker, or a label is exchanged with that of a cuff marker, and the "
        "stiffness may be biased",
    )
    LEAN = (
        "markers.lean",
        "the body leaned {lean_m:mm .1f} mm with the load; displacement is relative to the anchor, but stand still or "
        "lean against a support",
    )
    TURNS = (
        "markers.cuff_turns",
        "the cuff turns or bends with the load: its markers move apart by {apart_m:mm .1f} mm, and displacement is "
        "that of their mean; put them around the point where the rope pulls",
    )
    SYNC_CERTIFICATE = (
        "sync.certificate",
        "start and stop edge: offset {offset_of_both_edges_s:.4f} s",
        "start edge alone: offset {offset_of_start_edge_s:.4f} s",
        " ± {offset_sd_s:ms .2f} ms, ",
        "clock ratio not identified, assumed {assumed_drift:ppm +.0f} ± {drift_sd:ppm .0f} ppm",
        "clock ratio not identified, between {lowest_drift:ppm +.0f} and {highest_drift:ppm +.0f} ppm",
        "clock ratio {drift:ppm +.0f} ppm (95 % CI {low:ppm +.0f} to {high:ppm +.0f} ppm)",
        "; standard error of the time {time_sd_s:ms .2f} ms: {force_sd_n:.2f} N at {force_rate_n_per_s:.0f} N/s, or "
        "{displacement_sd_m:mm .3f} mm at {speed_m_per_s:mm .0f} mm/s",
    )
    SYNC_BOUNCES = "sync.edge_bounces", "bounce: the sync line crosses its threshold again at an edge" + _CABLE
    SYNC_DIPS = "sync.low_during_capture", "glitch: the sync line is low during the capture" + _CABLE
    SYNC_SPIKES = "sync.high_beside_capture", "glitch: the sync line is high outside the capture" + _CABLE
    SYNC_EARLY = (
        "sync.early_edge",
        "early edge: the sync line rises {rest_s:.2f} s after its first sample, expected 2 s of rest before it; start "
        "the capture only when the station is armed",
    )
    SYNC_BEFORE_FRAMES = (
        "sync.edge_before_first_frame",
        "early edge: the sync line rose {early_s:.2f} s before the first frame, by the frames' number and by their "
        "arrival; the lag is uncertain by as much, set QTM's sync output to measurement time",
    )
    SYNC_LOW = "sync.low_at_start", "the sync line is low where the capture began; check its cable"
    SYNC_NO_STOP = (
        "sync.no_stop_edge",
        "the sync line has not fallen when the recording ends: the start edge alone gives the time, and the clock "
        "ratio is assumed to be 0 ± 50 ppm; let the capture end before the recording",
    )
    SYNC_SHORT = (
        "sync.short_pulse",
        "no stop edge: the sync line is high for {duration_s:ms .0f} ms only, not for the capture; set QTM's output to "
        "measurement time",
    )
    SYNC_ARRIVAL = (
        "sync.aligned_by_arrival",
        "frame numbers put the capture's start {late_s:+.2f} s from the sync edge by the host's clock; markers are "
        "aligned by arrival time (± {standard_error_s:ms .0f} ms), too coarse for damping of a stiff cuff",
    )
    SYNC_CONTRADICTION = (
        "sync.stop_edge_contradicts_frames",
        "stop edge and number of frames disagree: the sync line fell ",
        "{before_end_s:ms .1f} ms before the last frame",
        "{between_frames_s:ms .1f} ms between two frames",
        ", more than clocks {limit:ppm .0f} ppm apart explain; the lag is uncertain by as much, check QTM's frame rate "
        "and its sync output",
    )
    SYNC_MISSING_FRAMES = (
        "sync.frames_missing_at_end",
        "the sync line fell several frames after the last received one: frames are missing at the end; the start edge "
        "alone gives the time",
    )
    CLOCKS_OR_FRAMES = (
        "sync.clock_ratio_or_missing_frames",
        "clock ratio not identified: the stop edge needs a drift beyond that of crystals ({limit:ppm .0f} ppm), or "
        "{frames:.0f} missing frame(s) at the end; record a trial of another duration to distinguish the two",
    )
    CLOCKS_OPEN = (
        "sync.clock_ratio_open",
        "clock ratio not identified: the capture is too short for the sampling interval and the stop edge's position "
        "in the last frame, which allow more than ±{limit:ppm .0f} ppm; record longer, or declare sync.stop_edge "
        "(docs/calibration.md)",
    )
    EMG_HOST_CLOCK = (
        "emg.aligned_by_host_clock",
        "EMG is aligned with the markers within {standard_error_s:ms .0f} ms by the computers' clocks alone: {reason}; "
        "connect the sync line to the amplifier to measure a lag between EMG and motion",
    )
    EMG_NO_SYNC = "emg.no_sync_line", "the amplifier does not record the sync line"
    EMG_LEFT_OUT = "emg.left_out", "EMG and analog inputs are left out: {reason}"
    ANOTHER_LINE = (
        "pull.another_line",
        "the rope pulls {angle_deg:.0f}° away from the donning's first line; the trial counts in three dimensions only",
    )
    TURNED = (
        "pull.motion_turned",
        "the cuff moves {angle_deg:.0f}° away from its direction in the donning's first {test} trial, and both count "
        "along one line; put two markers on the rope, which distinguish a turned pull from a cuff that slips sideways",
    )
    LOAD_FALLS = (
        "weights.load_falls",
        "the load falls by {fall_n:.1f} N where {mass_kg:g} kg ({weight_n:.1f} N) and more are to be added; "
        "reverse the polarity of the cell in the configuration, or begin with the bare hook",
    )
    NO_WEIGHT = "weights.none_hung_on", "no load step of the plan was added; the first is {weight_n:.1f} N"
    WEIGHT_GAIN = (
        "weights.gain_error",
        "the load rises by {rise_n:.1f} N where {mass_kg:g} kg ({weight_n:.1f} N) are added, {gain:.4f} ± "
        "{standard_error:.4f} times as much, {mistake}; correct the scale of the cell or the planned weights",
    )
    PULLEY = (
        "weights.pulley_friction",
        "the same weights read {hysteresis:percent +.0f} % more while they are removed than while they are added: "
        "friction of the pulley is {friction:percent .0f} % of the load (± {standard_error:percent .1f} %); oil it "
        "(the cell reads the force at the cuff, so the fit is not affected)",
    )
    WRONG_LOAD = (
        "weights.wrong_load",
        "the load held from {start_s:.1f} s on is {found_n:.1f} N above the hook, expected {expected_n:.1f} N "
        "({count:weight}); correct the weights or the step's time in protocol.toml",
    )
    FEW_WEIGHTS = "weights.some_not_hung_on", "the trial has {count:.0f} of {total:weight} of the plan"
    ONE_BRANCH = (
        "weights.single_unloading_branch",
        "all weights are removed at once: from a single unloading branch, slip and friction cannot be distinguished; "
        "remove them one by one",
    )
    START_LEFT_OUT = (
        "swing.start_left_out",
        "the cuff slipped or crept by {distance_m:mm .2f} mm in the first {cycles:.0f} cycle(s), which are left out",
    )
    POLARITY = (
        "swing.polarity",
        "the force falls by {fall_n:.1f} N from rest to the swing, and a rope only pulls: the sign of the load cell is "
        "wrong, reverse its polarity in the configuration; k and c of a swing are not affected",
    )
    SMALL_MOTION = (
        "swing.small_motion",
        "the cuff moves by ± {amplitude_m:mm .2f} mm, only {ratio:.1f} times the marker noise, which the error of c "
        "includes; pull with more force",
    )
    DISAGREES = (
        "swing.cross_check_disagrees",
        "{method} gives a {quantity} of {other:.0f} ± {other_standard_error:.0f} {unit}, the fit {value:.0f} ± "
        "{standard_error:.0f} {unit}, more than {limit:g} standard errors apart: F = k x + c ẋ does not describe all "
        "of this record",
    )
    CHECK_NOT_CONVERGED = (
        "swing.cross_check_not_converged",
        "{method} did not converge on this record, and does not check the fit",
    )
    COLOURED = (
        "swing.marker_noise_correlated",
        "the marker noise is correlated in time ({correlation:.2f} between neighbouring frames); check the mocap "
        "system's smoothing and the markers' hold on the cuff",
    )
    NOT_CONVERGED = (
        "swing.not_converged",
        "the fit of damping did not converge: its figures still changed at the limit of rounds; check that the markers "
        "are on the cuff, and record again",
    )
    BOUNCE_GAIN = (
        "bounce.gain_error",
        "{file}: the load cell reads {gain:.3f} times the force of {mass_kg:g} kg, {mistake}; the lag is used, the "
        "gain is not",
    )
    BOUNCES_NOT_CONVERGED = (
        "bounce.spread_not_converged",
        "the spread between the bounces is not identified: its iteration did not converge; record the bounces again",
    )
    BOUNCE_TARED = (
        "bounce.tared_with_weight",
        "{file}: the load cell was tared with the weight on; tare it with nothing on",
    )


class TensorCode(Code, prefix="tensor."):
    """Why there is no stiffness or damping in three dimensions."""

    NO_ROPE = (
        "tensor.no_rope_markers",
        "{quantity} in three dimensions needs two markers on the rope (rope_markers) and {test} trials",
    )
    ROPE_HIDDEN = "{quantity} in three dimensions needs the rope's markers, hidden in most of {file}"
    ROPE_HIDDEN_IN_HOLD = (
        "tensor.rope_hidden_in_a_hold",
        "stiffness in three dimensions needs the rope's markers in every hold; check the cameras' view",
    )
    ONE_LINE = (
        "tensor.pulls_along_one_line",
        "{quantity} in three dimensions needs pulls that span space, and the {test} trials pull along one line, which "
        "determines 3 of 6 entries; record two more directions, 30° or more towards {missing}",
    )
    ONE_PLANE = (
        "tensor.pulls_in_one_plane",
        "{quantity} in three dimensions needs pulls that span space, and the {test} trials pull in one plane "
        "({directions:direction}), which determines 5 of 6 entries; record one more direction, 30° or more "
        "towards {missing}",
    )
    EQUAL_LOADS = (
        "stiffness in three dimensions is not identified: the loads of some pull do not differ; hang on more weight"
    )
    NOT_POSITIVE = (
        "{quantity} in three dimensions is not identified: its smallest eigenvalue is {eigenvalue:.0f} ± "
        "{half_width:.0f}, expected above 0; pull farther apart or with more weight"
    )
    NO_SWING = "damping in three dimensions is not identified: in {file} {reason}"
    NOT_CONVERGED = "{quantity} in three dimensions is not identified: the fit did not converge; pull with more force"
