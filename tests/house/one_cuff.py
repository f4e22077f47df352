"""Record a session of one cuff on simulated devices, fit and report it: `python -m tests.house.one_cuff FOLDER`.

With --sample: record the session that comes with the library.
"""

import os
import sys
from pathlib import Path
from typing import Any

from station.config import parse_config
from station.demo import demo_config, record_session
from station.fit import fit_session_folder
from station.progress import silent
from station.report.page import write_report

SEED = 7


def main(folder: Path, *, is_pinned: bool) -> Path:
    if is_pinned:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    plain = _one_cuff()
    plain["protocol"] = {"repeats": 1, "pause_s": 5, "hold_s": 4.0, "step_masses_kg": [1.53] * 3}
    plain["simulation"] = {"protocol": {"dynamic": {"swing_s": 10.0}}}
    _record(folder, plain)
    write_report(folder, fit_session_folder(folder, folder / "cuffs.json"))
    return folder


def record_sample(folder: Path) -> None:
    """Record the short session that comes with the library (station/library.py), without poses and motions."""
    plain = _one_cuff() | {"body": None}
    plain["protocol"] = {"repeats": 1, "pause_s": 3, "hold_s": 3.5, "step_masses_kg": [3.5] * 2}
    plain["simulation"] |= {"protocol": {"dynamic": {"swing_s": 12.0}}, "bounce": {"bounce_s": 12.0}}
    _record(folder, plain)


def _one_cuff() -> dict[str, Any]:
    plain = demo_config().model_dump()
    return plain | {"cuffs": {"hand": plain["cuffs"]["hand"]}}


def _record(folder: Path, plain: dict[str, Any]) -> None:
    trials, _ = record_session(folder, parse_config(plain, "test"), None, SEED, silent)
    assert not any(trial.problem for trial in trials), [trial.problem for trial in trials]


if __name__ == "__main__":
    if "--sample" in sys.argv:
        record_sample(Path(sys.argv[1]))
    else:
        main(Path(sys.argv[1]), is_pinned="--pinned" in sys.argv)
