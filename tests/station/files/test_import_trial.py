"""Files of other programs become recordings; options that cannot be used are wrong usage."""

import errno
import os
import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from documents.message import Message
from fitting.cuffs.cuff_fit import CuffFit
from fitting.trial.trial import read_trial, read_trials
from recordings.contents import read_contents
from recordings.errors import WriteFailed
from recordings.exchange.c3d import write_c3d
from recordings.exchange.qtm_tsv import write_qtm_tsv
from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.signal_csv import write_columns
from recordings.exchange.trc import write_trc
from recordings.reader import open_recording, read_manifest
from station.checksums import Checksums
from station.files.complete_trial import complete_trial
from station.files.foreign_files import ForceSource, ImportRefused, MarkerSource, read_force, read_markers
from station.files.import_trial import Imported, import_trial, with_lag
from station.fit import fit_session_folder
from station.messages.assessment_messages import InputCode
from station.messages.file_messages import ExportCode, ImportCode
from station.messages.setup_messages import ConfigCode
from station.protocol import TrialSpec
from station.recordings_of_session import recordings_in
from tests.fitting.bouncing import Bounce, recorded
from tests.refusals import raises_refusal
from tests.station.command import assert_one_sentence, assert_refused
from tests.station.foreign import Truth, config, import_by_verb, static_and_dynamic

Files = tuple[Path, Path]
"""Force and markers."""
Pair = tuple[Truth, Truth]
"""Of a static and a dynamic test."""
STATIC, DYNAMIC = TrialSpec("hand", "static", 1), TrialSpec("hand", "dynamic", 1)


@pytest.fixture(scope="module")
def pair() -> Pair:
    return static_and_dynamic()


@pytest.fixture(scope="module")
def truth(pair: Pair) -> Truth:
    """The static test."""
    return pair[0]


