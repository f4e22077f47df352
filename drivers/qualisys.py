"""Markers from Qualisys Track Manager: labelled 3D with residuals, every frame, through qtm_rt over TCP."""

from __future__ import annotations

import asyncio
import re
import threading
from collections import deque
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

from drivers.device import HostClock
from drivers.errors import DeviceError, DeviceLost, DeviceMisconfigured, DeviceUnavailable
from drivers.qualisys_wire import MarkerBlocks, PacketGuard, decode_frame, decode_parameters
from recordings.samples import Event, Item, Loss, Samples, Stream

PROTOCOL_VERSION = "1.25"
CONNECT_TIMEOUT_S = 2.5
COMMAND_TIMEOUT_S = 2.0
CAMERAS_TIMEOUT_S = 8.0  # a new measurement has to connect to the cameras
LEAVE_TIMEOUT_S = 1.5
BLOCK_S = 0.05  # wall; frames that come within it are one block
LONGEST_QUEUE = 60_000  # frames that nobody read: ten minutes at 100 Hz
CAPTURE_NAME = "cuffstation"  # QTM saves a capture that we started under this name, and adds a number


class Qualisys:
    """Streams /markers in mm; sample numbers are QTM's frame numbers, device time is its time stamp.

    wanted_labels must be in QTM; empty, all are delivered. control "start" takes control of QTM, so that a capture can
    be started and stopped from here; QTM saves it in its project when the device closes. Where QTM numbers its frames
    anew (a capture after a preview), an event "numbering_restarted" says so.
    """

    def __init__(
        self,
        *,
        host: str,
        port: int,
        host_clock: HostClock,
        control: Literal["start"] | None = None,
        password: str = "",
        wanted_labels: Sequence[str] = (),
    ) -> None:
        wanted = tuple(dict.fromkeys(wanted_labels))
        self._wishes = _Wishes(f"QTM {host}:{port}", host, port, host_clock, control == "start", password, wanted)
        self._conversation: _Conversation | None = None

    @property
    def name(self) -> str:
        return self._wishes.name

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._conversation.streams if self._conversation else ()

    def open(self) -> None:
        self.close()
        conversation = _Conversation(self._wishes)
        conversation.begin()
        self._conversation = conversation

    def read(self, timeout_s: float) -> Sequence[Item]:
        return self._opened("read").inbox.take(timeout_s)

    def close(self) -> None:
        conversation, self._conversation = self._conversation, None
        if conversation is not None:
            conversation.end()

    def start_capture(self) -> None:
        """Raises DeviceMisconfigured with QTM's words where it refuses."""
        self._opened("start a capture").start_capture()

    def stop_capture(self) -> None:
        """No capture runs after this; nothing happens where none did. Raises as start_capture()."""
        self._opened("stop a capture").stop_capture()

    def _opened(self, what: str) -> _Conversation:
        conversation = self._conversation  # close() may come from the daemon's watchdog meanwhile
        if conversation is None:
            raise DeviceLost(f"{self.name} was asked to {what} and is closed; open it first")
        return conversation


@dataclass(frozen=True)
class _Wishes:
    """What the configuration asks for."""

    name: str
    host: str
    port: int
    host_clock: HostClock
    has_control: bool
    password: str
    labels: tuple[str, ...]


class _Inbox:
    """What came and was not read yet, between the event loop's thread and the reader's; it ends with a sentence."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._items: deque[Item] = deque()
        self._frames = 0
        self._last_time_ns = 0  # of the last frame that was admitted
        self._end: str | None = None

    def put(self, items: Sequence[Item]) -> None:
        with self._changed:
            for item in items:
                self._items.append(self._admitted(item))
            self._changed.notify_all()

    def end(self, sentence: str) -> None:
        with self._changed:
            self._end = self._end or sentence
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[Item]:
        """Everything that waits; waits for it at most timeout_s. Raises DeviceLost after the end, once it is empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._end, timeout_s)
            if not self._items and self._end:
                raise DeviceLost(self._end)
            items = list(self._items)
            self._items.clear()
            self._frames = 0
            return items

    def _admitted(self, item: Item) -> Item:
        """The item, or the loss of it where the queue is full."""
        if not isinstance(item, Samples):
            return item
        count = len(item.sample_numbers)
        if self._frames + count > LONGEST_QUEUE:
            first = int(item.sample_numbers[0])
            return Loss(item.stream, "queue_overflow", first, count, self._last_time_ns, item.host_time_ns)
        self._frames += count
        self._last_time_ns = int(item.device_time_ns[-1])
        return item


