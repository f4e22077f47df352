"""The whole way on simulated devices: 24 trials recorded over real wires, fitted, assessed, reported."""

from __future__ import annotations

import json
from pathlib import Path

from rich.console import Console

from drivers.simulators.settings import PUBLISHED_CUFFS
from station.bench.daemon import Daemon, TrialResult
from station.bench.simulation import SimulatedBench, simulator_settings
from station.clock import RealClock
from station.config import StationConfig, parse_config
from station.exit_code import DONE, LOSSY
from station.fit import fit_session_folder
from station.muscles.assess import assess_cuffs, write_assessment
from station.muscles.assessment_inputs import AssessmentInputs
from station.muscles.compilation import CompilationAhead, compilation_shown
from station.progress import Progress, progress_bars
from station.protocol import TrialSpec, published_plan
from station.report.page import TRUTH_FILE, write_report
from station.tables import assessment_table, cuff_table
from station.whole_file import write_whole

MUSCLE_BOUNDS = {"most_frames": 60, "most_rest_lengths": 16, "draws": 50}
"""At most so much of the bundled motion is solved; the assessment's own verb takes all of it and 200 draws."""


class DemoError(Exception):
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
        "protocol": {"step_masses_kg": [1.53] * 5},
        "bounce": {"mass_kg": 2.5, "marker": "weight"},
        "simulation": {"amplifier": {"delay_s": 0.003, "gain": 1.004}},  # for the bounce to find
    }
    return parse_config(data, "the demo")


def run_demo(folder: Path | None, speed: float, seed: int) -> int:
    """Returns the exit code; the report's path goes to stdout last."""
    folder = folder or _free_folder()
    if any(folder.glob("*.mcap")):
        raise DemoError(f"{folder} holds recordings already, and the demo overwrites none; give another --output")
    talk, data = Console(stderr=True), Console(markup=False)
    with progress_bars(talk) as progress, compilation_shown(progress), CompilationAhead(progress) as ahead:
        results, truth = record_session(folder, demo_config(), speed, seed, progress)
        write_whole(folder / TRUTH_FILE, json.dumps(truth, indent=2) + "\n")
        fitted = fit_session_folder(folder, folder / "cuffs.json", progress)
        inputs = AssessmentInputs(folder / "cuffs.json")
        ahead.wait()
        assessed = assess_cuffs(fitted.cuffs, inputs, **MUSCLE_BOUNDS, progress=progress)
        write_assessment(assessed, folder)
        page = write_report(folder, fitted, progress)
    data.print(cuff_table(fitted.cuffs, truth))
    data.print(assessment_table(assessed.assessment))
    print(page)
    is_whole = all(result.accepted and not result.lost_samples for result in results)
    return DONE if is_whole and not assessed.assessment.unsolved else LOSSY


def record_session(
    folder: Path, config: StationConfig, speed: float, seed: int, progress: Progress
) -> tuple[list[TrialResult], dict[str, dict[str, float]]]:
    """Walks the published plan on a simulated bench; returns what became of each trial, and the cuffs' truth.

    The truth of migration is what the simulated cuff slipped, not what its friction was laid out for.
    """
    plan = list(published_plan(config.cuffs, config.protocol.repeats, has_bounce=config.bounce is not None))
    results: list[TrialResult] = []
    truth: dict[str, dict[str, float]] = {}
    with SimulatedBench(simulator_settings(config), speed, seed) as bench:
        pointed = bench.pointed_at(config)
        for done, spec in enumerate(plan):
            progress("recording trials", done, len(plan))
            _prepare(bench, plan[done - 1] if done else None, spec, config.protocol.pause_s)
            result = Daemon(pointed, RealClock(speed)).record(folder, spec)
            if result.path is None:
                raise DemoError(f"{spec.file_name(spec.repeat)} was not recorded: {result.sentence}")
            results.append(result)
            if spec.cuff is not None:
                slipped = bench.tell({"truth": True})["truth"]["slip_m"]
                truth[spec.cuff] = {**bench.ready["truth"]["cuffs"][spec.cuff], "migration_m": slipped[spec.cuff]}
        progress("recording trials", len(plan), len(plan))
    return results, truth


def _prepare(bench: SimulatedBench, before: TrialSpec | None, spec: TrialSpec, pause_s: float) -> None:
    """What happens at the bench between two trials: another cuff is donned, or the wearer rests between repeats."""
    if spec.cuff is not None and (before is None or before.cuff != spec.cuff):
        bench.tell({"don": spec.cuff})
    elif before is not None and before.repeat != spec.repeat:
        bench.tell({"pause_s": pause_s})
    bench.tell({"trial": {"cuff": spec.cuff, "test": spec.test}})


def _free_folder() -> Path:
    number = 1
    while any((folder := Path("demo" if number == 1 else f"demo-{number}")).glob("*")):
        number += 1
    return folder
