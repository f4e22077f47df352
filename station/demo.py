"""The whole way on simulated devices: 24 trials recorded over real wires, fitted, assessed, reported."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

from rich.console import Console

from drivers.simulators.settings import PUBLISHED_CUFFS
from fitting.result import CuffFit
from solver.motion import MotionError
from solver.suit.suit import SuitError
from station.assessment.assess import AssessedSuit, assess_cuffs, write_assessment
from station.assessment.assessment_inputs import AssessmentInputs, wearable
from station.assessment.compilation import CompilationAhead, compilation_shown
from station.bench.bench_clock import BenchClock
from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench, SimulationError, simulator_settings
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.config import StationConfig, parse_config
from station.errors import StationError
from station.exit_code import DONE, LOSSY
from station.fit import fit_session_folder
from station.progress import Progress, progress_bars
from station.protocol import TrialSpec, published_plan
from station.report.page import MISSING_FILE, TRUTH_FILE, write_report
from station.second_attempt import RecordedTrial, record_plan
from station.tables import assessment_table, cuff_table
from station.whole_file import write_whole

MUSCLE_BOUNDS = {"most_frames": 60, "most_rest_lengths": 16, "draws": 50}
"""At most so much of the bundled motion is solved; the assessment's own verb takes all of it and 200 draws."""


class DemoError(StationError):
    """The demo cannot go on; one sentence."""


def demo_config() -> StationConfig:
    """The bench of the example configuration, its captures started by the station."""
    markers = {
        "anchor_markers": ["anchor_1", "anchor_2", "anchor_3", "anchor_4"],
        "cuff_markers": ["cuff_1"],
        "rope_markers": ["rope_1", "rope_2"],
    }
    data = {
        "cuffs": dict.fromkeys(PUBLISHED_CUFFS, markers),
        "mocap": {"control": "start"},
        "sync": {"stop_edge": "end_of_frame"},  # where the simulated line falls
        "protocol": {"step_masses_kg": [1.53] * 5},
        "bounce": {"mass_kg": 2.5, "marker": "weight"},
        "simulation": {"amplifier": {"delay_s": 0.003, "gain": 1.004}},  # for the bounce to find
    }
    return parse_config(data, "the demo")


def run_demo(folder: Path | None, speed: float | None, seed: int, ahead: CompilationAhead) -> int:
    """Returns the exit code; the report's path goes to stdout last. ahead compiles the solver meanwhile."""
    folder = folder or _free_folder()
    if any(folder.glob("*.mcap")):
        raise DemoError(f"{folder} holds recordings already, and the demo overwrites none; give another --output")
    talk, data = Console(stderr=True), Console(markup=False)
    say = partial(talk.print, markup=False, highlight=False, soft_wrap=True)
    with progress_bars(talk) as progress, compilation_shown(progress):
        ahead.show(progress)
        trials, truth = record_session(folder, demo_config(), speed, seed, progress, say)
        write_whole(folder / TRUTH_FILE, json.dumps(truth, indent=2) + "\n")
        readings = {trial.reading.file: trial.reading for trial in trials if trial.reading}
        fitted = fit_session_folder(folder, folder / "cuffs.json", progress, readings)
        ahead.wait()
        assessed, left_out = assess_what_is_there(folder, fitted.cuffs, progress)
        missing = [f"{trial.title}: {trial.problem}" for trial in trials if trial.problem] + left_out
        if missing:
            write_whole(folder / MISSING_FILE, json.dumps(missing, indent=2, ensure_ascii=False) + "\n")
        page = write_report(folder, fitted, progress)
    data.print(cuff_table(fitted.cuffs, truth))
    if assessed is not None:
        data.print(assessment_table(assessed.assessment))
    for sentence in missing:
        say(f"missing: {sentence}")
    print(page)
    is_whole = not missing and not any(trial.result.lost_samples for trial in trials)
    return DONE if is_whole and assessed is not None and not assessed.assessment.unsolved else LOSSY


def assess_what_is_there(
    folder: Path, cuffs: Mapping[str, CuffFit], progress: Progress
) -> tuple[AssessedSuit | None, list[str]]:
    """assessment.json of the cuffs that can be worn, and sentences on the others. None where there is no arm cuff."""
    worn, left_out = wearable({name: fit.wearable() for name, fit in cuffs.items()})
    missing = [f"not in the assessment: {reason}" for reason in left_out.values()]
    try:
        assessed = assess_cuffs(worn, AssessmentInputs(folder / "cuffs.json"), **MUSCLE_BOUNDS, progress=progress)
    except (SuitError, MotionError) as error:
        return None, [*missing, f"no assessment: {error}"]
    write_assessment(assessed, folder)
    return assessed, missing


def record_session(
    folder: Path,
    config: StationConfig,
    speed: float | None,
    seed: int,
    progress: Progress,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[list[RecordedTrial], dict[str, dict[str, float]]]:
    """Walks the published plan on a simulated bench; returns what became of each trial, and the cuffs' truth.

    The truth of migration is what the simulated cuff slipped, not what its friction was laid out for.
    """
    plan = list(published_plan(config.cuffs, config.protocol.repeats, has_bounce=config.bounce is not None))
    truth: dict[str, dict[str, float]] = {}
    before: TrialSpec | None = None
    with SimulatedBench(simulator_settings(config), speed, seed) as bench:
        pointed = bench.pointed_at(config)

        def attempt(spec: TrialSpec, *, is_new_donning: bool) -> TrialResult:
            nonlocal before
            _prepare(bench, before, spec, config.protocol.pause_s, is_new_donning=is_new_donning)
            before = spec
            with BenchClock(bench.clock_port) as clock:
                result = TrialRecorder(pointed, clock).record(folder, spec)
            if spec.cuff is not None:
                with suppress(SimulationError):  # the bench has ended; what it had recorded counts
                    slipped = bench.tell({"truth": True})["truth"]["slip_m"]
                    truth[spec.cuff] = {**bench.ready["truth"]["cuffs"][spec.cuff], "migration_m": slipped[spec.cuff]}
            return result

        return record_plan(folder, plan, attempt, say, progress), truth


def _prepare(
    bench: SimulatedBench, before: TrialSpec | None, spec: TrialSpec, pause_s: float, *, is_new_donning: bool
) -> None:
    """What happens at the bench between two trials: a cuff is donned, or the wearer rests between repeats."""
    if is_new_donning:
        bench.tell({"don": spec.cuff})
    elif before is not None and before.repeat != spec.repeat:
        bench.tell({"pause_s": pause_s})
    bench.tell({"trial": {"cuff": spec.cuff, "test": spec.test}})


def _free_folder() -> Path:
    number = 1
    while any((folder := Path(SIMULATED_FOLDER, "demo" if number == 1 else f"demo-{number}")).glob("*")):
        number += 1
    return folder
