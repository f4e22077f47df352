"""QTM's real-time protocol: decode packets, settings and errors, and assemble frames into blocks of /markers.

Settings are the labels, the frame rate, and the cameras that identify QTM. Errors of QTM and of the connection to it
become codes and sentences for the operator.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any
from xml.etree import ElementTree

import numpy as np

from documents.interval import counted
from drivers.device import DeviceClock, Received
from drivers.errors import DeviceCode, DeviceMisconfigured, DeviceUnavailable
from recordings.samples import Event, Item, Loss, Samples

HEADER = struct.Struct("<II")  # size with header, type
FRAME = struct.Struct("<qII")  # microseconds, frame number, components
COMPONENT = struct.Struct("<II")  # size with this header, type
MARKERS = struct.Struct("<IHH")  # count, drop rate, out-of-sync rate
LABELLED_3D_WITH_RESIDUALS = 9
NO_MORE_DATA = 4  # a type of packet
LARGEST_PACKET_BYTES = 4_000_000
FURTHEST_US = 2**53  # 285 years; beyond it nanoseconds leave the recording's 64 bits
PROTOCOL_VERSION = "1.25"
BUSY = {
    "capture_started": "is capturing",
    "waiting_for_trigger": "is waiting for the trigger of a capture",
    "calibration_started": "is being calibrated",
}
"""State in which QTM cannot start a capture → what it is doing."""

_ADVICE = {
    "QTM version": "check QTM",
    "protocol version": f"it may have ten clients already, or not support version {PROTOCOL_VERSION}",
    "control": "correct mocap.password, release control elsewhere, or save and close QTM's measurement",
    "settings": "open a measurement in QTM",
    "frames": "open a measurement in QTM",
}
"""Step of opening a connection → what to do if QTM refuses it."""
LEAST_STEP = 0.9
"""Least ratio of the frames by time stamps to those by frame numbers; below it, the numbers have begun anew."""
STAMP_TOLERANCE = 1.5
"""Frames by which the steps of time stamps and frame numbers may differ within a capture, as in the fit."""


@dataclass(frozen=True)
class MarkerFrame:
    """Frame number and time stamp [µs] of QTM, and little-endian float32 (markers, 4): x, y, z, residual [mm].

    drop_rate and out_of_sync_rate of the cameras' images are those of QTM, in per mille.
    """

    number: int
    timestamp_us: int
    points: bytes
    drop_rate: int
    out_of_sync_rate: int


def decode_frame(body: bytes) -> MarkerFrame:
    """Decode a data packet without its header. Raises ValueError if it lacks a whole set of markers with residuals."""
    try:
        timestamp_us, number, components = FRAME.unpack_from(body)
        if abs(timestamp_us) > FURTHEST_US:
            raise ValueError(f"frame {number} with a time stamp of {timestamp_us} µs")
        place = FRAME.size
        for _ in range(components):
            size, kind = COMPONENT.unpack_from(body, place)
            if kind == LABELLED_3D_WITH_RESIDUALS:
                count, drop_rate, out_of_sync_rate = MARKERS.unpack_from(body, place + COMPONENT.size)
                first = place + COMPONENT.size + MARKERS.size
                points = body[first : first + 16 * count]
                if len(points) != 16 * count:
                    raise ValueError(
                        f"frame {number}, which announces {counted(count, 'marker')} and ends before the last"
                    )
                return MarkerFrame(number, timestamp_us, points, drop_rate, out_of_sync_rate)
            place += max(size, COMPONENT.size)
    except struct.error as error:
        raise ValueError(f"a frame of {len(body)} bytes, which ends within a field") from error
    raise ValueError(f"frame {number} without labelled markers and residuals")


def markers_alone(body: bytes) -> bytes:
    """The data packet with its markers alone: qtm_rt cannot decode all components of newer protocols.

    Raises ValueError as decode_frame().
    """
    frame = decode_frame(body)
    head = FRAME.pack(frame.timestamp_us, frame.number, 1)
    markers = MARKERS.pack(len(frame.points) // 16, frame.drop_rate, frame.out_of_sync_rate)
    size = COMPONENT.size + len(markers) + len(frame.points)
    return head + COMPONENT.pack(size, LABELLED_3D_WITH_RESIDUALS) + markers + frame.points


class PacketGuard(asyncio.Protocol):
    """Filter between the socket and qtm_rt's receiver: it passes on whole packets that the receiver can decode.

    qtm_rt's receiver loops for ever on a length of zero, buffers without limit on a huge one, and fails on an unknown
    type, component or event. admit(type, body) returns the part of the body that the receiver can decode. A packet for
    which it raises ValueError or struct.error is skipped and reported, of several in a row the first only. A length
    outside the limits ends the connection after lost_boundaries(reason), because no later packet can be located.
    last_data_s is the time of the last bytes, by the loop's clock.
    """

    def __init__(
        self,
        receiver: asyncio.Protocol,
        admit: Callable[[int, bytes], bytes],
        report: Callable[[str], None],
        lost_boundaries: Callable[[str], None],
    ) -> None:
        self.last_data_s = 0.0
        self._receiver = receiver
        self._admit = admit
        self._report = report
        self._lost_boundaries = lost_boundaries
        self._unread = bytearray()
        self._was_readable = True
        self._transport: asyncio.BaseTransport | None = None
        self._port = 0
        self._received = 0

    @property
    def received(self) -> Received | None:
        """Bytes whose packets the receiver has handled; None before and after the connection."""
        port, size = self._port, self._received
        return Received(port, size) if port else None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport
        self._port = int(transport.get_extra_info("sockname")[1])
        self._receiver.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        self.last_data_s = asyncio.get_running_loop().time()
        self._unread += data
        place = 0
        while len(self._unread) - place >= HEADER.size:
            size, kind = HEADER.unpack_from(self._unread, place)
            if not HEADER.size <= size <= LARGEST_PACKET_BYTES:
                self._unread.clear()
                limits = f"{HEADER.size} to {LARGEST_PACKET_BYTES}"
                self._lost_boundaries(f"a packet with a length of {size} bytes, expected {limits}")
                self.close()
                return
            if len(self._unread) - place < size:
                break
            self._pass_on(bytes(self._unread[place : place + size]), kind)
            place += size
        del self._unread[:place]
        self._received += len(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._receiver.connection_lost(exc)
        self._port = 0

    def close(self) -> None:
        """Closes the connection at once."""
        if isinstance(self._transport, asyncio.WriteTransport):
            self._transport.abort()

    def _pass_on(self, packet: bytes, kind: int) -> None:
        try:
            body = self._admit(kind, packet[HEADER.size :])
        except (ValueError, struct.error) as error:
            if self._was_readable:
                self._report(f"a packet of type {kind} and {len(packet)} bytes that cannot be read: {error}")
            self._was_readable = False
        else:
            self._was_readable = True
            self._receiver.data_received(HEADER.pack(HEADER.size + len(body), kind) + body)


class MarkerBlocks:
    """Assemble frames into blocks of /markers in the order of the wanted labels, and report missing frames.

    labels is the order of the markers in the frames; while it is None, frames are held back.
    """

    def __init__(self, wanted: Sequence[str], rate_hz: float, source: str) -> None:
        self.labels: tuple[str, ...] | None = None
        self._wanted = tuple(wanted)
        self._frame_us = 1e6 / rate_hz
        self._source = source
        self._waiting: list[MarkerFrame] = []
        self._arrived_ns = 0
        self._last: MarkerFrame | None = None
        self._is_after_capture = False
        self._fits = True
        self._worst_rates = (0, 0)
        self._agreeing = 0  # frames whose time stamp agrees with their number, minus others
        self._clock = DeviceClock()  # of the frame numbers

    @property
    def has_frames(self) -> bool:
        """Whether any wait to be taken."""
        return bool(self._waiting)

    def add(self, frame: MarkerFrame, host_time_ns: int) -> None:
        self._waiting.append(frame)
        self._arrived_ns = host_time_ns

    def forget_labels(self) -> None:
        """The order of the labels has changed: hold frames back until it is known; drop those with an unknown order."""
        if self.labels is None:
            self._waiting.clear()
        self.labels = None

    def forget_last(self) -> None:
        """Discard the latest frame: it was damaged."""
        del self._waiting[-1:]

    def capture_ended(self) -> None:
        """The next frames belong to another capture or a preview with frame numbers of its own."""
        self._is_after_capture = True

    def take(self) -> list[Item]:
        """All frames held back. A jump of the numbers is a Loss; a restart of the numbers is an Event."""
        if self.labels is None:
            return []
        waiting, self._waiting = self._waiting, []
        items: list[Item] = []
        block: list[MarkerFrame] = []
        for frame in waiting:
            if len(frame.points) != 16 * len(self.labels):
                items += self._misfit(frame, len(self.labels))
                continue
            self._fits = True
            items += self._rates(frame)
            notices = [notice for notice in (self._stamp_jump(frame), self._notice(frame)) if notice is not None]
            if notices:
                items += [*self._block(block), *notices]
                block = []
            block.append(frame)
            self._last = frame
            self._clock.add(1e-6 * self._frame_us * frame.number, self._arrived_ns)
        return [*items, *self._block(block)]

    def _rates(self, frame: MarkerFrame) -> list[Item]:
        """Event for a drop rate or out-of-sync rate of QTM higher than before."""
        drop_rate, out_of_sync_rate = self._worst_rates
        self._worst_rates = max(drop_rate, frame.drop_rate), max(out_of_sync_rate, frame.out_of_sync_rate)
        if self._worst_rates == (drop_rate, out_of_sync_rate):
            return []
        text = (
            f"{self._source} reports at frame {frame.number} that {frame.drop_rate / 10:g} % of its cameras' images "
            f"were dropped and {frame.out_of_sync_rate / 10:g} % were out of synchronisation"
        )
        return [Event("images_dropped", text, self._arrived_ns, self._source)]

    def _misfit(self, frame: MarkerFrame, expected: int) -> list[Item]:
        """Event for a frame with another number of markers, once per series; it is counted as missing."""
        did_fit, self._fits = self._fits, False
        found = len(frame.points) // 16
        text = (
            f"{self._source} sent frame {frame.number} with {counted(found, 'marker')}, expected "
            f"{expected}, one for each label"
        )
        return [Event("unreadable_packet", text, self._arrived_ns, self._source)] if did_fit else []

    def _stamp_jump(self, frame: MarkerFrame) -> Item | None:
        """Event for time stamps that jump although the frame numbers go on. Most stamps must agree with the numbers."""
        last = self._last
        if last is None or self._is_after_capture or frame.number <= last.number:
            return None
        jump = (frame.timestamp_us - last.timestamp_us) / self._frame_us - (frame.number - last.number)
        self._agreeing += 1 if abs(jump) <= STAMP_TOLERANCE else -1
        is_fewer = jump < 0 and frame.number > last.number + 1  # the numbers jumped
        if abs(jump) <= STAMP_TOLERANCE or is_fewer or self._agreeing <= 0:
            return None
        text = (
            f"the time stamps of {self._source} jumped by {jump * self._frame_us * 1e-6:+.3f} s at frame {frame.number}"
        )
        return Event("time_stamps_jumped", text, self._arrived_ns, self._source)

    def _notice(self, frame: MarkerFrame) -> Item | None:
        """Loss or event that precedes this frame."""
        last, is_after_capture = self._last, self._is_after_capture
        self._is_after_capture = False
        if last is None or frame.number == last.number + 1:
            return None
        elapsed = (frame.timestamp_us - last.timestamp_us) / self._frame_us
        jumped = frame.number - last.number
        has_passed = self._clock.is_possible(1e-6 * self._frame_us * frame.number, self._arrived_ns)
        has_passed &= elapsed >= LEAST_STEP * jumped
        if is_after_capture or jumped <= 0 or not has_passed:  # no time for so many frames
            self._clock.restart()
            text = f"{self._source} restarted its frame numbers: {frame.number} follows {last.number}"
            return Event("numbering_restarted", text, self._arrived_ns, self._source)
        return Loss(
            stream="/markers",
            cause="skipped",
            first_missing=last.number + 1,
            count=jumped - 1,
            last_device_time_ns=last.timestamp_us * 1000,
            host_time_ns=self._arrived_ns,
        )

    def _block(self, frames: Sequence[MarkerFrame]) -> list[Item]:
        if not frames or self.labels is None:
            return []
        points = np.frombuffer(b"".join(frame.points for frame in frames), dtype="<f4")
        points = points.reshape(len(frames), len(self.labels), 4)
        values = np.full((len(frames), len(self._wanted), 4), np.nan, dtype=np.float32)
        for column, label in enumerate(self._wanted):
            if label in self.labels:
                values[:, column] = points[:, self.labels.index(label)]
        values[np.isnan(values).any(axis=2)] = np.nan
        samples = Samples(
            stream="/markers",
            sample_numbers=np.array([frame.number for frame in frames], dtype=np.uint64),
            device_time_ns=np.array([frame.timestamp_us for frame in frames], dtype=np.int64) * 1000,
            host_time_ns=self._arrived_ns,
            values=values,
        )
        return [samples]


@dataclass(frozen=True)
class CameraSystem:
    """Identity of a camera system: the serial numbers of its cameras, and the time of their calibration.

    Neither changes while a capture runs, but a camera may fail.
    """

    serials: frozenset[str]
    calibrated: str

    def __str__(self) -> str:
        cameras = f"cameras {', '.join(sorted(self.serials))}" if self.serials else "cameras without serial numbers"
        return f"{cameras}, calibrated {self.calibrated or 'at an unknown time'}"

    def contradicts(self, other: CameraSystem) -> bool:
        """Whether the two cannot be one system; what a QTM does not report contradicts nothing."""
        has_other_cameras = bool(self.serials and other.serials) and not self.serials & other.serials
        has_other_calibration = bool(self.calibrated and other.calibrated) and self.calibrated != other.calibrated
        return has_other_cameras or has_other_calibration


@dataclass(frozen=True)
class Parameters:
    """QTM's settings "general" and "3d": labels in the order of the frames, frame rate, cameras."""

    labels: tuple[str, ...]
    rate_hz: float
    cameras: CameraSystem


