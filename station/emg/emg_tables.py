"""Tables of `station emg`: envelopes for other programs, change for `station assess --emg`, tables for the terminal."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Literal

from documents.interval import bracketed
from fitting.emg.channels import ChannelFinding
from fitting.emg.envelopes import resampled
from fitting.emg.shape import ShapeOutcome
from solver.time_series_table import write_table
from station.assessment.emg import COLUMNS
from station.emg.comparison import ComparedChange, ComparedEmg, ComparedTrial
from station.emg.emg_json import EMG_FILE, EmgDocument, EmgFigure
from station.emg.trials import EnvelopeSection
from station.folded_table import FoldedTable
from station.whole_file import drafted, write_whole

OUTPUT_HZ = 100.0
"""Sample rate of written envelopes: far above their bandwidth, and the rate of most motions."""
CHANGE_FILE = "emg_change.csv"
UNIT_TEXT = {"1": "fraction of the MVC", "V": "V", "": "unknown"}

TableFormat = Literal["sto", "csv"]

FINDING_TEXT = {
    ChannelFinding.FLAT: "flat: no electrode, or the amplifier was off",
    ChannelFinding.CLIPPED: "clipped by the converter's range; lower the gain, or remove an offset",
    ChannelFinding.RECTIFIED: "rectified or smoothed already; give the raw signal",
    ChannelFinding.GAP: "samples are missing for more than 10 ms",
    ChannelFinding.HUM: "mains hum is more than half of the power; check electrodes and ground",
    ChannelFinding.ABOVE_MVC: "above the MVC, which was not maximal",
    ChannelFinding.NO_MVC: "no MVC is known; the shape is compared, and the level is unknown",
}
OUTCOME_TEXT = {
    ShapeOutcome.COMPARED: "",
    ShapeOutcome.LAG_NOT_IDENTIFIED: "lag not identified",
    ShapeOutcome.MODEL_AT_REST: "the model's muscles are at rest",
    ShapeOutcome.CONSTANT_EMG: "EMG does not change",
    ShapeOutcome.TOO_SHORT: "the trial is too short",
}
"""Codes as text, for terminal and report."""


def result_files(folder: Path, trials: Sequence[Path], table_format: TableFormat) -> list[Path]:
    """Every file that `station emg` may write for the EMG of these files."""
    envelopes = [_envelope_file(folder, path.stem, table_format) for path in trials]
    return [folder / EMG_FILE, folder / CHANGE_FILE, *envelopes]


def write_envelopes(folder: Path, compared: ComparedEmg, table_format: TableFormat) -> list[Path]:
    """Write NAME_emg.sto or .csv for every trial with a usable channel: time [s] and a column per channel."""
    return [
        _write_envelopes(_envelope_file(folder, trial.levels.name, table_format), trial)
        for trial in (*compared.trials, *compared.reference)
        if trial.levels.usable
    ]


def write_change(folder: Path, compared: ComparedEmg) -> Path | None:
    """Write emg_change.csv for `station assess --emg`: the changes with an interval. Returns None without one."""
    rows = [row for change in compared.changes for row in _rows(change, compared)]
    if not rows:
        return None
    path = folder / CHANGE_FILE
    write_whole(path, "\n".join([",".join(COLUMNS), *rows]) + "\n")
    return path


@dataclass(frozen=True)
class ShapeRow:
    """A channel beside the model, as text."""

    trial: str
    channel: str
    muscles: str
    correlation: str
    lag: str
    rmse: str
    note: str


def shape_rows(document: EmgDocument) -> Iterator[ShapeRow]:
    for trial in document.trials:
        for channel in trial.channels:
            found = channel.shape
            if found is None:
                continue
            is_lag_known = found.outcome is ShapeOutcome.COMPARED
            yield ShapeRow(
                trial.name,
                channel.channel,
                ", ".join(channel.muscles),
                _figure(found.correlation, digits=2),
                _figure(found.lag_s, 1e3) if is_lag_known else "–",
                _figure(found.shape_rmse, digits=2),
                ", ".join(filter(None, [OUTCOME_TEXT[found.outcome], *channel.findings])),
            )


def shape_table(document: EmgDocument) -> FoldedTable:
    """A row per channel that is compared with the model."""
    table = FoldedTable("trial", "channel", "muscles", "correlation", "lag [ms]", "shape RMSE", "note")
    table.caption = "in brackets: 95 % intervals; positive lag: EMG follows the model"
    for row in shape_rows(document):
        table.add_row(*astuple(row))
    return table


def pooled_table(document: EmgDocument) -> FoldedTable:
    """A row for each channel that is compared in several trials of a condition."""
    table = FoldedTable("trials", "channel", "number", "correlation", "with a lag", "lag [ms]")
    table.caption = "over the trials, random effects; in brackets 95 % intervals"
    for pooled in document.pooled:
        correlation = str(pooled.trials), _figure(pooled.correlation, digits=2)
        lag = str(pooled.trials_of_lag), _figure(pooled.lag_s, 1e3)
        table.add_row(pooled.condition, pooled.channel, *correlation, *lag)
    return table


def change_table(document: EmgDocument) -> FoldedTable:
    """Ratio of EMG in the condition to the reference, and of the activations of the model."""
    table = FoldedTable("channel", "muscles", "EMG, condition / reference", "model", "repeats")
    for change in document.changes:
        ratios = _figure(change.emg_ratio, digits=2), _figure(change.model_ratio, digits=2)
        repeats = zip(change.repeats, change.repeat_units, strict=True)
        counts = ", ".join(f"{count} {unit}{'s' if count != 1 else ''}" for count, unit in repeats)
        table.add_row(change.channel, ", ".join(change.muscles), *ratios, counts)
    return table


def method_text(section: EnvelopeSection) -> str:
    """Processing of the envelope, as text."""
    if section.method == "seth_2019":
        return "high-pass 100 Hz, rectified, low-pass 2.5 Hz (Seth et al. 2019)"
    low, high = section.band_hz
    smoothing = (
        f"RMS over {section.window_s:g} s" if section.method == "rms" else f"low-pass {section.low_pass_hz:g} Hz"
    )
    return f"band {low:g} to {high:g} Hz, {'' if section.method == 'rms' else 'rectified, '}{smoothing}"


def findings_text(document: EmgDocument) -> Iterator[str]:
    """A sentence for each finding on a trial, and for each kind of finding on channels, with these."""
    for trial in document.trials:
        yield from (f"{trial.name}: {finding}" for finding in trial.findings)
    for code, text in FINDING_TEXT.items():
        found = [
            f"{channel.channel} in {trial.name}"
            for trial in document.trials
            for channel in trial.channels
            if code in channel.findings
        ]
        if found:
            yield f"{', '.join(found)}: {text}"


def _figure(number: EmgFigure, scale: float = 1.0, digits: int = 0) -> str:
    return "–" if number.value is None else bracketed(number.value, number.ci95, scale, digits)


def _envelope_file(folder: Path, trial: str, table_format: TableFormat) -> Path:
    return folder / f"{trial}_emg.{table_format}"


def _write_envelopes(path: Path, trial: ComparedTrial) -> Path:
    envelopes = resampled(trial.levels, OUTPUT_HZ)
    notes = {
        "made_by": "station emg",
        "origin": trial.envelopes.origin,
        "unit": UNIT_TEXT[envelopes.unit],
        "method": method_text(trial.setup.envelope),
    }
    with drafted(path) as draft:
        write_table(draft, _column_names(envelopes.labels), envelopes.time, envelopes.values, notes)
    return path


def _column_names(labels: Sequence[str]) -> list[str]:
    """Labels without separators of columns, made unique."""
    names: list[str] = []
    for label in labels:
        name = re.sub(r"[\s,;]+", "_", label.strip())
        names.append(name if name not in names else f"{name}_{len(names) + 1}")
    return names


def _rows(change: ComparedChange, compared: ComparedEmg) -> Iterator[str]:
    """A row per muscle of the channel."""
    section = compared.setup.channels.get(change.label)
    if section is None or change.emg.standard_error is None:
        return
    for muscle in section.muscles:
        yield f"{muscle},{100 * (1 - change.emg.ratio):.6g},{100 * change.emg.standard_error:.6g}"
