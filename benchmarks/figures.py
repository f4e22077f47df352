"""Hashes of all figures of a fit and of a muscle-redundancy solution, to show that a change of the code keeps them.

    python -m benchmarks.figures [SESSION ...] [--motion] [--list]

fits simulated donnings with known defects, and the recorded sessions whose folders are given, and prints a SHA-256 over
the repr of every number of cuffs.json, one for each cuff and part. `--motion` adds FLX01 of the public data set beside
the repository. `--list` prints the numbers themselves. Two versions of the code agree where their outputs are equal.
Numbers under a key that ends in `_codes` or `_code` have a separate part, because such keys are added.
"""

import hashlib
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command_line import parse_options
from benchmarks.fitting import session_trials
from fitting.cuffs.cuffs_file import cuffs_json
from fitting.session import fit_session
from fitting.trial.trial import Trial
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.problem import build_redundancy
from solver.redundancy.sequence import solve_redundancy
from station.fit import fit_session_folder
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.diagnosis.test_causes import DEFECTS
from tests.fitting.experiment import Session, Truth, published
from tests.fitting.laws.test_model_class import STRONG
from tests.fitting.pulled_in_space import directions, elbow, pulled
from tests.solver.published import trial as published_trial

CODES = ("_codes", "_code")
CLEAN = Truth(friction=1e9, migration=0.0, duration=14.0, hold=5.0)


def main() -> None:
    options = parse_options(__doc__, paths="*", motion=False, list=False)
    whole = hashlib.sha256()
    for name, numbers in _results(options.paths, with_motion=options.motion):
        for part, lines in numbers.items():
            text = "".join(f"{line}\n" for line in lines)
            if not part.endswith(CODES):
                whole.update(text.encode())
            print(f"{name} {part} {len(lines)} {hashlib.sha256(text.encode()).hexdigest()[:16]}", flush=True)
            if options.list:
                sys.stdout.write(text)
    print(f"all but codes: {whole.hexdigest()}")


def _results(sessions: list[Path], *, with_motion: bool) -> Iterator[tuple[str, dict[str, list[str]]]]:
    for name, trials in _simulated():
        yield name, _numbers(json.loads(cuffs_json(fit_session(trials))))
    for folder in sessions:
        yield folder.name, _numbers(json.loads(cuffs_json(fit_session_folder(folder, None))))
    if with_motion:
        model, kinematics = published_trial("FLX01")
        solution = solve_redundancy(build_redundancy(model, evaluate_motion(model, kinematics), RedundancyOptions()))
        yield "FLX01", {"controls": list(map(repr, np.ravel(solution.controls).tolist()))}


def _simulated() -> Iterator[tuple[str, list[Trial]]]:
    for cause, (law, rig) in DEFECTS.items():
        yield str(cause), session_trials(OddSession(law, rig, 1, CLEAN), 1)
    for name, law in STRONG.items():
        yield name.replace(" ", "_"), session_trials(OddSession(law, Rig(), 1, CLEAN), 2)
    late_and_drifting = replace(CLEAN, lag=25e-3, zero_drift=2 / 60)
    yield "late_and_drifting", session_trials(OddSession(Law(), Rig(), 1, late_and_drifting), 1)
    for cuff in ("waist", "hand", "tube", "elbow"):
        yield cuff, session_trials(Session(published(cuff, hold=4.0, duration=12.0), 2), 2)
    for change in ({"occlusion": 0.3}, {"unloads_at_once": True}, {"force_rate": 20.0}, {"amplitude": 1.0}):
        (name,) = change
        yield name, session_trials(Session(published("tube", hold=4.0, duration=12.0, **change), 2), 2)
    random = np.random.default_rng(1)
    pulls = list(enumerate(directions(30), 1))
    space = elbow(random)
    for name, count in (("five_pulls", 5), ("two_pulls", 2)):
        yield name, [pulled(space, u, test, i, random) for i, u in pulls[:count] for test in ("static", "dynamic")]


def _numbers(document: Mapping[str, Any]) -> dict[str, list[str]]:
    """Part of the document → its numbers in order, each with its path."""
    parts: dict[str, list[str]] = {}
    for cuff, entry in document["cuffs"].items():
        for donning, fit in entry["donnings"].items():
            for key, value in fit.items():
                _collect(parts, f"{cuff}/{donning}/{key}", "", value)
    for key in ("calibration", "rejected"):
        _collect(parts, key, "", document[key])
    return parts


def _collect(parts: dict[str, list[str]], part: str, path: str, value: Any) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            is_code = key.endswith(CODES) and not part.endswith(CODES)
            _collect(parts, f"{part}.{key}" if is_code else part, f"{path}.{key}", inner)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _collect(parts, part, f"{path}.{i}", inner)
    elif not isinstance(value, str):
        parts.setdefault(part, []).append(f"{path} {value!r}")


if __name__ == "__main__":
    main()
