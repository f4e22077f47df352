"""Force from an indicator that streams ASCII lines: FUTEK's USB220 and USB520, through pyserial.

Both stream about ten lines a second without a request and without numbers: a lost line is detected only if part of it
arrives.
"""

from __future__ import annotations

import contextlib
import re
import socket
import time
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Any, Literal

import numpy as np

from drivers.device import HostClock, Received
from drivers.errors import DeviceCode, DeviceLost, DeviceUnavailable, one_line
from recordings.samples import DeviceIdentity, Event, Item, Loss, Samples, Stream

LineFormat = Literal["usb220", "usb520"]

LINES_PER_S = 10.0
LONGEST_LINE = 256  # bytes; an indicator sends no longer line
WAKE_S = 0.02  # duration of one wait for bytes
QUIET_S = 0.5  # five lines; of wall time and by the host's clock, which stops with a simulated world

USB220_LINE = re.compile(rb"([+-]\d{1,9}\.\d{1,9})\s+lbs\r?\n")  # 18 bytes, the value in the first 13
USB520_LINE = re.compile(rb"\s*([+-]?\d{1,9}\.\d{1,9})\s*g\s*\r?\n")
SHOWN = 40  # bytes of a line in a message


def decode_usb220(line: bytes) -> float | None:
    """Pounds-force in one whole line, None if it is garbled."""
    match = USB220_LINE.fullmatch(line)
    return float(match[1]) if match else None


def decode_usb520(line: bytes) -> float | None:
    """Grams-force in one whole line, None if it is garbled."""
    match = USB520_LINE.fullmatch(line)
    return float(match[1]) if match else None


FORMATS: dict[LineFormat, tuple[str, str, str, Callable[[bytes], float | None]]] = {
    "usb220": ("FUTEK USB220", "lbf", "+12.345 lbs", decode_usb220),
    "usb520": ("FUTEK USB520", "g", "12.345 g", decode_usb520),
}
"""Product, unit of its stream, an example of a line, and its decoder."""


