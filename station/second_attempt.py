"""Walk a measurement plan; record a trial a second time where it was not accepted or cannot be used.

A recording is judged at once, while the cuff is still on. The first one is set aside in the session's journal, as
`station judge --redo` does it, so that every later fit leaves it out for the same reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from drivers.errors import DeviceError
from fitting.protocol_file import read_protocol
from fitting.trial import TrialReading, read_alone
from fitting.usability import why_unusable
from recordings.errors import RecordingError
from station.bench.simulation import SimulationError
from station.bench.trial_recorder import TrialRefused, TrialResult
from station.journal import write_donned, write_verdict
from station.progress import Progress
from station.protocol import TrialSpec

STAGE = "recording trials"
CANNOT_BEGIN = (DeviceError, RecordingError, TrialRefused, SimulationError)


class Attempt(Protocol):
    """Prepare the bench, record one trial and return what became of it. Raises one of CANNOT_BEGIN.

    is_new_donning: the cuff has to be donned first, as it is another one, or has to be donned anew.
    """

    def __call__(self, spec: TrialSpec, *, is_new_donning: bool) -> TrialResult: ...


@dataclass(frozen=True)
class RecordedTrial:
    """One trial of the plan after its last attempt.

    spec      as it was recorded, with the number of its donning
    result    of the last attempt
    reading   of its recording; None where nothing was recorded
    problem   why it cannot be used, empty if it can
    """

    spec: TrialSpec
    result: TrialResult
    reading: TrialReading | None
    problem: str

    @property
    def title(self) -> str:
        return f"{self.spec.cuff or 'load cell'}, {self.spec.test}, repeat {self.spec.repeat}"


def record_plan(
    folder: Path, plan: Sequence[TrialSpec], attempt: Attempt, say: Callable[[str], None], progress: Progress
) -> list[RecordedTrial]:
    """Record every trial of the plan, with a second attempt where the first cannot be used; never stops at a trial.

    The first static trial of a donning is repeated on the cuff donned anew: the cuff may have migrated in the one that
    failed, so migration would stay unknown.
    """
    trials: list[RecordedTrial] = []
    donnings = _Donnings(folder)
    for done, planned in enumerate(plan):
        progress(STAGE, done, len(plan))
        trial = _record(folder, planned, attempt, donnings)
        if trial.problem:
            say(f"{trial.title}: {trial.problem}; it is recorded again")
            trial = _second_attempt(folder, trial, planned, attempt, donnings)
            if trial.problem:
                say(f"{trial.title}: {trial.problem}; it stays missing")
        trials.append(trial)
    progress(STAGE, len(plan), len(plan))
    return trials


class _Donnings:
    """Which donning of its cuff a trial is in, and whether the cuff has to be donned before it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._numbers: dict[str, int] = {}
        self._worn: set[str] = set()
        self._held: set[str] = set()  # cuffs with a usable static trial since they were donned

    def place(self, planned: TrialSpec) -> tuple[TrialSpec, bool]:
        """The trial with its donning, and whether that begins with it."""
        if planned.cuff is None:
            return planned, False
        return replace(planned, donning=str(self._numbers.setdefault(planned.cuff, 1))), planned.cuff not in self._worn

    def take(self, trial: RecordedTrial) -> None:
        """After an attempt. What was not recorded has loaded nothing."""
        cuff = trial.spec.cuff
        if cuff is None or trial.result.path is None:
            return
        self._worn.add(cuff)
        if trial.spec.test == "static" and not trial.problem:
            self._held.add(cuff)
        elif trial.spec.test == "static" and cuff not in self._held:
            self._worn.discard(cuff)
            self._numbers[cuff] += 1
            write_donned(self._folder, cuff)


def _second_attempt(
    folder: Path, first: RecordedTrial, planned: TrialSpec, attempt: Attempt, donnings: _Donnings
) -> RecordedTrial:
    """The first recording is set aside only where another one takes its place."""
    second = _record(folder, planned, attempt, donnings)
    if first.result.path is not None and second.result.path is not None:
        write_verdict(folder, first.result.path.name, "redo", first.problem)
    return second


def _record(folder: Path, planned: TrialSpec, attempt: Attempt, donnings: _Donnings) -> RecordedTrial:
    spec, is_new_donning = donnings.place(planned)
    try:
        result = attempt(spec, is_new_donning=is_new_donning)
    except CANNOT_BEGIN as error:
        result = TrialResult(None, 0, str(error), accepted=False)
    if result.path is None:
        return RecordedTrial(spec, result, None, f"nothing was recorded: {result.sentence}")
    reading = read_alone(result.path, read_protocol(folder))
    problem = why_unusable(reading) if result.accepted else f"not accepted: {result.sentence}"
    trial = RecordedTrial(spec, result, reading, problem)
    donnings.take(trial)
    return trial
