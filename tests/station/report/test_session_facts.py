"""Facts of the session: subject and operator from the journal, devices and protocol from the recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from fitting.results.cuffs_schema import CuffsDocument
from recordings.manifest import CuffSite, DataOrigin, LoadCell, Manifest, MeasurementProtocol
from recordings.samples import DeviceIdentity, Event
from station.journal import Setup, write_mark, write_setup
from station.report import session_facts as module
from station.report.session_facts import UNKNOWN, recording_rows, session_facts
from tests.recordings.trials import record

MANIFEST = Manifest(
    cuff=CuffSite("hand", "arm", ("a1",), ("c1",)),
    test="static",
    repeat=1,
    run=1,
    donning="1",
    start="sync_edge",
    sync_threshold_v=2.5,
    load_cell=LoadCell("daq", 98.0665, 1, serial_number="LC-7", capacity_kg=50.0, calibrated_on="2026-01-15"),
    start_utc_ns=1_780_000_000_000_000_000,
    protocol=MeasurementProtocol((1.5, 1.5), 7.0, 20.0),
    devices=(DeviceIdentity("NI Dev1", "USB-6008 serial number 01C0FFEE", False),),
)


def test_subject_devices_protocol_and_times_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_setup(tmp_path, Setup("P01", "MK", ("hand",), 1))
    later = replace(MANIFEST, test="dynamic", start_utc_ns=MANIFEST.start_utc_ns + 600 * 10**9)
    found = {"first.mcap": MANIFEST, "second.mcap": later}
    monkeypatch.setattr(module, "read_manifest", lambda path: found[path.name])
    listed = session_facts(tmp_path, [tmp_path / name for name in found], None, DataOrigin.MEASURED)
    facts = {fact.name: fact.text for fact in listed}
    assert facts["Subject"] == "P01"
    assert facts["Operator"] == "MK"
    assert facts["Data"] == "measured"
    assert facts["Devices"] == "USB-6008 serial number 01C0FFEE", "a device of several trials stands once"
    assert "LC-7" in facts["Load cell"] and "2026-01-15" in facts["Load cell"]
    assert facts["Protocol"].startswith("2 trials of 1 cuff in 1 donning; static: 2 weights, 3 kg together")
    assert facts["Recorded"] == "2026-05-28 20:26 to 20:36 UTC"


def test_a_folder_without_journal_and_recordings_says_that_nothing_is_recorded(tmp_path: Path) -> None:
    facts = {fact.name: fact.text for fact in session_facts(tmp_path, [], None, DataOrigin.UNKNOWN)}
    assert facts["Subject"] == facts["Operator"] == UNKNOWN
    assert set(facts) == {"Subject", "Operator", "Data"}


def test_a_named_mark_has_its_time_from_the_sync_edge(tmp_path: Path) -> None:
    zero_ns = 1_780_000_000_000_000_000
    at_s = {"sync_edge": (2.0,), "mark": (5.25, 9.5)}
    events = [Event(kind, "", zero_ns + round(1e9 * s), "station") for kind, times in at_s.items() for s in times]
    record(tmp_path / "a.mcap", events)
    write_mark(tmp_path, "a.mcap", 2, "coughed")
    (row,) = recording_rows(tmp_path, CuffsDocument(format=1, cuffs={}))
    assert row.remarks == ("mark 2 at 7.5 s: coughed",)