@pytest.fixture(scope="module")
def wire(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> CuffFit:
    """The fit of what the station itself recorded."""
    session = tmp_path_factory.mktemp("wire")
    for truth in pair:
        truth.record(session / f"cuff-hand_test-{truth.manifest.test}_run-1.mcap")
    return fit_session_folder(session, None).cuffs["hand"]


@pytest.fixture(scope="module")
def written(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("written")
    return truth.write_csv(folder / "daq.csv"), truth.write_markers(folder / "trial.tsv")


@pytest.fixture
def static(written: Files, tmp_path: Path) -> Files:
    """Files of a static test with a sync line, to be spoilt."""
    return Path(shutil.copy(written[0], tmp_path)), Path(shutil.copy(written[1], tmp_path))


def run(session: Path, force: Path, mocap: Path, spec: TrialSpec = STATIC, **how: object) -> Imported:
    return import_trial(session, spec, config(), ForceSource(force, **how), MarkerSource(mocap))  # type: ignore[arg-type]


def fitted(session: Path) -> CuffFit:
    return fit_session_folder(session, None).cuffs["hand"]


def test_tsv_and_csv_with_a_sync_line_give_the_live_fit(pair: Pair, wire: CuffFit, tmp_path: Path) -> None:
    for truth, spec in zip(pair, (STATIC, DYNAMIC), strict=True):
        force, mocap = truth.write_csv(tmp_path / "daq.csv"), truth.write_markers(tmp_path / "trial.tsv")
        run(tmp_path / "s", force, mocap, spec)
    found = fitted(tmp_path / "s")
    for name in ("stiffness", "damping", "migration"):
        assert getattr(found, name).value == pytest.approx(getattr(wire, name).value, rel=1e-9), found.verdict


@pytest.mark.parametrize("suffix", ["tsv", "trc", "c3d"])
def test_common_times_give_the_fit_within_half_a_sample(pair: Pair, wire: CuffFit, tmp_path: Path, suffix: str) -> None:
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


def test_newtons_and_pounds_give_the_fit_of_volts(truth: Truth, static: Files, tmp_path: Path) -> None:
    of_volts, volts = read_trial(run(tmp_path / "v", *static).path), truth.tracks["/force"].values
    for unit, stored, column, per_volt in (("N", "N", "pull", 98.0665), ("lbs", "lbf", "force_lbs", 22.0462)):
        force = truth.write_csv(tmp_path / "other.csv", newtons_per_unit=per_volt, column=column)
        named = {"column": column} if column == "pull" else {}
        recording = open_recording(run(tmp_path / "s", force, static[1], unit=unit, **named).path)
        assert recording.load("/force").stream.unit == stored
        assert np.array_equal(recording.load("/force").values, per_volt * volts)
        np.testing.assert_allclose(read_trial(recording.path).force, of_volts.force, rtol=1e-5)


def test_the_recording_is_complete_and_names_its_sources(static: Files, tmp_path: Path) -> None:
    captured = datetime(2025, 3, 4, 12, 0, 0, tzinfo=timezone(timedelta(hours=2)))
    force, mocap = ForceSource(static[0]), MarkerSource(static[1])
    contents = read_contents(import_trial(tmp_path / "s", STATIC, config(), force, mocap, captured).path)
    assert contents.complete and not contents.gaps
    assert contents.manifest and contents.manifest.start_utc_ns == 1741082400 * 10**9
    events = [item for item in open_recording(contents.path).items() if getattr(item, "kind", "") == "imported"]
    (text,) = (event.text for event in events)
    assert "daq.csv (sha256 " in text and "the sync line rises at 2.000" in text


def test_without_a_sync_line_the_declared_lag_reaches_the_fit(truth: Truth, tmp_path: Path) -> None:
    force = ForceSource(truth.write_csv(tmp_path / "daq.csv", has_sync=False))
    mocap = MarkerSource(truth.write_markers(tmp_path / "trial.tsv"))
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


def test_half_a_sample_at_20_hz_is_in_the_uncertainty_of_the_damping(pair: Pair, tmp_path: Path) -> None:
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


def test_a_recording_without_a_sync_line_is_not_replayed(station, truth: Truth, tmp_path: Path) -> None:
    force = truth.write_csv(tmp_path / "daq.csv", has_sync=False)
    path = run(tmp_path / "s", force, truth.write_markers(tmp_path / "trial.trc")).path
    assert_refused(station("replay", path), 1, ExportCode.NO_SYNC_EDGE)


def test_trials_imported_in_any_order_are_in_that_of_the_plan(static: Files, tmp_path: Path) -> None:
    plan = [TrialSpec("hand", test, repeat) for repeat in (1, 2) for test in ("static", "dynamic")]  # type: ignore[arg-type]
    for i in (3, 0, 2, 1):
        run(tmp_path / "s", *static, plan[i])
    run(tmp_path / "s", *static, plan[2])
    manifests = (read_manifest(path) for path in (tmp_path / "s").glob("*.mcap"))
    found = sorted(manifests, key=lambda manifest: manifest.start_utc_ns)
    expected = [(spec.repeat, spec.test) for spec in [*plan[:3], *plan[2:]]]
    assert [(manifest.repeat, manifest.test) for manifest in found] == expected
    assert found[2].run < found[3].run, "a repeat that is imported anew comes after the one it supersedes"


def test_times_of_any_origin_are_only_differences(truth: Truth, tmp_path: Path) -> None:
    trials = []
    for origin in (0.0, 1.7e9):
        force = truth.write_csv(tmp_path / "daq.csv", has_sync=False)
        header, *rows = force.read_text().splitlines()
        moved = [f"{float(row.split(',')[0]) + origin!r},{row.split(',')[1]}" for row in rows]
        force.write_text("\n".join([header, *moved]), encoding="utf-8")
        table = truth.markers
        mocap = tmp_path / "trial.tsv"
        mocap.write_text(write_qtm_tsv(replace(table, time_s=table.time_s + origin)), encoding="utf-8")
        trials.append(read_trial(run(tmp_path / "s", force, mocap).path))
    np.testing.assert_allclose(trials[1].force_time, trials[0].force_time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(trials[1].marker_time, trials[0].marker_time, rtol=0, atol=1e-6)


def test_lost_rows_are_losses_of_the_recording(static: Files, tmp_path: Path) -> None:
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


def test_no_file_is_overwritten_and_a_refused_import_leaves_none(static: Files, tmp_path: Path) -> None:
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


def test_a_marker_with_two_entries_is_chosen_by_label(station, truth, static, tmp_path: Path) -> None:
    markers = truth.markers
    doubled = replace(
        markers,
        labels=(*markers.labels, "cuff_1"),
        positions=np.concatenate([markers.positions, markers.positions[:, -1:] + 500.0], axis=1),
        residuals=np.concatenate([markers.residuals, markers.residuals[:, -1:]], axis=1),
    )
    write_c3d(tmp_path / "twice.c3d", doubled, {}, {})
    files = static[0], tmp_path / "twice.c3d"
    ran = import_by_verb(station, files, tmp_path / "s")
    assert_refused(ran, 1, ImportCode.MARKERS_MISSING, "cuff_1#1, cuff_1#2")
    ran = import_by_verb(station, files, tmp_path / "s", "--label", "cuff_1#1=cuff_1")
    assert ran.code == 0
    assert "cuff_1" in ran.err


def test_markers_are_renamed_by_label(station, static: Files, tmp_path: Path) -> None:
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
    station, static: Files, tmp_path: Path, which: int, old: str, new: str, figures: tuple[str, ...]
) -> None:
    edit(static[which], old, new)
    assert_one_sentence(import_by_verb(station, static, tmp_path / "s"), 1, static[which].name, *figures)
    assert not list(tmp_path.glob("s/*"))


@pytest.mark.parametrize(
    ("column", "code"), [("kraft", ImportCode.NO_FORCE_COLUMN), ("force_n", ImportCode.SEVERAL_FORCE_COLUMNS)]
)
def test_a_missing_or_ambiguous_force_column_is_refused(static: Files, column: str, code: ImportCode) -> None:
    titles, *rows = static[0].read_text().splitlines()
    if code is ImportCode.SEVERAL_FORCE_COLUMNS:
        static[0].write_text("\n".join([f"{titles},{column}", *(f"{row},1" for row in rows)]))
    else:
        edit(static[0], "force_v", column)
    with raises_refusal(code, kind=ImportRefused):
        read_force(ForceSource(static[0]))


def test_the_force_is_the_column_of_its_title_despite_commas(static: Files, tmp_path: Path) -> None:
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
        *((title, "N") for title in ("Fz [N]", "N", "F/N", "Fz [N] newtons")),
        *((title, "lbs") for title in ("Load (lbf)", "F / lbf")),
        *((title, "V") for title in ("Load", "load_on")),
        *((title, None) for title in ("Fz [kN]", "load_kg", "F/kN", "Fz [kN] filtered", "Kraft {daN}")),
        *((title, None) for title in ("Fz (N) [kN]", "Force [V] N")),  # two units
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
def test_a_stale_frame_rate_is_no_loss(truth: Truth, tmp_path: Path, suffix: str, nominal: float) -> None:
    full, measured = truth.markers, 29.97
    frames = len(full.time_s) * 29 // 100
    at = np.arange(frames) / measured
    positions = full.positions[np.minimum(np.rint(100 * at).astype(int), len(full.time_s) - 1)]
    table = MarkerTable(full.labels, nominal, at.round(5), positions, np.zeros(positions.shape[:2]))
    mocap = tmp_path / f"video{suffix}"
    mocap.write_text(write_trc(table, "video") if suffix == ".trc" else write_qtm_tsv(table), encoding="utf-8")
    done = run(tmp_path / "s", truth.write_csv(tmp_path / "daq.csv", has_sync=suffix == ".tsv"), mocap)
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
def test_another_force_is_refused_and_leaves_no_file(
    static: Files, tmp_path: Path, rows: list[str], code: ImportCode
) -> None:
    static[0].write_text("\n".join(["time_s,force_v,sync_v", *rows]))
    with raises_refusal(code, kind=ImportRefused):
        run(tmp_path / "s", *static)
    assert not list(tmp_path.glob("s/*"))


def test_a_position_that_no_laboratory_has_is_refused(truth: Truth, tmp_path: Path) -> None:
    full = truth.markers
    positions = full.positions.copy()
    positions[70, 0, 1] = 9_999_999
    mocap = tmp_path / "walk.trc"
    mocap.write_text(write_trc(replace(full, positions=positions), "walk"), encoding="utf-8")
    with raises_refusal(ImportCode.IMPOSSIBLE_VALUE, kind=ImportRefused, time_s=pytest.approx(full.time_s[70])):
        run(tmp_path / "s", truth.write_csv(tmp_path / "daq.csv"), mocap)


def test_files_with_too_little_time_in_common_are_refused(static: Files, tmp_path: Path) -> None:
    def rows(first: float, seconds: float) -> str:
        times = first + np.arange(round(1000 * seconds)) / 1000
        return "\n".join(["time_s,force_v", *(f"{time:.3f},{1 + i % 4}" for i, time in enumerate(times))])

    for first, seconds, common in ((100.0, 30.0, 0.0), (0.0, 8.0, 8.0)):
        static[0].write_text(rows(first, seconds))
        expected = {
            "common_s": pytest.approx(common, abs=2e-3),
            "force_from_s": pytest.approx(first),
            "expected_s": pytest.approx(max(seconds, 20.98), abs=2e-3),
        }
        with raises_refusal(ImportCode.SHORT_OVERLAP, kind=ImportRefused, **expected):
            run(tmp_path / "s", *static)
    static[0].write_text(rows(0.0, 19.6))
    note = run(tmp_path / "s", *static).notes[0]
    assert (note.code, note.figures["common_s"]) == (ImportCode.PARTIAL_OVERLAP, pytest.approx(19.6, abs=2e-3))


@pytest.mark.parametrize(
    ("of", "factor", "has_sync"),
    [("the force", 1 / 60, True), ("the force", 1 / 60, False), ("the markers", 60, False)],
)
def test_times_in_minutes_are_refused(static: Files, tmp_path: Path, of: str, factor: float, has_sync: bool) -> None:
    """Without a sync line, the force may be that of seconds, and the markers' times the ones in minutes."""
    rows = [f"{factor * i / 500!r},{1 + i % 4}" + f",{5 * (i > 200)}" * has_sync for i in range(14750)]
    static[0].write_text("\n".join(["time_s,force_v" + ",sync_v" * has_sync, *rows]))
    # "same trial": a fragment of the force has such a duration, too
    with raises_refusal(ImportCode.TIME_UNIT, "same trial", kind=ImportRefused, times_of=of, unit="min"):
        run(tmp_path / "s", *static)


@pytest.mark.parametrize(("rate_hz", "is_refused"), [(2000.0, False), (6000.0, True)])
def test_impossibly_fast_frames_are_refused(truth: Truth, tmp_path: Path, rate_hz: float, is_refused: bool) -> None:
    """6,000 Hz are times in minutes of frames at 100 Hz."""
    markers = truth.markers
    fast = replace(markers, rate_hz=rate_hz, time_s=np.arange(len(markers.time_s)) / rate_hz)
    file = tmp_path / "fast.tsv"
    file.write_text(write_qtm_tsv(fast))
    with raises_refusal(ImportCode.SAMPLE_RATE, kind=ImportRefused) if is_refused else nullcontext():
        read_markers(MarkerSource(file), markers.labels)


@pytest.mark.parametrize("has_sync", [True, False])
def test_the_time_in_common_is_that_after_the_lag(truth: Truth, static: Files, tmp_path: Path, has_sync: bool) -> None:
    truth.write_csv(static[0], has_sync=has_sync)
    files = ForceSource(static[0]), MarkerSource(static[1])
    begin, end = -truth.edge_s, len(truth.tracks["/force"].values) / 1000 - truth.edge_s
    for lag, common in ((15.0, 20.98 - 15 - begin), (-15.0, end - 15)):
        figures = {"common_s": pytest.approx(common, abs=3e-3), "force_from_s": pytest.approx(begin + lag, abs=2e-3)}
        with raises_refusal(ImportCode.SHORT_OVERLAP, kind=ImportRefused, **figures):
            import_trial(tmp_path / "s", STATIC, with_lag(config(), lag, None), *files)
    assert not list(tmp_path.glob("s/*"))
    note = import_trial(tmp_path / "s", STATIC, with_lag(config(), -2.0, None), *files).notes[0]
    assert note.code == ImportCode.PARTIAL_OVERLAP
    assert note.figures["common_s"] == pytest.approx(end - 2, abs=3e-3)


def test_positions_in_another_unit_are_refused(station, truth: Truth, static: Files, tmp_path: Path) -> None:
    for factor, apart, code in (
        (10, 0.0, ImportCode.MARKERS_CLOSE),  # cm
        (25.4, 50.0, ImportCode.MARKERS_CLOSE),  # inches, one marker far away
        (1000, 0.0, ImportCode.MARKER_DISTANCE),  # m
    ):
        positions = truth.markers.positions / factor
        positions[:, -1] += apart
        static[1].write_text(write_qtm_tsv(replace(truth.markers, positions=positions)))
        assert_refused(import_by_verb(station, static, tmp_path / "s"), 1, code)
    static[1].write_text(write_qtm_tsv(replace(truth.markers, positions=truth.markers.positions / 1000)))
    ran = import_by_verb(station, static, tmp_path / "s", "--mocap-unit", "m")
    assert ran.code == 0
    reference = run(tmp_path / "r", static[0], truth.write_markers(tmp_path / "mm.tsv")).path
    found, expected = (read_trial(path).markers for path in (Path(ran.out.strip()), reference))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("positions_mm", "needed", "code"),
    [
        ([[0, 0, 0], [45, 0, 0]], 2, None),  # markers on a wrist
        ([[0, 0, 0], [15, 15, 0]], 2, None),  # oblique
        ([[0, 0, 0], [15, 5, 0]], 2, ImportCode.MARKER_DISTANCE),
        ([[0, 0, 0], [0.5, 0, 0.3]], 1, ImportCode.MARKER_DISTANCE),  # a bounce in m beside another marker
        ([[0, 0, 0], [500, 0, 300]], 1, None),
        ([[0, 0, 0]], 1, None),
    ],
)
def test_the_size_of_a_marker_set_is_its_largest_distance(
    tmp_path: Path, positions_mm: list[list[float]], needed: int, code: ImportCode | None
) -> None:
    labels = tuple(f"m{i}" for i in range(len(positions_mm)))
    places = np.tile(np.array(positions_mm, dtype=float) + 1.0, (50, 1, 1))
    file = tmp_path / "markers.tsv"
    file.write_text(write_qtm_tsv(MarkerTable(labels, 100.0, np.arange(50) / 100, places, np.zeros(places.shape[:2]))))
    with raises_refusal(code, kind=ImportRefused) if code else nullcontext():
        read_markers(MarkerSource(file), labels[:needed])


def test_an_import_to_a_full_disk_names_the_recording_and_leaves_none(
    station, static: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise WriteFailed("record the trial again") from OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("station.files.import_trial.RecordingWriter.write", fail)
    ran = import_by_verb(station, static, tmp_path / "s")
    assert_refused(ran, 1, ImportCode.NOT_WRITTEN)
    assert os.strerror(errno.ENOSPC) in ran.err and "record the trial" not in ran.err
    assert not list((tmp_path / "s").rglob("*.mcap*"))


def test_an_imported_bounce_calibrates_the_lag_of_trials(station, static: Files, tmp_path: Path) -> None:
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


def test_wrong_usage_is_code_2(station, static: Files, tmp_path: Path) -> None:
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
        *((start, False) for start in ("0001-01-01", "1969-12-31", "2262-01-01", "9999-12-31T23:59:59")),
        *((start, True) for start in ("1970-01-01", "2261-12-31T23:59:59")),
    ],
)
def test_a_start_out_of_range_is_refused(station, static: Files, tmp_path: Path, start: str, is_possible: bool) -> None:
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