class SerialLoadCell:
    """Stream /force in the unit of the line: "lbf" (USB220 writes lbs) or "g", both of force.

    The wire carries no sample number, no time and no identity; the identity is that of the USB adapter, if any.
    Lines are numbered from 0 in the order of arrival, and device time is the host's at arrival. A garbled line takes a
    number and is reported as a Loss("garbled"), the first of consecutive ones also by the event "unreadable_line"; an
    incomplete first line after opening the port is not counted. If no line arrives for QUIET_S, the event "silent"
    reports it once. After a reconnection the numbers jump by ten for each second of the host's clock. port is anything
    pyserial accepts: COM3, /dev/ttyUSB0, socket://host:port.
    """

    def __init__(self, *, port: str, baud_rate: int, line_format: LineFormat, host_clock: HostClock) -> None:
        self._port_name = port
        self._baud_rate = baud_rate
        self._product, self._unit, self._example, self._decode = FORMATS[line_format]
        self._host_clock = host_clock
        self._vendor_errors: tuple[type[Exception], ...] = ()
        self._port: Any = None
        self._tcp_port, self._received = 0, 0
        self._streams: tuple[Stream, ...] = ()
        self._identity = DeviceIdentity(self.name, "", None)

    @property
    def name(self) -> str:
        return f"load cell on {self._port_name}"

    @property
    def received(self) -> Received | None:
        """None on a serial line; the simulated indicator is at the end of a TCP connection."""
        return Received(self._tcp_port, self._received) if self._port is not None and self._tcp_port else None

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._streams

    @property
    def identity(self) -> DeviceIdentity:
        return self._identity

    def open(self) -> None:
        self._open_port()
        self._identity = _identity_of_port(self.name, self._port_name)
        self._next_number = 0
        self._last_time_ns = self._counted_until_ns = self._host_clock()
        source = f"{self._product} on {self._port_name}"
        self._streams = (Stream("/force", self._unit, ("force",), LINES_PER_S, source),)

    def resume(self) -> None:
        self._open_port()
        host_time_ns = self._host_clock()
        if self._next_number:
            self._next_number += max(1, round((host_time_ns - self._counted_until_ns) * 1e-9 * LINES_PER_S))
        self._counted_until_ns = host_time_ns

    def read(self, timeout_s: float) -> Sequence[Item]:
        port = self._port
        if port is None:
            raise DeviceLost(f"{self.name} is closed; open it before reading", DeviceCode.CLOSED)
        deadline_s = time.perf_counter() + timeout_s
        while True:
            try:
                came = port.read(max(1, port.in_waiting))
            except self._vendor_errors as error:
                sentence = f"{self.name} stopped streaming: {one_line(error)}; check its cable"
                raise DeviceLost(sentence, DeviceCode.DISCONNECTED) from error
            self._pending += came
            self._received += len(came)
            if items := self._items(self._whole_lines()) or self._silence():
                return items
            if time.perf_counter() >= deadline_s:
                return []

    def close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(*self._vendor_errors):  # a lost port cannot be closed
                port.close()

    def _open_port(self) -> None:
        import serial

        self.close()
        # pyserial also raises these; TypeError when the port is closed during a read.
        self._vendor_errors = (serial.SerialException, OSError, ValueError, TypeError)
        try:
            self._port = serial.serial_for_url(
                # exclusive: two readers would share the lines between them
                self._port_name,
                baudrate=self._baud_rate,
                timeout=WAKE_S,
                exclusive=True,
            )
        except self._vendor_errors as error:
            raise DeviceUnavailable(
                f"{self.name} cannot be opened at {self._baud_rate} baud: {one_line(error)}; "
                "plug the indicator in, or correct load_cell.port",
                DeviceCode.NOT_FOUND,
            ) from error
        self._tcp_port = _tcp_port(self._port)
        self._received = 0
        self._pending = b""
        self._is_aligned = False
        self._is_readable = True
        self._note_line()

    def _whole_lines(self) -> list[bytes]:
        """Remove the complete lines from the received bytes."""
        *lines, self._pending = self._pending.split(b"\n")
        if len(self._pending) > LONGEST_LINE:
            lines, self._pending = [*lines, self._pending], b""
        if lines:
            self._note_line()
        if lines and not self._is_aligned:
            lines, self._is_aligned = lines[1:], True
        return [line + b"\n" for line in lines]

    def _note_line(self) -> None:
        self._heard_s, self._heard_ns, self._is_quiet = time.perf_counter(), self._host_clock(), False

    def _silence(self) -> list[Item]:
        """Event for a silent line."""
        quiet_s = min(time.perf_counter() - self._heard_s, (self._host_clock() - self._heard_ns) * 1e-9)
        if self._is_quiet or quiet_s < QUIET_S:
            return []
        self._is_quiet = True
        text = f"{self.name} has sent no line for {quiet_s:.1f} s, expected {LINES_PER_S:g} a second; check its supply"
        return [Event("silent", text, self._host_clock(), self.name)]

    def _items(self, lines: list[bytes]) -> list[Item]:
        """Consecutive good lines as a block, consecutive garbled ones as a Loss, in the order of arrival."""
        host_time_ns = self._host_clock()
        items: list[Item] = []
        decoded = list(zip(lines, map(self._decode, lines), strict=True))
        for is_garbled, run in groupby(decoded, key=lambda pair: pair[1] is None):
            pairs = list(run)
            first, self._next_number = self._next_number, self._next_number + len(pairs)
            self._counted_until_ns = host_time_ns
            if is_garbled:
                items += self._unreadable(pairs[0][0], host_time_ns)
                items.append(Loss("/force", "garbled", first, len(pairs), self._last_time_ns, host_time_ns))
                continue
            self._is_readable = True
            values = np.array([value for _, value in pairs], dtype=np.float64)[:, np.newaxis]
            numbers = np.arange(first, self._next_number, dtype=np.uint64)
            device_time_ns = np.full(len(values), host_time_ns, dtype=np.int64)
            items.append(Samples("/force", numbers, device_time_ns, host_time_ns, values))
            self._last_time_ns = host_time_ns
        return items

    def _unreadable(self, line: bytes, host_time_ns: int) -> list[Item]:
        """Event for the first of consecutive lines that are garbled, or have another unit."""
        was_readable, self._is_readable = self._is_readable, False
        found = line.rstrip(b"\r\n").decode("ascii", "backslashreplace")[:SHOWN]
        text = (
            f'{self.name} sent the line "{found}", expected one like "{self._example}"; set the indicator to '
            f"{self._example.split()[1]}, or correct load_cell.line_format and load_cell.baud_rate"
        )
        return [Event("unreadable_line", text, host_time_ns, self.name)] if was_readable else []


def _identity_of_port(name: str, port: str) -> DeviceIdentity:
    """Identity of the port's USB adapter, from the operating system; other ports have none."""
    from serial.tools import list_ports

    ports: Any = list_ports
    found = next((info for info in ports.comports() if info.device == port and info.vid is not None), None)
    if found is None:
        return DeviceIdentity(name, "", None)
    number = f"serial number {found.serial_number}" if found.serial_number else ""
    parts = (found.manufacturer or "", found.product or "", number)
    return DeviceIdentity(name, " ".join(part for part in parts if part), is_simulated=False)


def _tcp_port(port: Any) -> int:
    """The local port behind socket://; 0 for a serial line."""
    if not port.portstr.startswith("socket://"):
        return 0
    connection = socket.socket(fileno=port.fileno())
    try:
        return int(connection.getsockname()[1])
    finally:
        connection.detach()  # pyserial closes it