def decode_parameters(xml: bytes) -> Parameters:
    """Raises ValueError where the XML has no label or no frame rate."""
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314  (expat bounds what entities grow to)
    except ElementTree.ParseError as error:
        raise ValueError(f"settings that are not XML ({error})") from error
    labels = tuple(node.text or "" for node in root.findall("The_3D/Label/Name"))
    rate = root.findtext("General/Frequency")
    if not labels or rate is None:
        raise ValueError("settings without a capture frequency" if labels else "settings without labels")
    rate_hz = float(rate)
    if not 0 < rate_hz < inf:
        raise ValueError(f"settings with a capture frequency of {rate!r}")
    serials = frozenset(node.text.strip() for node in root.findall("General/Camera/Serial") if node.text)
    return Parameters(labels, rate_hz, CameraSystem(serials, (root.findtext("The_3D/CalibrationTime") or "").strip()))


def answer_text(answer: Any) -> str:
    """Text of an answer or a refusal of QTM."""
    value = getattr(answer, "value", answer)
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def no_server(name: str, error: OSError) -> DeviceUnavailable:
    """Nothing listens at QTM's address."""
    reason = error.strerror or error
    return DeviceUnavailable(
        f"{name}: no QTM answers ({reason}); start QTM, or correct mocap.host and mocap.port", DeviceCode.NO_SERVER
    )


