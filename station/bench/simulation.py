"""The simulated bench: served on the configured ports for any client, or as a child process of the station.

Commands can be typed at it: `ni unplug for_s=2`, a fault, or `hang 2`, a known mass.
"""

from __future__ import annotations

import json
import math
import signal
import socket
import sys
import threading
import tomllib
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from documents.message import Message, because
from station.child import DETACHED, Child
from station.config import StationConfig
from station.end_signals import end_signals
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.setup_messages import SimulationCode
from station.protocol import CUFF_TESTS, TrialSpec
from station.standard_input import read_lines

if TYPE_CHECKING:
    from drivers.simulators.faults import Fault
    from drivers.simulators.world import World

NI_PORT = 31763
"""Default port of NI's gRPC device server."""
QTM_PORT, DISCOVERY_PORT = 22223, 22226
"""Default ports of QTM, TCP and UDP."""
LOOPBACK = ("127.0.0.1", "localhost")
PROBE_TIMEOUT_S, END_TIMEOUT_S = 10.0, 5.0
SWING_MARGIN_S = 6.0
"""Seconds beyond a swing for the guide to detect its begin and its end."""


class SimulationError(StationError):
    """The simulated bench did not start or did not answer."""


class WrongTrial(SimulationError):
    """The command names a trial that the simulated bench does not have."""

    exit_code = WRONG_USAGE


