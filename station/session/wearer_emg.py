"""EMG of a session's motions beside the model, at the end of the session: emg.json, as `station emg` writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fitting.emg.channels import UnusableEmg
from fitting.errors import UnusableTrial
from recordings.errors import RecordingError
from solver.errors import SolverError
from solver.time_series_table import write_table
from station.checksums import drafted
from station.config import ConfigError
from station.emg.comparison import ComparedEmg, ConditionFiles, compare_emg
from station.emg.emg_json import write_emg
from station.emg.trials import EmgFileError
from station.journal import read_journal
from station.messages.emg_messages import EmgCode
from station.protocol import SUITED
from station.recordings_of_session import motions_in

if TYPE_CHECKING:
    from station.assessment.assess import AssessedSuit

MODEL_FILE = "model_activations.csv"
"""Activations of the model in the assessed motion, with which its EMG is compared."""


def write_wearer_emg(folder: Path, assessed: AssessedSuit | None) -> tuple[str, ...]:
    """Compare the EMG of the motions in the suit with that of the others, and that of the assessed motion with the
    model, which has no activations of the other motions.

    Returns why EMG was not compared; nothing if it was, or if none was recorded.
    """
    redone = read_journal(folder).redone
    motions = motions_in(folder).items()
    found = {path: manifest for path, manifest in motions if manifest.emg is not None and path.name not in redone}
    mvc = [path for path, manifest in found.items() if manifest.condition == "mvc"]
    suited = [path for path, manifest in found.items() if manifest.condition in SUITED]
    suited = [path for path in suited if found[path].condition == "tight"] or suited
    unsuited = [path for path, manifest in found.items() if manifest.condition in (None, "unsuited")]
    condition, reference = (suited, unsuited) if suited else (unsuited, [])
    if not condition:
        return ()
    modelled = _write_activations(folder, assessed)
    try:
        compared = _compare(condition, reference, mvc, modelled)
    except (EmgFileError, UnusableEmg, UnusableTrial, RecordingError, ConfigError, SolverError) as error:
        return (f"EMG was not compared: {error}",)
    used = {trial.activations.file for trial in (*compared.trials, *compared.reference) if trial.activations}
    inputs = {"emg": condition, "reference": reference, "mvc": mvc, "activations": [folder / name for name in used]}
    write_emg(folder, compared, inputs)
    return ()


def _write_activations(folder: Path, assessed: AssessedSuit | None) -> dict[str, Path]:
    """Name of the assessed recording → the file of its activations with a slack cord; empty without a wearer."""
    if assessed is None or assessed.subject is None:
        return {}
    solved = assessed.assessment
    with drafted(folder / MODEL_FILE) as draft:
        write_table(draft, solved.muscles, solved.time, solved.slack)
    return {assessed.subject.motion: folder / MODEL_FILE}


def _compare(
    condition: Sequence[Path], reference: Sequence[Path], mvc: Sequence[Path], modelled: Mapping[str, Path]
) -> ComparedEmg:
    """With the model where it has muscles for a channel."""
    files = [
        ConditionFiles(tuple(paths), tuple(modelled.get(path.name) for path in paths))
        for paths in (condition, reference)
    ]
    try:
        return compare_emg(files[0], files[1], mvc, None)
    except EmgFileError as error:
        if error.code != EmgCode.NO_COMMON_CHANNEL:
            raise
    return compare_emg(ConditionFiles(tuple(condition)), ConditionFiles(tuple(reference)), mvc, None)
