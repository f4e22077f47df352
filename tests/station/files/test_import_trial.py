"""Files of other programs become recordings; options that cannot be used are wrong usage."""

from __future__ import annotations

import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit
from fitting.trial.trial import read_trial, read_trials
from recordings.contents import read_contents
from recordings.exchange.c3d import write_c3d
from recordings.exchange.qtm_tsv import write_qtm_tsv
from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.signal_csv import write_columns
from recordings.exchange.trc import write_trc
from recordings.reader import open_recording, read_manifest
from station.checksums import Checksums
from station.files.foreign_files import ForceSource, ImportRefused, MarkerSource, read_force, read_markers
from station.files.import_trial import Imported, import_trial, with_lag
from station.fit import fit_session_folder
from station.messages.assessment_messages import InputCode
from station.messages.file_messages import ExportCode, ImportCode
from station.messages.setup_messages import ConfigCode
from station.protocol import TrialSpec
from tests.fitting.bouncing import Bounce, recorded
from tests.refusals import raises_refusal
from tests.station.command import assert_one_sentence, assert_refused
from tests.station.foreign import Truth, config, import_by_verb, static_and_dynamic

STATIC, DYNAMIC = TrialSpec("hand", "static", 1), TrialSpec("hand", "dynamic", 1)


@pytest.fixture(scope="module")
def pair() -> tuple[Truth, Truth]:
    return static_and_dynamic()


@pytest.fixture(scope="module")
def wire(pair: tuple[Truth, Truth], tmp_path_factory: pytest.TempPathFactory) -> CuffFit:
    """The fit of what the station itself recorded."""
    session = tmp_path_factory.mktemp("wire")
    for truth in pair:
        truth.record(session / f"cuff-hand_test-{truth.manifest.test}_run-1.mcap")
    return fit_session_folder(session, None).cuffs["hand"]