class SimulatedBench:
    """A context manager; the child (simulator_process.py) ends with this process.

    speed None: the simulated world advances as fast as an attached station handles it, and only then. outlives: like a
    real bench, it stays for a trial that is still recorded when this process ends or is killed.
    """

    def __init__(self, settings: dict[str, Any], speed: float | None, seed: int, *, outlives: bool = False) -> None:
        self.ready: dict[str, Any] = {}
        self._settings = {**settings, "speed": speed, "seed": seed}
        self._outlives = outlives
        self._child: Child | None = None

    def __enter__(self) -> SimulatedBench:
        arguments, options = (("outlives",), DETACHED) if self._outlives else ((), {})
        self._child = Child("station.bench.simulator_process", *arguments, **options)
        try:
            self.ready = self.request(self._settings)
        except BaseException:
            self.close()
            raise
        return self

    def request(self, request: dict[str, Any]) -> dict[str, Any]:
        """Send one request and return the answer. Raises SimulationError if it is refused or not answered."""
        child = self._child
        if child is None:
            raise SimulationError(Message(SimulationCode.NOT_RUNNING))
        with suppress(OSError):  # it has ended, and answers nothing
            child.send(request)
        answer = child.receive()
        if answer is None:
            code = child.ensure_ended(END_TIMEOUT_S)
            raise SimulationError(Message(SimulationCode.ENDED, {"exit_code": str(code)}))
        if "error" in answer:
            raise SimulationError(Message(SimulationCode.REFUSED, {"reason": str(answer["error"])}))
        return answer

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the child, by force after END_TIMEOUT_S; one that outlives this process ends by itself."""
        child, self._child = self._child, None
        if child is not None:
            with suppress(OSError):
                child.send({"quit": True})
            if self._outlives and self.ready:
                child.leave()
            else:
                child.ensure_ended(END_TIMEOUT_S)

    @property
    def clock_port(self) -> int:
        """Port of the clock that a BenchClock attaches to."""
        return int(self.ready["ports"]["clock"])

    def configure(self, config: StationConfig) -> StationConfig:
        """The configuration with the addresses of this bench."""
        ports = self.ready["ports"]
        daq = config.daq.model_copy(update={"grpc_target": f"127.0.0.1:{ports['ni']}"})
        mocap = config.mocap.model_copy(update={"host": "127.0.0.1", "port": ports["qtm"]})
        is_lsl = config.emg is not None and config.emg.source == "lsl"
        emg = None if is_lsl else config.emg  # an outlet is on the wall's time, and a simulated bench has none
        return config.model_copy(update={"daq": daq, "mocap": mocap, "emg": emg})


def simulator_settings(config: StationConfig) -> dict[str, Any]:
    """Settings of the simulator from all sections of the configuration; [simulation] overrides the others."""
    daq, cell = config.daq, config.load_cell
    emg = config.emg.daq_channels if config.emg else {}
    derived: dict[str, Any] = {
        "wiring": {
            "device": daq.device,
            "force_channel": daq.force_channel,
            "sync_channel": daq.sync_channel,
            "emg": {name: channel.model_dump() for name, channel in emg.items()},
        },
        "amplifier": {"capacity_kg": cell.capacity_kg, "full_scale_v": cell.full_scale_v},
        "protocol": {"repeats": config.protocol.repeats, "static": {"hold_s": config.protocol.hold_s + 1.0}},
        "serial": {"line_format": cell.line_format},
        "mocap": {"password": config.mocap.password},
    }
    if config.protocol.step_masses_kg:
        derived["protocol"]["static"]["step_masses_kg"] = config.protocol.step_masses_kg
    if config.bounce is not None:
        derived["bounce"] = {"mass_kg": config.bounce.mass_kg, "marker": config.bounce.marker}
    if config.body is not None:
        derived["person"] = {"pose_s": config.body.pose_s + 1.0, "raises": {"cycles": config.body.cycles}}
    return _merge(derived, config.simulation)


def practice_settings(config: StationConfig) -> dict[str, Any]:
    """The same for a bench of the console: the station starts captures, and simulated hands follow the cues."""
    swing_s = config.protocol.swing_s + SWING_MARGIN_S
    settings = _merge({"protocol": {"dynamic": {"swing_s": swing_s}}}, simulator_settings(config))
    return {**settings, "operator": {"capture": "remote", "hands": "led"}}


def serve_until_stopped(
    config: StationConfig,
    speed: float,
    seed: int,
    trial: TrialSpec | None = None,
    *,
    in_turn: bool = False,
    fault_plan: Path | None = None,
) -> None:
    """Serve the devices on the configured ports until Ctrl-C or SIGTERM; stderr shows the trial of every capture.

    Lines on standard input are faults that happen now, and masses to hang on the load cell (execute_commands).

    All captures play this trial, or with in_turn the tests of its cuff; without a trial they play the plan in its
    order. Raises SimulationError if the settings, the fault plan or a port cannot be used.
    """
    from drivers.simulators.faults import read_fault_plan
    from drivers.simulators.settings import settings_from_dict
    from drivers.simulators.simulated_bench import Bench

    stopped = threading.Event()
    for number in end_signals():
        signal.signal(number, lambda *_: stopped.set())
    try:
        ports = {"ports": {"ni": _port(config.daq.grpc_target, NI_PORT), "qtm": config.mocap.port}}
        ports["ports"] |= {"serial": _port(config.load_cell.port, 0), "clock": clock_port(config)}
        if config.mocap.port == QTM_PORT:
            ports["ports"]["discovery"] = DISCOVERY_PORT
        settings = settings_from_dict(_merge(ports, simulator_settings(config)))
        with Bench(settings, speed, seed, read_fault_plan(fault_plan) if fault_plan else ()) as bench:
            world = bench.world
            if trial is not None:
                _select(world, trial)
            _log(f"NI gRPC device server at 127.0.0.1:{bench.ports['ni']} ({config.daq.device})")
            _log(f"QTM real-time server at 127.0.0.1:{bench.ports['qtm']}")
            _log(f"serial indicator at socket://127.0.0.1:{bench.ports['serial']}")
            _log(f"clock at 127.0.0.1:{bench.ports['clock']}, for `station record --speed`")
            _log(
                "stop with Ctrl-C; `hang 2` hangs 2 kg on the load cell, a line such as `ni unplug for_s=2` is a fault"
            )
            execute_commands_in_thread(read_lines(sys.stdin), world, _log)
            _report_captures(world, stopped, in_turn=in_turn and trial is not None)
    except (ValueError, OSError, RuntimeError) as error:
        raise SimulationError(Message(SimulationCode.NOT_POSSIBLE, because(error))) from error


def _select(world: World, trial: TrialSpec) -> None:
    cuff = trial.cuff or world.trial.cuff if trial.test in CUFF_TESTS else None
    try:
        world.select_trial(cuff, trial.test, trial.condition)
    except ValueError as error:
        raise WrongTrial(Message(SimulationCode.NOT_POSSIBLE, because(error))) from error


def _report_captures(world: World, stopped: threading.Event, *, in_turn: bool) -> None:
    """Log the trial of every capture. in_turn: after a capture, select the other test of the cuff."""
    reported, is_over = 0, True
    while not stopped.wait(0.2):
        capture = world.capture
        if capture is None:
            continue
        if capture.number > reported:
            reported, is_over = capture.number, False
            played = capture.trial
            _log(f"capture {reported}: {played.cuff or played.condition or 'no cuff'}, {played.test}")
        elif in_turn and not is_over and world.now() > capture.end:
            is_over = True
            done = CUFF_TESTS.index(capture.trial.test)
            world.select_trial(capture.trial.cuff, CUFF_TESTS[1 - done])


def is_served_by_simulator(config: StationConfig) -> bool:
    """Whether the devices of this configuration are those of a `station simulate` on this machine.

    The clock of the simulator, next to the DAQ's server, reports the ports of its devices.
    """
    target, _, ni_port = (config.daq.grpc_target or "").rpartition(":")
    if target not in LOOPBACK or config.mocap.host not in LOOPBACK:
        return False
    try:
        with socket.create_connection(("127.0.0.1", clock_port(config)), PROBE_TIMEOUT_S) as connection:
            connection.settimeout(PROBE_TIMEOUT_S)
            connection.sendall(b'{"ports": true}\n')
            ports = json.loads(connection.makefile("rb").readline())["ports"]
    except (OSError, OverflowError, ValueError, TypeError, KeyError):
        return False
    return bool(ports.get("ni") == int(ni_port) and ports.get("qtm") == config.mocap.port)


def clock_port(config: StationConfig) -> int:
    """Port of the clock of `station simulate`: the one after the DAQ's server, unless [simulation.ports] sets it."""
    daq_port = _port(config.daq.grpc_target, NI_PORT)
    port = config.simulation.get("ports", {}).get("clock", daq_port + 1 if daq_port else 0)
    if not isinstance(port, int):
        raise SimulationError(Message(SimulationCode.WRONG_PORT, {"port": repr(port)}))
    return port


