"""Markers from Qualisys Track Manager: labelled 3D with residuals, every frame, through qtm_rt over TCP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from drivers.capture_note import CaptureNote
from drivers.device import HostClock, Received
from drivers.errors import DeviceLost
from drivers.qualisys_conversation import Conversation, Wishes
from recordings.samples import DeviceIdentity, Item, Stream


class Qualisys:
    """Streams /markers in mm; sample numbers are QTM's frame numbers, device time is its time stamp.

    wanted_labels must be in QTM and come first; all others follow. control "start" takes control of QTM, so that a
    capture can be started and stopped from here; QTM saves it in its project when the device closes. One that a killed
    station left there, by its note, is ended and saved at opening; any other is left alone, and opening refused. Where
    QTM numbers its frames anew (a capture after a preview), an event "numbering_restarted" says so.
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
        capture_note: CaptureNote | None = None,
        timeout_scale: float = 1.0,
    ) -> None:
        wanted = tuple(dict.fromkeys(wanted_labels))
        note = capture_note or CaptureNote(None, host_clock)
        self._wishes = Wishes(
            f"QTM {host}:{port}", host, port, host_clock, control == "start", password, wanted, note, timeout_scale
        )
        self._conversation: Conversation | None = None

    @property
    def name(self) -> str:
        return self._wishes.name

    @property
    def received(self) -> Received | None:
        return self._conversation.received if self._conversation else None

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._conversation.streams if self._conversation else ()

    @property
    def identity(self) -> DeviceIdentity:
        return self._conversation.identity if self._conversation else DeviceIdentity(self.name, "", None)

    def open(self) -> None:
        self.close()
        conversation = Conversation(self._wishes)
        conversation.begin()
        self._conversation = conversation

    def resume(self) -> None:
        past = self._opened("resume")
        past.end(is_lost=True)
        conversation = Conversation(self._wishes, past)
        conversation.begin()
        self._conversation = conversation

    def read(self, timeout_s: float) -> Sequence[Item]:
        return self._opened("read").take(timeout_s)

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

    def _opened(self, what: str) -> Conversation:
        conversation = self._conversation  # close() may come from the daemon's watchdog meanwhile
        if conversation is None:
            raise DeviceLost(f"{self.name} was asked to {what} and is closed; open it first")
        return conversation
