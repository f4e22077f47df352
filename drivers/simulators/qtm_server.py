"""QTM's real-time server, protocol 1.25, little endian: serves the World's markers to any client of Qualisys.

Frame 1 of a capture is exposed mocap.phase_s after the edge of the sync line, and timestamps count from that frame.
With a preview, frames flow between captures too; their numbers restart with every capture and every preview.
GetParameters gives the general settings and those of 3D.

Does not imitate: the ports of other versions and byte orders, UDP and OSC, components other than labelled 3D with and
without residuals, the settings of other components and most of those two, changing settings but by a fault, triggers,
transfer of files, calibration, real time from file, delays of QTM's own processing, label changes without an event,
discovery by other computers, more than one QTM.
"""

from __future__ import annotations

import asyncio
import re
import struct
import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from xml.sax.saxutils import escape

from drivers.simulators.marker_frames import COMPONENTS, Camera, QtmFaults
from drivers.simulators.settings import MocapSettings
from drivers.simulators.world import Capture, World

ERROR, COMMAND, XML, NO_MORE_DATA, EVENT = 0, 1, 2, 4, 6
CONNECTED, CLOSED, CAPTURE_STARTED, CAPTURE_STOPPED, SETTINGS_CHANGED, CAPTURE_SAVED = 1, 2, 3, 4, 11, 13
PASSING = (SETTINGS_CHANGED, CAPTURE_SAVED)  # events that do not report a state
VERSIONS = tuple(f"1.{minor}" for minor in range(1, 26))
PARAMETERS = f"QTM_Parameters_Ver_{VERSIONS[-1]}"
MOST_CLIENTS = 10
LONGEST_COMMAND_BYTES = 65_536
GLANCE_S = 0.008  # wall
MASTERS_COMMANDS = ("new", "close", "start", "stop", "save", "event")
MOST_UNSENT_BYTES = 1_000_000  # a client that is further behind slows the world down
QTM_VERSION = "2024.3 (build 17700), simulated"


class QualisysSimulator:
    """The server, on 127.0.0.1 in a separate thread; port 0 takes a free one. start() and stop() work once each."""

    def __init__(self, world: World, *, port: int = 0) -> None:
        self.port = port
        self._server = _Server(world)
        self._thread = threading.Thread(target=self._run, name="QTM simulator", daemon=True)
        self._bound: Future[int] = Future()

    @property
    def streaming_client(self) -> object | None:
        """The first client that takes frames."""
        return next((client for client in tuple(self._server.clients) if client.stream), None)

    @property
    def is_controlled(self) -> bool:
        """Whether a client has taken control."""
        return self._server.master is not None

    def start(self) -> None:
        """Binds and serves. Raises OSError if the port is taken."""
        self._thread.start()
        self.port = self._bound.result()

    def step(self, now: float) -> None:
        """Sends every client the frames and events of up to now [world s]."""
        if not self._server.is_idle:  # as it mostly is: another thread's step takes more than half of the processor
            asyncio.run_coroutine_threadsafe(self._server.step(now), self._server.loop).result()

    def sent(self) -> dict[int, int | None]:
        """Bytes sent so far on each connection, by the client's port; None where the connection was closed."""
        return self._server.sent()

    @property
    def has_pending_reply(self) -> bool:
        """Whether a command while silent, a stop of a capture, or the first frame of a client awaits its answer."""
        server = self._server
        return server.is_silent or server.is_stopping or any(client.awaits_frame for client in tuple(server.clients))

    def find_slow_client(self) -> str | None:
        laggard = self._server.laggard()
        return f"the client of QTM at port {laggard.port}" if laggard else None

    def drop_slow_client(self) -> None:
        if laggard := self._server.laggard():
            self._server.loop.call_soon_threadsafe(laggard.close)

    def stop(self) -> None:
        """Closes every connection."""
        self._server.loop.call_soon_threadsafe(self._server.ending.set)
        self._thread.join()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._server.loop) as runner:
            runner.run(self._server.serve(self.port, self._bound))


class _RefusedError(Exception):
    """QTM's refusal of a command."""