def test_the_option_that_an_import_lacks_is_named(station, static: Files) -> None:
    given = {"--session": "s", "--cuff": "hand", "--test": "static", "--force": static[0]}
    for option in given:
        words = [word for name, value in given.items() if name != option for word in (name, value)]
        assert_refused(
            station("import", "--mocap", static[1], *words), 2, ImportCode.INCOMPLETE_COMMAND, f"lacks {option};"
        )


# An export of the markers completes a recording whose live stream lost frames, markers or labels.

NAME = "cuff-hand_test-static_run-1.mcap"


@pytest.fixture
def lossy(truth: Truth, tmp_path: Path) -> Path:
    """The live stream of the trial: 60 frames were skipped, a marker hidden for a while, a label not yet known."""
    full = truth.tracks["/markers"]
    kept = np.delete(np.arange(len(full.values)), np.r_[400:430, 900:930])
    values = full.values[:, 1:].copy()
    values[100:140, -1] = np.nan
    stream = replace(full.stream, labels=full.stream.labels[1:])
    return truth.with_track("/markers", kept, stream=stream, values=values).record(tmp_path / NAME)


def export(truth: Truth, tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "export.tsv"
    path.write_text(write_qtm_tsv(replace(truth.markers, **changes)), encoding="utf-8")  # type: ignore[arg-type]
    return path


def test_the_completed_recording_is_whole_and_the_original_untouched(truth: Truth, lossy: Path, tmp_path: Path) -> None:
    before = lossy.read_bytes()
    done = complete_trial(lossy, MarkerSource(export(truth, tmp_path)))
    completed = tmp_path / NAME.replace(".mcap", ".completed.mcap")
    assert done.path == completed
    assert lossy.read_bytes() == before
    added, labels, filled = done.notes
    assert (added.code, added.figures["added"], added.figures["frames"]) == (ImportCode.FRAMES_ADDED, 60, 2099)
    assert "401" in str(added.figures["first"])
    assert (labels.code, labels.figures) == (ImportCode.LABELS_ADDED, {"labels": "anchor_1"})
    assert (filled.code, filled.figures) == (ImportCode.MARKERS_FILLED, {"filled": "cuff_1 in 40"})
    contents = read_contents(completed)
    assert contents.complete and not contents.gaps and contents.outcome
    assert contents.outcome.accepted
    assert recordings_in(tmp_path) == [completed]
    whole = truth.record(tmp_path / "whole.mcap")
    found, expected = read_trial(completed), read_trial(whole)
    assert found.is_whole
    assert np.array_equal(found.force_time, expected.force_time) and np.array_equal(found.force, expected.force)
    assert np.array_equal(found.marker_time, expected.marker_time)
    assert np.array_equal(found.markers, expected.markers, equal_nan=True)


def test_live_preview_around_the_capture_is_left_out(truth: Truth, tmp_path: Path) -> None:
    full = truth.tracks["/markers"]
    second = np.arange(100)
    preview = {
        "sample_numbers": (second + 50_000).astype(np.uint64),
        "device_time_ns": full.device_time_ns[0] - (100 - second) * 10_000_000 - 5_000_000,
        "host_time_ns": full.host_time_ns[0] - (100 - second) * 10_000_000,
        "values": full.values[:100] + 900,
    }
    both = {name: np.concatenate((column, getattr(full, name))) for name, column in preview.items()}
    path = truth.with_track("/markers", **both).record(tmp_path / NAME)
    done = complete_trial(path, MarkerSource(export(truth, tmp_path)))
    assert done.notes[0].code == ImportCode.FRAMES_ADDED and done.notes[0].figures["added"] == 0
    numbers = open_recording(done.path).load("/markers").sample_numbers
    assert np.array_equal(numbers, np.arange(1, 2100))


def test_frames_that_a_cut_export_lacks_are_kept(truth: Truth, lossy: Path, tmp_path: Path) -> None:
    table = truth.markers
    part = {name: getattr(table, name)[500:2000] for name in ("time_s", "positions", "residuals")}
    done = complete_trial(lossy, MarkerSource(export(truth, tmp_path, **part)))
    assert done.notes[-1] == Message(ImportCode.FRAMES_KEPT, {"frames": 569})
    gaps = read_contents(done.path).gaps
    assert [(gap.first_missing, gap.count) for gap in gaps] == [(401, 30)]


def test_a_marker_hidden_in_the_export_is_hidden_in_the_recording(truth: Truth, lossy: Path, tmp_path: Path) -> None:
    positions = truth.markers.positions.copy()
    positions[1500:1510, 2] = np.nan
    done = complete_trial(lossy, MarkerSource(export(truth, tmp_path, positions=positions)))
    values = open_recording(done.path).load("/markers").values
    assert np.isnan(values[1500:1510, 2]).all()


def test_an_export_of_another_trial_is_refused(station, truth: Truth, lossy: Path, tmp_path: Path) -> None:
    ask = ("import", "--over", lossy, "--mocap")
    elsewhere = export(truth, tmp_path, positions=truth.markers.positions + np.array([30.0, 0, 0]))
    with raises_refusal(ImportCode.OTHER_TRIAL, kind=ImportRefused, distance_mm=pytest.approx(30.0, abs=0.5)):
        complete_trial(lossy, MarkerSource(elsewhere))
    later = export(truth, tmp_path, time_s=truth.markers.time_s + 500)
    assert_refused(station(*ask, later), 1, ImportCode.NOTHING_IN_COMMON)
    slower = export(truth, tmp_path, time_s=2 * truth.markers.time_s, rate_hz=50.0)
    assert_refused(station(*ask, slower), 1, ImportCode.FRAME_RATE)
    assert_refused(station(*ask, slower, "--force", slower), 2, ImportCode.UNUSED_OPTION)
    assert [path.name for path in tmp_path.glob("*.mcap*")] == [NAME]


def test_a_cut_or_completed_recording_is_not_completed(station, truth: Truth, lossy: Path, tmp_path: Path) -> None:
    tsv = export(truth, tmp_path)
    ran = station("import", "--over", lossy, "--mocap", tsv)
    assert ran.code == 0 and ran.out.strip() == str(tmp_path / NAME.replace(".mcap", ".completed.mcap"))
    assert len(ran.err.splitlines()) == 3
    assert_refused(station("import", "--over", lossy, "--mocap", tsv), 1, ImportCode.FILE_EXISTS)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(lossy.read_bytes()[:90000])
    assert_refused(station("import", "--over", cut, "--mocap", tsv), 1, ImportCode.CUT_RECORDING)