class _Conversation:
    """One connection, in a thread with its own event loop. Methods below the line run in that thread."""

    def __init__(self, wishes: _Wishes) -> None:
        self.streams: tuple[Stream, ...] = ()
        self.inbox = _Inbox()
        self._wishes = wishes
        self._name = wishes.name
        self._opened: Future[None] = Future()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=wishes.name, daemon=True)
        self._is_capturing = False
        self._has_captured = False

    def begin(self) -> None:
        """Returns when frames may come. Raises DeviceError."""
        self._thread.start()
        try:
            self._opened.result()
        except DeviceError:
            self._thread.join()
            raise

    def end(self) -> None:
        with suppress(RuntimeError):  # the loop is closed where the conversation ended by itself
            self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join(2 * LEAVE_TIMEOUT_S)

    def start_capture(self) -> None:
        self._command("start a capture", self._connection.start)
        self._is_capturing = self._has_captured = True

    def stop_capture(self) -> None:
        if self._is_capturing:
            self._command("stop the capture", self._connection.stop)

    def _command(self, what: str, command: Callable[[], Coroutine[Any, Any, Any]]) -> None:
        """Has QTM do something, on behalf of another thread."""
        from qtm_rt.protocol import QRTCommandException

        try:
            asyncio.run_coroutine_threadsafe(command(), self._loop).result(2 * COMMAND_TIMEOUT_S)
        except QRTCommandException as error:
            advice = "check QTM's measurement" if self._wishes.has_control else 'set mocap.control = "start"'
            raise DeviceMisconfigured(
                f'{self._name} was asked to {what} and answered "{_words(error)}"; {advice}'
            ) from error
        except (TimeoutError, RuntimeError) as error:  # RuntimeError: the loop has ended
            raise DeviceLost(f"{self._name} was asked to {what} and did not answer; check that QTM runs") from error

    # ------------------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._talk())

    async def _talk(self) -> None:
        self._ending = asyncio.Event()
        self._cameras_are_connected = asyncio.Event()
        self._guard: PacketGuard | None = None
        self._relabelling: asyncio.Task[None] | None = None
        try:
            await self._open()
        except DeviceError as error:
            self._opened.set_exception(error)
        except Exception as error:  # the caller waits for an answer, whatever went wrong
            self._opened.set_exception(DeviceUnavailable(f"{self._name}: {type(error).__name__}: {error}"))
        else:
            self._opened.set_result(None)
            await self._ending.wait()
            await self._leave()
        if self._guard is not None:
            self._guard.close()

    async def _open(self) -> None:
        from qtm_rt.protocol import QRTCommandException

        step = "protocol version"
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                await self._connect()
            if self._wishes.has_control:
                step = "control"
                await self._take_control()
            step = "settings"
            await self._describe()
            step = "frames"
            await self._connection.stream_frames("allframes", ["3dres"], self._on_packet)
        except TimeoutError as error:
            raise DeviceUnavailable(
                f"{self._name} was asked for its {step} and did not answer in time; check that this is QTM's "
                "real-time port (mocap.port, by default 22223)"
            ) from error
        except OSError as error:
            raise DeviceUnavailable(
                f"{self._name}: no QTM answers there ({error.strerror or error}); start QTM, or correct mocap.host "
                "and mocap.port"
            ) from error
        except QRTCommandException as error:
            raise DeviceMisconfigured(
                f'{self._name} was asked for its {step} and answered "{_words(error)}"; {_ADVICE[step]}'
            ) from error

    async def _connect(self) -> None:
        """As qtm_rt.connect() does; that one ignores its time-out, returns None and leaves the socket open."""
        from qtm_rt.protocol import QTMProtocol
        from qtm_rt.qrt import QRTConnection

        client = QTMProtocol(on_event=self._on_event, on_disconnect=self._on_disconnect)
        self._guard = guard = PacketGuard(client, _check, self._on_unreadable)
        await self._loop.create_connection(lambda: guard, self._wishes.host, self._wishes.port)
        await client.set_version(PROTOCOL_VERSION)
        self._connection = QRTConnection(client, timeout=COMMAND_TIMEOUT_S)

    async def _take_control(self) -> None:
        await self._connection.take_control(self._wishes.password)
        if await self._connection.new() == b"Creating new connection":
            with suppress(TimeoutError):  # then QTM refuses to start a capture, and says why
                await asyncio.wait_for(self._cameras_are_connected.wait(), CAMERAS_TIMEOUT_S)

    async def _describe(self) -> None:
        labels, rate_hz = await self._ask_parameters()
        wanted = self._wishes.labels or labels
        missing = [label for label in wanted if label not in labels]
        if missing:
            raise DeviceMisconfigured(
                f"{self._name} has no marker {', '.join(missing)}; it has {', '.join(labels)}; correct the labels in "
                "QTM or the cuff's markers in the configuration"
            )
        self._blocks = MarkerBlocks(wanted, self._name)
        self._blocks.labels = labels
        self.streams = (Stream("/markers", "mm", wanted, rate_hz, self._name),)

    async def _ask_parameters(self) -> tuple[tuple[str, ...], float]:
        try:
            return decode_parameters(await self._connection.get_parameters(["general", "3d"]))
        except ValueError as error:
            raise DeviceMisconfigured(f"{self._name} sent {error}; apply an AIM model to the markers in QTM") from error

    async def _leave(self) -> None:
        """Ends what we began; QTM keeps its capture."""
        from qtm_rt.protocol import QRTCommandException

        if not self._wishes.has_control or not self._connection.has_transport():
            return
        with suppress(TimeoutError, QRTCommandException):
            async with asyncio.timeout(LEAVE_TIMEOUT_S):
                if self._has_captured:
                    await self._save_capture()
                await self._connection.release_control()

    async def _save_capture(self) -> None:
        """Where QTM cannot, it says why on its own screen."""
        from qtm_rt.protocol import QRTCommandException

        with suppress(QRTCommandException):
            if self._is_capturing:
                with suppress(QRTCommandException):  # it has been stopped, and the event is on its way
                    await self._connection.stop()
            while self._is_capturing:
                await asyncio.sleep(0.01)
            await self._connection.save(CAPTURE_NAME)

    def _on_packet(self, packet: Any) -> None:
        frame = decode_frame(packet.data)
        if not self._blocks.has_frames:
            self._loop.call_later(BLOCK_S, self._deliver)
        self._blocks.add(frame, self._wishes.host_clock())

    def _deliver(self) -> None:
        if self.streams:
            self.inbox.put(self._blocks.take())

    def _on_event(self, event: Any) -> None:
        """QRTEvent.EventCaptureStarted becomes "capture_started"; all frames before it are delivered before it."""
        kind = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", event.name.removeprefix("Event")).lower()
        self._deliver()
        self._say(kind, f"{self._name} reports: {kind.replace('_', ' ')}")
        if kind == "connected":
            self._cameras_are_connected.set()
        elif kind in ("capture_started", "capture_stopped"):
            self._is_capturing = kind == "capture_started"
        elif kind == "camera_settings_changed" and self.streams:
            self._blocks.labels = None  # the frames wait until their order is known again
            if self._relabelling is not None:
                self._relabelling.cancel()  # its answer would be of yesterday
            self._relabelling = self._loop.create_task(self._relabel())

    async def _relabel(self) -> None:
        try:
            labels, _ = await self._ask_parameters()
        except Exception as error:
            self.inbox.end(f"{self._name} changed its settings and did not tell its labels again ({error})")
            return
        if set(self.streams[0].labels) - set(labels):
            self._say("labels_lost", f"{self._name} has {', '.join(labels)} only; what it lost is recorded as missing")
        self._blocks.labels = labels
        self._deliver()

    def _on_unreadable(self, what: str) -> None:
        self._say("unreadable_packet", f"{self._name} sent {what}")

    def _say(self, kind: str, text: str) -> None:
        self.inbox.put([Event(kind, text, self._wishes.host_clock(), self._name)])

    def _on_disconnect(self, error: Exception | None) -> None:
        self._deliver()
        why = f" ({error})" if error else ""
        self.inbox.end(f"{self._name} closed the connection{why}; check that QTM runs and its cable is plugged in")


_ADVICE = {
    "protocol version": f"it may have ten clients already, or not speak version {PROTOCOL_VERSION}",
    "control": "correct mocap.password, release control elsewhere, or save and close QTM's measurement",
    "settings": "open a measurement in QTM",
    "frames": "open a measurement in QTM",
}


def _check(kind: int, body: bytes) -> None:
    """Raises ValueError or struct.error for a packet that qtm_rt or this driver could not read."""
    from qtm_rt.packet import QRTEvent, QRTPacket, QRTPacketType, RTEvent

    if QRTPacketType(kind) is QRTPacketType.PacketData:
        QRTPacket(body)
        decode_frame(body)
    elif kind == QRTPacketType.PacketEvent.value:
        QRTEvent(ord(RTEvent.unpack(body)[0]))


def _words(error: Any) -> str:
    """What QTM said."""
    return error.value.decode("utf-8", "replace") if isinstance(error.value, bytes) else str(error.value)
