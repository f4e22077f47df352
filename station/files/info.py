"""What is in a recording, and making a cut one whole, for the terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from fitting.plain import plain_sync
from fitting.quality import UnusableTrial
from fitting.timing.decimation import Decimator
from fitting.timing.sync_certificate import SyncCertificate, certify
from recordings.contents import Contents, summarise
from recordings.manifest import DataOrigin, LoadCell, Manifest
from recordings.reader import survey_file
from recordings.recovery import recover
from station.checksums import CHECKSUMS_FILE, changed_files, standing_of, write_checksums
from station.exit_code import DONE, LOSSY
from station.progress import busy, progress_bars


def show_contents(path: Path, *, as_json: bool) -> int:
    """Prints what is in the file to stdout; returns 0, or 3 where something of it is missing."""
    with busy(f"reading {path.name}"):
        contents, certificate, sentence = _read(path)
    standing = standing_of(path)
    if as_json:
        origin = contents.manifest.origin if contents.manifest else DataOrigin.UNKNOWN
        plain = {
            **json.loads(contents.to_json()),
            "origin": origin,
            "checked": standing,
            "sync": plain_sync(certificate),
            "sync_sentence": sentence,
        }
        print(json.dumps(plain, indent=2, ensure_ascii=False))
    else:
        _print_tables(contents, Console(markup=False))
        for words in (f"sync: {sentence}", *(certificate.findings if certificate else ())):
            print(words)
        print(f"{path.name}: {standing}, by {CHECKSUMS_FILE}")
    is_whole = contents.complete and not contents.gaps and not standing.is_break
    return DONE if is_whole else LOSSY


def recover_recording(path: Path, output: Path | None, *, as_json: bool) -> int:
    """Writes what can be read into a whole file, prints its path; returns 0, or 3 where something stays missing.

    A file that is whole is left as it is, and its own path is printed.
    """
    survey = survey_file(path)
    if not survey.damage and not survey.missing:
        print(f"{path} is whole: there is nothing to recover", file=sys.stderr)
        print(json.dumps(_recovered(path, path, (), lossless=True), indent=2) if as_json else path)
        return DONE
    with progress_bars(Console(stderr=True)) as progress:
        size = path.stat().st_size if path.is_file() else 0
        progress("recovering, kB", 0, size // 1000)
        report = recover(path, output, lambda done: progress("recovering, kB", done // 1000, size // 1000))
    write_checksums(report.output)
    for sentence in (*changed_files([path]), *report.sentences()):
        print(sentence, file=sys.stderr)
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
    """What is in the file; what the trial's sync edges are worth, and that or why nothing in a sentence."""
    survey = survey_file(path)
    if survey.manifest is None:
        return summarise(path, survey), None, "no certificate: the recording has lost its manifest"
    decimator = Decimator(survey.manifest, survey.streams)
    contents = summarise(path, survey, decimator.take)
    try:
        certificate = certify(survey.manifest, decimator.tracks())
    except UnusableTrial as error:
        return contents, None, f"no certificate: {'the file is damaged' if survey.damaged else error}"
    if certificate is not None and survey.damaged:
        certificate = replace(certificate, findings=())  # they may be the damage's work
    words = "no certificate: its clocks are as declared" if certificate is None else certificate.sentence
    return contents, certificate, words


def _print_tables(contents: Contents, console: Console) -> None:
    manifest, outcome = contents.manifest, contents.outcome
    if manifest is not None:
        subject = f"cuff {manifest.cuff.name}, donning {manifest.donning}" if manifest.cuff else "load cell"
        console.print(
            f"{subject}, {manifest.test}, repeat {manifest.repeat}, run {manifest.run}",
            highlight=False,
        )
        console.print(_origin_in_words(manifest), highlight=False, soft_wrap=True)
        console.print(_cell_in_words(manifest.load_cell), highlight=False)
    words = "no outcome: the recording was cut" if outcome is None else f"{outcome.state}: {outcome.sentence}"
    console.print(words, highlight=False)
    console.print(_topics_table(contents))
    console.print(_streams_table(contents))
    began_ns = contents.events[0].host_time_ns if contents.events else 0
    for event in contents.events:
        words = f"{(event.host_time_ns - began_ns) * 1e-9:8.2f} s  {event.text}"
        console.print(words, highlight=False, markup=False, soft_wrap=True)
    for gap in contents.gaps:
        console.print(f"gap in {gap.stream}: {gap.count} samples from {gap.first_missing} on, {gap.cause}", style="red")
    for sentence in contents.missing:
        console.print(sentence, style="red", highlight=False)


def _origin_in_words(manifest: Manifest) -> str:
    """Measured or simulated, and what each device said of itself."""
    said = "; ".join(f"{device.name}: {device.text or 'tells nothing of itself'}" for device in manifest.devices)
    words = {
        DataOrigin.SIMULATED: "SIMULATED data",
        DataOrigin.MEASURED: "measured data",
        DataOrigin.UNKNOWN: "measured or simulated: not recorded",
    }[manifest.origin]
    return f"{words} ({said})" if said else words


def _cell_in_words(cell: LoadCell) -> str:
    """The load cell and its certificate, as far as the configuration told."""
    said = [
        f"serial number {cell.serial_number}" if cell.serial_number else "no serial number",
        f"{cell.capacity_kg:g} kg" if cell.capacity_kg else "",
        f"{cell.sensitivity_mv_per_v:g} mV/V" if cell.sensitivity_mv_per_v else "",
        f"gain ± {100 * cell.gain_relative_sd:.3g} %" if cell.gain_relative_sd else "",
        f"calibrated {cell.calibrated_on}" if cell.calibrated_on else "no calibration date",
        f"due {cell.calibration_due_on}" if cell.calibration_due_on else "",
    ]
    return f"load cell: {', '.join(each for each in said if each)}"


def _topics_table(contents: Contents) -> Table:
    table = Table("topic", "messages", "seconds")
    for name, topic in contents.topics.items():
        table.add_row(name, str(topic.messages), f"{(topic.last_ns - topic.first_ns) * 1e-9:.2f}")
    return table


def _streams_table(contents: Contents) -> Table:
    table = Table("stream", "samples", "lost", "rate", "nominal", "unit", "worst occluded")
    for name, stream in contents.streams.items():
        worst = max(stream.occluded.items(), key=lambda pair: pair[1], default=None)
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
