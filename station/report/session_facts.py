"""Subject, times, devices and recordings of the session, from its recordings and journal."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from fitting.results.cuffs_schema import CalibrationEntry, CuffsDocument, TrialEntry
from recordings.errors import RecordingError
from recordings.manifest import DataOrigin, Manifest, manifest_to_json
from recordings.reader import TrackCollector, open_recording, read_manifest
from station.journal import Journal, JournalError, read_journal
from station.protocol import describe_trial
from station.recordings_of_session import recordings_in
from station.report.numbers import LocatedObject, Number, Shown, half_width, length, located, plain, total
from station.report.report_file import Derivation, Source

UNKNOWN = "not recorded"
ORIGINS = {
    DataOrigin.MEASURED: "measured",
    DataOrigin.SIMULATED: "simulated devices",
    DataOrigin.UNKNOWN: "unknown whether measured or simulated",
}


@dataclass(frozen=True)
class Fact:
    """A line of the first page, with its numbers apart from its text."""

    name: str
    parts: tuple[Shown, ...]

    @property
    def text(self) -> str:
        return "".join(map(str, self.parts))


def session_facts(
    folder: Path, recordings: Sequence[Path], calibration: CalibrationEntry | None, origin: DataOrigin
) -> tuple[Fact, ...]:
    """Facts for the first page; a recording that cannot be read is left out here, and listed where it is refused.

    calibration: the located entry of cuffs.json, None without one
    """
    manifests = dict(_manifests(recordings))
    journal = _journal(folder)
    facts = [*_people(journal), Fact("Data", (ORIGINS[origin],))]
    if manifests:
        facts += [
            Fact("Recorded", (_time(list(manifests.values())),)),
            Fact("Devices", (_devices(list(manifests.values())),)),
            Fact("Load cell", tuple(_load_cell(*list(manifests.items())[-1]))),
            Fact("Calibration", tuple(_calibration(calibration))),
            Fact("Protocol", tuple(_protocol(manifests))),
        ]
    if note := journal.notes.get(""):
        facts.append(Fact("Note", (note,)))
    return tuple(facts)


@dataclass(frozen=True)
class RecordingRow:
    """A recording in the order of the session: its entry in cuffs.json, None without one, or why it was rejected.

    remarks are the operator's: the note on the trial, and the names of its marks with their times
    """

    time: str
    title: str
    file: str
    trial: TrialEntry | None
    reason: str
    remarks: tuple[str, ...] = ()


def recording_rows(folder: Path, document: CuffsDocument | None) -> tuple[RecordingRow, ...]:
    """Every trial of the session, also those of the wearer and those that were not used, by time."""
    cuffs, unusable = (document.cuffs.values(), document.rejected) if document else ((), ())
    trials = {trial.file: trial for cuff in cuffs for trial in cuff.trials}
    rejected = {trial.file: trial.reason for trial in unusable}
    rows, journal = {}, _journal(folder)
    for file, manifest in _manifests(recordings_in(folder)):
        cuff = manifest.cuff.name if manifest.cuff else None
        title = describe_trial(cuff, manifest.test, manifest.repeat, manifest.condition)
        begun = datetime.fromtimestamp(1e-9 * manifest.start_utc_ns, UTC)
        remarks = tuple(_remarks(journal, file, folder))
        row = RecordingRow(f"{begun:%H:%M:%S}", title, file, trials.get(file), rejected.get(file, ""), remarks)
        rows[file] = (manifest.start_utc_ns, row)
    unread = [
        RecordingRow("", "", file, trials.get(file), rejected.get(file, ""), tuple(_remarks(journal, file, folder)))
        for file in (*trials, *rejected)
        if file not in rows
    ]
    return (*(row for _, row in sorted(rows.values(), key=lambda entry: entry[0])), *unread)


def _manifests(recordings: Sequence[Path]) -> Iterator[tuple[str, Manifest]]:
    for path in recordings:
        try:
            yield path.name, read_manifest(path)
        except (RecordingError, OSError):
            continue


def _journal(folder: Path) -> Journal:
    """Of a session that has one and whose journal can be read; else empty."""
    try:
        return read_journal(folder)
    except JournalError:
        return Journal()


def _remarks(journal: Journal, file: str, folder: Path) -> Iterator[str]:
    if note := journal.notes.get(file):
        yield f"note: {note}"
    named = {number: name for number, name in sorted(journal.marks.get(file, {}).items()) if name}
    times_s = _mark_times(folder / file) if named else {}
    for number, name in named.items():
        yield f"mark {number}{f' at {times_s[number]:.1f} s' if number in times_s else ''}: {name}"


def _mark_times(path: Path) -> dict[int, float]:
    """Time of every mark by its number, from the sync edge [s]; empty for a recording that cannot be read."""
    collector = TrackCollector(path)
    try:
        open_recording(path, collector.take)
    except (RecordingError, OSError):
        return {}
    events = collector.events()
    edge_ns = next((event.host_time_ns for event in events if event.kind == "sync_edge"), None)
    marks_ns = [event.host_time_ns for event in events if event.kind == "mark"]
    return {} if edge_ns is None else {number: 1e-9 * (at - edge_ns) for number, at in enumerate(marks_ns, 1)}


def _people(journal: Journal) -> Iterator[Fact]:
    """Subject (a code) and operator."""
    setup = journal.setup
    yield Fact("Subject", ((setup and setup.subject) or UNKNOWN,))
    yield Fact("Operator", ((setup and setup.operator) or UNKNOWN,))


def _time(manifests: Sequence[Manifest]) -> str:
    first, last = (
        datetime.fromtimestamp(1e-9 * end(manifest.start_utc_ns for manifest in manifests), UTC) for end in (min, max)
    )
    if first.date() == last.date():
        return f"{first:%Y-%m-%d %H:%M} to {last:%H:%M} UTC"
    return f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} UTC"


def _devices(manifests: Sequence[Manifest]) -> str:
    """Identity of every device, with its serial number where it has one."""
    found = {device.text or device.name: None for manifest in manifests for device in manifest.devices}
    return "; ".join(found) or UNKNOWN


def _load_cell(file: str, manifest: Manifest) -> Iterator[Shown]:
    cell = manifest.load_cell
    if cell.capacity_kg:
        yield plain(_manifest(file, manifest)["load_cell"]["capacity_kg"])
        yield " kg, "
    certificate = f"calibrated on {cell.calibrated_on}" if cell.calibrated_on else "calibration date not recorded"
    due = f", due on {cell.calibration_due_on}" if cell.calibration_due_on else ""
    yield f"serial number {cell.serial_number or UNKNOWN}, {certificate}{due}"


def _calibration(calibration: CalibrationEntry | None) -> Iterator[Shown]:
    """Of the load cell in this session, by its bounce trials."""
    if calibration is None:
        yield "no bounce trial: gain and lag as configured"
        return
    yield from _with_noun(length(calibration.sources), "bounce trial")
    yield ": gain "
    yield half_width(calibration.gain, digits=4)
    yield ", lag of the force "
    yield half_width(calibration.lag_s, 1e3, 1)
    yield " ms (95 % intervals)"


def _protocol(manifests: Mapping[str, Manifest]) -> Iterator[Shown]:
    of_cuffs = {file: manifest for file, manifest in manifests.items() if manifest.cuff is not None}
    if not of_cuffs:
        yield "no trial of a cuff"
        return
    yield from _with_noun(_count(of_cuffs), "trial")
    yield " of "
    yield from _with_noun(_count(of_cuffs, "/cuff/name"), "cuff")
    yield " in "
    yield from _with_noun(_count(of_cuffs, "/cuff/name", "/donning"), "donning")
    file, last = list(of_cuffs.items())[-1]
    planned: LocatedObject = _manifest(file, last)["protocol"]
    if masses := planned["step_masses_kg"]:
        yield "; static: "
        yield from _with_noun(length(masses), "weight")
        yield ", "
        yield total(masses)
        yield " kg together"
    if planned["hold_s"]:
        yield from ("; each load held ", plain(planned["hold_s"]), " s")
    if planned["swing_s"]:
        yield from ("; dynamic: at least ", plain(planned["swing_s"]), " s")
    motions = {file: manifest for file, manifest in manifests.items() if manifest.body is not None}
    if motions:
        yield "; "
        yield from _with_noun(_count(motions), "trial")
        yield " of the wearer"


def _manifest(file: str, manifest: Manifest) -> LocatedObject:
    """The manifest of a recording as located plain data."""
    found: LocatedObject = located(json.loads(manifest_to_json(manifest)), Source.of(file))
    return found


def _count(manifests: Mapping[str, Manifest], *pointers: str) -> Number:
    """Number of different values at these places of the manifests, or of recordings."""
    source = Source.of("", " ".join(pointers), Derivation.DISTINCT)
    documents = [json.loads(manifest_to_json(manifest)) for manifest in manifests.values()] if pointers else []
    values = {tuple(str(Source.of("", pointer).resolve(document)) for pointer in pointers) for document in documents}
    count = len(values) if pointers else len(manifests)
    return Number(str(count), count, source, recordings=tuple(manifests))


def _with_noun(count: Number, noun: str) -> Iterator[Shown]:
    """`1 cuff`, `2 cuffs`."""
    yield count
    yield f" {noun}{'' if count.value == 1 else 's'}"
