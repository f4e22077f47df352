"""Show the content of a recording, and recover a cut one, for the terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from fitting.errors import UnusableTrial
from fitting.results.codes import Standing
from fitting.trial.decimation import Decimator
from fitting.trial.timeline import SyncCertificate, certify
from recordings.contents import Contents, summarise
from recordings.manifest import DataOrigin, LoadCell, Manifest
from recordings.reader import survey_file
from recordings.recovery import recover
from station.checksums import CHECKSUMS_FILE, changed_files, check_hash, write_checksums
from station.exit_code import DONE, LOSSY
from station.folded_table import FoldedTable
from station.progress import busy, progress_bars
from station.protocol import describe_trial


def show_contents(path: Path, *, as_json: bool) -> int:
    """Print the content of the file to stdout. Returns 0, or 3 if a part of it is missing."""
    with busy(f"reading {path.name}"):
        contents, certificate, sentence = _read(path)
    standing = check_hash(path)
    if as_json:
        from fitting.cuffs.cuffs_file import sync_entry  # all steps of a fit behind it take long to import

        origin = contents.manifest.origin if contents.manifest else DataOrigin.UNKNOWN
        plain = {
            **json.loads(contents.to_json()),
            "origin": origin,
            "checked": standing,
            "sync": sync_entry(certificate).model_dump(mode="json") if certificate else None,
            "sync_sentence": sentence,
        }
        print(json.dumps(plain, indent=2, ensure_ascii=False))
    else:
        _print_tables(contents, Console(markup=False))
        for line in (f"sync: {sentence}", *(certificate.findings if certificate else ())):
            print(line)
        print(f"{path.name}: {standing}, by {CHECKSUMS_FILE}")
    return LOSSY if contents.shortfalls or standing.is_break else DONE


def recover_recording(path: Path, output: Path | None, *, as_json: bool) -> int:
    """Write the readable part to a complete file, and print its path. Returns 0, or 3 if a part is missing.

    A complete file is not changed, and its own path is printed.
    """
    survey = survey_file(path)
    if not survey.damage and not survey.missing:
        print(f"{path} is complete, there is nothing to recover", file=sys.stderr)
        print(json.dumps(_recovered(path, path, (), lossless=True), indent=2) if as_json else path)
        return DONE
    with progress_bars(Console(stderr=True)) as progress:
        size = path.stat().st_size if path.is_file() else 0
        progress("recovering, kB", 0, size // 1000)
        report = recover(path, output, lambda done: progress("recovering, kB", done // 1000, size // 1000))
    left = [path] if check_hash(path) is Standing.ADDED else []  # by a recorder that was killed
    write_checksums(*left, report.output)
    for message in (*changed_files([path]), *report.sentences()):
        print(message, file=sys.stderr)
    if as_json:
        print(
            json.dumps(_recovered(report.source, report.output, report.sentences(), lossless=report.lossless), indent=2)
        )
    else:
        print(report.output)
    return DONE if report.lossless and not report.damage else LOSSY


def _recovered(source: Path, output: Path, missing: Sequence[str], *, lossless: bool) -> dict[str, Any]:
    return {"source": str(source), "output": str(output), "lossless": lossless, "missing": list(missing)}


def _read(path: Path) -> tuple[Contents, SyncCertificate | None, str]:
    """Content of the file, and certificate of its sync edges, also as a sentence that explains a missing one."""
    survey = survey_file(path)
    if survey.manifest is None:
        return summarise(path, survey), None, "no certificate: the manifest of the recording is lost"
    decimator = Decimator(survey.manifest, survey.streams)
    contents = summarise(path, survey, decimator.take)
    try:
        certificate = certify(survey.manifest, decimator.tracks())
    except UnusableTrial as error:
        return contents, None, f"no certificate: {'the file is damaged' if survey.damaged else error}"
    if certificate is not None and survey.damaged:
        certificate = replace(certificate, findings=())  # the damage may cause them
    sentence = "no certificate: the clocks are as declared" if certificate is None else str(certificate.summary)
    return contents, certificate, sentence


def _print_tables(contents: Contents, console: Console) -> None:
    manifest, outcome = contents.manifest, contents.outcome
    if manifest is not None:
        console.print(_describe_trial(manifest), highlight=False)
        console.print(_describe_origin(manifest), highlight=False, soft_wrap=True)
        console.print(_describe_cell(manifest.load_cell), highlight=False)
        for line in _describe_wearer(manifest):
            console.print(line, highlight=False, soft_wrap=True)
    line = "no outcome: the recording was cut" if outcome is None else f"{outcome.state}: {outcome.sentence}"
    console.print(line, highlight=False)
    console.print(_topics_table(contents))
    console.print(_streams_table(contents))
    began_ns = contents.events[0].host_time_ns if contents.events else 0
    for event in contents.events:
        line = f"{(event.host_time_ns - began_ns) * 1e-9:8.2f} s  {event.text}"
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for sentence in contents.shortfalls:
        console.print(sentence, style="red", highlight=False)


def _describe_trial(manifest: Manifest) -> str:
    if manifest.body is not None:
        title = describe_trial(None, manifest.test, manifest.repeat, manifest.condition)
        return f"wearer, {title}, run {manifest.run}"
    subject = f"cuff {manifest.cuff.name}, donning {manifest.donning}" if manifest.cuff else "load cell"
    return f"{subject}, {manifest.test}, repeat {manifest.repeat}, run {manifest.run}"


def _describe_wearer(manifest: Manifest) -> Iterator[str]:
    """Markers, elevation and EMG of a pose or a motion."""
    body, emg = manifest.body, manifest.emg
    if body is not None:
        suit = f"; of the suit: {', '.join(body.suit)}" if body.suit else ""
        yield f"markers of the body: {', '.join(body.body)}{suit}"
        if body.arm:
            yield f"elevation: {' to '.join(body.arm)} relative to {' to '.join(body.trunk)}"
        if body.is_cord_measured:
            yield "the load cell is in the cord of the suit"
    if emg is not None:
        gains = ", ".join(f"{label} ×{gain:g}" for label, gain in emg.gains.items())
        yield f"EMG: {emg.source}{f', gains {gains}' if gains else ''}"


def _describe_origin(manifest: Manifest) -> str:
    """Measured or simulated, and the identity that every device reported."""
    devices = "; ".join(f"{device.name}: {device.text or 'no identification'}" for device in manifest.devices)
    origin = {
        DataOrigin.SIMULATED: "SIMULATED data",
        DataOrigin.MEASURED: "measured data",
        DataOrigin.UNKNOWN: "measured or simulated: not recorded",
    }[manifest.origin]
    return f"{origin} ({devices})" if devices else origin


def _describe_cell(cell: LoadCell) -> str:
    """The load cell and its certificate, as far as the configuration gives them."""
    parts = [
        f"serial number {cell.serial_number}" if cell.serial_number else "no serial number",
        f"{cell.capacity_kg:g} kg" if cell.capacity_kg else "",
        f"{cell.sensitivity_mv_per_v:g} mV/V" if cell.sensitivity_mv_per_v else "",
        f"gain ± {100 * cell.gain_relative_sd:.3g} %" if cell.gain_relative_sd else "",
        f"calibrated {cell.calibrated_on}" if cell.calibrated_on else "no calibration date",
        f"due {cell.calibration_due_on}" if cell.calibration_due_on else "",
    ]
    return f"load cell: {', '.join(part for part in parts if part)}"


def _topics_table(contents: Contents) -> FoldedTable:
    """Seconds: of the streams; manifest, events and outcome are written when something happens."""
    table = FoldedTable("topic", "messages", "seconds")
    for name, topic in contents.topics.items():
        seconds = f"{(topic.last_ns - topic.first_ns) * 1e-9:.2f}" if name in contents.streams else ""
        table.add_row(name, str(topic.messages), seconds)
    return table


def _streams_table(contents: Contents) -> FoldedTable:
    """Occluded: of the markers that the trial needs, as others may be in the label list of the mocap system."""
    subject = contents.manifest.subject if contents.manifest else None
    labels = subject.labels if subject else ()
    table = FoldedTable("stream", "samples", "lost", "rate", "nominal", "unit", "worst occluded")
    for name, stream in contents.streams.items():
        needed = {label: part for label, part in stream.occluded.items() if label in labels} or stream.occluded
        worst = max(needed.items(), key=lambda pair: pair[1], default=None)
        table.add_row(
            name,
            str(stream.samples),
            str(contents.lost(name)),
            "-" if stream.rate_hz is None else f"{stream.rate_hz:.2f}",
            f"{stream.nominal_rate_hz:g}",
            stream.unit,
            f"{worst[0]} {worst[1]:.1%}" if worst else "",
        )
    return table
