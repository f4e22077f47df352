"""The simulated bench: served on the configuration's ports for any client, or as a child process that goes with us."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from recordings.manifest import TestKind
from station.bench.typed_faults import handle_commands_in_thread
from station.config import StationConfig, parse_config
from station.end_signals import end_signals
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.protocol import CUFF_TESTS

if TYPE_CHECKING:
    from drivers.simulators.world import World

NI_PORT = 31763
"""Where NI's own gRPC device server listens unless told otherwise."""
QTM_PORT, DISCOVERY_PORT = 22223, 22226
"""QTM's own, over TCP and UDP."""
LOOPBACK = ("127.0.0.1", "localhost")
PROBE_TIMEOUT_S = 2.0


SWING_MARGIN_S = 6.0
"""What a page needs beyond a swing to know that it began and that it lasted."""


class SimulationError(StationError):
    """The simulated bench did not start or did not answer; one sentence."""


class WrongTrial(SimulationError):
    """The command names a trial that the simulated bench does not have."""

    exit_code = WRONG_USAGE


class SimulatedBench:
    """A context manager; the child ends with its standard input, so it never outlives this process.

    speed None: the simulated world goes on as fast as an attached station handles it, and only then.
    """

    def __init__(self, settings: dict[str, Any], speed: float | None, seed: int) -> None:
        self.ready: dict[str, Any] = {}
        self._request = {**settings, "speed": speed, "seed": seed}
        self._child: subprocess.Popen[str] | None = None

    def __enter__(self) -> SimulatedBench:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "drivers.simulators"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        try:
            self.ready = self.tell(self._request)
        except BaseException:
            self.close()
            raise
        return self

    def tell(self, request: dict[str, Any]) -> dict[str, Any]:
        """Sends one request and returns the answer. Raises SimulationError if it is refused or nobody answers."""
        child = self._child
        if child is None or child.stdin is None or child.stdout is None:
            raise SimulationError("the simulated bench is not running")
        try:
            child.stdin.write(json.dumps(request) + "\n")
            child.stdin.flush()
        except OSError as error:
            raise SimulationError(f"the simulated bench ended with code {child.poll()}") from error
        line = child.stdout.readline()
        if not line:
            raise SimulationError(f"the simulated bench ended with code {child.wait(5)}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise SimulationError(f"the simulated bench refused: {answer['error']}")
        return answer

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the child by closing its standard input; kills it if it has not gone within 5 s."""
        child, self._child = self._child, None
        if child is None:
            return
        if child.stdin is not None:
            child.stdin.close()
        try:
            child.wait(5)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()

    @property
    def clock_port(self) -> int:
        """Where a BenchClock attaches."""
        return int(self.ready["ports"]["clock"])

    def pointed_at(self, config: StationConfig) -> StationConfig:
        """The configuration with the addresses of this bench in the place of its own."""
        data = config.model_dump(mode="json")
        data["daq"]["grpc_target"] = f"127.0.0.1:{self.ready['ports']['ni']}"
        data["mocap"] |= {"host": "127.0.0.1", "port": self.ready["ports"]["qtm"]}
        return parse_config(data, "the simulated bench")


def simulator_settings(config: StationConfig) -> dict[str, Any]:
    """[simulation] of the configuration, with what follows from its other sections; what [simulation] says wins."""
    daq, cell = config.daq, config.load_cell
    follows: dict[str, Any] = {
        "wiring": {"device": daq.device, "force_channel": daq.force_channel, "sync_channel": daq.sync_channel},
        "amplifier": {"capacity_kg": cell.capacity_kg, "full_scale_v": cell.full_scale_v},
        "protocol": {"repeats": config.protocol.repeats, "static": {"hold_s": config.protocol.hold_s + 1.0}},
        "serial": {"line_format": cell.line_format},
        "mocap": {"password": config.mocap.password},
    }
    if config.protocol.step_masses_kg:
        follows["protocol"]["static"]["step_masses_kg"] = config.protocol.step_masses_kg
    if config.bounce is not None:
        follows["bounce"] = {"mass_kg": config.bounce.mass_kg, "marker": config.bounce.marker}
    return _laid_over(follows, config.simulation)


def practice_settings(config: StationConfig) -> dict[str, Any]:
    """The same for a console's own bench: the station starts the captures, and hands follow the page step by step."""
    swing_s = config.protocol.swing_s + SWING_MARGIN_S
    settings = _laid_over({"protocol": {"dynamic": {"swing_s": swing_s}}}, simulator_settings(config))
    return {**settings, "operator": {"capture": "remote", "hands": "led"}}


def serve_until_stopped(
    config: StationConfig,
    speed: float,
    seed: int,
    *,
    cuff: str | None = None,
    test: TestKind | None = None,
    fault_plan: Path | None = None,
) -> None:
    """Serves the devices on the configuration's ports until Ctrl-C or SIGTERM; says on stderr what each capture plays.

    Lines on standard input are faults that happen now, and masses to hang on the load cell (typed_faults.py).

    test chooses one trial for all captures, instead of the plan in its order; cuff alone its tests, in turn. Raises
    SimulationError where the settings, the fault plan or a port cannot be used.
    """
    from drivers.simulators.bench import Bench
    from drivers.simulators.faults import read_fault_plan
    from drivers.simulators.settings import settings_from_dict

    stopped = threading.Event()
    for number in end_signals():
        signal.signal(number, lambda *_: stopped.set())
    try:
        ports = {"ports": {"ni": _port(config.daq.grpc_target, NI_PORT), "qtm": config.mocap.port}}
        ports["ports"] |= {"serial": _port(config.load_cell.port, 0), "clock": clock_port(config)}
        if config.mocap.port == QTM_PORT:
            ports["ports"]["discovery"] = DISCOVERY_PORT
        settings = settings_from_dict(_laid_over(ports, simulator_settings(config)))
        with Bench(settings, speed, seed, read_fault_plan(fault_plan) if fault_plan else ()) as bench:
            world = bench.world
            _select(world, cuff, test)
            _say(f"NI gRPC device server at 127.0.0.1:{bench.ports['ni']} ({config.daq.device})")
            _say(f"QTM real-time server at 127.0.0.1:{bench.ports['qtm']}")
            _say(f"serial indicator at socket://127.0.0.1:{bench.ports['serial']}")
            _say(f"clock at 127.0.0.1:{bench.ports['clock']}, for `station record --speed`")
            _say(
                "stop with Ctrl-C; `hang 2` hangs 2 kg on the load cell, a line such as `ni unplug for_s=2` is a fault"
            )
            handle_commands_in_thread(sys.stdin, world, _say)
            _tell_captures(world, stopped, in_turn=cuff is not None and test is None)
    except (ValueError, OSError, RuntimeError) as error:
        raise SimulationError(f"the devices cannot be simulated: {error}") from error


def _select(world: World, cuff: str | None, test: TestKind | None) -> None:
    try:
        if test == "bounce":
            world.select_trial(None, test)
        elif cuff is not None or test is not None:
            world.select_trial(cuff or world.trial.cuff, test or CUFF_TESTS[0])
    except ValueError as error:
        raise WrongTrial(f"the devices cannot be simulated: {error}") from error


def _tell_captures(world: World, stopped: threading.Event, *, in_turn: bool) -> None:
    """Says what each capture plays. in_turn: when one is over, the cuff's other test is set up."""
    told, is_over = 0, True
    while not stopped.wait(0.2):
        capture = world.capture
        if capture is None:
            continue
        if capture.number > told:
            told, is_over = capture.number, False
            _say(f"capture {told}: {capture.trial.cuff or 'load cell'}, {capture.trial.test}")
        elif in_turn and not is_over and world.now() > capture.end:
            is_over = True
            done = CUFF_TESTS.index(capture.trial.test)
            world.select_trial(capture.trial.cuff, CUFF_TESTS[1 - done])


def serves_simulated(config: StationConfig) -> bool:
    """Whether the devices of this configuration are those of a `station simulate` on this machine.

    Its clock, beside the DAQ's server, is asked where its devices answer.
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
    """Where `station simulate` serves its clock: beside the DAQ's server, unless [simulation.ports] says otherwise."""
    beside = _port(config.daq.grpc_target, NI_PORT)
    port = config.simulation.get("ports", {}).get("clock", beside + 1 if beside else 0)
    if not isinstance(port, int):
        raise SimulationError(f"simulation.ports.clock is {port!r}, expected a port's number")
    return port


def _port(address: str | None, otherwise: int) -> int:
    """The TCP port at the end of "host:port" or "socket://host:port"; a serial line of this machine has none."""
    digits = (address or "").rpartition(":")[2]
    return int(digits) if digits.isdigit() else otherwise


def _laid_over(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    both = {**below, **above}
    for key in below.keys() & above.keys():
        if isinstance(below[key], dict) and isinstance(above[key], dict):
            both[key] = _laid_over(below[key], above[key])
    return both


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