class _Server:
    """QTM: its clients, the master, the measurement, and the stream of frames."""

    def __init__(self, world: World) -> None:
        self.loop = asyncio.new_event_loop()
        self.ending = asyncio.Event()
        self.clients: list[Client] = []
        self.master: Client | None = None
        self.is_stopping = False  # a client requested the end of the capture, which comes at the end of a frame
        self._world = world
        self._mocap = world.settings.mocap
        self._is_connected = world.settings.operator.capture == "auto" or self._mocap.has_preview
        self._is_unsaved = False
        self._state = CONNECTED if self._is_connected else CLOSED
        self._capture: Capture | None = None  # the one that runs
        self._captures = 0
        self._camera: Camera | None = None
        self._trouble = QtmFaults(world.faults, world.labels, self._mocap.rate_hz)
        self._applied_until = 0.0  # world seconds
        self._closed: deque[int] = deque(maxlen=MOST_CLIENTS)  # ports of clients that are gone
        self._port = 0
        self._listener: asyncio.Server | None = None
        self._start_preview(0.0)

    async def serve(self, port: int, bound: Future[int]) -> None:
        try:
            self._listener = await asyncio.start_server(self._serve_client, "127.0.0.1", port)
        except OSError as error:
            bound.set_exception(error)
            return
        self._port = self._listener.sockets[0].getsockname()[1]
        bound.set_result(self._port)
        await self.ending.wait()
        self._hang_up()
        while self.clients:  # each leaves by itself
            await asyncio.sleep(GLANCE_S)

    def _hang_up(self) -> None:
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        for client in self.clients:
            client.close()

    @property
    def is_idle(self) -> bool:
        """Whether a step would change nothing: no client, no faults, and no capture since the last one."""
        if self.clients or self._capture or self._world.faults.of("qtm"):
            return False
        return (capture := self._world.capture) is None or capture.number == self._captures

    async def step(self, now: float) -> None:
        if self.ending.is_set():
            return
        if self._trouble.is_now("restart"):
            self._hang_up()
        elif self._listener is None:
            self._listener = await asyncio.start_server(self._serve_client, "127.0.0.1", self._port)
        before = self._applied_until
        capture = self._world.capture
        if capture is not None and capture.number > self._captures:
            if self._capture is not None:  # it has ended and the next has begun since the last step
                self._send_until(min(self._capture.end, capture.start))
                self._end(self._capture)
            self._send_until(capture.start)
            self._begin(capture)
        if self._capture is None:
            self._send_until(now)
        elif capture is not None:
            self._send_until(min(now, capture.end))
            if now >= capture.end:
                self._end(capture)
        self._send(dict.fromkeys(self._streams(), self._trouble.strays(before, self._applied_until)))

    def sent(self) -> dict[int, int | None]:
        live = {client.port: None if client.is_closed else client.sent for client in tuple(self.clients)}
        return dict.fromkeys(tuple(self._closed)) | live

    @property
    def is_silent(self) -> bool:
        return self._trouble.is_now("silent")

    def laggard(self) -> Client | None:
        return next((client for client in tuple(self.clients) if client.is_behind), None)

    def _send_until(self, until: float) -> None:
        """Sends the frames exposed before until, and announces what changes between them."""
        for moment, what in self._trouble.turns(self._applied_until, until):
            self._send_before(moment)
            self._applied_until = moment
            if what == "settings":
                self._announce(SETTINGS_CHANGED)
            elif self._camera is not None:
                self._camera = self._camera.renumbered()
        self._send_before(until)
        self._applied_until = max(self._applied_until, until)

    def _send_before(self, until: float) -> None:
        streams = self._streams()
        if self._camera and not streams:
            self._camera.skip_before(until)
        elif self._camera and (frames := self._camera.frames_before(until)) is not None:
            packets = self._trouble.packets
            self._send({stream: packets(frames, stream.component, stream.divisor) for stream in streams})

    def _streams(self) -> set[FrameSubscription]:
        return {client.stream for client in self.clients if client.stream}

    def _send(self, packets: dict[FrameSubscription, bytes]) -> None:
        for client in self.clients:
            if client.stream and packets[client.stream]:
                client.awaits_frame = False
                client.send_bytes(packets[client.stream])

    def _begin(self, capture: Capture) -> None:
        self._capture = capture
        self._captures = capture.number
        self._is_connected = True
        self._is_unsaved = self.master is not None  # a person at the PC saves what he started
        early = self._world.faults.of("sync", "early_edge")
        early_s = sum(one.fault.for_s for one in early if one.fault.capture == capture.number)
        self._camera = Camera(self._world, capture.start + self._mocap.phase_s + early_s)
        self._announce(CAPTURE_STARTED)

    def _end(self, capture: Capture) -> None:
        self._capture = None
        self.is_stopping = False
        self._is_connected = not self._is_unsaved
        self._announce(CAPTURE_STOPPED)
        self._start_preview(capture.end)
        if self._camera is None:
            for client in self.clients:
                if client.stream:
                    client.send(NO_MORE_DATA)

    def _start_preview(self, since: float) -> None:
        self._camera = Camera(self._world, since) if self._mocap.has_preview and self._is_connected else None

    def _announce(self, event: int) -> None:
        if event not in PASSING:
            self._state = event
        for client in self.clients:
            if not self._trouble.is_now("silent"):
                client.send(EVENT, bytes([event]))

    async def _serve_client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = Client(writer)
        if len(self.clients) >= MOST_CLIENTS or self._trouble.is_now("full"):
            client.send_text(ERROR, "Connection refused. Max number of clients reached.")
            writer.close()
            return
        if not self.clients:
            self._send_until(self._world.now())  # the frames of the idle time, which no client takes
        self.clients.append(client)
        try:
            with suppress(asyncio.IncompleteReadError, ConnectionError):
                client.send_text(COMMAND, "QTM RT Interface connected")
                while True:
                    size, kind = struct.unpack("<II", await reader.readexactly(8))
                    if not 8 <= size <= LONGEST_COMMAND_BYTES:
                        break
                    body = await reader.readexactly(size - 8)
                    while self._trouble.is_now("silent") and not self.ending.is_set():
                        await asyncio.sleep(GLANCE_S)
                    self._handle_command(client, kind, body.rstrip(b"\0").decode("utf-8", "replace").strip())
        finally:
            self.clients.remove(client)
            self._closed.append(client.port)
            if self.master is client:
                self.master = None
            client.close()

    def _handle_command(self, client: Client, kind: int, text: str) -> None:
        """Answer one command in QTM's wording."""
        word, _, rest = text.partition(" ")
        word = word.lower()
        command = getattr(self, f"_on_{word}", None) if kind == COMMAND and word.isalpha() else None
        try:
            if command is None:
                raise _RefusedError("Parse error")
            if word in MASTERS_COMMANDS and client is not self.master:
                raise _RefusedError("You must be master to issue this command")
            if (answer := command(client, rest.strip())) is not None:
                client.send_text(COMMAND, answer)
        except _RefusedError as refusal:
            client.send_text(ERROR, str(refusal))

    def _on_version(self, _client: Client, version: str) -> str:
        if not version:
            return f"Version is {VERSIONS[-1]}"
        if version not in VERSIONS:
            raise _RefusedError("Version NOT supported")
        return f"Version set to {version}"

    def _on_qtmversion(self, _client: Client, _rest: str) -> str:
        return f"QTM Version is {QTM_VERSION}"

    def _on_byteorder(self, _client: Client, _rest: str) -> str:
        return "Byte order is little endian"

    def _on_getstate(self, client: Client, _rest: str) -> None:
        client.send(EVENT, bytes([self._state]))

    def _on_getparameters(self, client: Client, wanted: str) -> None:
        labels = [label for label, _ in self._trouble.labels(self._applied_until)]
        xml = parameters_xml(wanted.lower().split(), self._mocap, labels)
        if xml is None:
            raise _RefusedError("Parse error")
        client.send_text(XML, xml)

    def _on_streamframes(self, client: Client, wanted: str) -> None:
        """The answer is the first frame, or no-more-data without a stream."""
        client.stream = self._stream(wanted.lower().split())
        client.awaits_frame = client.stream is not None and self._camera is not None
        if client.stream and self._camera is None:
            client.send(NO_MORE_DATA)

    def _on_getcurrentframe(self, client: Client, component: str) -> None:
        frame = self._camera.latest() if self._camera else None
        if component.lower() not in COMPONENTS:
            raise _RefusedError("Parse error")
        if frame is None:
            client.send(NO_MORE_DATA)
        else:
            client.send_bytes(self._trouble.packets(frame, component.lower(), 1))

    def _on_takecontrol(self, client: Client, password: str) -> str:
        if self._mocap.password not in ("", password):  # without a required password, any is accepted
            raise _RefusedError("Wrong or missing password")
        if self.master is client:
            return "You are already master"
        if self.master is not None:
            raise _RefusedError(f"127.0.0.1 ({self.master.port}) is already master")
        self.master = client
        return "You are now master"

    def _on_releasecontrol(self, client: Client, _rest: str) -> str:
        if self.master is not client:
            return "You are already a regular client"
        self.master = None
        return "You are now a regular client"

    def _on_new(self, _client: Client, _rest: str) -> str:
        if self._is_connected:
            return "Already connected"
        if self._is_unsaved:
            raise _RefusedError("The previous measurement has not been saved or closed")
        self._is_connected = True
        self._start_preview(self._world.now())
        self._announce(CONNECTED)
        return "Creating new connection"

    def _on_start(self, _client: Client, _rest: str) -> str:
        if not self._is_connected:
            raise _RefusedError("Not connected. Create connection with new")
        try:
            self._world.start_capture()
        except ValueError as error:
            raise _RefusedError("Measurement is already running") from error
        return "Starting measurement"

    def _on_stop(self, _client: Client, _rest: str) -> str:
        try:
            self._world.stop_capture()
        except ValueError as error:
            raise _RefusedError("No measurement is running") from error
        self.is_stopping = self._capture is not None
        return "Stopping measurement"

    def _on_save(self, _client: Client, _rest: str) -> str:
        if not self._is_unsaved or self._capture:
            raise _RefusedError("No measurement to save")
        self._is_unsaved = False
        self._announce(CAPTURE_SAVED)
        return "Measurement saved"

    def _on_close(self, _client: Client, _rest: str) -> str:
        if not self._is_connected and not self._is_unsaved:
            return "No connection to close"
        answer = "Closing file" if self._is_unsaved else "Closing connection"
        self._is_connected = self._is_unsaved = False
        self._camera = None
        self._announce(CLOSED)
        return answer

    def _on_event(self, _client: Client, _label: str) -> str:
        if not self._capture:
            raise _RefusedError("QTM is not capturing")
        return "Event set"

    def _stream(self, arguments: list[str]) -> FrameSubscription | None:
        """Subscription of a streamframes command; None to stop."""
        if arguments == ["stop"]:
            return None
        pace = re.fullmatch(r"allframes|frequency:(\d+)|frequencydivisor:(\d+)", arguments[0]) if arguments else None
        if pace is None or len(arguments) != 2 or arguments[1] not in COMPONENTS:
            raise _RefusedError("Parse error")
        frequency, divisor = (int(digits) if digits else 0 for digits in pace.groups())
        if frequency:
            divisor = round(self._mocap.rate_hz / frequency)
        return FrameSubscription(arguments[1], max(divisor, 1))


