"""Records one trial in a process of its own, spoken to in lines of JSON; `python -m station.session.trial_daemon`.

The first line on standard input says what: {"config": {…}, "folder": "…", "spec": {…}, "clock_port": null, "speed": 1};
the port is that of a simulated bench's clock, the speed the pace of its world. Each further line is a wish:
{"stop": true} (once: cleanly; twice: at once), {"mark": true}. Standard output carries telemetry (twenty lines a
second) and, last, {"result": {…}} or {"refused": "a sentence"}. The console may die, freeze or stop reading: the trial
goes on to the end of its capture, what became of it is in the session's journal, and the process ends.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

from station.bench.bench_clock import BenchClock
from station.bench.session_folder import why_not_here
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.clock import Clock, RealClock
from station.config import StationConfig, parse_config
from station.journal import Recorded, write_recorded
from station.protocol import TrialSpec
from station.session.telemetry import Telemetry

LAST_WORD_S = 2.0
"""Wall seconds that a console which does not read is given for the last line."""


def main() -> NoReturn:
    # Ctrl-C in a terminal reaches the whole group; a trial is ended by its operator, not by the console's end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    request = json.loads(sys.stdin.readline())
    try:
        config, spec = parse_config(request["config"], "the console"), TrialSpec(**request["spec"])
        recorded = _record(config, Path(request["folder"]), spec, request["clock_port"], request["speed"])
        said: dict[str, Any] = {"result": asdict(recorded)}
    except Exception as error:  # whatever it is, the operator must hear of it
        said = {"refused": " ".join(str(error).split()) or type(error).__name__}
    speaker = threading.Thread(target=_say, args=(said,), name="last word", daemon=True)
    speaker.start()
    speaker.join(LAST_WORD_S)
    os._exit(0)  # a frozen device, or a console that does not read, would hold the interpreter's own way out


def _record(
    config: StationConfig, folder: Path, spec: TrialSpec, clock_port: int | None, speed: float | None
) -> Recorded:
    site = None if spec.cuff is None else config.cuff_site(spec.cuff)
    with ExitStack() as stack:
        bench_clock = None if clock_port is None else stack.enter_context(BenchClock(clock_port, speed))
        clock: Clock = bench_clock or RealClock()
        telemetry = stack.enter_context(Telemetry(sys.stdout, site, config.calibration(), folder, bench_clock))
        daemon = TrialRecorder(config, clock, [telemetry], why_not_here=why_not_here)
        threading.Thread(target=_obey, args=(daemon,), name="wishes", daemon=True).start()
        result = daemon.record(folder, spec)
    recorded = _account(spec, result)
    if result.path is not None:
        write_recorded(folder, recorded)
    return recorded


def _account(spec: TrialSpec, result: TrialResult) -> Recorded:
    file = result.path.name if result.path else ""
    return Recorded(
        file,
        spec.cuff,
        spec.test,
        spec.repeat,
        spec.donning,
        result.accepted,
        result.lost_samples,
        result.sentence,
        result.origin,
    )


def _obey(daemon: TrialRecorder) -> None:
    for line in sys.stdin:
        wish = json.loads(line)
        if wish.get("stop"):
            daemon.stop()
        elif wish.get("mark"):
            daemon.mark()


def _say(said: dict[str, Any]) -> None:
    with suppress(OSError):  # the console is gone; the journal has it
        print(json.dumps(said), flush=True)


if __name__ == "__main__":
    main()
