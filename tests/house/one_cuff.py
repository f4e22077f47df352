"""Record a session of one cuff on simulated devices, fit and report it: `python -m tests.house.one_cuff FOLDER`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from station.config import parse_config
from station.demo import demo_config, record_session
from station.fit import fit_session_folder
from station.progress import silent
from station.report.page import write_report

SEED = 7


def main(folder: Path, *, is_pinned: bool) -> Path:
    if is_pinned:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    plain = demo_config().model_dump()
    plain["cuffs"] = {"hand": plain["cuffs"]["hand"]}
    plain["protocol"] = {"repeats": 1, "pause_s": 5, "hold_s": 4.0, "step_masses_kg": [1.53] * 3}
    plain["simulation"] = {"protocol": {"dynamic": {"swing_s": 10.0}}}
    trials, _ = record_session(folder, parse_config(plain, "test"), None, SEED, silent)
    assert not any(trial.problem for trial in trials), [trial.problem for trial in trials]
    write_report(folder, fit_session_folder(folder, folder / "cuffs.json"))
    return folder


if __name__ == "__main__":
    main(Path(sys.argv[1]), is_pinned="--pinned" in sys.argv)
