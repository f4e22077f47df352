"""Markers from Qualisys Track Manager: labelled 3D with residuals, every frame, through qtm_rt over TCP.

One connection to QTM opens it, controls captures, receives frames and events, and releases control at the end. An Inbox
is the queue between the thread of the connection and the thread that reads the device.
"""

from __future__ import annotations

import asyncio
import re
import threading
from collections import deque
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal

from drivers.device import HostClock, Received
from drivers.errors import DeviceCode, DeviceError, DeviceLost, DeviceMisconfigured, DeviceUnavailable
from drivers.qualisys_settings import BLOCK_S, CaptureNote, QtmSettings
from drivers.qualisys_wire import (
    BUSY,
    NO_MORE_DATA,
    PROTOCOL_VERSION,
    CameraSystem,
    MarkerBlocks,
    PacketGuard,
    Parameters,
    answer_text,
    busy,
    decode_frame,
    decode_parameters,
    markers_alone,
    missing_markers,
    no_answer,
    no_server,
    refused_command,
    refused_step,
)
from recordings.samples import DeviceIdentity, Event, Item, Loss, Samples, Stream

CONNECT_TIMEOUT_S = 2.5
COMMAND_TIMEOUT_S = 2.0
CAMERAS_TIMEOUT_S = 8.0  # a new measurement has to connect to the cameras
LEAVE_TIMEOUT_S = 1.5
OPENED_TIMEOUT_S = 2 * (CONNECT_TIMEOUT_S + CAMERAS_TIMEOUT_S)  # for a step that ignores its own time-out
QUIET_S = 0.5  # wall; after this silence QTM is polled
LONGEST_QUEUE = 60_000  # unread frames: ten minutes at 100 Hz
CAPTURE_NAME = "cuffstation"  # QTM saves a capture that we started under this name, and adds a number
_PASSING = ("camera_settings_changed", "capture_saved", "trigger")  # events that do not report a state


