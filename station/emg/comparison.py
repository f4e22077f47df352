"""Compare EMG with a model: trials of a condition and of its reference, with the activations of the model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message
from fitting.emg.change import EmgChange, PooledShape, emg_change, pool_shapes
from fitting.emg.envelopes import EmgEnvelopes, compute_envelopes, largest_envelopes, normalised
from fitting.emg.shape import LEAST_ACTIVATION, ShapeComparison, compare_shapes
from recordings.manifest import DataOrigin
from solver.time_series_table import read_table
from station.emg.trials import EmgFileError, EmgSetup, read_emg_setup, read_emg_trial
from station.exit_code import WRONG_USAGE
from station.messages.emg_messages import EmgCode
from station.sources import repeated_name

Array = NDArray[np.float64]


LEAST_COMMON = 0.95
"""Smallest part of EMG or activations that is compared without a finding. Two recordings of one trial differ by a few
frames; two trials of one movement in the public data by 6 %."""
LONGEST_STEP_S = 0.5
"""Of activations, which are compared at 3 Hz and above."""


class WrongEmgFiles(EmgFileError):
    """The command names files that do not belong together."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True)
class ConditionFiles:
    """EMG of the repeats of a condition, and activations of the model in the same order: none, or one per repeat, None
    for a repeat that the model has not solved.
    """

    emg: tuple[Path, ...]
    activations: tuple[Path | None, ...] = ()


@dataclass(frozen=True, eq=False)
class ModelActivations:
    """Activations (n, muscles) of a model at time (n,) [s], from a file.

    row_counts  rows by the header of the file and rows that it has, if they differ
    """

    file: str
    time: Array
    muscles: tuple[str, ...]
    values: Array
    row_counts: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class ComparedTrial:
    """A repeat: its envelopes and, with activations of the model, the comparison of every channel with its muscles.

    normalised: envelopes as fractions of their MVC; None if no channel has a known MVC.
    findings: on channels that were not read, on the file of activations, and on its time in common with the EMG.
    """

    envelopes: EmgEnvelopes
    normalised: EmgEnvelopes | None
    activations: ModelActivations | None
    comparisons: Mapping[str, ShapeComparison]
    setup: EmgSetup
    findings: tuple[Message[EmgCode], ...] = ()

    @property
    def levels(self) -> EmgEnvelopes:
        """The normalised envelopes; without an MVC, the envelopes."""
        return self.normalised or self.envelopes

    def means(self, envelopes: EmgEnvelopes, label: str) -> list[float]:
        """Mean of every cycle, or of the whole trial, within the time of the activations if there are any."""
        if self.activations is None:
            return envelopes.means(label)
        first, last = self.activations.time[[0, -1]]
        return envelopes.means(label, float(first), float(last))

    def model(self, label: str) -> tuple[Array, Array] | None:
        """Time (n,) [s] and combined activation (n,) of the muscles of a channel."""
        if self.activations is None or label not in self.setup.channels:
            return None
        section = self.setup.channels[label]
        places = [self.activations.muscles.index(muscle) for muscle in section.muscles]
        return self.activations.time, section.combined(self.activations.values[:, places])


@dataclass(frozen=True, eq=False)
class ComparedChange:
    """Ratio of EMG in the condition to the reference, and that of the model; None if it is unknown."""

    label: str
    emg: EmgChange
    model_ratio: float | None


@dataclass(frozen=True, eq=False)
class ComparedEmg:
    """All trials of a condition and of its reference, changes by channel, and the set-up."""

    trials: tuple[ComparedTrial, ...]
    reference: tuple[ComparedTrial, ...]
    changes: tuple[ComparedChange, ...]
    setup: EmgSetup

    @property
    def origin(self) -> DataOrigin:
        """Simulated if any of the trials is."""
        return DataOrigin.joined(trial.envelopes.origin for trial in (*self.trials, *self.reference))


def compare_emg(
    condition: ConditionFiles, reference: ConditionFiles, mvc: Sequence[Path], setup_file: Path | None
) -> ComparedEmg:
    """Read the files and compute envelopes, comparison with the model, and change from the reference.

    Raises WrongEmgFiles, ConfigError and the errors of the readers.
    """
    for files in (condition, reference):
        if files.activations and len(files.activations) != len(files.emg):
            counts = {"trials": len(files.emg), "activations": len(files.activations)}
            raise WrongEmgFiles(Message(EmgCode.ACTIVATIONS_COUNT, counts))
    setup = read_emg_setup(setup_file)
    _ensure_distinct([*condition.emg, *reference.emg])
    envelopes = {path: _read_envelopes(path, setup) for path in (*condition.emg, *reference.emg, *mvc)}
    if setup_file is not None:
        for path in condition.emg:
            setup.require_channels((*envelopes[path].labels, *envelopes[path].unread), path.name)
    _ensure_same_unit(envelopes)
    maxima = largest_envelopes([envelopes[path] for path in mvc], setup.mvc.window_s) | setup.maxima
    trials, references = (
        tuple(
            _compared(envelopes[path], maxima, activations, setup)
            for path, activations in zip(files.emg, files.activations or [None] * len(files.emg), strict=True)
        )
        for files in (condition, reference)
    )
    return ComparedEmg(trials, references, tuple(_changes(trials, references)), setup)


def pool_trials(trials: Sequence[ComparedTrial]) -> dict[str, PooledShape]:
    """Correlation and lag over the trials of a condition, by channel, where at least two trials are compared."""
    labels = dict.fromkeys(label for trial in trials for label in trial.comparisons)
    found = {
        label: pool_shapes([trial.comparisons[label] for trial in trials if label in trial.comparisons])
        for label in labels
    }
    return {label: pooled for label, pooled in found.items() if pooled is not None}