@pytest.fixture(scope="module")
def written(pair: tuple[Truth, Truth], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("written")
    return pair[0].write_csv(folder / "daq.csv"), pair[0].write_markers(folder / "trial.tsv")


@pytest.fixture
def static(written: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """Files of a static test with a sync line, to be spoilt."""
    return Path(shutil.copy(written[0], tmp_path)), Path(shutil.copy(written[1], tmp_path))


def run(session: Path, force: Path, mocap: Path, spec: TrialSpec = STATIC, **how: object) -> Imported:
    return import_trial(session, spec, config(), ForceSource(force, **how), MarkerSource(mocap))  # type: ignore[arg-type]


def fitted(session: Path) -> CuffFit:
    return fit_session_folder(session, None).cuffs["hand"]


def test_a_tsv_and_a_csv_with_a_sync_line_give_the_fit_of_the_live_recording(
    pair: tuple[Truth, Truth], wire: CuffFit, tmp_path: Path
) -> None:
    for truth, spec in zip(pair, (STATIC, DYNAMIC), strict=True):
        force, mocap = truth.write_csv(tmp_path / "daq.csv"), truth.write_markers(tmp_path / "trial.tsv")
        run(tmp_path / "s", force, mocap, spec)
    found = fitted(tmp_path / "s")
    for name in ("stiffness", "damping", "migration"):
        assert getattr(found, name).value == pytest.approx(getattr(wire, name).value, rel=1e-9), found.verdict


@pytest.mark.parametrize("suffix", ["tsv", "trc", "c3d"])
def test_files_with_common_times_give_the_fit_within_half_a_sample_of_lag(
    pair: tuple[Truth, Truth], wire: CuffFit, tmp_path: Path, suffix: str
) -> None:
    for truth, spec in zip(pair, (STATIC, DYNAMIC), strict=True):
        mocap = truth.write_markers(tmp_path / f"trial.{suffix}")
        if suffix == "c3d":
            run(tmp_path / "s", mocap, mocap, spec, column="ai0")
        else:
            run(tmp_path / "s", truth.write_csv(tmp_path / "daq.csv", has_sync=False), mocap, spec)
    drift = read_trials((tmp_path / "s").glob("*.mcap"))[0][0].lag.drift
    assert drift == (0.0 if suffix == "c3d" else 50e-6), "one file has one clock"
    found = fitted(tmp_path / "s")
    assert found.stiffness and wire.stiffness and found.damping and wire.damping
    assert found.stiffness.value == pytest.approx(wire.stiffness.value, rel=2e-3)
    assert abs(found.damping.value - wire.damping.value) < 8520 * 0.6e-3, "half a sample of lag, and a little"


def test_newtons_and_pounds_are_stored_unchanged_and_give_the_fit_of_volts(
    pair: tuple[Truth, Truth], static: tuple[Path, Path], tmp_path: Path
) -> None:
    of_volts, volts = read_trial(run(tmp_path / "v", *static).path), pair[0].tracks["/force"].values
    for unit, stored, column, per_volt in (("N", "N", "pull", 98.0665), ("lbs", "lbf", "force_lbs", 22.0462)):
        force = pair[0].write_csv(tmp_path / "other.csv", newtons_per_unit=per_volt, column=column)
        named = {"column": column} if column == "pull" else {}
        recording = open_recording(run(tmp_path / "s", force, static[1], unit=unit, **named).path)
        assert recording.load("/force").stream.unit == stored
        assert np.array_equal(recording.load("/force").values, per_volt * volts)
        np.testing.assert_allclose(read_trial(recording.path).force, of_volts.force, rtol=1e-5)


def test_the_recording_is_complete_and_names_its_sources(static: tuple[Path, Path], tmp_path: Path) -> None:
    captured = datetime(2025, 3, 4, 12, 0, 0, tzinfo=timezone(timedelta(hours=2)))
    force, mocap = ForceSource(static[0]), MarkerSource(static[1])
    contents = read_contents(import_trial(tmp_path / "s", STATIC, config(), force, mocap, captured).path)
    assert contents.complete and not contents.gaps
    assert contents.manifest and contents.manifest.start_utc_ns == 1741082400 * 10**9
    events = [item for item in open_recording(contents.path).items() if getattr(item, "kind", "") == "imported"]
    assert (
        len(events) == 1 and "daq.csv (sha256 " in events[0].text and "the sync line rises at 2.000" in events[0].text
    )


def test_without_a_sync_line_the_declared_lag_reaches_the_fit(pair: tuple[Truth, Truth], tmp_path: Path) -> None:
    force = ForceSource(pair[0].write_csv(tmp_path / "daq.csv", has_sync=False))
    mocap = MarkerSource(pair[0].write_markers(tmp_path / "trial.tsv"))
    plain = read_trial(import_trial(tmp_path / "a", STATIC, config(), force, mocap).path)
    lagged = import_trial(tmp_path / "b", STATIC, with_lag(config(), -0.012, 0.003), force, mocap).path
    assert open_recording(lagged).manifest.start == "declared"
    trial = read_trial(lagged)
    assert plain.lag.declared == pytest.approx(np.hypot(0.0005, 0.0005 / np.sqrt(3))), "half a sample at 1 kHz"
    assert trial.lag.declared == 0.003, "a given value is used as it is"
    assert plain.lag.total(20.0) == pytest.approx(np.hypot(plain.lag.declared, 20 * 50e-6)), "two clocks drift apart"
    assert plain.force_time[0] - trial.force_time[0] == pytest.approx(0.0, abs=1.1e-3), "both begin at time 0"
    shift = np.interp(5.0, trial.force_time, trial.force) - np.interp(5.012, plain.force_time, plain.force)
    assert shift == pytest.approx(0.0, abs=0.3)


def test_without_a_sync_line_half_a_sample_at_20_hz_is_in_the_uncertainty_of_the_damping(
    pair: tuple[Truth, Truth], tmp_path: Path
) -> None:
    whole = pair[1].write_csv(tmp_path / "whole.csv", has_sync=False).read_text().splitlines()
    force, mocap = tmp_path / "daq.csv", pair[1].write_markers(tmp_path / "trial.tsv")
    force.write_text("\n".join([whole[0], *whole[1::50]]))
    assumed = run(tmp_path / "s", force, mocap, DYNAMIC)
    assert read_trial(assumed.path).lag.declared == pytest.approx(0.025 / np.sqrt(3), rel=1e-3)
    note = assumed.notes[-1]
    assert (note.code, note.figures["rate_hz"]) == (ImportCode.LAG_ASSUMED, pytest.approx(20))
    assert note.figures["lag_sd_ms"] == pytest.approx(14.4, abs=0.05)
    (trial,) = fitted(tmp_path / "s").trials
    assert trial.damping and trial.damping.parts["lag"] == pytest.approx(8520 * 0.0144, rel=0.02)

    given = with_lag(config(), None, 0.0005)
    imported = import_trial(tmp_path / "given", DYNAMIC, given, ForceSource(force), MarkerSource(mocap))
    assert read_trial(imported.path).lag.declared == 0.0005 and not imported.notes


def test_a_recording_without_a_sync_line_is_not_replayed(station, pair: tuple[Truth, Truth], tmp_path: Path) -> None:
    force = pair[0].write_csv(tmp_path / "daq.csv", has_sync=False)
    path = run(tmp_path / "s", force, pair[0].write_markers(tmp_path / "trial.trc")).path
    assert_refused(station("replay", path), 1, ExportCode.NO_SYNC_EDGE)


def test_trials_imported_in_any_order_are_in_that_of_the_plan(static: tuple[Path, Path], tmp_path: Path) -> None:
    plan = [TrialSpec("hand", test, repeat) for repeat in (1, 2) for test in ("static", "dynamic")]  # type: ignore[arg-type]
    for i in (3, 0, 2, 1):
        run(tmp_path / "s", *static, plan[i])
    run(tmp_path / "s", *static, plan[2])
    manifests = (read_manifest(path) for path in (tmp_path / "s").glob("*.mcap"))
    found = sorted(manifests, key=lambda manifest: manifest.start_utc_ns)
    expected = [(spec.repeat, spec.test) for spec in [*plan[:3], *plan[2:]]]
    assert [(manifest.repeat, manifest.test) for manifest in found] == expected
    assert found[2].run < found[3].run, "a repeat that is imported anew comes after the one it supersedes"


def test_times_of_any_origin_are_only_differences(pair: tuple[Truth, Truth], tmp_path: Path) -> None:
    trials = []
    for origin in (0.0, 1.7e9):
        force = pair[0].write_csv(tmp_path / "daq.csv", has_sync=False)
        header, *rows = force.read_text().splitlines()
        moved = [f"{float(row.split(',')[0]) + origin!r},{row.split(',')[1]}" for row in rows]
        force.write_text("\n".join([header, *moved]), encoding="utf-8")
        table = pair[0].markers
        mocap = tmp_path / "trial.tsv"
        mocap.write_text(write_qtm_tsv(replace(table, time_s=table.time_s + origin)), encoding="utf-8")
        trials.append(read_trial(run(tmp_path / "s", force, mocap).path))
    np.testing.assert_allclose(trials[1].force_time, trials[0].force_time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(trials[1].marker_time, trials[0].marker_time, rtol=0, atol=1e-6)


def test_lost_rows_are_losses_of_the_recording(static: tuple[Path, Path], tmp_path: Path) -> None:
    for path, first, header in zip(static, (5000, 300), (1, 12), strict=True):
        lines = path.read_text(encoding="utf-8").splitlines()
        del lines[header + first : header + first + 50]
        lines = [
            re.sub(r"NO_OF_FRAMES\t(\d+)", lambda found: f"NO_OF_FRAMES\t{int(found[1]) - 50}", line) for line in lines
        ]
        path.write_text("\n".join(lines), encoding="utf-8")
    done = run(tmp_path / "s", *static)
    gaps = {gap.stream: (gap.cause, gap.first_missing, gap.count) for gap in read_contents(done.path).gaps}
    assert gaps == {"/force": ("skipped", 5000, 50), "/sync": ("skipped", 5000, 50), "/markers": ("skipped", 301, 50)}
    assert not read_trial(done.path).is_whole


def test_no_file_is_overwritten_and_a_refused_import_leaves_none(static: tuple[Path, Path], tmp_path: Path) -> None:
    session = tmp_path / "s"
    first = run(session, *static).path
    content = first.read_bytes()
    second = run(session, *static).path
    assert (first.name, second.name) == ("cuff-hand_test-static_run-1.mcap", "cuff-hand_test-static_run-2.mcap")
    static[0].write_text("time_s,force_v,sync_v\n" + "".join(f"{i / 1000},1.0,{5 * (i > 500)}\n" for i in range(30000)))
    with raises_refusal(ImportCode.NOT_USABLE, kind=ImportRefused):
        run(session, *static)
    left = {path.name for path in session.iterdir() if not path.name.startswith(".")}
    assert left == {first.name, second.name, "SHA256SUMS"}
    assert set(Checksums(session).sums) == {first.name, second.name}
    assert first.read_bytes() == content


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_a_marker_with_two_entries_is_chosen_by_label(station, pair, static, tmp_path: Path) -> None:
    markers = pair[0].markers
    doubled = replace(
        markers,
        labels=(*markers.labels, "cuff_1"),
        positions=np.concatenate([markers.positions, markers.positions[:, -1:] + 500.0], axis=1),
        residuals=np.concatenate([markers.residuals, markers.residuals[:, -1:]], axis=1),
    )
    write_c3d(tmp_path / "twice.c3d", doubled, {}, {})
    files = static[0], tmp_path / "twice.c3d"
    ran = import_by_verb(station, files, tmp_path / "s")
    assert_refused(ran, 1, ImportCode.MARKERS_MISSING)
    assert "cuff_1#1, cuff_1#2" in ran.err
    ran = import_by_verb(station, files, tmp_path / "s", "--label", "cuff_1#1=cuff_1")
    assert ran.code == 0
    assert "cuff_1" in ran.err


def test_markers_are_renamed_by_label(station, static: tuple[Path, Path], tmp_path: Path) -> None:
    edit(static[1], "cuff_1", "LHand2")
    assert_refused(import_by_verb(station, static, tmp_path / "s"), 1, ImportCode.MARKERS_MISSING)
    ran = import_by_verb(station, static, tmp_path / "s", "--label", "LHand2=cuff_1")
    assert (ran.code, ran.out.strip()) == (0, str(tmp_path / "s" / "cuff-hand_test-static_run-1.mcap"))
    for label, code in (("LHand2", ImportCode.WRONG_LABEL_PAIR), ("x=cuff_1", ImportCode.UNKNOWN_LABEL)):
        assert_refused(import_by_verb(station, static, tmp_path / "s", "--label", label), 2, code)
    assert_one_sentence(import_by_verb(station, static, tmp_path / "s", "--label", "LHand2=anchor_1"), 1, "anchor_1")


@pytest.mark.parametrize(
    ("which", "old", "new", "figures"),
    [
        (0, "time_s", "t", ("time_s",)),
        (0, "\n0.007,", "\n,", ("line 9",)),
        (0, "\n0.007,", "\n0.006,", ("0.006 s", "line 9")),
        (0, "\n0.007,", "\n0.001,", ("0.001 s", "0.006 s", "line 9")),
        (0, "\n0.007,", "\n0.007,wet,", ("'wet'", "column 2")),
        (0, "\n0.007,", "\n0.007,,", ("force",)),
        (1, "cuff_1\n", "hand_1\n", ("cuff_1", "hand_1")),
        (1, "MARKER_NAMES", "NAMES", ("MARKER_NAMES",)),
        (1, "\n8\t0.07\t", "\n8\t0.06\t", ("0.06 s", "line 20")),
    ],
)
def test_a_bad_line_is_refused_with_its_place_and_writes_nothing(
    station, static: tuple[Path, Path], tmp_path: Path, which: int, old: str, new: str, figures: tuple[str, ...]
) -> None:
    edit(static[which], old, new)
    assert_one_sentence(import_by_verb(station, static, tmp_path / "s"), 1, static[which].name, *figures)
    assert not list(tmp_path.glob("s/*"))


@pytest.mark.parametrize(
    ("column", "code"), [("kraft", ImportCode.NO_FORCE_COLUMN), ("force_n", ImportCode.SEVERAL_FORCE_COLUMNS)]
)
def test_a_force_column_that_is_missing_or_ambiguous_is_refused(
    static: tuple[Path, Path], column: str, code: ImportCode
) -> None:
    titles, *rows = static[0].read_text().splitlines()
    if code is ImportCode.SEVERAL_FORCE_COLUMNS:
        static[0].write_text("\n".join([f"{titles},{column}", *(f"{row},1" for row in rows)]))
    else:
        edit(static[0], "force_v", column)
    with raises_refusal(code, kind=ImportRefused):
        read_force(ForceSource(static[0]))


def test_the_force_is_the_column_of_its_title_whatever_commas_others_hold(
    static: tuple[Path, Path], tmp_path: Path
) -> None:
    titles, *rows = static[0].read_text().splitlines()
    others = '"Torque, request",' + titles + ',"a ""b"", c"'
    static[0].write_text("\n".join([others, *(f'"1,5 N, ?",{row},23.1' for row in rows)]))
    volts = [float(row.split(",")[1]) for row in rows]
    done = run(tmp_path / "s", *static)
    assert open_recording(done.path).load("/force").values[:, 0] == pytest.approx(volts)
    (note,) = [note for note in done.notes if note.code is ImportCode.FORCE_COLUMN]
    assert note.figures["column"] == "force_v"
    assert (note.figures["least"], note.figures["most"]) == pytest.approx((min(volts), max(volts)))


@pytest.mark.parametrize(
    ("title", "unit"),
    [
        ("Fz [N]", "N"),
        ("N", "N"),
        ("Load (lbf)", "lbs"),
        ("Load", "V"),
        ("load_on", "V"),
        ("Fz [kN]", None),
        ("load_kg", None),
        ("F/N", "N"),
        ("F / lbf", "lbs"),
        ("F/kN", None),
        ("Fz [kN] filtered", None),
        ("Kraft {daN}", None),
        ("Fz (N) [kN]", None),
        ("Force [V] N", None),
        ("Fz [N] newtons", "N"),
    ],
)
def test_the_unit_in_a_title_is_that_of_the_force(tmp_path: Path, title: str, unit: str | None) -> None:
    (tmp_path / "daq.csv").write_text(f"time_s,{title}\n" + "".join(f"{i / 1000},1\n" for i in range(100)))
    source = ForceSource(tmp_path / "daq.csv", title)
    if unit is None:
        with raises_refusal(ImportCode.FORCE_UNIT, kind=ImportRefused):
            read_force(source)
    else:
        assert read_force(source).unit == unit


@pytest.mark.parametrize(("suffix", "nominal"), [(".trc", 30), (".tsv", 30), (".trc", 250)])
def test_a_stale_frame_rate_invents_no_loss(
    pair: tuple[Truth, Truth], tmp_path: Path, suffix: str, nominal: float
) -> None:
    truth, measured = pair[0].markers, 29.97
    frames = len(truth.time_s) * 29 // 100
    at = np.arange(frames) / measured
    positions = truth.positions[np.minimum(np.rint(100 * at).astype(int), len(truth.time_s) - 1)]
    table = MarkerTable(truth.labels, nominal, at.round(5), positions, np.zeros(positions.shape[:2]))
    mocap = tmp_path / f"video{suffix}"
    mocap.write_text(write_trc(table, "video") if suffix == ".trc" else write_qtm_tsv(table), encoding="utf-8")
    done = run(tmp_path / "s", pair[0].write_csv(tmp_path / "daq.csv", has_sync=suffix == ".tsv"), mocap)
    assert not read_contents(done.path).gaps
    found = read_trial(done.path).marker_time
    assert found - found[0] == pytest.approx(at[: len(found)], abs=2e-5)


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        (["0.0,1,0", "0.001,2,5"], ImportCode.SHORT_OVERLAP),
        ([f"{i},{i % 7},{5 * (i > 400)}" for i in range(30000)], ImportCode.SAMPLE_RATE),
        ([f"{i / 1000},{9.95 + i % 3 / 100},{5 * (i > 400)}" for i in range(30000)], ImportCode.NOT_USABLE),
        ([f"{i / 1000},{i % 7},0.1" for i in range(30000)], ImportCode.NOT_USABLE),
        ([f"{i / 1000},{i % 7},5.0" for i in range(30000)], ImportCode.NOT_USABLE),
        ([f"{i / 1000},{i % 7},{5 * (i > 12000)}" for i in range(20000)], ImportCode.SHORT_OVERLAP),
        ([f"{i / 1000},{1e300 if i == 9 else 1},{5 * (i > 400)}" for i in range(30000)], ImportCode.IMPOSSIBLE_VALUE),
    ],
)
def test_a_force_of_another_measurement_is_refused_and_leaves_no_file(
    static: tuple[Path, Path], tmp_path: Path, rows: list[str], code: ImportCode
) -> None:
    static[0].write_text("\n".join(["time_s,force_v,sync_v", *rows]))
    with raises_refusal(code, kind=ImportRefused):
        run(tmp_path / "s", *static)
    assert not list(tmp_path.glob("s/*"))


def test_a_position_that_no_laboratory_has_is_refused(pair: tuple[Truth, Truth], tmp_path: Path) -> None:
    truth = pair[0].markers
    positions = truth.positions.copy()
    positions[70, 0, 1] = 9_999_999
    mocap = tmp_path / "walk.trc"
    mocap.write_text(write_trc(replace(truth, positions=positions), "walk"), encoding="utf-8")
    with raises_refusal(ImportCode.IMPOSSIBLE_VALUE, kind=ImportRefused) as caught:
        run(tmp_path / "s", pair[0].write_csv(tmp_path / "daq.csv"), mocap)
    assert caught.value.cause.figures["time_s"] == pytest.approx(truth.time_s[70])


def test_files_with_too_little_time_in_common_are_refused_and_a_remainder_is_reported(
    static: tuple[Path, Path], tmp_path: Path
) -> None:
    def rows(first: float, seconds: float) -> str:
        times = first + np.arange(round(1000 * seconds)) / 1000
        return "\n".join(["time_s,force_v", *(f"{time:.3f},{1 + i % 4}" for i, time in enumerate(times))])

    for first, seconds, common in ((100.0, 30.0, 0.0), (0.0, 8.0, 8.0)):
        static[0].write_text(rows(first, seconds))
        with raises_refusal(ImportCode.SHORT_OVERLAP, kind=ImportRefused) as caught:
            run(tmp_path / "s", *static)
        figures = caught.value.cause.figures
        assert figures["common_s"] == pytest.approx(common, abs=2e-3)
        assert figures["force_from_s"] == pytest.approx(first)
        assert figures["expected_s"] == pytest.approx(max(seconds, 20.98), abs=2e-3)
    static[0].write_text(rows(0.0, 19.6))
    note = run(tmp_path / "s", *static).notes[0]
    assert (note.code, note.figures["common_s"]) == (ImportCode.PARTIAL_OVERLAP, pytest.approx(19.6, abs=2e-3))


@pytest.mark.parametrize(
    ("of", "factor", "has_sync"),
    [("the force", 1 / 60, True), ("the force", 1 / 60, False), ("the markers", 60, False)],
)
def test_times_in_minutes_are_refused_by_their_unit(
    static: tuple[Path, Path], tmp_path: Path, of: str, factor: float, has_sync: bool
) -> None:
    """Without a sync line, the force may be that of seconds, and the markers' times the ones in minutes."""
    rows = [f"{factor * i / 500!r},{1 + i % 4}" + f",{5 * (i > 200)}" * has_sync for i in range(14750)]
    static[0].write_text("\n".join(["time_s,force_v" + ",sync_v" * has_sync, *rows]))
    with raises_refusal(ImportCode.TIME_UNIT, kind=ImportRefused) as caught:
        run(tmp_path / "s", *static)
    assert (caught.value.cause.figures["times_of"], caught.value.cause.figures["unit"]) == (of, "min")
    assert "same trial" in str(caught.value), "a fragment of the force has such a duration, too"


@pytest.mark.parametrize(("rate_hz", "is_refused"), [(2000.0, False), (6000.0, True)])
def test_frames_faster_than_any_system_that_sees_a_body_are_refused(
    pair: tuple[Truth, Truth], tmp_path: Path, rate_hz: float, is_refused: bool
) -> None:
    """6,000 Hz are times in minutes of frames at 100 Hz."""
    markers = pair[0].markers
    fast = replace(markers, rate_hz=rate_hz, time_s=np.arange(len(markers.time_s)) / rate_hz)
    file = tmp_path / "fast.tsv"
    file.write_text(write_qtm_tsv(fast))
    with raises_refusal(ImportCode.SAMPLE_RATE, kind=ImportRefused) if is_refused else nullcontext():
        read_markers(MarkerSource(file), markers.labels)


@pytest.mark.parametrize("has_sync", [True, False])
def test_the_time_in_common_is_that_after_the_lag(
    pair: tuple[Truth, Truth], static: tuple[Path, Path], tmp_path: Path, has_sync: bool
) -> None:
    pair[0].write_csv(static[0], has_sync=has_sync)
    files = ForceSource(static[0]), MarkerSource(static[1])
    begin, end = -pair[0].edge_s, len(pair[0].tracks["/force"].values) / 1000 - pair[0].edge_s
    for lag, common in ((15.0, 20.98 - 15 - begin), (-15.0, end - 15)):
        with raises_refusal(ImportCode.SHORT_OVERLAP, kind=ImportRefused) as caught:
            import_trial(tmp_path / "s", STATIC, with_lag(config(), lag, None), *files)
        assert caught.value.cause.figures["common_s"] == pytest.approx(common, abs=3e-3)
        assert caught.value.cause.figures["force_from_s"] == pytest.approx(begin + lag, abs=2e-3)
    assert not list(tmp_path.glob("s/*"))
    note = import_trial(tmp_path / "s", STATIC, with_lag(config(), -2.0, None), *files).notes[0]
    assert note.code == ImportCode.PARTIAL_OVERLAP
    assert note.figures["common_s"] == pytest.approx(end - 2, abs=3e-3)


def test_positions_in_another_unit_are_refused(
    station, pair: tuple[Truth, Truth], static: tuple[Path, Path], tmp_path: Path
) -> None:
    metres = replace(pair[0].markers, positions=pair[0].markers.positions / 1000)
    static[1].write_text(write_qtm_tsv(metres))
    assert_refused(import_by_verb(station, static, tmp_path / "s"), 1, ImportCode.MARKER_DISTANCE)
    ran = import_by_verb(station, static, tmp_path / "s", "--mocap-unit", "m")
    assert ran.code == 0
    reference = run(tmp_path / "r", static[0], pair[0].write_markers(tmp_path / "mm.tsv")).path
    found, expected = (read_trial(path).markers for path in (Path(ran.out.strip()), reference))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_an_imported_bounce_calibrates_the_lag_of_trials(station, static: tuple[Path, Path], tmp_path: Path) -> None:
    bounce = Truth(*recorded(Bounce(lag=-0.012, duration=20.0), seed=1))
    toml = tmp_path / "bounce.toml"
    toml.write_text('[bounce]\nmass_kg = 2.5\nmarker = "weight"\n')
    force, mocap = tmp_path / "bounce.csv", bounce.write_markers(tmp_path / "bounce.tsv")
    volts = bounce.tracks["/force"].values[:, 0]
    force.write_text(write_columns({"time_s": np.arange(len(volts)) / 1000, "force_v": volts}, ","), encoding="utf-8")
    command = ("import", "--session", tmp_path / "s", "--test", "bounce", "--config", toml)
    ran = station(*command, "--force", force, "--mocap", mocap)
    assert ran.code == 0, ran.err
    trial_path = run(tmp_path / "s", *static).path
    (trial,), rejected = read_trials([Path(ran.out.strip()), trial_path])
    assert not rejected
    assert trial.lag.value == pytest.approx(-0.012, abs=4 * trial.lag.declared) and trial.lag.declared < 1e-3
    assert_refused(station(*command, "--force", force, "--mocap", static[1]), 1, ImportCode.MARKERS_MISSING)


def test_wrong_usage_is_code_2(station, static: tuple[Path, Path], tmp_path: Path) -> None:
    other = static[1].rename(static[1].with_suffix(".xlsx"))
    session = tmp_path / "s"
    assert_refused(import_by_verb(station, (static[0], other), session), 2, ImportCode.MARKER_FORMAT)
    files = static[0].with_suffix(".tdms"), other.rename(static[1])
    assert_refused(import_by_verb(station, files, session), 2, ImportCode.FORCE_FORMAT)
    assert_refused(import_by_verb(station, static, session, "--test", "bounce"), 2, ImportCode.UNUSED_OPTION)
    assert_refused(import_by_verb(station, static, session, "--cuff", "knee"), 2, ConfigCode.UNKNOWN_CUFF)
    for wrong in (("--lag-sd-s", "-1"), ("--lag-s", "nan"), ("--lag-s", "inf"), ("--lag-sd-s", "inf")):
        assert import_by_verb(station, static, session, *wrong).code == 2
    assert not session.exists()
    session.write_text("kept")
    for place in (session, session / "below"):
        assert_refused(import_by_verb(station, static, place), 2, InputCode.OUTPUT_IS_FILE)
    assert session.read_text() == "kept"


@pytest.mark.parametrize(
    ("start", "is_possible"),
    [
        ("9999-12-31T23:59:59", False),
        ("2262-01-01", False),
        ("2261-12-31T23:59:59", True),
        ("1970-01-01", True),
        ("1969-12-31", False),
        ("0001-01-01", False),
    ],
)
def test_a_start_that_a_recording_cannot_hold_is_wrong_usage(
    station, static: tuple[Path, Path], tmp_path: Path, start: str, is_possible: bool
) -> None:
    ran = import_by_verb(station, static, tmp_path / "s", "--start", start)
    if not is_possible:
        assert_refused(ran, 2, ImportCode.START_OUT_OF_RANGE)
        assert not list(tmp_path.glob("s/*"))
        return
    assert ran.code == 0, ran.err
    assert not ran.err, "the path only is printed"
    contents = read_contents(Path(ran.out.strip()))
    assert contents.manifest and contents.manifest.start_utc_ns == np.datetime64(start, "ns").astype(np.int64)
    assert not contents.shortfalls


@pytest.mark.parametrize("option", ["--session", "--cuff", "--test", "--force"])
def test_the_option_that_an_import_lacks_is_named(station, static: tuple[Path, Path], option: str) -> None:
    given = {"--session": "s", "--cuff": "hand", "--test": "static", "--force": static[0]}
    words = [word for name, value in given.items() if name != option for word in (name, value)]
    ran = station("import", "--mocap", static[1], *words)
    assert_refused(ran, 2, ImportCode.INCOMPLETE_COMMAND)
    assert f"lacks {option};" in ran.err