@dataclass(frozen=True)
class FrameSubscription:
    """Subscription of a client: every divisor-th frame of one component."""

    component: str
    divisor: int


class Client:
    """One connection."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.stream: FrameSubscription | None = None
        self.port = int(writer.get_extra_info("peername")[1])
        self.sent = 0  # bytes
        self.is_closed = False
        self.awaits_frame = False
        self._writer = writer

    @property
    def is_behind(self) -> bool:
        return self._writer.transport.get_write_buffer_size() > MOST_UNSENT_BYTES

    def send(self, kind: int, body: bytes = b"") -> None:
        self.send_bytes(struct.pack("<II", 8 + len(body), kind) + body)

    def send_text(self, kind: int, text: str) -> None:
        self.send(kind, text.encode() + b"\0")

    def send_bytes(self, packets: bytes) -> None:
        self.sent += len(packets)
        self._writer.write(packets)

    def close(self) -> None:
        self.is_closed = True
        self._writer.transport.abort()


def parameters_xml(wanted: Sequence[str], mocap: MocapSettings, labels: Sequence[str]) -> str | None:
    """The XML of the settings that are wanted ("general", "3d", "all"); None where none of them is known."""
    names = "".join(f"<Label><Name>{escape(name)}</Name><RGBColor>65280</RGBColor></Label>" for name in labels)
    cameras = "".join(
        f"<Camera><ID>{number}</ID><Serial>{serial}</Serial></Camera>"
        for number, serial in enumerate(mocap.camera_serials, 1)
    )
    blocks = {
        "general": f"<General><Frequency>{mocap.rate_hz:g}</Frequency>{cameras}</General>",
        "3d": f"<The_3D><AxisUpwards>+Z</AxisUpwards><CalibrationTime>{escape(mocap.calibrated)}</CalibrationTime>"
        f"<Labels>{len(labels)}</Labels>{names}</The_3D>",
    }
    chosen = "".join(block for name, block in blocks.items() if name in wanted or "all" in wanted)
    return f"<{PARAMETERS}>{chosen}</{PARAMETERS}>" if chosen else None