class Qualisys:
    """Streams /markers in mm; sample numbers are QTM's frame numbers, device time is its time stamp.

    wanted_labels must be in QTM and come first; all others follow. control "start" takes control of QTM, so that this
    driver can start and stop a capture; QTM saves it in its project when the device closes. A capture that a killed
    station left running, according to its note, is stopped and saved at opening; during any other capture, opening is
    refused. The event "numbering_restarted" reports that QTM restarted its frame numbers (a capture after a preview).
    """

    def __init__(  # noqa: PLR0913  (settings of a device, by name)
        self,
        *,
        host: str,
        port: int,
        host_clock: HostClock,
        control: Literal["start"] | None = None,
        password: str = "",
        wanted_labels: Sequence[str] = (),
        capture_note: CaptureNote | None = None,
        timeout_scale: float = 1.0,
        block_s: float = BLOCK_S,
    ) -> None:
        """block_s: wall time over which frames are gathered into a block; shorter for less latency, and more blocks."""
        note, wanted = capture_note or CaptureNote(None, host_clock), tuple(dict.fromkeys(wanted_labels))
        name, has_control = f"QTM {host}:{port}", control == "start"
        self._settings = QtmSettings(
            name, host, port, host_clock, has_control, password, wanted, note, timeout_scale, block_s
        )
        self._connection: QtmConnection | None = None

    @property
    def name(self) -> str:
        return self._settings.name

    @property
    def received(self) -> Received | None:
        return self._connection.received if self._connection else None

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._connection.streams if self._connection else ()

    @property
    def identity(self) -> DeviceIdentity:
        return self._connection.identity if self._connection else DeviceIdentity(self.name, "", None)

    def open(self) -> None:
        self.close()
        self._connect(None)

    def resume(self) -> None:
        past = self._opened("resume")
        past.end(is_lost=True)
        self._connect(past)

    def _connect(self, past: QtmConnection | None) -> None:
        connection = QtmConnection(self._settings, past)
        connection.begin()
        self._connection = connection

    def read(self, timeout_s: float) -> Sequence[Item]:
        return self._opened("read").take(timeout_s)

    def close(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.end()

    def start_capture(self) -> None:
        """Raises DeviceMisconfigured with QTM's reason if it refuses."""
        self._opened("start a capture").start_capture()

    def stop_capture(self) -> None:
        """No capture runs after this; nothing happens where none did. Raises as start_capture()."""
        self._opened("stop a capture").stop_capture()

    def _opened(self, what: str) -> QtmConnection:
        connection = self._connection  # the watchdog may call close() meanwhile
        if connection is None:
            raise DeviceLost(f"{self.name} was asked to {what} and is closed; open it first", DeviceCode.CLOSED)
        return connection


class QtmConnection:
    """One connection in a thread with its own event loop; _run() and the methods below it run in that thread.

    `past` is a lost connection to continue: the streams are the same, and the capture may still run.
    """

    def __init__(self, settings: QtmSettings, past: QtmConnection | None = None) -> None:
        from qtm_rt.protocol import QRTCommandException, QTMProtocol
        from qtm_rt.qrt import QRTConnection

        self._refusal = QRTCommandException
        self.streams: tuple[Stream, ...] = ()
        self.inbox = Inbox(LONGEST_QUEUE)
        self._resumed: tuple[Stream, ...] = past.streams if past else ()
        self._cameras: CameraSystem | None = past._cameras if past else None
        self._settings = settings
        self._name = settings.name
        self.identity = DeviceIdentity(settings.name, "", None)
        self._opened: Future[None] = Future()
        self._loop = asyncio.new_event_loop()
        self._client = QTMProtocol(loop=self._loop, on_event=self._on_event, on_disconnect=self._on_disconnect)
        self._connection = QRTConnection(self._client, timeout=settings.timeout_s(COMMAND_TIMEOUT_S))
        self._guard = PacketGuard(self._client, self._admit, self._on_unreadable, self._on_lost_boundaries)
        self._thread = threading.Thread(target=self._run, name=settings.name, daemon=True)
        self._is_capturing: bool = past is not None and past._is_capturing
        self._has_captured: bool = past is not None and past._has_captured
        self._is_asking_state = False
        self._state: asyncio.Future[str] | None = None  # of the query for it, while the connection opens
        self._is_lost = False

    def begin(self) -> None:
        """Connect; returns when QTM streams frames. Raises DeviceError."""
        self._thread.start()
        try:
            self._opened.result(self._settings.timeout_s(OPENED_TIMEOUT_S))
        except DeviceError:
            self._thread.join(self._settings.timeout_s(LEAVE_TIMEOUT_S))  # resolving a host name may take minutes
            raise
        except TimeoutError as error:
            raise no_answer(self._name, "connection") from error

    def end(self, *, is_lost: bool = False) -> None:
        """Stop and save our capture, release control and disconnect; if is_lost, only close the connection."""
        self._is_lost = is_lost
        with suppress(RuntimeError):  # the loop is closed if the connection has ended already
            self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join(2 * self._settings.timeout_s(LEAVE_TIMEOUT_S))

    @property
    def received(self) -> Received | None:
        return self._guard.received

    def take(self, timeout_s: float) -> list[Item]:
        """All queued items; with a timeout of 0 also the frames of a partial block."""
        if timeout_s <= 0:
            delivered: Future[None] = Future()
            with suppress(RuntimeError, TimeoutError):  # the loop has ended, and delivered what it had
                self._loop.call_soon_threadsafe(self._deliver)
                self._loop.call_soon_threadsafe(delivered.set_result, None)
                delivered.result(self._settings.timeout_s(COMMAND_TIMEOUT_S))
        return self.inbox.take(timeout_s)

    def start_capture(self) -> None:
        self._has_captured = True  # noted when QTM reports the start, which may be before the answer
        try:
            self._command("start a capture", self._connection.start)
        except DeviceMisconfigured:
            self._has_captured = False
            self._settings.note.erase()  # a capture that started meanwhile is not ours
            raise
        self._is_capturing = True

    def stop_capture(self) -> None:
        if self._is_capturing:
            self._command("stop the capture", self._connection.stop)

    def _command(self, what: str, command: Callable[[], Coroutine[Any, Any, Any]]) -> None:
        """Send a command to QTM from another thread and wait for its answer."""
        try:
            timeout_s = 2 * self._settings.timeout_s(COMMAND_TIMEOUT_S)
            asyncio.run_coroutine_threadsafe(command(), self._loop).result(timeout_s)
        except self._refusal as error:
            raise refused_command(self._name, what, error, has_control=self._settings.has_control) from error
        except (TimeoutError, RuntimeError) as error:  # RuntimeError: the loop has ended
            sentence = f"{self._name} was asked to {what} and did not answer; check that QTM runs"
            raise DeviceLost(sentence, DeviceCode.SILENT) from error

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        self._ending = asyncio.Event()
        self._cameras_are_connected = asyncio.Event()
        self._relabelling: asyncio.Task[None] | None = None
        # qtm_rt pairs replies with requests by their order, and that to streamframes comes with the first frame only.
        self._turn = asyncio.Lock()
        try:
            await self._open()
        except DeviceError as error:
            self._opened.set_exception(error)
        except Exception as error:  # the caller waits for an answer, whatever went wrong
            self._opened.set_exception(DeviceUnavailable(f"{self._name}: {type(error).__name__}: {error}"))
        else:
            self._opened.set_result(None)
            watching = self._loop.create_task(self._watch())
            await self._ending.wait()
            watching.cancel()
            if not self._is_lost:
                await self._leave()
        self._guard.close()

    async def _open(self) -> None:
        step = "protocol version"
        try:
            async with asyncio.timeout(self._settings.timeout_s(CONNECT_TIMEOUT_S)):
                await self._connect()
            step = "QTM version"
            self.identity = await self._ask_identity()
            if self._settings.has_control:
                step = "control"
                await self._take_control()
            step = "settings"
            await self._describe()
            step = "frames"
            async with self._turn:
                await self._connection.stream_frames("allframes", ["3dres"], self._on_packet)
            if self._is_capturing:  # the answer is an event; qtm_rt's own get_state() has no time-out
                self._is_asking_state = True
                self._client.send_command("getstate", callback=False)
        except TimeoutError as error:
            raise no_answer(self._name, step) from error
        except OSError as error:
            raise no_server(self._name, error) from error
        except self._refusal as error:
            raise refused_step(self._name, step, error) from error

    async def _connect(self) -> None:
        """Connect without qtm_rt.connect(), which ignores its time-out, returns None and leaves the socket open."""
        await self._loop.create_connection(lambda: self._guard, self._settings.host, self._settings.port)
        await self._client.set_version(PROTOCOL_VERSION)

    async def _ask_identity(self) -> DeviceIdentity:
        """QTM's answer to QTMVersion; a simulated QTM identifies itself in it."""
        try:
            answer = answer_text(await self._connection.qtm_version())
        except self._refusal:
            return DeviceIdentity(self._name, "", None)
        return DeviceIdentity(self._name, answer, "simulat" in answer.lower())

    async def _take_control(self) -> None:
        await self._connection.take_control(self._settings.password)
        if self._resumed:
            return
        state = await self._ask_state()
        if state in BUSY:
            await self._ensure_ours(state)
            self._is_capturing = True
        if self._settings.note.age_s is not None:
            await asyncio.wait_for(self._save_capture(), self._settings.timeout_s(COMMAND_TIMEOUT_S))
        if await self._connection.new() == b"Creating new connection":
            with suppress(TimeoutError):  # QTM then refuses to start a capture and gives the reason
                await asyncio.wait_for(self._cameras_are_connected.wait(), self._settings.timeout_s(CAMERAS_TIMEOUT_S))

    async def _ask_state(self) -> str:
        self._state = self._loop.create_future()
        self._client.send_command("getstate", callback=False)  # the answer is an event
        return await asyncio.wait_for(self._state, self._settings.timeout_s(COMMAND_TIMEOUT_S))

    async def _ensure_ours(self, state: str) -> None:
        """Raises DeviceUnavailable if another user's capture keeps QTM busy; that capture is left alone."""
        note = self._settings.note
        if state == "capture_started" and note.age_s is not None:
            with suppress(TimeoutError, self._refusal):  # QTM has no frame to compare
                rate_hz = (await self._ask_parameters()).rate_hz
                frame = decode_frame((await self._connection.get_current_frame(["3dres"])).data)
                if note.fits((frame.number - 1) / rate_hz):
                    return
        raise busy(self._name, state)

    async def _describe(self) -> None:
        parameters = await self._ask_parameters()
        labels, rate_hz = parameters.labels, parameters.rate_hz
        self._check_cameras(parameters.cameras)
        required = self._resumed[0].labels if self._resumed else self._settings.labels
        missing = [label for label in required if label not in labels]
        if missing and self._resumed:
            self._report_lost_labels(missing)
        elif missing:
            raise missing_markers(self._name, missing, labels)
        kept = required if self._resumed else (*required, *(label for label in labels if label not in required))
        self._blocks = MarkerBlocks(kept, rate_hz, self._name)
        self._blocks.labels = labels
        self.streams = self._resumed or (Stream("/markers", "mm", kept, rate_hz, self._name),)

    def _check_cameras(self, cameras: CameraSystem) -> None:
        """Frames of other cameras are in another frame of reference, however well their capture fits in time."""
        self._cameras = expected = self._cameras or cameras
        if expected.contradicts(cameras):
            self._has_captured = self._is_capturing = False  # what runs there is not ours to end
            found = f"{cameras}, expected {expected}; check that mocap.host is the address of the right QTM"
            self._report("capture_replaced", f"{self._name} reconnected with another camera system: {found}")

    async def _watch(self) -> None:
        """Poll a silent QTM; without an answer the connection is lost."""
        while self._connection.has_transport():
            await asyncio.sleep(QUIET_S / 2)
            if self._loop.time() - self._guard.last_data_s < QUIET_S:
                continue
            try:
                await self._ask_parameters()
            except TimeoutError:
                waited = f"no frame, and no answer within {self._settings.timeout_s(COMMAND_TIMEOUT_S):g} s"
                self._fail(f"is connected and silent: {waited}; check that QTM has not frozen", DeviceCode.SILENT)
            except (self._refusal, DeviceError):  # any answer shows that QTM runs; _on_disconnect reports its end
                continue

    async def _ask_parameters(self) -> Parameters:
        try:
            async with self._turn:
                return decode_parameters(await self._connection.get_parameters(["general", "3d"]))
        except ValueError as error:
            sentence = f"{self._name} sent {error}; apply an AIM model to the markers in QTM"
            raise DeviceMisconfigured(sentence, DeviceCode.UNUSABLE_SETTINGS) from error

    async def _leave(self) -> None:
        """Save our capture and release control."""
        if not self._settings.has_control or not self._connection.has_transport():
            return
        with suppress(TimeoutError, self._refusal):
            async with asyncio.timeout(self._settings.timeout_s(LEAVE_TIMEOUT_S)):
                if self._has_captured:
                    await self._save_capture()
                await self._connection.release_control()

    async def _save_capture(self) -> None:
        """Stop and save our capture. If QTM cannot save it, it shows the reason on its own screen."""
        with suppress(self._refusal):
            if self._is_capturing:
                with suppress(self._refusal):  # it has been stopped, and the event is on its way
                    await self._connection.stop()
            while self._is_capturing:
                await asyncio.sleep(0.01)
            await self._connection.save(CAPTURE_NAME)
        self._settings.note.erase()

    def _on_packet(self, packet: Any) -> None:
        frame = decode_frame(packet.data)
        if not self._blocks.has_frames:
            self._loop.call_later(self._settings.block_s, self._deliver)
        self._blocks.add(frame, self._settings.host_clock())

    def _deliver(self) -> None:
        if self.streams:
            self.inbox.put(self._blocks.take())

    def _on_event(self, event: Any) -> None:
        """QRTEvent.EventCaptureStarted becomes "capture_started"; all frames before it are delivered before it."""
        kind = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", event.name.removeprefix("Event")).lower()
        self._deliver()
        if self._state is not None and kind not in _PASSING:
            answer, self._state = self._state, None
            if not answer.done():
                answer.set_result(kind)
            return
        if self._is_asking_state and kind != "camera_settings_changed":
            self._is_asking_state = False
            if kind == "capture_started":
                return  # it still runs; its start was reported before
            kind = "capture_stopped"
        self._report(kind, f"{self._name} reports: {kind.replace('_', ' ')}")
        if kind == "connected":
            self._cameras_are_connected.set()
        elif kind in ("capture_started", "capture_stopped"):
            self._is_capturing = kind == "capture_started"
            if self._is_capturing and self._has_captured:
                self._settings.note.write()
            if kind == "capture_stopped" and self.streams:
                self._blocks.capture_ended()
        elif kind == "camera_settings_changed" and self.streams:
            self._blocks.forget_labels()
            if self._relabelling is not None:
                self._relabelling.cancel()  # its answer would be out of date
            self._relabelling = self._loop.create_task(self._relabel())

    async def _relabel(self) -> None:
        try:
            labels = (await self._ask_parameters()).labels
        except Exception as error:
            self._fail(f"changed its settings and did not send its labels again ({error})", DeviceCode.UNREADABLE)
            return
        if missing := [label for label in self.streams[0].labels if label not in labels]:
            self._report_lost_labels(missing)
        self._blocks.labels = labels
        self._deliver()

    def _report_lost_labels(self, missing: Sequence[str]) -> None:
        self._report("labels_lost", f"{self._name} no longer has the marker {', '.join(missing)}; recorded as missing")

    def _admit(self, kind: int, body: bytes) -> bytes:
        """The part of a packet that qtm_rt can decode. Raises ValueError or struct.error if there is none."""
        from qtm_rt.packet import QRTEvent, QRTPacketType, RTEvent

        if QRTPacketType(kind) is QRTPacketType.PacketData:
            return markers_alone(body)
        if kind == QRTPacketType.PacketEvent.value:
            QRTEvent(ord(RTEvent.unpack(body)[0]))
        elif kind == NO_MORE_DATA and self._is_capturing:
            self._report("no_more_data", f"{self._name} reports that it sends no frames at present")
        return body

    def _on_unreadable(self, what: str) -> None:
        self._report("unreadable_packet", f"{self._name} sent {what}")

    def _on_lost_boundaries(self, what: str) -> None:
        """Packet boundaries are lost: discard the last frame and end the connection."""
        if self.streams:
            self._blocks.forget_last()
        self._fail(f"sent {what}; the connection cannot be read any further; check mocap.port", DeviceCode.UNREADABLE)

    def _on_disconnect(self, error: Exception | None) -> None:
        why = f" ({error})" if error else ""
        advice = "check that QTM runs and its cable is plugged in"
        self._fail(f"closed the connection{why}; {advice}", DeviceCode.DISCONNECTED)

    def _fail(self, what: str, code: DeviceCode) -> None:
        """End the connection with the reason, after all frames so far."""
        self._deliver()
        self.inbox.end(f"{self._name} {what}", code)
        self._guard.close()

    def _report(self, kind: str, text: str) -> None:
        self.inbox.put([Event(kind, text, self._settings.host_clock(), self._name)])


class Inbox:
    """At most longest_queue samples and events; consecutive blocks beyond that become one Loss.

    end() closes the queue with the error that take() raises once it is empty.
    """

    def __init__(self, longest_queue: int) -> None:
        self._longest_queue = longest_queue
        self._changed = threading.Condition()
        self._items: deque[Item] = deque()
        self._held = 0
        self._last_time_ns = 0  # of the last sample that was admitted
        self._end: tuple[str, DeviceCode] | None = None

    def put(self, items: Sequence[Item]) -> None:
        with self._changed:
            for item in items:
                self._put(item)
            self._changed.notify_all()

    def end(self, sentence: str, code: DeviceCode) -> None:
        """Close the queue with the reason; the first reason is kept."""
        with self._changed:
            self._end = self._end or (sentence, code)
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[Item]:
        """All queued items. Waits at most timeout_s for the first. Raises DeviceLost once closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._end, timeout_s)
            if not self._items and self._end:
                raise DeviceLost(*self._end)
            items = list(self._items)
            self._items.clear()
            self._held = 0
            return items

    def _put(self, item: Item) -> None:
        count = len(item.sample_numbers) if isinstance(item, Samples) else 1
        if self._held + count <= self._longest_queue:
            self._held += count
            self._items.append(item)
            if isinstance(item, Samples):
                self._last_time_ns = int(item.device_time_ns[-1])
        elif not isinstance(item, Event):  # events beyond the limit are dropped
            self._put_loss(item)

    def _put_loss(self, item: Samples | Loss) -> None:
        first, count = (
            (item.first_missing, item.count)
            if isinstance(item, Loss)
            else (int(item.sample_numbers[0]), len(item.sample_numbers))
        )
        last = self._items[-1] if self._items else None
        if isinstance(last, Loss) and last.stream == item.stream and last.first_missing + last.count == first:
            self._items[-1] = replace(last, cause="queue_overflow", count=last.count + count)
        else:
            self._items.append(Loss(item.stream, "queue_overflow", first, count, self._last_time_ns, item.host_time_ns))
