"""Reconnect a lost device, and count every sample that was not received exactly once.

Drivers are opened by name; each is imported when it is first used.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

from drivers.device import CaptureControl, Device, HostClock, Received, Resumable, StreamingDevice
from drivers.errors import DeviceCode, DeviceError, DeviceLost, DeviceMisconfigured
from recordings.samples import DeviceIdentity, Event, Item, Loss, Samples, Stream

TIMEOUT_S = 10.0  # by the given clock; after it the device is lost for good
FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 0.5
CAPTURE_AGREES_S = 2.0  # largest difference between the outage by the device's clock and by the host's: network delays
PROBE_S = 0.05  # a device that is lost again within this time was not reconnected

Seconds = Callable[[], float]
CATALOGUE = {
    "nidaq": "drivers.nidaq:NiDaq",
    "qualisys": "drivers.qualisys:Qualisys",
    "lsl": "drivers.lsl:LslEmg",
    "serial_load_cell": "drivers.serial_load_cell:SerialLoadCell",
}


class ResumableDevice(Device, Resumable, Protocol):
    pass


class Reconnecting:
    """Pass on the items of a device; a loss of connection adds two events and one Loss per stream.

    The event "connection_lost" carries the sentence of the device. "connection_restored" follows on reconnection, then
    the Loss "disconnected" before the next block of a stream. If the sample numbers restart, the event
    "numbering_restarted" replaces the Loss. After timeout_s by the clock `seconds`, read() raises DeviceLost.
    """

    def __init__(
        self,
        device: ResumableDevice,
        host_clock: HostClock,
        timeout_s: float = TIMEOUT_S,
        seconds: Seconds = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.device = device
        self._streaming = device if isinstance(device, StreamingDevice) else None  # the check is slow: once
        self._host_clock = host_clock
        self._timeout_s = timeout_s
        self._seconds = seconds
        self._sleep = sleep
        self._is_open = False
        self._outage: _Outage | None = None
        self._last: dict[str, _Place] = {}
        self._interrupted: set[str] = set()  # streams without a sample since the outage

    @property
    def name(self) -> str:
        return self.device.name

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self.device.streams

    @property
    def identity(self) -> DeviceIdentity:
        return self.device.identity

    @property
    def received(self) -> Received | None:
        return None if self._streaming is None or self._outage is not None else self._streaming.received

    def open(self) -> None:
        self._outage = None
        self._last.clear()
        self._interrupted.clear()
        self.device.open()
        self._is_open = True

    def read(self, timeout_s: float) -> Sequence[Item]:
        if self._outage is not None:
            return self._reconnect(self._outage, timeout_s)
        try:
            return list(self._accounted(self.device.read(timeout_s)))
        except DeviceLost as error:
            if not self._is_open:
                raise
            self._outage = _Outage(str(error), self._seconds(), self._seconds() + FIRST_PAUSE_S)
            self._interrupted = set(self._last)
            return [self._event("connection_lost", f"{error}; reconnecting for up to {self._timeout_s:g} s")]

    def close(self) -> None:
        self._is_open = False
        self._outage = None
        self.device.close()

    def _reconnect(self, outage: _Outage, timeout_s: float) -> list[Item]:
        """One attempt, when it is due."""
        pause_s = outage.next_attempt_s - self._seconds()
        if pause_s > 0:
            self._sleep(min(pause_s, timeout_s))
        if self._seconds() < outage.next_attempt_s:
            return []
        try:
            self.device.resume()
            items = self.device.read(PROBE_S)
        except DeviceError as error:
            self._postpone(outage, error)
            return []
        self._outage = None
        message = f"{self.name} reconnected after {self._seconds() - outage.since_s:.1f} s"
        return [self._event("connection_restored", message), *self._accounted(items)]

    def _postpone(self, outage: _Outage, error: DeviceError) -> None:
        now = self._seconds()
        if now - outage.since_s >= self._timeout_s:
            sentence = f"{outage.sentence}; it could not be reconnected within {self._timeout_s:g} s"
            raise DeviceLost(sentence, DeviceCode.NOT_RECONNECTED) from error
        outage.next_attempt_s = now + outage.pause_s
        outage.pause_s = min(2 * outage.pause_s, LONGEST_PAUSE_S)

    def _accounted(self, items: Sequence[Item]) -> Iterator[Item]:
        """The items, and before the first of an interrupted stream the Loss or event of its gap."""
        for item in items:
            if isinstance(item, Samples | Loss):
                if item.stream in self._interrupted:
                    self._interrupted.discard(item.stream)
                    yield from self._gap(self._last[item.stream], item)
                self._last[item.stream] = _last_place(item)
            yield item

    def _gap(self, last: _Place, item: Samples | Loss) -> list[Item]:
        first = item.first_missing if isinstance(item, Loss) else int(item.sample_numbers[0])
        if first <= last.number:
            text = f"{self.name} restarted the sample numbers of {item.stream}: {first} follows {last.number}"
            return [Event("numbering_restarted", text, item.host_time_ns, self.name)]
        missing, count = last.number + 1, first - last.number - 1
        if not count:
            return []
        return [Loss(item.stream, "disconnected", missing, count, last.device_time_ns, item.host_time_ns)]

    def _event(self, kind: str, text: str) -> Event:
        return Event(kind, text, self._host_clock(), self.name)


class ReconnectingCapture(Reconnecting):
    """Reconnect a device that controls the capture and numbers its frames itself.

    After an outage its clock must have advanced as much as the host's. Otherwise another capture runs, or another
    device answers at the address: the event "capture_replaced" reports it.
    """

    device: ResumableCapture

    def _gap(self, last: _Place, item: Samples | Loss) -> list[Item]:
        first = item.first_missing if isinstance(item, Loss) else int(item.sample_numbers[0])
        device_s = (_start_ns(item) - last.device_time_ns) * 1e-9
        host_s = (item.host_time_ns - last.host_time_ns) * 1e-9
        if first > last.number and (isinstance(item, Loss) or abs(device_s - host_s) < CAPTURE_AGREES_S):
            return super()._gap(last, item)
        text = (
            f"{self.name} reconnected during another capture: frame {first} at {_start_ns(item) * 1e-9:.1f} s came "
            f"{host_s:.1f} s after frame {last.number} at {last.device_time_ns * 1e-9:.1f} s; check that mocap.host "
            "is the address of the right QTM"
        )
        return [Event("capture_replaced", text, item.host_time_ns, self.name)]

    def start_capture(self) -> None:
        self.device.start_capture()

    def stop_capture(self) -> None:
        self.device.stop_capture()


class ResumableCapture(ResumableDevice, CaptureControl, Protocol):
    pass


@dataclass
class _Outage:
    """Seconds by the given clock; sentence is that of the DeviceLost."""

    sentence: str
    since_s: float
    next_attempt_s: float
    pause_s: float = 2 * FIRST_PAUSE_S


@dataclass(frozen=True)
class _Place:
    """The last sample of a stream that was received or counted, and the time of the last that was received."""

    number: int
    device_time_ns: int
    host_time_ns: int


def _last_place(item: Samples | Loss) -> _Place:
    if isinstance(item, Loss):
        return _Place(item.first_missing + item.count - 1, item.last_device_time_ns, item.host_time_ns)
    return _Place(int(item.sample_numbers[-1]), int(item.device_time_ns[-1]), item.host_time_ns)


def _start_ns(item: Samples | Loss) -> int:
    return item.last_device_time_ns if isinstance(item, Loss) else int(item.device_time_ns[0])


def make_device(source: str, *, host_clock: HostClock, seconds: Seconds = time.perf_counter, **options: Any) -> Device:
    """A device, not yet opened, that reconnects when it is lost; the options are those of its class.

    seconds is the clock of the reconnection. Raises DeviceMisconfigured for a source without a driver.
    """
    if source not in CATALOGUE:
        sentence = f'no driver is named "{source}"; choose one of {", ".join(sorted(CATALOGUE))}'
        raise DeviceMisconfigured(sentence, DeviceCode.UNKNOWN_DRIVER)
    module, name = CATALOGUE[source].split(":")
    device = getattr(import_module(module), name)(host_clock=host_clock, **options)
    kind = ReconnectingCapture if isinstance(device, CaptureControl) else Reconnecting
    return kind(device, host_clock, seconds=seconds)