def _port(address: str | None, default: int) -> int:
    """The TCP port at the end of "host:port" or "socket://host:port"; a serial line of this machine has none."""
    digits = (address or "").rpartition(":")[2]
    return int(digits) if digits.isdigit() else default


def _merge(defaults: dict[str, Any], overrides: dict[str, Any]) -> dict[str, Any]:
    merged = {**defaults, **overrides}
    for key in defaults.keys() & overrides.keys():
        if isinstance(defaults[key], dict) and isinstance(overrides[key], dict):
            merged[key] = _merge(defaults[key], overrides[key])
    return merged


def _log(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def parse_fault(line: str) -> Fault:
    """Device, fault, and keys of a fault plan with their values. Raises ValueError."""
    from drivers.simulators.faults import fault_from_dict

    fields = line.split()
    if len(fields) < 2:
        raise ValueError(
            f"{line.strip()!r} is not a fault, expected a device and its fault, such as `ni unplug for_s=2`, or "
            "`hang 2`"
        )
    device, fault, *keys = fields
    try:
        values = tomllib.loads("\n".join(keys))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(
            f"{' '.join(keys)!r} cannot be parsed, expected keys of a fault plan such as for_s=2"
        ) from error
    return fault_from_dict({**values, "device": device, "fault": fault})


def parse_mass(line: str) -> float:
    """Kilograms after `hang`. Raises ValueError."""
    _, *fields = line.split()
    try:
        mass = float(fields[0]) if len(fields) == 1 else math.nan
    except ValueError:
        mass = math.nan
    if not 0 <= mass < math.inf:
        raise ValueError(
            f"{line.strip()!r} cannot be parsed, expected kilograms: `hang 2`, or `hang 0` for the empty cell"
        )
    return mass


def execute_commands(lines: Iterable[str], world: World, reply: Callable[[str], None]) -> None:
    """Execute every line and reply with one sentence."""
    for line in lines:
        if not line.strip():
            continue
        try:
            reply(_execute(line, world))
        except ValueError as error:
            reply(str(error))


def _execute(line: str, world: World) -> str:
    if line.split(maxsplit=1)[0] == "hang":
        mass = parse_mass(line)
        world.hang(mass)
        return f"{mass:g} kg on the load cell, until the next capture begins"
    fault = parse_fault(line)
    world.faults.inject(fault)
    return f"{fault.fault} of {fault.device} in {fault.at_s:g} s, for {fault.for_s:g} s"


def execute_commands_in_thread(lines: Iterable[str], world: World, reply: Callable[[str], None]) -> None:
    """Execute lines until they end, in a thread."""
    # In the background of a terminal the first read would stop the devices; with the signal ignored it fails instead.
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    threading.Thread(target=execute_commands, args=(lines, world, reply), name="typed commands", daemon=True).start()
