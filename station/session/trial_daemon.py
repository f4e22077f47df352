"""Record one trial in a process of its own, started by TrialProcess.

The first message is the request: {"config": {…}, "folder": "…", "spec": {…}, "clock_port": null, "speed": 1}; the port
is that of a simulated bench's clock, the speed the pace of its world. Every further one is a command: {"stop": true}
(the first ends the trial cleanly, the second at once) or {"mark": true}. The recorder sends telemetry (telemetry.py)
and, last, {"result": {…}} or {"refused": "a sentence", "code": "…"}. If the console ends, freezes or stops
receiving, the trial continues to the end of its capture, its result is written to the session's journal, and the
process ends.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

from drivers.errors import DeviceError
from station.bench.bench_clock import BenchClock
from station.bench.session_folder import check_folder
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.child import ProcessLink, exit_at_once
from station.clock import Clock, RealClock
from station.config import parse_config
from station.errors import StationError
from station.journal import Recorded, write_recorded
from station.live.tap import live_views
from station.protocol import TrialSpec
from station.session.telemetry import Telemetry

RESULT_TIMEOUT_S = 2.0
"""Wall seconds for a console that does not receive to take the result."""


def main(console: ProcessLink) -> NoReturn:
    request = console.receive()
    if request is not None:
        writer = threading.Thread(target=_send, args=(console, _outcome(console, request)), name="result", daemon=True)
        writer.start()
        writer.join(RESULT_TIMEOUT_S)
    exit_at_once(0)  # a frozen device, or a console that does not receive, would block a normal exit


def _outcome(console: ProcessLink, request: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"result": asdict(_record(console, request))}
    except Exception as error:  # every error must reach the operator
        sentence = " ".join(str(error).split()) or type(error).__name__
        return {"refused": sentence, "code": error.code if isinstance(error, StationError | DeviceError) else ""}


def _record(console: ProcessLink, request: dict[str, Any]) -> Recorded:
    config, spec = parse_config(request["config"], "the console"), TrialSpec(**request["spec"])
    folder, clock_port = Path(request["folder"]), request["clock_port"]
    with ExitStack() as stack:
        bench_clock = None if clock_port is None else stack.enter_context(BenchClock(clock_port, request["speed"]))
        clock: Clock = bench_clock or RealClock()
        emg = config.emg.amplifier() if config.emg is not None else None
        view = Telemetry(console.send, config.subject(spec), config.calibration(), folder, bench_clock, emg)
        telemetry = stack.enter_context(view)
        taps = [stack.enter_context(tap) for tap in live_views(config, folder, spec, clock)]
        recorder = TrialRecorder(config, clock, [telemetry, *taps], check_folder=check_folder)
        threading.Thread(target=_execute_commands, args=(console, recorder), name="commands", daemon=True).start()
        result = recorder.record(folder, spec)
    recorded = _recorded(spec, result)
    if result.path is not None:
        write_recorded(folder, recorded)
    return recorded


def _recorded(spec: TrialSpec, result: TrialResult) -> Recorded:
    return Recorded(
        result.path.name if result.path else "",
        spec.cuff,
        spec.test,
        spec.repeat,
        spec.donning,
        result.accepted,
        result.lost_samples,
        result.sentence,
        result.messages,
        result.origin,
        spec.condition,
    )


def _execute_commands(console: ProcessLink, recorder: TrialRecorder) -> None:
    for command in console:
        if command.get("stop"):
            recorder.stop()
        elif command.get("mark"):
            recorder.mark()


def _send(console: ProcessLink, result: dict[str, Any]) -> None:
    with suppress(OSError):  # the console has ended; the journal has the result
        console.send(result)
