"""Who, when and with what: what the first page of the report says of the session, from its recordings and journal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from fitting.cuffs.cuff_fit import SessionFit
from fitting.trial.calibration import Calibration
from recordings.errors import RecordingError
from recordings.manifest import DataOrigin, LoadCell, Manifest
from recordings.reader import read_manifest
from station.interval import plus_minus
from station.journal import JOURNAL_FILE, JournalError, read_journal
from station.report.number_texts import counted

UNKNOWN = "not recorded"
ORIGINS = {
    DataOrigin.MEASURED: "measured",
    DataOrigin.SIMULATED: "simulated devices",
    DataOrigin.UNKNOWN: "unknown whether measured or simulated",
}


@dataclass(frozen=True)
class Fact:
    """A line of the first page."""

    name: str
    text: str


def session_facts(
    folder: Path, recordings: Sequence[Path], fitted: SessionFit | None, origin: DataOrigin
) -> tuple[Fact, ...]:
    """Facts for the first page; a recording that cannot be read is left out here, and listed where it is refused."""
    manifests = list(_manifests(recordings))
    facts = [*_people(folder), Fact("Data", ORIGINS[origin])]
    if manifests:
        facts += [
            Fact("Recorded", _time(manifests)),
            Fact("Devices", _devices(manifests)),
            Fact("Load cell", _load_cell(manifests[-1].load_cell)),
            Fact("Calibration", _calibration(fitted.calibration if fitted else None)),
            Fact("Protocol", _protocol(manifests)),
        ]
    return tuple(facts)


def _manifests(recordings: Sequence[Path]) -> Iterator[Manifest]:
    for path in recordings:
        try:
            yield read_manifest(path)
        except (RecordingError, OSError):
            continue


def _people(folder: Path) -> Iterator[Fact]:
    """Subject (a code) and operator, from the journal of a session that has one."""
    setup = None
    if (folder / JOURNAL_FILE).is_file():
        try:
            setup = read_journal(folder).setup
        except JournalError:
            setup = None
    yield Fact("Subject", (setup and setup.subject) or UNKNOWN)
    yield Fact("Operator", (setup and setup.operator) or UNKNOWN)


def _time(manifests: Sequence[Manifest]) -> str:
    first, last = (
        datetime.fromtimestamp(1e-9 * end(manifest.start_utc_ns for manifest in manifests), UTC) for end in (min, max)
    )
    if first.date() == last.date():
        return f"{first:%Y-%m-%d %H:%M} to {last:%H:%M} UTC"
    return f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} UTC"


def _devices(manifests: Sequence[Manifest]) -> str:
    """What every device said of itself, with its serial number where it has one."""
    found = {device.text or device.name: None for manifest in manifests for device in manifest.devices}
    return "; ".join(found) or UNKNOWN


def _load_cell(cell: LoadCell) -> str:
    capacity = f"{cell.capacity_kg:g} kg, " if cell.capacity_kg else ""
    certificate = f"calibrated on {cell.calibrated_on}" if cell.calibrated_on else "calibration date not recorded"
    due = f", due on {cell.calibration_due_on}" if cell.calibration_due_on else ""
    return f"{capacity}serial number {cell.serial_number or UNKNOWN}, {certificate}{due}"


def _calibration(calibration: Calibration | None) -> str:
    """Of the load cell in this session, by its bounce trials."""
    if calibration is None:
        return "no bounce trial: gain and lag as configured"
    gain = plus_minus(calibration.gain.value, calibration.gain.ci95, digits=4)
    lag = plus_minus(calibration.lag.value, calibration.lag.ci95, 1e3, 1).replace("-", "−")
    trials = counted(len(calibration.sources), "bounce trial")
    return f"{trials}: gain {gain}, lag of the force {lag} ms (95 % intervals)"


def _protocol(manifests: Sequence[Manifest]) -> str:
    of_cuffs = [manifest for manifest in manifests if manifest.cuff is not None]
    if not of_cuffs:
        return "no trial of a cuff"
    cuffs = {manifest.cuff.name for manifest in of_cuffs if manifest.cuff}
    donnings = {(manifest.cuff.name, manifest.donning) for manifest in of_cuffs if manifest.cuff}
    planned = of_cuffs[-1].protocol
    parts = [
        f"{counted(len(of_cuffs), 'trial')} of {counted(len(cuffs), 'cuff')} in {counted(len(donnings), 'donning')}"
    ]
    if planned.step_masses_kg:
        total = sum(planned.step_masses_kg)
        parts.append(f"static: {counted(len(planned.step_masses_kg), 'weight')}, {total:g} kg together")
    if planned.hold_s:
        parts.append(f"each load held {planned.hold_s:g} s")
    if planned.swing_s:
        parts.append(f"dynamic: at least {planned.swing_s:g} s")
    motions = [manifest for manifest in manifests if manifest.body is not None]
    if motions:
        parts.append(f"{counted(len(motions), 'trial')} of the wearer")
    return "; ".join(parts)
