"""Results of `station emg`: emg.json and its schema, envelopes as tables, and the change for `station assess --emg`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from documents.interval import bracketed, counted
from documents.message import Message, because
from documents.plain_data import read_json
from documents.validation import DOCUMENT_ERRORS, Section, invalid_because
from fitting.emg.change import RepeatUnit
from fitting.emg.channels import UNUSABLE, ChannelFinding
from fitting.emg.envelopes import resampled
from fitting.emg.shape import ShapeComparison, ShapeOutcome
from recordings.manifest import DataOrigin
from solver.time_series_table import write_table
from station.assessment.assessment_inputs import REDUCTION_COLUMNS
from station.checksums import drafted, file_sha256, write_checksums, write_whole
from station.emg.comparison import ComparedChange, ComparedEmg, ComparedTrial, pool_trials
from station.emg.trials import EmgFileError, EmgSetup, EnvelopeSection
from station.folded_table import FoldedTable
from station.messages.emg_messages import FINDING_TEXT, OUTCOME_TEXT, EmgCode
from station.versions import solving_versions

EMG_FILE = "emg.json"
FORMAT: Literal[1] = 1
CURVE_HZ = 25.0
"""Sample rate of the shapes in the file, above twice the bandwidth of the smoothing."""
OUTPUT_HZ = 100.0
"""Sample rate of written envelopes: far above their bandwidth, and the rate of most motions."""
CHANGE_FILE = "emg_change.csv"
UNIT_TEXT = {"1": "fraction of the MVC", "V": "V", "": "unknown"}
TableFormat = Literal["sto", "csv"]


class EmgFigure(Section):
    """A number with its 95 % interval; null if it is unknown."""

    value: float | None
    ci95: tuple[float, float] | None = None


class EmgShape(Section):
    """EMG beside the model's activation. lag_s is positive if EMG follows the model.

    Shapes are scaled from 0, the minimum of the curve in the trial, to 1, its maximum; they have no amplitude.
    """

    outcome: ShapeOutcome
    correlation: EmgFigure
    lag_s: EmgFigure
    shape_rmse: EmgFigure
    time_s: list[float]
    emg_shape: list[float]
    model_shape: list[float]

    @model_validator(mode="after")
    def _ensure_same_length(self) -> Self:
        if not len(self.time_s) == len(self.emg_shape) == len(self.model_shape) > 0:
            raise ValueError("time_s, emg_shape and model_shape need the same number of values, at least one")
        return self


class EmgChannel(Section):
    """A channel of a trial: findings, mean in `level_unit`, and muscles of the model at its electrodes."""

    channel: str
    findings: list[ChannelFinding]
    mean: float | None
    muscles: list[str]
    shape: EmgShape | None


class EmgFinding(Section):
    """A finding on a trial or on its activations: its code, and the figures of its sentence."""

    code: EmgCode
    figures: dict[str, float | str]

    def __str__(self) -> str:
        return str(Message(self.code, self.figures))


class EmgTrialEntry(Section):
    name: str
    condition: Literal["condition", "reference"]
    channels: list[EmgChannel]
    findings: list[EmgFinding] = Field(default_factory=list)

    @property
    def compared(self) -> list[EmgChannel]:
        """Channels that are compared with the model."""
        return [channel for channel in self.channels if channel.shape is not None]

    @property
    def is_whole(self) -> bool:
        """Whether all channels of the set-up that the file has could be read and used."""
        is_read = all(finding.code is not EmgCode.UNREAD_CHANNELS for finding in self.findings)
        return is_read and not any(UNUSABLE & set(channel.findings) for channel in self.channels)


class EmgPooledEntry(Section):
    """Correlation and lag of a channel over the trials of a condition, and the number of trials in each."""

    condition: Literal["condition", "reference"]
    channel: str
    correlation: EmgFigure
    lag_s: EmgFigure
    trials: int
    trials_of_lag: int


class EmgChangeEntry(Section):
    """Ratio of EMG in the condition to the reference, and the same of the model's activations.

    repeats and repeat_units: of the reference and of the condition. Cycles of a single trial do not contain the
    variation between trials.
    """

    channel: str
    muscles: list[str]
    emg_ratio: EmgFigure
    model_ratio: EmgFigure
    repeats: Annotated[list[int], Field(min_length=2, max_length=2)]
    repeat_units: Annotated[list[RepeatUnit], Field(min_length=2, max_length=2)]


class EmgDocument(Section):
    """emg.json: EMG beside the model's activations.

    `level_unit` is "1" for fractions of the MVC, "V", or "" if the files declare none; `setup` is the effective set-up,
    `inputs` has the SHA-256 of every file.
    """

    format: Literal[1]
    origin: DataOrigin
    level_unit: Literal["1", "V", ""]
    setup: EmgSetup
    trials: list[EmgTrialEntry]
    pooled: list[EmgPooledEntry]
    changes: list[EmgChangeEntry]
    inputs: dict[str, str]
    versions: dict[str, str]


def write_emg(folder: Path, compared: ComparedEmg, files: Mapping[str, Sequence[Path]]) -> EmgDocument:
    """Write emg.json into the folder; files: the inputs by role."""
    trials = [_trial(trial, "condition") for trial in compared.trials]
    trials += [_trial(trial, "reference") for trial in compared.reference]
    pooled = [*_pooled(compared.trials, "condition"), *_pooled(compared.reference, "reference")]
    document = EmgDocument(
        format=FORMAT,
        origin=compared.origin,
        level_unit=_unit(compared),
        setup=compared.setup,
        trials=trials,
        pooled=pooled,
        changes=[_change(change, compared) for change in compared.changes],
        inputs={
            f"{role} {i}": f"{path.name} {file_sha256(path)}"
            for role, paths in files.items()
            for i, path in enumerate(paths, start=1)
        },
        versions=solving_versions(),
    )
    text = json.dumps(document.model_dump(mode="json"), indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(folder / EMG_FILE, text + "\n")
    write_checksums(folder / EMG_FILE)
    return document


def read_emg_document(path: Path) -> EmgDocument:
    """Read emg.json. Raises EmgFileError with the wrong key."""
    try:
        return EmgDocument.model_validate(read_json(path))
    except OSError as error:
        figures = {"path": str(path), **because(error)}
        raise EmgFileError(Message(EmgCode.UNREADABLE, figures)) from error
    except DOCUMENT_ERRORS as error:
        figures = {"path": str(path), **invalid_because(error)}
        raise EmgFileError(Message(EmgCode.WRONG_DOCUMENT, figures)) from error


def _unit(compared: ComparedEmg) -> Any:
    return (compared.trials or compared.reference)[0].levels.unit


def _trial(trial: ComparedTrial, condition: Literal["condition", "reference"]) -> EmgTrialEntry:
    levels, channels = trial.levels, []
    for label in levels.labels:
        section = trial.setup.channels.get(label)
        found = trial.comparisons.get(label)
        channels.append(
            EmgChannel(
                channel=label,
                findings=list(levels.findings[label]),
                mean=float(np.mean(trial.means(levels, label))) if label in levels.usable else None,
                muscles=list(section.muscles) if section else [],
                shape=None if found is None else _shape(found),
            )
        )
    findings = [EmgFinding(code=finding.code, figures=dict(finding.figures)) for finding in trial.findings]
    return EmgTrialEntry(name=levels.name, condition=condition, channels=channels, findings=findings)


def _shape(found: ShapeComparison) -> EmgShape:
    time = np.arange(found.time[0], found.time[-1] + 1e-9, 1 / CURVE_HZ)
    curves = [np.interp(time, found.time, curve).round(4).tolist() for curve in (found.emg, found.model)]
    return EmgShape(
        outcome=found.outcome,
        correlation=_figure(found.correlation, found.correlation_ci95),
        lag_s=_figure(found.lag, found.lag_ci95),
        shape_rmse=_figure(found.rmse, None),
        time_s=time.round(6).tolist(),
        emg_shape=curves[0],
        model_shape=curves[1],
    )


def _pooled(trials: Sequence[ComparedTrial], condition: Literal["condition", "reference"]) -> Iterator[EmgPooledEntry]:
    for label, found in pool_trials(trials).items():
        yield EmgPooledEntry(
            condition=condition,
            channel=label,
            correlation=_figure(found.correlation, found.correlation_ci95),
            lag_s=EmgFigure(value=None) if found.lag is None else _figure(found.lag.value, found.lag.ci95),
            trials=found.trials,
            trials_of_lag=found.trials_of_lag,
        )


def _change(change: ComparedChange, compared: ComparedEmg) -> EmgChangeEntry:
    section = compared.setup.channels.get(change.label)
    return EmgChangeEntry(
        channel=change.label,
        muscles=list(section.muscles) if section else [],
        emg_ratio=_figure(change.emg.ratio, change.emg.ci95),
        model_ratio=EmgFigure(value=change.model_ratio),
        repeats=list(change.emg.repeats),
        repeat_units=list(change.emg.units),
    )


def _figure(value: float, ci95: tuple[float, float] | None) -> EmgFigure:
    if not np.isfinite(value):
        return EmgFigure(value=None)
    return EmgFigure(value=value, ci95=ci95)


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
    write_whole(path, "\n".join([",".join(REDUCTION_COLUMNS), *rows]) + "\n")
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
                _figure_text(found.correlation, digits=2),
                _figure_text(found.lag_s, 1e3) if is_lag_known else "–",
                _figure_text(found.shape_rmse, digits=2),
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
        correlation = str(pooled.trials), _figure_text(pooled.correlation, digits=2)
        lag = str(pooled.trials_of_lag), _figure_text(pooled.lag_s, 1e3)
        table.add_row(pooled.condition, pooled.channel, *correlation, *lag)
    return table


def change_table(document: EmgDocument) -> FoldedTable:
    """Ratio of EMG in the condition to the reference, and of the activations of the model."""
    table = FoldedTable("channel", "muscles", "EMG, condition / reference", "model", "repeats")
    for change in document.changes:
        ratios = _figure_text(change.emg_ratio, digits=2), _figure_text(change.model_ratio, digits=2)
        repeats = zip(change.repeats, change.repeat_units, strict=True)
        counts = ", ".join(counted(count, unit) for count, unit in repeats)
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


def _figure_text(number: EmgFigure, scale: float = 1.0, digits: int = 0) -> str:
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
