"""Record a measurement plan; a trial that is not accepted or cannot be used is recorded a second time.

A recording is judged at once, while the cuff is still worn. The first one is rejected in the session's journal, as by
`station judge --redo`, so that every later fit excludes it for the same reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from drivers.errors import DeviceError
from fitting.errors import UnusableTrial
from fitting.session import find_rejection
from fitting.trial.trial_reader import TrialReading, read_alone, read_protocol
from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.errors import RecordingError
from station.bench.simulation import SimulationError
from station.bench.trial_recorder import TrialRefused, TrialResult
from station.journal import write_donned, write_verdict
from station.messages.codes import TrialCode
from station.messages.message import Message
from station.progress import Progress
from station.protocol import BODY_TESTS, TrialSpec

STAGE = "recording trials"
START_ERRORS = (DeviceError, RecordingError, TrialRefused, SimulationError)


class Attempt(Protocol):
    """Prepare the bench and record one trial. Raises one of START_ERRORS.

    is_new_donning: the cuff is donned first.
    """

    def __call__(self, spec: TrialSpec, *, is_new_donning: bool) -> TrialResult: ...


@dataclass(frozen=True)
class RecordedTrial:
    """One trial of the plan after its last attempt.

    spec      as it was recorded, with the number of its donning
    result    of the last attempt
    reading   of a recording of a cuff or a bounce; None for others, and without a recording
    problem   reason why it cannot be used; empty if it can
    """

    spec: TrialSpec
    result: TrialResult
    reading: TrialReading | None
    problem: str

    @property
    def title(self) -> str:
        subject = self.spec.cuff or self.spec.condition or ("wearer" if self.spec.test in BODY_TESTS else "load cell")
        return f"{subject}, {self.spec.test}, repeat {self.spec.repeat}"


def record_plan(
    folder: Path, plan: Sequence[TrialSpec], attempt: Attempt, report: Callable[[str], None], progress: Progress
) -> list[RecordedTrial]:
    """Record every trial of the plan, with a second attempt if the first cannot be used; no trial ends the plan.

    The first static trial of a donning is repeated on the cuff donned anew: the cuff may have migrated in the one that
    failed, so migration would stay unknown.
    """
    trials: list[RecordedTrial] = []
    donnings = _Donnings(folder)
    for done, planned in enumerate(plan):
        progress(STAGE, done, len(plan))
        trial = _record(folder, planned, attempt, donnings)
        if trial.problem:
            report(f"{trial.title}: {trial.problem}; recording it again")
            trial = _second_attempt(folder, trial, planned, attempt, donnings)
            if trial.problem:
                report(f"{trial.title}: {trial.problem}; the trial is missing")
        trials.append(trial)
    progress(STAGE, len(plan), len(plan))
    return trials


class _Donnings:
    """Number of the current donning of every cuff, and the cuffs that are worn."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._numbers: dict[str, int] = {}
        self._worn: set[str] = set()
        self._held: set[str] = set()  # cuffs with a usable static trial since they were donned

    def place(self, planned: TrialSpec) -> tuple[TrialSpec, bool]:
        """The trial with its donning, and whether the donning starts with it."""
        if planned.cuff is None:
            return planned, False
        return replace(planned, donning=str(self._numbers.setdefault(planned.cuff, 1))), planned.cuff not in self._worn

    def take(self, trial: RecordedTrial) -> None:
        """Update after an attempt; without a recording, the cuff was not loaded."""
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
    """Record again; the first recording is rejected only if there is a second one."""
    second = _record(folder, planned, attempt, donnings)
    if first.result.path is not None and second.result.path is not None:
        write_verdict(folder, first.result.path.name, "redo", first.problem)
    return second


def _record(folder: Path, planned: TrialSpec, attempt: Attempt, donnings: _Donnings) -> RecordedTrial:
    spec, is_new_donning = donnings.place(planned)
    try:
        result = attempt(spec, is_new_donning=is_new_donning)
    except START_ERRORS as error:
        result = TrialResult(None, 0, (Message(TrialCode.NOT_STARTED, {"text": str(error)}),), accepted=False)
    if result.path is None:
        return RecordedTrial(spec, result, None, f"nothing was recorded: {result.sentence}")
    if spec.test in BODY_TESTS:
        return RecordedTrial(spec, result, None, _problem_of_wearer(result))
    reading = read_alone(result.path, read_protocol(folder))
    problem = str(find_rejection(reading) or "") if result.accepted else f"not accepted: {result.sentence}"
    trial = RecordedTrial(spec, result, reading, problem)
    donnings.take(trial)
    return trial


def _problem_of_wearer(result: TrialResult) -> str:
    """Reason why a pose or motion cannot be used; empty if it can."""
    if result.path is None or not result.accepted:
        return f"not accepted: {result.sentence}"
    try:
        read_wearer_trial(result.path)
    except (UnusableTrial, RecordingError) as error:
        return str(error)
    return ""
