"""Recordings become trials: the clock, the units, the cut, and what cannot be used. Damaged tracks are refused."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.constants import g

from fitting.cuffs.cuffs_file import cuffs_json
from fitting.errors import UnusableTrial
from fitting.results.codes import FitErrorCode
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode
from fitting.session import fit_session
from fitting.trial.mass_checks import MassCheck, evaluate_reading, with_mass_checks
from fitting.trial.trial import SessionProtocol, build_trial, read_alone, read_protocol, read_trial, read_trials
from recordings.chunks import Damage, Entry, read_entries
from recordings.manifest import Manifest, MeasurementProtocol, Timing, TrialOutcome
from recordings.reader import Track
from recordings.samples import Event, Samples
from recordings.writer import RecordingWriter
from tests.fitting.bouncing import Bounce
from tests.fitting.bouncing import recorded as bounce
from tests.fitting.experiment import Session, published
from tests.refusals import raises_refusal

Tracks = dict[str, Track]
Damages = list[tuple[int, str, str, list[float]]]
FINE = TrialOutcome(True, "closed", "the capture ended")
FATES = {"used", "unusable", *RejectionCode}
KINDS = ("lost", "only", "nan", "zero", "huge", "stuck", "renumbered", "late", "stamps")
F, M, S = "/force", "/markers", "/sync"
fractions = st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted)
damages = st.lists(
    st.tuples(st.integers(0, 1), st.sampled_from([F, S, M]), st.sampled_from(KINDS), fractions), max_size=3
)


@cache
def _recorded() -> tuple[Manifest, Tracks]:
    return Session(published("hand", weights=(20.0, 40.0), hold=2.0, clock_ppm=0.0), 3).static()


def _changed(name: str, **changes: object) -> Tracks:
    tracks = dict(_recorded()[1])
    tracks[name] = replace(tracks[name], **changes)  # type: ignore[arg-type]
    return tracks


def test_its_arrays_cannot_be_changed() -> None:
    trial = build_trial(*_recorded(), "a.mcap", "hash")
    with pytest.raises(ValueError, match="read-only"):
        trial.force[0] = 0.0


@pytest.mark.parametrize("name", ["/force", "/markers"])
def test_a_trial_that_lost_samples_is_not_whole(name: str) -> None:
    track = _recorded()[1][name]
    count = len(track.sample_numbers)
    kept = _keep(track, np.delete(np.arange(count), slice(count // 2, count // 2 + 10)))
    assert not build_trial(_recorded()[0], _recorded()[1] | {name: kept}, "a.mcap", "hash").is_whole


def test_mass_and_scale_uncertainty_are_those_of_the_manifest() -> None:
    manifest, tracks = _recorded()
    assert manifest.cuff is not None
    cuff, cell = replace(manifest.cuff, mass_kg=0.35), replace(manifest.load_cell, gain_relative_sd=0.01)
    trial = build_trial(replace(manifest, cuff=cuff, load_cell=cell), tracks, "a.mcap", "hash")
    assert (trial.cuff_mass, trial.gain_sd) == (0.35, 0.01)


def test_the_zero_may_drift_by_a_part_of_the_capacity_that_the_configuration_names() -> None:
    manifest, tracks = _recorded()
    volts = tracks["/force"].values
    drifting = _changed("/force", values=volts + np.linspace(0.0, 0.08, len(volts))[:, None])
    cell = replace(manifest.load_cell, capacity_kg=25.0)
    with raises_refusal(
        RejectionCode.ZERO_DRIFT, drift_n=pytest.approx(5.6, abs=0.3), limit_n=pytest.approx(4.903, abs=1e-3)
    ):
        build_trial(replace(manifest, load_cell=cell), drifting, "a.mcap", "hash")
    wider = replace(manifest, load_cell=replace(cell, zero_drift_relative_limit=0.04))
    assert build_trial(wider, drifting, "a.mcap", "hash").zero_drift == pytest.approx(5.64, abs=0.05)


def test_a_recording_that_was_cut_does_not_determine_the_zero_drift() -> None:
    manifest, tracks = _recorded()
    high = np.flatnonzero(tracks["/sync"].values[:, 0] > 2.5)
    whole = build_trial(manifest, tracks, "a.mcap", "hash")
    cut = {
        name: _keep(track, np.arange(int(high[-1]) - 200)) if name != "/markers" else track
        for name, track in tracks.items()
    }
    assert whole.zero_drift == pytest.approx(0.0, abs=0.1)
    assert build_trial(manifest, cut, "a.mcap", "hash").zero_drift is None


def test_force_beyond_the_cell_s_capacity_is_saturated_whatever_reads_it() -> None:
    manifest, tracks = _recorded()
    peak = float(np.abs(tracks["/force"].values).max())
    small = peak * manifest.load_cell.newtons_per_unit / g / 1.2
    indicator = replace(tracks["/force"].stream, unit="N")
    manifest = replace(manifest, load_cell=replace(manifest.load_cell, capacity_kg=small))
    with raises_refusal(RejectionCode.FORCE_SATURATED, limit=pytest.approx(peak / 1.2), unit="N"):
        build_trial(manifest, _changed("/force", stream=indicator), "a.mcap", "hash")


def test_a_missing_label_is_named() -> None:
    manifest, tracks = _recorded()
    renamed = replace(tracks["/markers"].stream, labels=("anchor_1", "anchor_2", "anchor_3", "x", "cuff_1"))
    with raises_refusal(RejectionCode.MISSING_MARKERS, missing="anchor_4"):
        build_trial(manifest, _changed("/markers", stream=renamed), "a.mcap", "hash")


def _write(path: Path, outcome: TrialOutcome, *events: Event, recorded: tuple[Manifest, Tracks] | None = None) -> None:
    manifest, tracks = recorded or _recorded()
    writer = RecordingWriter(path, manifest, [track.stream for track in tracks.values()])
    for event in events:
        writer.write(event)
    for name, track in tracks.items():
        for part in np.array_split(np.arange(len(track.sample_numbers)), 40):
            first, last = track.sample_numbers[part], int(track.host_time_ns[part[-1]])
            writer.write(Samples(name, first, track.device_time_ns[part], last, track.values[part]))
    writer.close(outcome)


def test_a_recording_on_disk_gives_the_same_trial_and_one_that_was_cut_is_not_whole(tmp_path: Path) -> None:
    path = tmp_path / "cuff-hand_test-static_run-1.mcap"
    _write(path, FINE)
    trial, plain = read_trial(path), build_trial(*_recorded(), path.name, "hash")
    np.testing.assert_array_equal(trial.force, plain.force)
    np.testing.assert_array_equal(trial.markers, plain.markers)
    np.testing.assert_allclose(trial.force_time, plain.force_time, atol=1e-9)
    assert len(trial.sha256) == 64
    assert trial.is_whole
    assert trial.notes == ()
    path = tmp_path / "a.mcap"
    _write(path, FINE)
    path.write_bytes(path.read_bytes()[:-100])
    trial = read_trial(path)
    assert not trial.is_whole
    assert trial.notes


def test_a_recording_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    _write(path, FINE)
    readings: list[Path] = []

    def counted(read_path: Path) -> Iterator[Entry | Damage]:
        readings.append(read_path)
        return read_entries(read_path)

    monkeypatch.setattr("recordings.reader.read_entries", counted)
    (trial,), _ = read_trials([path])
    assert trial.is_whole
    assert readings == [path]


def test_what_was_read_before_is_not_read_again(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    _write(path, FINE)
    reading = read_alone(path)
    path.unlink()
    assert read_trials([path], {path.name: reading}) == ((reading,), ())


def test_files_that_are_no_trials_are_listed_with_their_reason(tmp_path: Path) -> None:
    _write(tmp_path / "a.mcap", TrialOutcome(False, "failed", "QTM went silent"))
    (tmp_path / "b.mcap").write_bytes(b"no recording")
    trials, rejected = read_trials(sorted(tmp_path.glob("*.mcap")))
    assert trials == ()
    assert rejected[0].reason == Note(RejectionCode.NOT_ACCEPTED, {"outcome": "QTM went silent"})
    assert rejected[1].reason.code is RejectionCode.UNREADABLE
    assert rejected[1].file == "b.mcap"
    assert [each.capture for each in rejected] == [None, None]


def test_a_rejected_recording_whose_capture_had_begun_says_what_it_was_of(tmp_path: Path) -> None:
    edge = Event("sync_edge", "the sync line rose", _recorded()[0].start_utc_ns, "station")
    _write(tmp_path / "a.mcap", TrialOutcome(False, "failed", "QTM went silent"), edge)
    rejected = read_trials([tmp_path / "a.mcap"])[1]
    assert rejected[0].capture == _recorded()[0]


def test_a_bounce_of_the_session_moves_and_scales_the_force_of_its_trials(tmp_path: Path) -> None:
    _write(tmp_path / "cuff-hand_test-static_run-1.mcap", FINE)
    plain = read_trials(tmp_path.glob("*.mcap"))[0][0]
    _write(tmp_path / "test-bounce_run-1.mcap", FINE, recorded=bounce(Bounce(lag=0.006, gain=1.02), 1))
    (trial,), rejected = read_trials(sorted(tmp_path.glob("*.mcap")))
    assert rejected == ()
    assert trial.lag.value == pytest.approx(0.006, abs=4e-4)
    assert trial.lag.source == "test-bounce_run-1.mcap"
    assert trial.lag.declared == trial.calibration.lag.standard_error < plain.lag.declared
    np.testing.assert_allclose(trial.force_time, plain.force_time + trial.lag.value)
    np.testing.assert_allclose(trial.force, plain.force / trial.calibration.gain.value)
    assert trial.gain_sd == pytest.approx(0.0009, abs=0.0004)


def test_a_bounce_that_cannot_be_used_is_listed_and_the_lag_stays_declared(tmp_path: Path) -> None:
    _write(tmp_path / "a.mcap", FINE)
    _write(tmp_path / "test-bounce_run-1.mcap", FINE, recorded=bounce(Bounce(duration=8.0), 1))
    (trial,), (rejected,) = read_trials(sorted(tmp_path.glob("*.mcap")))
    assert trial.calibration is None
    assert trial.lag.source == "declared"
    assert rejected.reason.code is RejectionCode.BOUNCE_FEW_CYCLES
    with raises_refusal(RejectionCode.IS_BOUNCE, file="test-bounce_run-1.mcap"):
        read_trial(tmp_path / "test-bounce_run-1.mcap")


def test_the_configuration_declares_lag_and_weights_and_the_session_corrects_them(tmp_path: Path) -> None:
    manifest, tracks = _recorded()
    timing = Timing(lag_s=0.02, lag_sd_s=0.003, stop_edge="end_of_frame")
    reported = replace(manifest, timing=timing, protocol=MeasurementProtocol((2.0, 2.0)))
    trial, plain = (build_trial(each, tracks, "a.mcap", "hash") for each in (reported, manifest))
    assert (trial.lag.value, trial.lag.declared, trial.step_masses) == (0.02, 0.003, (2.0, 2.0))
    moved, there = (np.interp(time, each.force_time, each.force) for each, time in ((trial, 3.02), (plain, 3.0)))
    assert moved == pytest.approx(there, abs=1e-9)
    _write(tmp_path / "a.mcap", FINE, recorded=(reported, tracks))
    (tmp_path / "protocol.toml").write_text('step_masses_kg = [1.0]\n[steps_s]\n"a.mcap" = [2.0]\n', encoding="utf-8")
    (edited,), _ = read_trials([tmp_path / "a.mcap"])
    assert (edited.step_masses, edited.step_times) == ((1.0,), (2.0,))
    (tmp_path / "protocol.toml").write_text('[steps_s]\n"a.mcap" = [2.0, 2000]\n', encoding="utf-8")
    with raises_refusal(FitErrorCode.PROTOCOL_OUTSIDE, recording="a.mcap", step_s=2000.0):
        read_trials([tmp_path / "a.mcap"])


@cache
def _recorded_tracks() -> tuple[tuple[Manifest, Tracks], ...]:
    """A short static and a short dynamic trial, force at 100 Hz."""
    truth = published("elbow", force_rate=100.0, hold=4.0, weights=(20.0, 40.0), duration=9.0)
    session = Session(truth, 7)
    return session.static(), session.dynamic()


def _keep(track: Track, index: np.ndarray) -> Track:
    parts = (track.sample_numbers, track.device_time_ns, track.host_time_ns, track.values)
    return Track(track.stream, *(part[index] for part in parts))


def _damage(track: Track, kind: str, first: float, last: float) -> Track:
    """One damage to the stretch between two fractions of the track."""
    n = len(track.sample_numbers)
    part = slice(int(first * n), int(last * n))
    if kind == "lost":
        return _keep(track, np.delete(np.arange(n), part))
    if kind == "only":
        return _keep(track, np.arange(n)[part])
    changed = {
        name: getattr(track, name).copy() for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values")
    }
    if kind in ("nan", "zero", "huge"):
        changed["values"][part] = {"nan": math.nan, "zero": 0.0, "huge": 1e6}[kind]
    elif kind == "stuck":
        changed["values"][part] = changed["values"][part.start : part.start + 1]
    elif kind == "renumbered":
        changed["sample_numbers"][part.stop :] += np.uint64(500)
    elif kind == "late":
        changed["host_time_ns"][part] += 5_000_000_000
    elif kind == "stamps":
        changed["device_time_ns"][part] = 0
    return replace(track, **changed)


FOUND: tuple[Damages, ...] = (
    [(1, M, "lost", [0.0135, 0.85]), (0, S, "stuck", [0.0116, 0.708]), (1, M, "huge", [0.5747, 0.9585])],
    [(0, M, "lost", [0.875, 0.999])],
    [(0, M, "stuck", [0.02, 1.0]), (0, F, "only", [0.3422, 0.771])],
    [(0, F, "lost", [0.00791, 0.04217]), (1, M, "stuck", [0.35038, 1.0])],
    [
        (1, S, "zero", [0.00294, 0.28687]),
        (1, M, "stuck", [0.31218, 0.92625]),
        (0, M, "huge", [0.29563, 0.97075]),
        (0, F, "zero", [0.0335, 1.0]),
    ],
    [
        (0, M, "stamps", [0.0, 0.51796]),
        (0, S, "lost", [0.96352, 1.0]),
        (0, F, "renumbered", [0.5727, 0.99122]),
        (0, M, "only", [0.75122, 0.75306]),
    ],
    [(0, M, "only", [0.70733, 1.0]), (1, M, "late", [0.0, 0.95667]), (0, F, "lost", [0.0412, 0.99312])],
    [(1, S, "zero", [0.62233664, 1.0]), (0, F, "late", [0.9452918, 0.99568963])],
)
"""Those that a random search found to be neither fitted nor refused."""


@pytest.mark.parametrize("damages", FOUND)
def test_damage_that_was_found_is_fitted_or_refused_in_a_sentence(damages: Damages) -> None:
    assert _fates(damages) <= FATES


@pytest.mark.parametrize("examples", [10, pytest.param(60, marks=pytest.mark.slow)])
def test_damaged_tracks_are_fitted_or_refused_in_a_sentence(examples: int) -> None:
    @settings(max_examples=examples, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(damages)
    def check(damages: Damages) -> None:
        assert _fates(damages) <= FATES

    check()


def _fates(damages: Damages) -> set[str]:
    """Of each trial the state in cuffs.json, or the code of its refusal; "NaN" or "Infinity" if the file has one."""
    tracks = [dict(tracks) for _, tracks in _recorded_tracks()]
    for trial, name, kind, (first, last) in damages:
        tracks[trial][name] = _damage(tracks[trial][name], kind, first, last)
    trials, fates = [], []
    for i, (manifest, _) in enumerate(_recorded_tracks()):
        try:
            trials.append(build_trial(manifest, tracks[i], f"{i}.mcap", "hash"))
        except UnusableTrial as error:
            fates.append(error.code)
    document = json.loads(cuffs_json(fit_session(trials)), parse_constant=fates.append)
    listed = [trial for cuff in document["cuffs"].values() for trial in cuff["trials"]]
    written = {trial["file"]: trial["state"] for trial in listed}
    rejected = {trial["file"]: trial["reason_code"]["code"] for trial in document["rejected"]}
    return {*fates, *((written | rejected)[trial.file] for trial in trials)}


def _written(folder: Path, text: str) -> Path:
    (folder / "a.mcap").touch()
    (folder / "protocol.toml").write_text(text, encoding="utf-8")
    return folder


def test_steps_and_weights_are_taken_from_the_file_and_without_one_are_as_configured(tmp_path: Path) -> None:
    assert read_protocol(tmp_path) == SessionProtocol()
    protocol = read_protocol(_written(tmp_path, 'step_masses_kg = [1, 2.5]\n[steps_s]\n"a.mcap" = [3.1, 12]\n'))
    assert protocol.step_masses == (1.0, 2.5)
    assert protocol.steps["a.mcap"] == (3.1, 12.0)
    (tmp_path / "a.recovered.mcap").touch()
    text = '[steps_s]\n"a.mcap" = [3]\n'
    assert read_protocol(_written(tmp_path, text)).steps["a.recovered.mcap"] == (3.0,)
    text += '"a.recovered.mcap" = [4]\n'
    assert read_protocol(_written(tmp_path, text)).steps["a.recovered.mcap"] == (4.0,)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("masses = [1]", "masses"),
        ("steps_s = [1]", "steps_s"),
        ("step_masses_kg = [1, -2]", "step_masses_kg.1"),
        ('step_masses_kg = "heavy"', "step_masses_kg"),
        ('[steps_s]\n"a.mcap" = [3, 3]', "steps_s.a.mcap"),
        ('[steps_s]\n"a.mcap" = [3, nan]', "steps_s.a.mcap.1"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(tmp_path: Path, text: str, key: str) -> None:
    with raises_refusal(FitErrorCode.PROTOCOL_INVALID, file=str(tmp_path / "protocol.toml"), key=key):
        read_protocol(_written(tmp_path, text))


def test_a_file_that_is_not_toml_or_of_an_unknown_recording_is_refused(tmp_path: Path) -> None:
    with raises_refusal(FitErrorCode.PROTOCOL_NOT_TOML, file=str(tmp_path / "protocol.toml")):
        read_protocol(_written(tmp_path, "step_masses_kg = [1,"))
    with raises_refusal(FitErrorCode.PROTOCOL_NO_RECORDING, recording="b.mcap"):
        read_protocol(_written(tmp_path, '[steps_s]\n"b.mcap" = [3]'))


def test_readings_that_agree_change_nothing() -> None:
    checks = [MassCheck("", 2.0, 19.613, 19.60, 0.02, 0.1), MassCheck("", 2.0, 19.613, 19.63, 0.02, 0.4)]
    trial = build_trial(*_recorded(), "a.mcap", "hash")
    (checked,) = with_mass_checks([trial], checks)
    assert (checked.gain_sd, checked.is_gain_checked) == (trial.gain_sd, True)


@pytest.mark.parametrize(
    "checks",
    [
        [],
        [MassCheck("", 0.0, 0.0, 0.1, 0.02, None)],
        [MassCheck("", 2.0, 19.613, 19.6, 0.02, None)],
        [MassCheck("", 2.0, 19.613, 19.6, 0.02, 0.1), MassCheck("", 2.0, 19.613, 21.6, 0.02, 0.1)],
    ],
    ids=["no reading", "the empty cell alone", "no zero", "one reading is wrong"],
)
def test_the_gain_is_checked_by_readings_of_a_mass_that_are_all_right(checks: list[MassCheck]) -> None:
    trial = build_trial(*_recorded(), "a.mcap", "hash")
    assert not with_mass_checks([trial], checks)[0].is_gain_checked


def test_a_reading_is_without_the_zero_and_may_be_off_by_its_uncertainty_and_a_part_of_the_weight() -> None:
    noise = np.random.default_rng(1).standard_normal(6000)
    zero = evaluate_reading(3.0 + 0.1 * noise, 0.0, None)
    loaded = evaluate_reading(22.613 + 0.1 * noise[::-1], 2.0, zero)
    assert loaded.expected == pytest.approx(19.6133)
    assert loaded.found == pytest.approx(19.613, abs=4 * loaded.sd)
    assert zero.sd == pytest.approx(0.1 / np.sqrt(6000), rel=0.7)
    assert loaded.sd > zero.sd
    with raises_refusal(FitErrorCode.CHECK_SHORT, samples=5, expected=6):
        evaluate_reading(np.zeros(5), 1.0, None)
    check = MassCheck("", 2.0, 20.0, 20.0, 0.03, 0.0)
    assert check.tolerance(0.002, 50.0) == pytest.approx(3 * 0.05 + 0.2)
    empty = MassCheck("", 0.0, 0.0, 1.0, 0.0, None)
    assert empty.tolerance(0.002, 50.0) == pytest.approx(0.05 * 50 * 9.80665)
