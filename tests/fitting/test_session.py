"""Whole sessions of a simulated experiment whose truth is known: what the station is for."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_file import cuffs_json
from fitting.diagnosis.identification import _stopped_static, along_unknown_rope
from fitting.pull.pull import make_pulls
from fitting.results.codes import EXPLAINED_BY, NoteCode, Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.session import fit_session
from fitting.trial.bounce import calibrate
from fitting.trial.trial import RejectedTrial, Trial, build_bounce, build_trial, calibrated
from fitting.uncertainty import normal_estimate
from recordings.manifest import MeasurementProtocol
from recordings.reader import Track
from tests.fitting.bouncing import Bounce
from tests.fitting.bouncing import recorded as bounced
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import PUBLISHED, Session, published
from tests.refusals import figures_by_code

FIVE = (15.0 / 9.80665,) * 5
"""Weights of the static trials [kg]."""


@cache
def _donning(
    cuff: str, repeats: int = 1, seed: int = 1, rate: float = 1000.0, *, has_rope_markers: bool = False
) -> tuple[tuple[Trial, ...], float]:
    """Static and dynamic trials, alternating, and how far the cuff had slipped after the last static one."""
    truth = published(cuff, force_rate=rate, hold=4.0, duration=16.0, has_rope_markers=has_rope_markers)
    session = Session(truth, seed)
    trials, slip = [], 0.0
    for repeat in range(1, repeats + 1):
        trials.append(build_trial(*session.static(repeat), f"{cuff}-static-{repeat}", f"s{repeat}"))
        slip = session.slip
        trials.append(build_trial(*session.dynamic(repeat), f"{cuff}-dynamic-{repeat}", f"d{repeat}"))
    return tuple(trials), slip


@cache
def _fitted(cuff: str, repeats: int = 1) -> SessionFit:
    return fit_session(_donning(cuff, repeats)[0])


def _fit(trials: Sequence[Trial]) -> CuffFit:
    return fit_session(trials).cuffs[trials[0].cuff.name]


def _causes(fit: CuffFit) -> list[Note]:
    """Notes that explain a verdict."""
    return [note for note in fit.notes if note.code in EXPLAINED_BY]


def _values(fit: CuffFit) -> np.ndarray:
    return np.array([e.value for e in (fit.stiffness, fit.damping, fit.migration) if e])


@pytest.mark.parametrize("cuff", PUBLISHED)
def test_the_published_cuffs_come_back_although_they_migrate(cuff: str) -> None:
    repeats = 2 if cuff == "hand" else 1
    slip, fit = _donning(cuff, repeats)[1], _fitted(cuff, repeats).cuffs[cuff]
    assert fit.verdicts == (Verdict.IDENTIFIED,)
    assert fit.damping
    assert fit.migration
    stiffness, damping, _ = PUBLISHED[cuff]
    assert fit.stiffness.value == pytest.approx(stiffness, rel=0.01)
    for estimate, truth in ((fit.stiffness, stiffness), (fit.damping, damping), (fit.migration, slip)):
        assert abs(estimate.value - truth) < 3.3 * estimate.standard_error
    assert fit.damping.standard_error < 0.2 * damping
    assert fit.migration.standard_error < 1e-4
    assert fit.diagnostics["slip_m"] == pytest.approx(slip, rel=0.05)


def test_a_fit_says_whether_a_bounce_calibrated_lag_and_gain() -> None:
    trials = _donning("hand")[0]
    declared = _fitted("hand")
    note = figures_by_code(declared.cuffs["hand"].notes)[NoteCode.NOT_CALIBRATED]
    assert note == {"lag_s": trials[0].lag.value, "lag_sd_s": trials[0].lag.declared, "gain_sd": trials[0].gain_sd}
    assert NoteCode.NOT_CALIBRATED in repr(declared.cuffs["hand"])
    assert declared.bounces == ()

    calibration, _ = calibrate([build_bounce(*bounced(Bounce(), 1), "bounce-1", "s")])
    assert calibration
    known = fit_session([calibrated(trial, calibration) for trial in trials])
    assert NoteCode.NOT_CALIBRATED not in figures_by_code(known.cuffs["hand"].notes)
    assert NoteCode.NOT_CALIBRATED not in repr(known.cuffs["hand"])
    assert known.bounces == ("bounce-1",)


def test_a_wrong_gain_of_the_load_cell_scales_stiffness_and_damping_alike() -> None:
    gain_sd = 0.02
    fit = _fit([replace(trial, gain_sd=gain_sd) for trial in _donning("tube", has_rope_markers=True)[0]])
    stiffness, damping, _ = _values(fit)
    assert fit.covariance[0, 1] == pytest.approx(gain_sd**2 * stiffness * damping, rel=1e-3)
    assert fit.covariance[1, 0] == fit.covariance[0, 1]
    assert not fit.covariance[2, :2].any()


@pytest.mark.parametrize("ratio", [0.5, pytest.param(1.0, marks=pytest.mark.slow), 2.0])
def test_without_rope_markers_the_intervals_contain_the_figures_along_an_oblique_rope(ratio: float) -> None:
    angle = np.radians(35.0)
    along = 1 / (np.cos(angle) ** 2 + np.sin(angle) ** 2 / ratio)
    session = OddSession(Law(), Rig(static_angle=angle, dynamic_angle=angle, ratio=ratio), 1)
    fit = _fit([build_trial(*session.static(1), "s", "s"), build_trial(*session.dynamic(1), "d", "d")])
    for estimate, truth in ((fit.stiffness, along * Law().stiffness), (fit.damping, along * Law().damping)):
        assert estimate and estimate.ci95[0] < truth < estimate.ci95[1]
        assert sum(part**2 for part in estimate.parts.values()) == pytest.approx(estimate.standard_error**2)
    assert fit.stiffness and fit.damping
    shared = fit.stiffness.parts["direction"] * fit.damping.parts["direction"]
    assert fit.covariance[0, 1] == pytest.approx(shared + fit.stiffness.parts["gain"] * fit.damping.parts["gain"])
    assert NoteCode.NO_ROPE in [note.code for note in fit.notes]


def test_the_figure_along_an_unknown_rope_is_in_its_interval_for_every_direction_of_the_pull() -> None:
    """A bound that is attained: some of the pulls reach most of it."""
    random, ratios = np.random.default_rng(0), []
    for _ in range(200):
        axes, _ = np.linalg.qr(random.standard_normal((3, 3)))
        pull = random.standard_normal(3)
        pull /= np.linalg.norm(pull)
        displacement = axes @ np.diag([1e-3, 7e-4, 5e-4]) @ axes.T @ pull
        found = along_unknown_rope(normal_estimate(1 / float(np.linalg.norm(displacement)), 1e-9))
        assert found and found.ci95[0] <= 1 / float(pull @ displacement) <= found.ci95[1]
        ratios.append(1 / float(pull @ displacement) / found.ci95[1])
    assert max(ratios) > 0.99


@pytest.mark.parametrize("cuff", ["waist", "tube"])
def test_force_at_twenty_hertz_still_gives_the_stiffness_and_an_honest_damping(cuff: str) -> None:
    fit = _fit(_donning(cuff, seed=1 if cuff == "waist" else 4, rate=20.0)[0])
    stiffness, damping, _ = PUBLISHED[cuff]
    assert fit.stiffness.value == pytest.approx(stiffness, rel=0.01)
    if cuff == "waist":
        assert fit.damping.value == pytest.approx(damping, rel=0.2)
        assert abs(fit.damping.value - damping) < 3.3 * fit.damping.standard_error
        assert NoteCode.STATIC_STIFFNESS_USED in [note.code for note in fit.notes]
    else:
        assert abs(fit.damping.value - damping) < 3.3 * fit.damping.standard_error
        assert fit.damping.standard_error > 0.5 * damping
        assert fit.verdicts == (Verdict.LAG,)
        assert fit.missing == ("damping",), "it cannot be worn"
        assert all(band.damping.standard_error > 0.5 * damping for band in fit.complex_stiffness)


def test_a_damping_that_comes_out_negative_is_not_called_identified() -> None:
    """An undeclared lag of 50 ms: c and k τ are 210 and −426 N s/m."""
    trials = [replace(trial, force_time=trial.force_time + 0.05) for trial in _donning("hand")[0]]
    fit = _fit(trials)
    assert fit.damping and fit.damping.value < 0
    assert fit.verdicts == (Verdict.NEGATIVE,)
    assert fit.missing == ("damping",)


def test_what_is_not_known_of_the_lag_is_in_damping_over_frequency_too() -> None:
    lag_sd = 10e-3
    trials = [replace(trial, lag=replace(trial.lag, declared=lag_sd)) for trial in _donning("hand")[0]]
    bands = _fit(trials).complex_stiffness
    assert bands
    for band in bands:
        assert band.damping.parts["lag"] >= 0.9 * 8520 * lag_sd
        assert band.damping.ci95[1] - band.damping.ci95[0] > 2 * 1.96 * 0.9 * 8520 * lag_sd
        assert sum(part**2 for part in band.damping.parts.values()) == pytest.approx(band.damping.standard_error**2)


def test_a_session_without_static_trials_says_so() -> None:
    fit = _fit(_donning("hand")[0][1:])
    assert fit.stiffness is None
    assert fit.migration is None
    assert fit.damping
    assert fit.verdicts == (Verdict.NO_STATIC,)


@pytest.mark.parametrize(
    ("end_s", "verdicts"), [(7.0, {Verdict.FEW_LOADS}), (22.0, {Verdict.ONLY_ROSE, Verdict.NOT_UNLOADED})]
)
def test_few_held_loads_and_a_load_that_only_rose_are_not_a_stiffness(end_s: float, verdicts: set[Verdict]) -> None:
    fit = _fit([_cut(_donning("hand")[0][0], end_s)])
    assert fit.stiffness is None and verdicts <= set(fit.verdicts)
    assert all(verdict.sentence() in fit.verdict for verdict in verdicts - {Verdict.NOT_UNLOADED}), "no planned weights"


@pytest.mark.parametrize(
    ("end_s", "code", "count"),
    [(7.0, NoteCode.STOPPED_LOADING, 1), (18.0, NoteCode.STOPPED_LOADING, 4), (36.0, NoteCode.STOPPED_UNLOADING, 3)],
)
def test_a_static_trial_that_ended_early_is_the_cause_of_the_verdicts_of_its_donning(
    end_s: float, code: NoteCode, count: int
) -> None:
    static, dynamic = _donning("hand")[0]
    cut = replace(_cut(static, end_s), step_masses=FIVE)
    fit = _fit([cut, dynamic])
    (note,) = _causes(fit)
    assert (note.code, note.figures["count"], note.figures["total"]) == (code, count, 5)
    assert fit.verdict == fit.wearable().verdict == str(note)
    windowed = replace(cut, notes=(Note(TrialNoteCode.WINDOW, {"start_s": 0.0, "end_s": end_s}),))
    assert not _causes(_fit([windowed, dynamic]))


def _hidden(trial: Trial, start: float, end: float) -> Trial:
    inside = (trial.marker_time > start) & (trial.marker_time < end)
    return replace(trial, markers=np.where(inside[:, None, None], np.nan, trial.markers))


def test_loads_under_which_the_markers_are_hidden_are_no_loads_that_were_not_hung() -> None:
    """The force shows that all five are hung."""
    static, dynamic = _donning("hand")[0]
    planned = replace(static, step_masses=FIVE)
    assert not _causes(_fit([planned, dynamic]))
    fit = _fit([_hidden(planned, 12.0, 32.0), dynamic])
    (note,) = _causes(fit)
    assert note.code is NoteCode.HIDDEN_LOADS and (note.figures["count"], note.figures["total"]) == (2, 5)
    assert str(note) in fit.verdict
    bare = replace(make_pulls([planned])[0][0], plateaus=())
    first_step = planned.force_time[np.argmax(planned.force > planned.force[0] + 7.5)]
    unseen = replace(bare, displacement=np.where(bare.marker_time > first_step, np.nan, bare.displacement))
    assert [note and note.code for note in map(_stopped_static, (unseen, bare))] == [
        NoteCode.HIDDEN_LOADS,
        NoteCode.STOPPED_LOADING,
    ]


@pytest.mark.parametrize("end_s", [18.0, 36.0])
def test_a_stream_that_ends_before_the_capture_is_no_trial_that_ended_early(end_s: float) -> None:
    """The sync line falls when the capture ends: there, too, all weights were on, or off again."""
    static, dynamic = _donning("hand")[0]
    planned = replace(static, step_masses=FIVE)
    fit = _fit([replace(_cut(planned, end_s), capture_end=43.0), dynamic])
    assert [note.code for note in _causes(fit)] == [NoteCode.HIDDEN_LOADS]


def test_a_daq_that_stops_with_its_sync_line_is_no_trial_that_ended_early() -> None:
    """The frames show that the capture went on."""
    for test, samples, code in (("static", 12_000, NoteCode.HIDDEN_LOADS), ("dynamic", 8_000, NoteCode.SWING_CUT)):
        session = Session(published("hand"), 1)
        both = {"static": session.static(), "dynamic": session.dynamic()}
        manifest, tracks = both[test]
        protocol = MeasurementProtocol(step_masses_kg=FIVE, swing_s=20.0)
        cut = {name: track if name == "/markers" else _first(track, samples) for name, track in tracks.items()}
        both[test] = replace(manifest, protocol=protocol), cut
        fit = _fit([build_trial(*recorded, name, name) for name, recorded in both.items()])
        assert [note.code for note in _causes(fit)] == [code]


def test_a_line_across_hidden_frames_is_no_law_of_the_cuff() -> None:
    """The cuff slips, within the gap by 5 mm; Coulomb friction would leave the damping unidentified."""
    static, dynamic = _donning("hand")[0]
    fit = _fit([_hidden(static, 8.0, 11.0), _hidden(dynamic, 6.0, 8.0)])
    assert fit.classes and fit.classes.chosen == ("slip",)
    assert fit.verdicts == (Verdict.IDENTIFIED,)


def test_a_short_swing_is_the_cause_of_a_damping_that_is_not_identified() -> None:
    static, dynamic = _donning("hand")[0]
    short = replace(_cut(dynamic, 6.0), swing_duration=16.0)
    fit = _fit([static, short])
    (note,) = _causes(fit)
    assert note.code is NoteCode.STOPPED_SWINGING and note.figures["found_s"] == pytest.approx(6.0, abs=0.5)
    assert fit.verdicts == (Verdict.NO_DYNAMIC,) and fit.verdict == str(note)
    assert _fit([static, replace(short, swing_duration=5.0)]).verdict == Verdict.NO_DYNAMIC.sentence()


def test_the_same_trials_give_the_same_bytes_in_any_order() -> None:
    assert cuffs_json(_fitted("hand", 2)) == cuffs_json(fit_session(_donning("hand", 2)[0][::-1]))


def test_a_turned_laboratory_changes_nothing() -> None:
    trials = _donning("hand")[0]
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = [replace(trial, markers=trial.markers @ turn.T + 1.0) for trial in trials]
    np.testing.assert_allclose(_values(_fit(turned)), _values(_fitted("hand").cuffs["hand"]), rtol=1e-6)


def test_twice_the_force_is_twice_as_stiff_and_twice_the_way_half() -> None:
    trials = _donning("hand")[0]
    plain = _values(_fitted("hand").cuffs["hand"])
    doubled = [
        replace(trial, force=2 * trial.force, force_step=2 * trial.force_step, cuff_mass=2 * trial.cuff_mass)
        for trial in trials
    ]
    np.testing.assert_allclose(_values(_fit(doubled)), plain * [2, 2, 1], rtol=2e-3)
    larger = [replace(trial, markers=2 * trial.markers, cuff_mass=trial.cuff_mass / 2) for trial in trials]
    np.testing.assert_allclose(_values(_fit(larger)), plain * [0.5, 0.5, 2], rtol=2e-3)


def test_a_load_cell_of_the_wrong_sign_is_listed_with_its_reason() -> None:
    static = _donning("hand")[0][0]
    fit = _fit([replace(static, force=-static.force)])
    assert fit.trials[0].state == "unusable"
    assert fit.trials[0].reason.code is RejectionCode.FORCE_POLARITY


def test_a_swing_that_pushes_the_rope_names_the_load_cell_s_sign() -> None:
    dynamic = _donning("hand")[0][1]
    (upside_down,) = _fit([replace(dynamic, force=-dynamic.force)]).trials
    assert TrialNoteCode.POLARITY in figures_by_code(upside_down.notes)
    assert upside_down.damping and upside_down.damping.value == pytest.approx(210.0, rel=0.2)
    tared = replace(dynamic, force=dynamic.force - 25.0)
    for sound in (dynamic, tared):
        (trial,) = _fit([sound]).trials
        assert TrialNoteCode.POLARITY not in figures_by_code(trial.notes)


def test_an_unusable_trial_is_listed_and_the_others_are_fitted() -> None:
    first, dynamic, second, _ = _donning("hand", repeats=2)[0]
    markers = second.markers.copy()
    markers[: int(0.7 * len(markers))] = np.nan
    fit = _fit([first, dynamic, replace(second, markers=markers)])
    assert fit.stiffness
    listed = {trial.file: trial for trial in fit.trials}
    assert listed[second.file].state == "unusable"
    reason = listed[second.file].reason
    assert reason and reason.code is RejectionCode.MARKERS_HIDDEN
    assert list(fit.sources) == [first.file, dynamic.file]


def test_a_repeat_recorded_again_counts_and_the_earlier_is_superseded() -> None:
    (first, dynamic, second, _), slip = _donning("hand", repeats=2)
    fit = _fit([first, dynamic, replace(second, repeat=1, run=2)])
    states = {trial.file: trial.state for trial in fit.trials}
    assert states == {first.file: "superseded", dynamic.file: "used", second.file: "used"}
    assert fit.migration.value == pytest.approx(slip, abs=2e-4), "it counts from the earlier one"
    assert set(fit.sources) == {first.file, dynamic.file, second.file}


@pytest.mark.parametrize("test", ["static", "dynamic"])
def test_a_later_run_that_cannot_be_used_supersedes_nothing(test: str) -> None:
    trials = _donning("hand", repeats=2)[0]
    good = trials[0 if test == "static" else 1]
    again = trials[2 if test == "static" else 3]
    dark = replace(again, repeat=1, run=2, markers=np.full_like(again.markers, np.nan))
    fit = _fit([*trials[:2], dark])
    states = {trial.file: trial.state for trial in fit.trials}
    assert states == {trials[0].file: "used", trials[1].file: "used", dark.file: "unusable"}
    assert good.file in fit.sources
    assert fit.verdicts == (Verdict.IDENTIFIED,)


def test_migration_is_open_where_an_earlier_recording_of_the_donning_is_lost() -> None:
    _, dynamic, second, _ = _donning("hand", repeats=2)[0]
    manifest = replace(Session(published("hand"), 1).static()[0], start_utc_ns=second.start_utc_ns - 10**11)
    assert _fit([second]).migration
    lost = RejectedTrial("lost.mcap", "the load cell went silent", manifest)
    fit = fit_session([dynamic, second], [lost]).cuffs["hand"]
    assert fit.migration is None
    assert fit.verdicts == (Verdict.MIGRATED_BEFORE,)
    (note,) = (note for note in fit.notes if note.code is NoteCode.MIGRATED_BEFORE)
    assert note.figures["before"] == "lost.mcap"
    for other in (replace(manifest, test="dynamic"), replace(manifest, donning="2"), None):
        assert fit_session([second], [replace(lost, capture=other)]).cuffs["hand"].migration


def test_donnings_are_never_pooled() -> None:
    trials = _donning("hand")[0]
    later = [
        replace(trial, donning="2", start_utc_ns=trial.start_utc_ns + 10**12, file="later") for trial in trials[:1]
    ]
    session = fit_session([*later, *trials])
    assert list(session.donnings["hand"]) == ["1", "2"]
    assert session.cuffs["hand"].donning == "2"
    assert session.cuffs["hand"].damping is None
    assert session.donnings["hand"]["1"].damping is not None


def test_the_curves_of_every_used_trial_are_there_for_the_figures() -> None:
    trials = _donning("hand")[0]
    curves = _fitted("hand").pulls
    static, dynamic = (curves[trial.file] for trial in trials)
    line = PUBLISHED["hand"][0] * np.array([p.displacement for p in static.static.plateaus]) + static.static.offset
    force = np.array([p.force for p in static.static.plateaus])
    settled = np.arange(len(force)) > 4  # from the highest load on, nothing slips
    np.testing.assert_allclose(line[settled], force[settled], atol=1.0)
    slope = np.polyfit(dynamic.dynamic.velocity, dynamic.dynamic.damper_force, 1)[0]
    assert slope == pytest.approx(dynamic.dynamic.damping.value, rel=0.02)


def _first(track: Track, samples: int) -> Track:
    names = ("sample_numbers", "device_time_ns", "host_time_ns", "values")
    return replace(track, **{name: getattr(track, name)[:samples] for name in names})


def _cut(trial: Trial, end: float) -> Trial:
    in_force, in_frames = trial.force_time <= end, trial.marker_time <= end
    return replace(
        trial,
        force_time=trial.force_time[in_force],
        force=trial.force[in_force],
        marker_time=trial.marker_time[in_frames],
        markers=trial.markers[in_frames],
        capture_end=end,
    )