def no_answer(name: str, step: str) -> DeviceUnavailable:
    """The port is open, and a step of opening the connection timed out."""
    return DeviceUnavailable(
        f"{name} was asked for its {step} and did not answer in time; check that this is QTM's real-time port "
        "(mocap.port, by default 22223)",
        DeviceCode.NO_ANSWER,
    )


def refused_step(name: str, step: str, answer: Exception) -> DeviceMisconfigured:
    """QTM refused a step of opening the connection."""
    sentence = f'{name} was asked for its {step} and answered "{answer_text(answer)}"; {_ADVICE[step]}'
    return DeviceMisconfigured(sentence, DeviceCode.REFUSED)


def refused_command(name: str, command: str, answer: Exception, *, has_control: bool) -> DeviceMisconfigured:
    """QTM refused a command, such as "start a capture"."""
    advice = "check QTM's measurement" if has_control else 'set mocap.control = "start"'
    sentence = f'{name} was asked to {command} and answered "{answer_text(answer)}"; {advice}'
    return DeviceMisconfigured(sentence, DeviceCode.REFUSED)


def busy(name: str, state: str) -> DeviceUnavailable:
    """A capture or calibration runs that this station did not start."""
    return DeviceUnavailable(
        f"{name} {BUSY[state]}, and this station did not start it; end it in QTM, save it, and try again",
        DeviceCode.CAPTURE_NOT_OURS,
    )


def missing_markers(name: str, missing: Sequence[str], labels: Sequence[str]) -> DeviceMisconfigured:
    """The configuration names markers that QTM does not label."""
    return DeviceMisconfigured(
        f"{name} has no marker {', '.join(missing)}; it has {', '.join(labels)}; correct the labels in QTM or the "
        "markers in the configuration",
        DeviceCode.NO_MARKER,
    )
