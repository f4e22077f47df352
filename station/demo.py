"""Session on simulated devices: calibration, 24 trials of cuffs, a pose and two motions of the wearer.

A trial of the plan that is not accepted or cannot be used is recorded a second time. A recording is judged at once,
while the cuff is still worn. The first one is rejected in the session's journal, as by `station judge --redo`, so that
every later fit excludes it for the same reason.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from rich.console import Console

from documents.message import Message, because
from drivers.errors import DeviceError
from drivers.simulators.settings import PUBLISHED_CUFFS
from fitting.errors import UnusableTrial
from fitting.session import find_rejection
from fitting.trial.trial import TrialReading, read_alone, read_protocol
from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.errors import RecordingError
from station.assessment.compilation import CompilationAhead, compilation_shown
from station.bench.bench_clock import BenchClock
from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench, SimulationError, simulator_settings
from station.bench.trial_recorder import TrialRecorder, TrialRefused, TrialResult
from station.checksums import write_whole
from station.config import StationConfig, parse_config
from station.errors import StationError
from station.exit_code import DONE, LOSSY
from station.journal import write_donned, write_verdict
from station.messages.bench_messages import TrialCode
from station.messages.setup_messages import FolderCode
from station.progress import Progress, progress_bars
from station.protocol import BODY_TESTS, TrialSpec, published_plan
from station.report.page import TRUTH_FILE
from station.session.summary import end_session
from station.subject.subject_file import SUBJECT_FILE
from station.tables import assessment_table, cuff_table

MUSCLE_BOUNDS = {"most_frames": 60, "most_rest_lengths": 16}
"""Limits of the assessment in the demo; `station assess` solves all frames."""


SUBJECT = "mass_kg = 75.0\n\n[cord]\nrest_length_m = 0.73\n"
"""subject.toml of the simulated person, whose cord is fixed to rigid cuffs."""
STAGE = "recording trials"
START_ERRORS = (DeviceError, RecordingError, TrialRefused, SimulationError)


class DemoError(StationError):
    """The demo cannot start."""


def demo_config() -> StationConfig:
    """The bench of the example configuration; the station starts the captures."""
    markers = {
        "anchor_markers": ["anchor_1", "anchor_2", "anchor_3", "anchor_4"],
        "cuff_markers": ["cuff_1"],
        "rope_markers": ["rope_1", "rope_2"],
    }
    data = {
        "cuffs": dict.fromkeys(PUBLISHED_CUFFS, markers),
        "mocap": {"control": "start"},
        "sync": {"stop_edge": "end_of_frame"},  # as on the simulated bench
        "protocol": {"step_masses_kg": [1.53] * 5},
        "bounce": {"mass_kg": 2.5, "marker": "weight"},
        "body": {
            "markers": ["ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "gu", "EpL", "EpM"],
            "suit_markers": ["cord_waist", "cord_shoulder", "cord_arm"],
            "arm": ["ac", "EpL"],
            "trunk": ["c7", "t8"],
            "cycles": 2,
            "conditions": ["unsuited", "tight"],
            "is_cord_measured": True,
        },
        "simulation": {"amplifier": {"delay_s": 0.003, "gain": 1.004}},  # to be identified by the bounce
    }
    return parse_config(data, "the demo")


def run_demo(folder: Path | None, speed: float | None, seed: int, ahead: CompilationAhead) -> int:
    """Record, fit and assess a simulated session. The last line on stdout is the path of the report.

    ahead: compilation of the solver in a second process. Returns the exit code.
    """
    folder = folder or _free_folder()
    if any(folder.glob("*.mcap")):
        raise DemoError(Message(FolderCode.DEMO_NOT_EMPTY, {"folder": str(folder)}))
    messages, results = Console(stderr=True), Console(markup=False)
    report = partial(messages.print, markup=False, highlight=False, soft_wrap=True)
    with progress_bars(messages) as progress, compilation_shown(progress, ahead):
        ahead.show(progress)
        trials, truth = record_session(folder, demo_config(), speed, seed, progress, report)
        write_whole(folder / TRUTH_FILE, json.dumps(truth, indent=2) + "\n")
        write_whole(folder / SUBJECT_FILE, SUBJECT)
        readings = {trial.reading.file: trial.reading for trial in trials if trial.reading}
        failed = tuple(f"{trial.title}: {trial.problem}" for trial in trials if trial.problem)
        ended = end_session(folder, progress, readings, failed, ahead.wait, MUSCLE_BOUNDS)
    results.print(cuff_table(ended.fitted.cuffs, truth))
    assessed = ended.assessed
    if assessed is not None:
        results.print(assessment_table(assessed.assessment))
    for sentence in ended.missing:
        report(f"missing: {sentence}")
    print(ended.page)
    is_whole = not ended.missing and not any(trial.result.lost_samples for trial in trials)
    return DONE if is_whole and assessed is not None and not assessed.assessment.unsolved else LOSSY


def record_session(
    folder: Path,
    config: StationConfig,
    speed: float | None,
    seed: int,
    progress: Progress,
    report: Callable[[str], None] = lambda _: None,
) -> tuple[list[RecordedTrial], dict[str, dict[str, float]]]:
    """Record the published plan on a simulated bench. Returns the trials and the true parameters of the cuffs.

    The true migration is the slip of the simulated cuff, not the value that its friction was designed for.
    """
    plan = list(
        published_plan(
            config.cuffs,
            config.protocol.repeats,
            has_bounce=config.bounce is not None,
            conditions=config.body.conditions if config.body else (),
        )
    )
    truth: dict[str, dict[str, float]] = {}
    previous: TrialSpec | None = None
    with SimulatedBench(simulator_settings(config), speed, seed) as bench:
        bench_config = bench.configure(config)

        def attempt(spec: TrialSpec, *, is_new_donning: bool) -> TrialResult:
            nonlocal previous
            _prepare(bench, previous, spec, config.protocol.pause_s, is_new_donning=is_new_donning)
            previous = spec
            with BenchClock(bench.clock_port) as clock:
                result = TrialRecorder(bench_config, clock).record(folder, spec)
            if spec.cuff is not None:
                with suppress(SimulationError):  # the bench has ended; its recordings are used
                    slipped = bench.request({"truth": True})["truth"]["slip_m"]
                    truth[spec.cuff] = {**bench.ready["truth"]["cuffs"][spec.cuff], "migration_m": slipped[spec.cuff]}
            return result

        return record_plan(folder, plan, attempt, report, progress), truth


def _prepare(
    bench: SimulatedBench, previous: TrialSpec | None, spec: TrialSpec, pause_s: float, *, is_new_donning: bool
) -> None:
    """Prepare the next trial: don the cuff, or let the wearer rest between repeats."""
    if is_new_donning:
        bench.request({"don": spec.cuff})
    elif previous is not None and previous.repeat != spec.repeat:
        bench.request({"pause_s": pause_s})
    bench.request({"trial": {"cuff": spec.cuff, "test": spec.test, "condition": spec.condition}})


def _free_folder() -> Path:
    number = 1
    while any((folder := Path(SIMULATED_FOLDER, "demo" if number == 1 else f"demo-{number}")).glob("*")):
        number += 1
    return folder


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
        result = TrialResult(None, 0, (Message(TrialCode.NOT_STARTED, because(error)),), accepted=False)
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
