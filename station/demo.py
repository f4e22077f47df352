"""Session on simulated devices: calibration, 24 trials of cuffs, a pose and two motions of the wearer."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from rich.console import Console

from drivers.simulators.settings import PUBLISHED_CUFFS
from station.assessment.compilation import CompilationAhead, compilation_shown
from station.bench.bench_clock import BenchClock
from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench, SimulationError, simulator_settings
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.config import StationConfig, parse_config
from station.errors import StationError
from station.exit_code import DONE, LOSSY
from station.messages.message import Message
from station.messages.setup_codes import FolderCode
from station.progress import Progress, progress_bars
from station.protocol import TrialSpec, published_plan
from station.report.page import TRUTH_FILE
from station.second_attempt import RecordedTrial, record_plan
from station.session.summary import end_session
from station.subject.subject_file import SUBJECT_FILE
from station.tables import assessment_table, cuff_table
from station.whole_file import write_whole

MUSCLE_BOUNDS = {"most_frames": 60, "most_rest_lengths": 16}
"""Limits of the assessment in the demo; `station assess` solves all frames."""


SUBJECT = "mass_kg = 75.0\n\n[cord]\nrest_length_m = 0.73\n"
"""subject.toml of the simulated person, whose cord is fixed to rigid cuffs."""


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
