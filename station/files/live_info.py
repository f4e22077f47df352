"""Show, recover and export live results, for the terminal."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from recordings.errors import RecordingError
from recordings.exchange.signal_csv import write_columns
from recordings.live_result import LiveResult, read_live_result, recover_live_result
from recordings.recovery import recovered_path
from station.exit_code import DONE, LOSSY
from station.files.synchronised import ExportRefused
from station.live.result_file import live_path
from station.messages.file_codes import ExportCode
from station.messages.message import Message
from station.whole_file import drafted, write_whole

FORMATS: tuple[str, ...] = ("csv", "tsv", "parquet")
SEPARATORS = {"csv": ",", "tsv": "\t"}


def show_live_result(path: Path, *, as_json: bool) -> int:
    """Print what the file holds. Returns 0, or 3 for an incomplete one."""
    result = read_live_result(path)
    plain = _plain(path, result)
    if as_json:
        print(json.dumps(plain, indent=2))
    else:
        print(f"LIVE RESULT, not the offline one: {plain['sentence']}")
        for key in ("recording", "body", "lag_s", "suits", "frames", "origin"):
            print(f"{key}: {plain[key]}")
        for event in result.events:
            print(f"{event.kind}: {event.text}")
    return DONE if plain["standing"] == "complete" else LOSSY


def live_result_of(recording: Path) -> dict[str, Any] | None:
    """The live result beside a recording; None where there is none."""
    path = live_path(recording)
    if not path.exists():
        return None
    try:
        return _plain(path, read_live_result(path))
    except RecordingError as error:
        return {"path": str(path), "standing": "unreadable", "sentence": str(error)}


def recover_live(path: Path, output: Path | None, *, as_json: bool) -> int:
    """Write the readable part to a new file and print its path; a complete file is not changed."""
    result = read_live_result(path)
    if result.is_complete:
        print(f"{path} is complete, there is nothing to recover", file=sys.stderr)
        target = path
    else:
        target = output or recovered_path(path)
        result = recover_live_result(path, target)
        print(f"{len(result.frames)} frames are kept; the end is missing", file=sys.stderr)
    plain = {"source": str(path), "output": str(target), "lossless": result.is_complete}
    print(json.dumps(plain, indent=2) if as_json else target)
    return DONE if result.is_complete else LOSSY


def export_live_result(path: Path, to: str, output: Path) -> list[Path]:
    """A table of all values, a row per frame, and for csv and tsv the description beside it as JSON.

    Raises ExportRefused for a format that has no place for them, RecordingError.
    """
    if to not in FORMATS:
        figures = {"file": path.name, "format": to, "possible": ", ".join(FORMATS)}
        raise ExportRefused(Message(ExportCode.LIVE_FORMAT, figures))
    result = read_live_result(path)
    frames, names = result.frames, list(result.manifest.columns)
    columns = {
        "time_s": np.array([frame.time_s for frame in frames]),
        "frame": np.array([float(frame.frame) for frame in frames]),
        **dict(zip(names, result.values.T, strict=True)),
    }
    target = output / f"{path.name.removesuffix('.mcap')}.{to}"
    if to == "parquet":
        from recordings.exchange.sample_tables import write_parquet

        notes = {"station": json.dumps(_plain(path, result))}
        with drafted(target) as draft:
            write_parquet(draft, columns, {"time_s": "s", "frame": "", **result.manifest.columns}, notes)
        return [target]
    write_whole(target, write_columns(columns, SEPARATORS[to]))
    beside = target.with_suffix(".json")
    write_whole(beside, json.dumps({**_plain(path, result), "units": dict(result.manifest.columns)}, indent=2) + "\n")
    return [target, beside]


def shortfalls_of_live(path: Path) -> tuple[str, ...]:
    """What an incomplete file lacks, as sentences. Raises RecordingError."""
    result = read_live_result(path)
    return () if result.is_complete else (_standing(path, result)[1],)


def _plain(path: Path, result: LiveResult) -> dict[str, Any]:
    manifest, outcome = result.manifest, result.outcome
    standing, sentence = _standing(path, result)
    return {
        "result": manifest.result,
        "path": str(path),
        "standing": standing,
        "sentence": sentence,
        "recording": manifest.recording,
        "recording_sha256": outcome.recording_sha256 if outcome else "",
        "body": manifest.model if manifest.is_scaled else f"{manifest.model}, generic",
        "lag_s": manifest.lag_s,
        "suits": list(manifest.suits),
        "frames": len(result.frames),
        "dropped_frames": outcome.dropped_frames if outcome else None,
        "outcomes": dict(Counter(frame.outcome for frame in result.frames)),
        "origin": manifest.origin,
        "versions": dict(manifest.versions),
    }


def _standing(path: Path, result: LiveResult) -> tuple[str, str]:
    """Whether the file is complete, and belongs to the recording that is there now."""
    count, outcome = len(result.frames), result.outcome
    if outcome is None or not result.is_complete:
        return "incomplete", f"{count} frames, incomplete: its process or the recorder ended before the trial did"
    left = f", {outcome.dropped_frames} left out" if outcome.dropped_frames else ""
    raw = path.parent.parent / outcome.recording
    if not raw.exists():
        return "complete", f"{count} frames{left}; its recording is elsewhere"
    if hashlib.sha256(raw.read_bytes()).hexdigest() != outcome.recording_sha256:
        return "other_recording", f"{count} frames{left}; {raw.name} is not the recording that it was computed from"
    return "complete", f"{count} frames{left}, from this recording"