def read_model_activations(path: Path) -> ModelActivations:
    """Read a table (.sto, .mot, .csv) with a column `time` and one per muscle. Raises MotionError, EmgFileError."""
    names, values, header = read_table(path)
    if "time" not in names:
        figures = {"file": path.name, "columns": ", ".join(names)}
        raise EmgFileError(Message(EmgCode.NO_TIME_COLUMN, figures))
    place = names.index("time")
    steps = np.diff(values[:, place])
    if (steps <= 0).any():
        raise EmgFileError(Message(EmgCode.TIMES_NOT_RISING, {"file": path.name}))
    if (step := float(np.median(steps))) > LONGEST_STEP_S:
        times: Figures = {"file": path.name, "step_s": step, "longest_s": LONGEST_STEP_S}
        raise EmgFileError(Message(EmgCode.FEW_TIMES, times))
    muscles = tuple(name for name in names if name != "time")
    without_time = np.delete(values, place, axis=1)
    return ModelActivations(path.name, values[:, place], muscles, without_time, header.row_counts(len(values)))


def _read_envelopes(path: Path, setup: EmgSetup) -> EmgEnvelopes:
    subtracted = [label for label, section in setup.channels.items() if section.subtract_minimum]
    return compute_envelopes(read_emg_trial(path, setup), setup.envelope.settings(), subtracted)


def _ensure_distinct(paths: Sequence[Path]) -> None:
    """The name of a trial is the name of its files."""
    if (name := repeated_name(paths)) is not None:
        raise WrongEmgFiles(Message(EmgCode.SAME_NAME, {"name": name}))


def _ensure_same_unit(envelopes: Mapping[Path, EmgEnvelopes]) -> None:
    units = {trial.unit: path.name for path, trial in envelopes.items()}
    if len(units) > 1:
        raise WrongEmgFiles(Message(EmgCode.MIXED_UNITS, {"in_volts": units["V"], "unknown": units[""]}))


def _compared(
    envelopes: EmgEnvelopes, maxima: Mapping[str, float], path: Path | None, setup: EmgSetup
) -> ComparedTrial:
    levels = normalised(envelopes, maxima, setup.mvc.window_s) if maxima else None
    if path is None:
        return ComparedTrial(envelopes, levels, None, {}, setup, tuple(_findings(envelopes)))
    activations = read_model_activations(path)
    channels = [label for label in envelopes.labels if label in setup.channels]
    if not channels:
        figures = {
            "configured": ", ".join(setup.channels),
            "trial": envelopes.name,
            "recorded": ", ".join(envelopes.labels),
        }
        raise WrongEmgFiles(Message(EmgCode.NO_COMMON_CHANNEL, figures))
    setup.require_muscles(channels, activations.muscles, path.name)
    plain = ComparedTrial(envelopes, levels, activations, {}, setup)
    comparisons = {}
    for label in channels:
        model = plain.model(label)
        if label in envelopes.usable and model is not None:
            measured = envelopes.time, envelopes.of(label)
            bandwidth, max_lag = setup.envelope.settings().bandwidth, setup.comparison.max_lag_s
            comparisons[label] = compare_shapes(measured, model, bandwidth, max_lag)
    return replace(plain, comparisons=comparisons, findings=tuple(_findings(envelopes, activations)))


def _findings(envelopes: EmgEnvelopes, activations: ModelActivations | None = None) -> Iterator[Message[EmgCode]]:
    """On channels of the set-up that were not read, and on the activations."""
    if envelopes.unread:
        yield Message(EmgCode.UNREAD_CHANNELS, {"channels": ", ".join(envelopes.unread)})
    if activations is None:
        return
    file = activations.file
    if activations.row_counts is not None:
        stated, found = activations.row_counts
        yield Message(EmgCode.ROW_COUNTS, {"file": file, "stated": stated, "found": found})
    (start, end), (model_start, model_end) = envelopes.time[[0, -1]], activations.time[[0, -1]]
    common = min(end, model_end) - max(start, model_start)
    if common < LEAST_COMMON * max(end - start, model_end - model_start):
        ends = {"emg_start_s": start, "emg_end_s": end, "model_start_s": model_start, "model_end_s": model_end}
        figures = {name: float(value) for name, value in (ends | {"common_s": common}).items()}
        yield Message(EmgCode.PARTLY_COMMON, {"file": file, **figures})


def _changes(trials: Sequence[ComparedTrial], reference: Sequence[ComparedTrial]) -> list[ComparedChange]:
    """Changes of the channels that are usable in every repeat."""
    if not trials or not reference:
        return []
    everywhere = set.intersection(*(set(trial.envelopes.usable) for trial in (*trials, *reference)))
    changes = []
    for label in (label for label in trials[0].envelopes.labels if label in everywhere):
        before, after = ([trial.means(trial.envelopes, label) for trial in repeats] for repeats in (reference, trials))
        if min(min(cycles) for cycles in before + after) <= 0:
            continue
        changes.append(ComparedChange(label, emg_change(before, after), _model_ratio(reference, trials, label)))
    return changes


def _model_ratio(reference: Sequence[ComparedTrial], trials: Sequence[ComparedTrial], label: str) -> float | None:
    """Ratio of mean activations; None if one is unknown, or if the muscles are at rest in the reference."""
    before, after = ([trial.model(label) for trial in repeats] for repeats in (reference, trials))
    known = [model[1] for model in before if model is not None], [model[1] for model in after if model is not None]
    if (len(known[0]), len(known[1])) != (len(before), len(after)):
        return None
    if max(float(activation.max()) for activation in known[0]) < LEAST_ACTIVATION:
        return None
    means = [float(np.mean([activation.mean() for activation in part])) for part in known]
    return means[1] / means[0]
