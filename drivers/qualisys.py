"""Markers from Qualisys Track Manager: labelled 3D with residuals, every frame, through qtm_rt over TCP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from drivers.device import HostClock, Received
from drivers.errors import DeviceCode, DeviceLost
from drivers.qualisys_connection import QtmConnection
from drivers.qualisys_settings import BLOCK_S, CaptureNote, QtmSettings
from recordings.samples import DeviceIdentity, Item, Stream


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
        wanted = tuple(dict.fromkeys(wanted_labels))
        note = capture_note or CaptureNote(None, host_clock)
        self._settings = QtmSettings(
            f"QTM {host}:{port}",
            host,
            port,
            host_clock,
            control == "start",
            password,
            wanted,
            note,
            timeout_scale,
            block_s,
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
        connection = QtmConnection(self._settings)
        connection.begin()
        self._connection = connection

    def resume(self) -> None:
        past = self._opened("resume")
        past.end(is_lost=True)
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
